#!/usr/bin/env bash
# Makes docs/gaussians.jpg: a file of trained splats by every profile: whole, near, and drawn 8 times smaller (enlarged
# again, without filtering). Needs a build in build/release and ImageMagick.
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
