#!/usr/bin/env bash
# Prints the table of docs/reliability.md, section "Adversarial geometry". Needs a build in
# build/release, and a machine that does nothing else for some minutes. Exits with 1 where a run takes more than it may.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bin=build/release/bin
good=0
echo '| command | surfels | sphere | longest | memory | `all-huge` | refused |'
echo '|---|---|---|---|---|---|---|'
for command in surfel-convert surfel-info surfel-render surfel-estimate surfel-from-mesh; do
  "$bin/adversarial_table" "$bin" 10000 "$command" || good=1
done
for command in surfel-group surfel-texture surfel-lod surfel-simplify; do
  "$bin/adversarial_table" "$bin" 20000 "$command" || good=1
done
exit "$good"
