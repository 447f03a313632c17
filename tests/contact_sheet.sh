#!/usr/bin/env bash
# Makes docs/contact-sheet.jpg again: every mesh of the test data from its file as it came to pictures,
# whole, near, far and from a grazing side. Usage: tests/contact_sheet.sh [folder of the tools] [output]
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
tools=${1:-$root/build/release/bin}
output=${2:-$root/docs/contact-sheet.jpg}
data=${SURFEL_TEST_DATA:-$root/../shared/data}
command -v oiiotool >/dev/null || { echo "oiiotool is missing: apt-get install openimageio-tools" >&2; exit 1; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
tiles=()

# sheet_row NAME MESH UP FROM SIDE [surfel-texture options...]: four pictures of one mesh.
sheet_row() {
  local name=$1 mesh=$2 up=$3 from=$4 side=$5
  shift 5
  local surfels=$work/$name.ply shading=phong
  "$tools/surfel-from-mesh" "$mesh" --count 400000 --seed 1 -o "$surfels" --quiet
  if [ $# -gt 0 ]; then
    "$tools/surfel-texture" "$surfels" "$@" -o "$work/$name-textured.ply" --quiet
    surfels=$work/$name-textured.ply
  fi
  local view
  for view in "whole --from=$from" "near --from=$from --zoom 6" "far --from=$from --zoom 0.2" "side --from=$side"; do
    local label=${view%% *} options=${view#* }
    # shellcheck disable=SC2086  # the options are words
    "$tools/surfel-render" "$surfels" -o "$work/$name-$label.png" $options --up="$up" --size 256x256 \
      --cull none --shading "$shading" --background 0.6,0.6,0.65,1 --quiet
    tiles+=("$work/$name-$label.png")
  done
  echo "$name"
}

t=$data/textured
sheet_row spot "$t/spot/spot_triangulated.obj" 0,1,0 0.5,0.3,-1 -1,0.05,-0.1 \
  --mesh "$t/spot/spot_triangulated.obj" --image "$t/spot/spot_texture.png"
sheet_row head "$t/head_scan/lee_perry_smith.obj" 0,1,0 0.3,0.1,1 1,0.05,0.1 \
  --mesh "$t/head_scan/lee_perry_smith.obj" --image "$t/head_scan/lee_perry_smith_color.png"
sheet_row scissors "$t/scissors/scissors.obj" 0,1,0 0.1,-0.2,1 0.1,-1,0.15 \
  --mesh "$t/scissors/scissors.obj" --image "$t/scissors/scissors_texture.png"
m=$data/meshes
sheet_row bunny "$m/stanford_bunny.obj" 0,1,0 0,0.2,1 1,0.05,0.1
sheet_row dragon "$m/dragon_vrip_res2.ply" 0,1,0 0,0.2,1 1,0.05,0.1
sheet_row armadillo "$m/armadillo.ply" 0,1,0 0,0.2,1 1,0.05,0.1
sheet_row fandisk "$m/fandisk.obj" 0,1,0 -0.7,0.5,-1 -1,0.05,-0.1
sheet_row brain "$m/brain_tristrips.ply" 0,0,1 0.3,-1,0.4 1,0.05,0.1
sheet_row mri_head "$m/mri_head_surface.ply" 0,-1,0 -1,-0.1,0.5 0.1,-0.05,1

mkdir -p "$(dirname "$output")"
oiiotool --nosoftwareattrib "${tiles[@]}" --mosaic:pad=2 "4x$((${#tiles[@]} / 4))" --compression jpeg:85 -o "$work/sheet.jpg"
mv "$work/sheet.jpg" "$output"
echo "$output"
