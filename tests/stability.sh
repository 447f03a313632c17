#!/usr/bin/env bash
# Makes docs/stability.md, the places where methods fail, and docs/stability.png, some of them as
# pictures. Needs a build in build/release. Takes some minutes.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bin=build/release/bin
out=${1:-docs/stability.md}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# What is worse than published, or beyond its bound, is said and marked in the table.
"$bin/stability_table" > "$work/table.md" || echo "see the rows above" >&2

# Every input can be made as written.
sed -n 's/^|[^|]*| `\([a-z0-9.:e+-]*\)`.*/\1/p' "$work/table.md" | sort -u | while read -r input; do
  "$bin/surfel-generate" --case "$input" --quiet -o "$work/input.ply"
done

# CASE NAME OPTIONS...: that case seen as surfel-generate says, with the options.
picture() {
  local input=$1 name=$2
  shift 2
  "$bin/surfel-generate" --case "$input" --quiet --stats "$work/case.json" -o "$work/case.ply"
  local view
  view=$(sed -n 's/^ *"view": "\(.*\) --size .*/\1/p' "$work/case.json")
  # shellcheck disable=SC2086
  "$bin/surfel-render" "$work/case.ply" $view --size 192x144 --shading none --quiet --background 1,1,1,1 \
    "$@" -o "$work/$name.png"
}
pictures=()
for input in near-plane:0.02 inside:0.02; do
  name=${input%:*}
  picture "$input" "$name-published" --kernel affine
  picture "$input" "$name-ours"
  picture "$input" "$name-truth" --reference --samples 4
  pictures+=("$work/$name"-{published,ours,truth}.png)
done
picture flicker:64 flicker-published --filter none
picture flicker:64 flicker-ours
picture flicker:64 flicker-truth --reference --samples 4
pictures+=("$work"/flicker-{published,ours,truth}.png)
oiiotool --nosoftwareattrib "${pictures[@]}" --mosaic:pad=4 3x3 -o "$(dirname "$out")/stability.png"

{
  echo "# Stability: where methods fail"
  echo
  cat <<'TEXT'
Each row has a place where rendering or estimating points is hard: an input that shows it, a measure, the published method and its figure,
Surfelkit's and its figure, the bound that a test holds it to, and the reason. SS01 is *Surface Splatting* (Zwicker et al. 2001), SP06
*Single-Pass Point Rendering and Transparent Shading* (Zhang, Pajarola 2006).

TEXT
  echo "Made by \`tests/stability.sh\`; at reduced size the same measurements are the tests in \`tests/stability/\`."
  echo
  cat "$work/table.md"
  cat tests/stability_notes.md
} > "$out"
