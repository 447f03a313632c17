#!/usr/bin/env bash
# Makes the files that fuzzers begin with: small ones of every format, and those that once were findings.
#   tests/fuzz/make_corpus.sh FOLDER TOOLS     a folder of FOLDER for each fuzzer; TOOLS: the folder of the tools
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
rm -rf "$1"
mkdir -p "$1"
cd "$1"
PATH=$2:$PATH
export ASAN_OPTIONS=${ASAN_OPTIONS:-}:detect_leaks=0
mkdir cloud_ply cloud_pcd cloud_text mesh_ply mesh_obj mesh_stl mesh_off image_png image_exr scene camera material options \
  polygon estimate render

surfel-generate sphere --count 20 -o cloud_ply/binary.ply --quiet
surfel-convert cloud_ply/binary.ply -o cloud_ply/text.ply --ascii --quiet
surfel-convert cloud_ply/binary.ply -o cloud_pcd/binary.pcd --quiet
printf 'VERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH 2\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA ascii\n0 0 0 255\n1 nan 2 65280\n' > cloud_pcd/text.pcd
surfel-generate sphere --count 600 -o levels.ply --quiet
surfel-lod levels.ply -o cloud_ply/levels.ply --quiet
rm levels.ply
printf '0 0 0\n1 0 0.5\n0 1 0\n' > cloud_text/plain.xyz
printf 'x,y,z,r,g,b\n0,0,0,255,0,0\n1,2,3,0,255,0\n' > cloud_text/names.xyz
printf '2\n0 0 0 10 1 2 3\n1 1 1 20 4 5 6\n' > cloud_text/count.xyz

quad='1 2 3 4'
printf 'v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvn 0 0 1\nvt 0 0\nf %s\nf -4 -3 -2\nf 1/1/1 2/1/1 3/1/1\n' "$quad" > mesh_obj/quad.obj
printf 'mtllib none.mtl\nv 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nusemtl a\nf 1 2 3\n' > mesh_obj/colours.obj
printf 'OFF\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n' > mesh_off/quad.off
printf 'COFF # comment\n3 1 0\n0 0 0 255 0 0 255\n1 0 0 0 255 0 255\n0 1 0 0 0 255 255\n3 0 1 2\n' > mesh_off/colours.off
printf 'solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid a\n' > mesh_stl/text.stl
{
  head -c 80 /dev/zero
  printf '\x01\0\0\0'
  head -c 50 /dev/zero
} > mesh_stl/binary.stl
printf 'ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n' > mesh_ply/text.ply
{
  printf 'ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar uint vertex_index\nproperty list uchar float texcoord\nend_header\n'
  head -c 36 /dev/zero
  printf '\x03\0\0\0\0\x01\0\0\0\x02\0\0\0\x06'
  head -c 24 /dev/zero
} > mesh_ply/binary.ply

surfel-render cloud_ply/binary.ply -o image_png/8.png --size 9x7 --quiet
surfel-render cloud_ply/binary.ply -o image_exr/plain.exr --size 9x7 --quiet
printf 'ambient = [0.2, 0.2, 0.2]\nrefraction = "multi"\n[sky]\nup = [0, 1, 0]\n[[light]]\ntype = "point"\nposition = [1, 2, 3]\ncolor = [1, 1, 1]\n[[material]]\nname = "glass"\nior = 1.5\n' > scene/scene.toml
printf '[[camera]]\neye = [0, 0, 3]\ntarget = [0, 0, 0]\nfov = 30\nwidth = 64\nheight = 48\n[[camera]]\northo = 2.0\n' > camera/cameras.toml
printf 'newmtl a\nKd 0.5 0.5 0.5\nmap_Kd -s 1 1 1 none.png\nbump -bm 0.1 none.png\nnewmtl b\nd 0.5\n' > material/two.mtl
printf '1,2,3' > options/numbers
printf '640x480' > options/size
printf '#ff8800cc' > options/color
printf 'number = 1.5\nword = "text"\nflag = true\n' > options/config
for name in polygon estimate render; do
  head -c 400 "$here/make_corpus.sh" > "$name/text"
  printf '\0\x20\x10\x10\x70\x10\x70\x70\x10\x70\x20\x30\x40\x50' > "$name/few"
done

for found in "$here"/found/*/; do
  [ -d "$found" ] && cp -r "$found." "$1/$(basename "$found")/"
done
exit 0
