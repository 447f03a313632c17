#!/usr/bin/env bash
# Makes docs/scans.jpg again: every scan of the test data from its file as it came to a picture.
# Usage: tests/scan_sheet.sh [folder of the tools] [output]
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
tools=${1:-$root/build/release/bin}
output=${2:-$root/docs/scans.jpg}
data=${SURFEL_TEST_DATA:-$root/../shared/data}
command -v oiiotool >/dev/null || { echo "oiiotool is missing: apt-get install openimageio-tools" >&2; exit 1; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
tiles=()

# scan FILE ORIENTATION FROM UP
scan() {
  local name=${1##*/}
  # shellcheck disable=SC2086  # the orientation may hold several words
  "$tools/surfel-estimate" "$data/$1" --orient $2 -o "$work/$name.ply" --quiet
  "$tools/surfel-render" "$work/$name.ply" -o "$work/$name.png" --from="$3" --up="$4" --size 340x340 \
    --background 0.6,0.6,0.65,1 --shading phong --quiet
  tiles+=("$work/$name.png")
}

scan colour_clouds/fragment_normals_rgb.pcd align 0,-1,-0.6 0,-1,0
scan colour_clouds/lion_takanawa_third.ply align -1,1,0.3 0,0,1
scan colour_clouds/milk_color.pcd "viewpoint --viewpoint 0,0,0" 0,0,-1 0,-1,0
scan colour_clouds/table_scene_mug_stereo.pcd viewpoint 0,-0.3,-1 0,-1,0
scan raw_scans/bun0.pcd outward 0,0.2,1 0,1,0
scan raw_scans/bun000_range_grid.ply "viewpoint --viewpoint 0,0.1,1" 0,0,1 0,1,0
scan lidar/samp11-utm.pcd up 0.3,-1,0.8 0,0,1
scan raw_scans/kitten.xyz outward 0.3,0.2,1 0,1,0
scan raw_scans/oni.xyz align 0.3,0.2,1 0,1,0
oiiotool --nosoftwareattrib "${tiles[@]}" --mosaic:pad=4 3x3 --compression jpeg:88 -o "$output"
echo "$output"
