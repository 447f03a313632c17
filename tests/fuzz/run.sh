#!/usr/bin/env bash
# Builds the fuzzers and runs each of them, one after the other, for a while; tells how many inputs each has tried and
# how many edges of the library they cover. Inputs that end a fuzzer are in build/fuzz/findings: mend the cause, then keep
# the input in tests/fuzz/found/FUZZER.
#   tests/fuzz/run.sh MINUTES [FUZZER]...
#   tests/fuzz/run.sh keep [FUZZER]...    Adds to tests/fuzz/corpus what covers more than that does, short inputs first.
set -euo pipefail
minutes=${1:?how many minutes each fuzzer runs}
shift
source "$(dirname "${BASH_SOURCE[0]}")/../support/setup.sh"
surfel_install_packages "${surfel_packages[@]}"
surfel_build fuzz fuzzer
build=$surfel_root/build/fuzz
here=$surfel_root/tests/fuzz
if [ $# -eq 0 ]; then
  for folder in "$here"/corpus/*/; do set -- "$@" "$(basename "$folder")"; done
fi
# Some write files.
if [ -w /dev/shm ]; then export TMPDIR=/dev/shm; fi
failed=0
for name in "$@"; do
  export SURFEL_FUZZER=$name
  findings=$build/findings/$name
  corpus=$build/corpus/$name
  mkdir -p "$findings" "$corpus"
  if [ "$minutes" = keep ]; then
    "$build/tests/fuzzer" -merge=1 -use_counters=0 -max_len=1024 "$here/corpus/$name" "$corpus" > "$findings.log" 2>&1
    continue
  fi
  # Where bytes are numbers, few of them cover as much as many do, in less time.
  case $name in written) most=96 ;; names | settings) most=128 ;; estimate | requests) most=256 ;; gaussians | render) most=512 ;; cloud_la[sz]) most=8192 ;; *) most=1024 ;; esac
  options=(-max_total_time=$((60 * minutes)) -timeout=10 -rss_limit_mb=2048 -max_len=$most -entropic=0 -print_final_stats=1)
  if [ -f "$here/dictionaries/$name.txt" ]; then options+=(-dict="$here/dictionaries/$name.txt"); fi
  folders=("$corpus" "$here/corpus/$name")
  # The twins that LASzip has written.
  case $name in cloud_la[sz]) folders+=("$surfel_root/tests/laz/laszip") ;; esac
  if [ -d "$here/found/$name" ]; then folders+=("$here/found/$name"); fi
  status=0
  "$build/tests/fuzzer" "${options[@]}" -artifact_prefix="$findings/" "${folders[@]}" > "$findings.log" 2>&1 || status=$?
  tried=$(sed -n 's/^stat::number_of_executed_units: *//p' "$findings.log")
  edges=$(sed -n 's/.* cov: \([0-9]*\) .*/\1/p' "$findings.log" | tail -n 1)
  result="no finding"
  if [ $status -ne 0 ]; then
    result="FINDING, see $findings.log"
    failed=1
  fi
  echo "$name: ${tried:-?} inputs, ${edges:-?} edges, $result"
done
exit $failed
