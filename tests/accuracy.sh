#!/usr/bin/env bash
# Makes docs/accuracy.md: the fast renderer against the reference, the reference against itself.
# Needs the real data and a build with -DSURFEL_BUILD_BENCH=ON in build/release. Takes minutes.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
data=${SURFEL_TEST_DATA:-../shared/data}
bin=build/release/bin
out=${1:-docs/accuracy.md}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# Surfels for the three distances: the picture shows as many as it can hold at that spacing.
spot() {
  "$bin/surfel-from-mesh" "$data/textured/spot/spot_triangulated.obj" --count "$1" --quiet -o - |
    "$bin/surfel-texture" - --image "$data/textured/spot/spot_texture.png" --quiet -o "$work/$1.ply"
}
spot 2000
spot 40000
spot 200000
"$bin/accuracy_table" "$work/2000.ply" "$work/40000.ply" "$work/200000.ply" > "$work/table.md"
{
  echo "# Accuracy: measured"
  echo
  echo "Made by \`tests/accuracy.sh\`."
  cat "$work/table.md" tests/accuracy_notes.md
} > "$out"
