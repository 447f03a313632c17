#!/usr/bin/env bash
# Makes docs/accuracy.md: the fast renderer against the reference, the reference against itself; and
# docs/filters.png: SS01 figure 8.
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
  "$bin/surfel-from-mesh" "$data/textured/spot/spot_triangulated.obj" --count "$1" --variance-scale 1 --quiet -o - |
    "$bin/surfel-texture" - --image "$data/textured/spot/spot_texture.png" --quiet -o "$work/$1.ply"
}
spot 2000
spot 40000
spot 200000
"$bin/accuracy_table" "$work/2000.ply" "$work/40000.ply" "$work/200000.ply" > "$work/table.md"
# SS01 figure 8: a checker on a regular grid, magnified in front, minified at the horizon.
view=(--eye 0,-0.52,0.05 --target 0,0.1,-0.06 --up 0,0,1 --fov 30 --size 256x192 --shading none --quiet)
"$bin/surfel-generate" plane --jitter 0 --count 40000 --quiet -o - |
  "$bin/surfel-texture" - --image checker:50 --quiet -o "$work/plane.ply"
filters=(ewa ewa-source circular none)
for filter in "${filters[@]}"; do
  "$bin/surfel-render" "$work/plane.ply" -o "$work/$filter.exr" --filter "$filter" "${view[@]}"
  "$bin/surfel-render" "$work/plane.ply" -o "$work/$filter.png" --filter "$filter" "${view[@]}" --background 1,1,1,1
done
"$bin/surfel-render" "$work/plane.ply" -o "$work/reference.exr" --reference "${view[@]}"
"$bin/surfel-render" "$work/plane.ply" -o "$work/reference.png" --reference "${view[@]}" --background 1,1,1,1
oiiotool --nosoftwareattrib "$work"/{ewa,circular,none,reference}.png --mosaic:pad=4 2x2 -o "$(dirname "$out")/filters.png"
psnr() { "$bin/surfel-compare" "$1" "$2" --inside --json | sed -n 's/.*"psnr": \([0-9]*\.\{0,1\}[0-9]\{0,1\}\)[0-9]*.*/\1/p' | head -1; }

{
  echo "# Accuracy"
  echo
  cat <<'TEXT'
How far pictures of `surfel-render` are from the truth: `--reference`, which casts rays at the same surfels, in double precision and with a
Gaussian pixel filter. `--kernel affine` is the kernel of *Surface Splatting* (Zwicker et al. 2001, "SS01"), `perspective` one that is exact on
large splats, `auto` (the default) takes either by the size of a splat; `ewa-source`, `circular` and `none` are filters to compare with.

TEXT
  echo "Made by \`tests/accuracy.sh\`."
  cat "$work/table.md"
  echo
  echo "## Filters (SS01 figure 8)"
  echo
  echo "![ewa, circular; none, the reference](filters.png)"
  echo
  echo "A checker on a regular grid, magnified in front, minified at the horizon: ewa, circular (top), none, the reference"
  echo "(bottom). PSNR inside the silhouette against the reference, dB:"
  for filter in "${filters[@]}"; do echo "$filter $(psnr "$work/$filter.exr" "$work/reference.exr");"; done
  echo "ewa against ewa-source $(psnr "$work/ewa.exr" "$work/ewa-source.exr")."
  cat tests/accuracy_notes.md
} > "$out"
