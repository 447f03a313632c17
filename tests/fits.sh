#!/usr/bin/env bash
# Makes docs/texture.md and docs/fits.png: the fits of surfel-texture beside each other, against the
# ray-traced textured mesh. Needs the real data. Takes minutes.
# Usage: tests/fits.sh [folder of the tools] [output]
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
tools=${1:-$root/build/release/bin}
out=${2:-$root/docs/texture.md}
data=${SURFEL_TEST_DATA:-$root/../shared/data}
command -v oiiotool >/dev/null || { echo "oiiotool is missing: apt-get install openimageio-tools" >&2; exit 1; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
fits=(ewa gram render)

# number KEY < JSON
number() { sed -n "s/.*\"$1\": \\(-\\{0,1\\}[0-9.e+-]*\\).*/\\1/p" | head -1; }

# table NAME MESH IMAGE FROM: rows of PSNR and seconds for several numbers of surfels and cutoffs.
table() {
  local view=(--from "$4" --size 400x400 --shading none --quiet)
  for count in 5000 20000 100000; do
    "$tools/surfel-from-mesh" "$2" --count "$count" -o "$work/s.ply" --quiet
    "$tools/surfel-render" "$work/s.ply" --mesh "$2" --image "$3" -o "$work/truth.exr" "${view[@]}"
    for cutoff in 1 2; do
      local row="| $1 | $count | $cutoff |"
      for fit in "${fits[@]}"; do
        "$tools/surfel-texture" "$work/s.ply" --mesh "$2" --image "$3" --fit "$fit" --cutoff "$cutoff" \
          -o "$work/t.ply" --stats "$work/t.json" --quiet
        "$tools/surfel-render" "$work/t.ply" -o "$work/t.exr" --cutoff "$cutoff" "${view[@]}"
        row+=$(printf ' %.1f dB, %.1f s |' \
          "$("$tools/surfel-compare" "$work/t.exr" "$work/truth.exr" --inside --json | number psnr)" \
          "$(number total_ms < "$work/t.json" | awk '{print $1 / 1000}')")
      done
      echo "$row"
    done
  done
}

# A magnified checker.
"$tools/surfel-generate" plane --count 40000 -o "$work/plane.ply" --quiet
for fit in "${fits[@]}"; do
  "$tools/surfel-texture" "$work/plane.ply" --image checker:20 --fit "$fit" -o "$work/$fit.ply" --quiet
  "$tools/surfel-render" "$work/$fit.ply" -o "$work/$fit.png" --shading none --eye 0.1,0.1,0.5 --target 0.1,0.1,0 \
    --size 300x300 --quiet
done
oiiotool "$work"/{ewa,gram,render}.png --mosaic:pad=4 3x1 -o "$(dirname "$out")/fits.png"

{
  cat <<'TEXT'
# Texture fits: measured

Made by `tests/fits.sh`. PSNR of sRGB values inside the silhouette, 400 x 400 pixels, of the rendered surfels against the ray-traced
textured mesh (`surfel-render --mesh`); whole time of `surfel-texture` with 2 threads. Surfels of `surfel-from-mesh`, sigma = spacing.

![A magnified checker: ewa, gram, render](fits.png)

| mesh | surfels | c | ewa | gram | render |
|---|---|---|---|---|---|
TEXT
  table spot "$data/textured/spot/spot_triangulated.obj" "$data/textured/spot/spot_texture.png" 0.6,0.3,-1
  cat "$root/tests/fits_notes.md"
} > "$out"
