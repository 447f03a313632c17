#!/usr/bin/env bash
# Makes docs/gaussians.jpg: a file of trained splats by every profile: whole, near, and drawn 8 times smaller (enlarged
# again, without filtering); and docs/gaussians_mesh.jpg: a mesh as surfels and exported as splats. Needs a build in
# build/release and ImageMagick.
#
# Usage: tests/gaussians.sh FILE   (table.splat of the test data)
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
file=$1
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
profiles=(inria gsplat mip 2dgs exact)
# draw NAME PROFILE OPTION...
draw() {
  build/release/bin/surfel-render "$file" -o "$work/$1-$2.png" --profile "$2" --from 0.3,-0.4,-1 --up=-y --background white --quiet "${@:3}"
}
columns=()
for profile in "${profiles[@]}"; do
  draw whole "$profile" --size 320x240
  draw near "$profile" --size 320x240 --zoom 6
  draw small "$profile" --size 80x60
  convert "$work/small-$profile.png" -filter point -resize 400% "$work/small-$profile.png"
  convert "$work"/{whole,near,small}-"$profile".png -gravity NorthWest -fill black -pointsize 16 -append \
    -annotate +6+4 "$profile" "$work/$profile.png"
  columns+=("$work/$profile.png")
done
convert "${columns[@]}" +append -quality 88 docs/gaussians.jpg

bin=build/release/bin
$bin/surfel-from-mesh samples/spot.obj --count 100000 -o "$work/spot.ply" --quiet
$bin/surfel-texture "$work/spot.ply" --mesh samples/spot.obj --image samples/spot.png -o "$work/spot_t.ply" --quiet
$bin/surfel-convert "$work/spot_t.ply" -o "$work/spot.splat" --quiet
# spot FILE NAME TEXT OPTION...
spot() {
  $bin/surfel-render "$1" -o "$work/$2.png" --size 320x320 --background white --eye=1.6,1,-2.4 --target 0,0.1,0 --up y --quiet "${@:4}"
  convert "$work/$2.png" -gravity NorthWest -fill black -pointsize 16 -annotate +6+4 "$3" "$work/$2.png"
}
spot "$work/spot_t.ply" surfels surfels --shading none
spot "$work/spot.splat" exported ".splat, inria" --profile inria
spot "$work/spot.splat" exact ".splat, exact" --profile exact --samples 2
convert "$work"/{surfels,exported,exact}.png +append -quality 88 docs/gaussians_mesh.jpg
