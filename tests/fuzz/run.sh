#!/usr/bin/env bash
# Builds the fuzzers and runs each of them for a while; tells how many inputs each has tried. Inputs that end a fuzzer
# are in build/fuzz/findings: mend the cause, then keep the input in tests/fuzz/found/FUZZER.
#   tests/fuzz/run.sh MINUTES [FUZZER]...
set -euo pipefail
minutes=${1:?how many minutes each fuzzer runs}
shift
source "$(dirname "${BASH_SOURCE[0]}")/../support/setup.sh"
surfel_install_packages "${surfel_packages[@]}"
surfel_build fuzz fuzzers
build=$surfel_root/build/fuzz
if [ $# -eq 0 ]; then
  for fuzzer in "$build"/fuzz/fuzz_*; do set -- "$@" "$(basename "${fuzzer#*fuzz_}")"; done
fi
corpus=$build/corpus
[ -d "$corpus" ] || "$surfel_root/tests/fuzz/make_corpus.sh" "$corpus" "$build/bin"
failed=0
for name in "$@"; do
  name=${name#fuzz_}
  mkdir -p "$build/findings/$name"
  status=0
  "$build/fuzz/fuzz_$name" -max_total_time=$((60 * minutes)) -timeout=10 -rss_limit_mb=1024 -max_len=4096 -print_final_stats=1 \
    -artifact_prefix="$build/findings/$name/" "$corpus/$name" > "$build/findings/$name.log" 2>&1 || status=$?
  tried=$(sed -n 's/^stat::number_of_executed_units: *//p' "$build/findings/$name.log")
  echo "$name: ${tried:-?} inputs, $([ $status -eq 0 ] && echo "no finding" || echo "FINDING, see $build/findings/$name.log")"
  [ $status -eq 0 ] || failed=1
done
exit $failed
