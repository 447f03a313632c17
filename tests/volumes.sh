#!/usr/bin/env bash
# Prints the table of docs/volumes.md and makes docs/volumes.jpg: a phantom of a head as Gaussians, and as rays see it.
# Needs a build with SURFEL_BUILD_BENCH in build/release and ImageMagick.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
build/release/bin/volume_table "$work"
for name in ct ct-bone; do
  for way in gaussians rays; do
    convert "$work/$name-$way.png" -gravity NorthWest -fill white -pointsize 16 -annotate +6+4 "--transfer $name: $way" "$work/$name-$way.png"
  done
done
convert "$work"/ct-{gaussians,rays}.png "$work"/ct-bone-{gaussians,rays}.png +append -quality 88 docs/volumes.jpg
