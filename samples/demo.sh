#!/usr/bin/env bash
# The main job on the samples: a textured mesh, and raw points, to surfels to antialiased pictures. Installs on a
# fresh Debian 12 what building needs, and builds.
#   samples/demo.sh [FOLDER]     FOLDER for the results; default: out/ in the project
set -euo pipefail
output=$(realpath -m "${1:-$(dirname "${BASH_SOURCE[0]}")/../out}")
source "$(dirname "${BASH_SOURCE[0]}")/../tests/support/setup.sh"
surfel_install_packages "${surfel_demo_packages[@]}"
surfel_build demo
PATH=$surfel_root/build/demo/bin:$PATH
samples=$surfel_root/samples
mkdir -p "$output"
cd "$output"

show() { echo "+ $*"; "$@"; }

show surfel-from-mesh "$samples/lee_perry_smith.obj" --spacing 0.02 -o head.ply
show surfel-texture head.ply --mesh "$samples/lee_perry_smith.obj" -o head_t.ply
show surfel-info head_t.ply
show surfel-render head_t.ply -o head.png --size 512x512 --cutoff 2
show surfel-render head_t.ply -o head_texture.png --size 512x512 --shading none
show surfel-render head_t.ply -o head_far.png --size 64x64
show surfel-render head_t.ply -o 'head_turn_%04d.png' --size 256x256 --turntable 8
show surfel-render "$samples/milk.ply" -o milk.png --size 512x512

echo
echo "The pictures are in $output:"
ls -1 -- *.png
