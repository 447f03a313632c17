#!/usr/bin/env bash
# The main job on the samples: a textured mesh to surfels to antialiased pictures. Installs on a
# fresh Debian 12 what building needs, and builds.
#   samples/demo.sh [FOLDER]     FOLDER for the results; default: out/ in the project
set -euo pipefail
output=$(realpath -m "${1:-$(dirname "${BASH_SOURCE[0]}")/../out}")
source "$(dirname "${BASH_SOURCE[0]}")/../tests/support/setup.sh"
surfel_install_packages "${surfel_demo_packages[@]}"
surfel_build demo surfel-from-mesh surfel-texture surfel-info surfel-render
PATH=$surfel_root/build/demo/bin:$PATH
samples=$surfel_root/samples
mkdir -p "$output"
cd "$output"

show() { echo "+ $*"; "$@"; }

show surfel-from-mesh "$samples/head.obj" --spacing 0.01 -o head.ply
show surfel-texture head.ply --image "$samples/head.png" --mesh "$samples/head.obj" -o head_t.ply
show surfel-info head_t.ply
show surfel-render head_t.ply -o head.png --from 0,0.36,1 --size 512x512 --cutoff 2
show surfel-render head_t.ply -o head_texture.png --from 0,0.36,1 --size 512x512 --shading none
show surfel-render head_t.ply -o head_far.png --from 0,0.36,1 --size 64x64
show surfel-render head_t.ply -o 'head_turn_%04d.png' --from 0,0.36,1 --size 256x256 --turntable 8

echo
echo "The pictures are in $output:"
ls -1 -- *.png
