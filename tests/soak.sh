#!/usr/bin/env bash
# Runs all tools, and beside them the library in one process, on inputs that change from round to round,
# and prints the tables of docs/reliability.md, section "Soak". Fails where a run ends in an unexpected
# way or leaves files behind, or where memory grows. Needs a build in build/release.
#   tests/soak.sh MINUTES [SEED]
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bin=build/release/bin
minutes=${1:?minutes}
seed=${2:-1}
table=$(mktemp)
trap 'rm -f "$table"' EXIT
"$bin/soak" library "$minutes" "$seed" > "$table" &
library=$!
good=0
"$bin/soak" "$bin" "$minutes" "$seed" || good=1
wait "$library" || good=1
echo
cat "$table"
exit "$good"
