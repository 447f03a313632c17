#!/usr/bin/env bash
# Makes the files that fuzzers begin with, small ones of every format; tests/fuzz/corpus holds them and what the fuzzers
# found since.
#   tests/fuzz/make_corpus.sh FOLDER TOOLS     a folder of FOLDER for each fuzzer; TOOLS: the folder of the tools
set -euo pipefail
script=$(realpath "$0")
tools=$(realpath "$2")
PATH=$tools:$PATH
mkdir -p "$1"
cd "$1"
mkdir -p cloud_ply cloud_levels cloud_pcd cloud_text cloud_columns cloud_e57 cloud_expe cloud_ptx gaussian_ply gaussian_splat gaussian_spz gaussian_ksplat volume_nrrd volume_mha mesh_ply mesh_obj mesh_stl mesh_off mesh_gltf image_png image_exr scene camera colmap_text colmap_binary views \
  material options polygon estimate gaussians render names requests settings written

surfel-generate sphere --count 6 -o cloud_ply/binary.ply --quiet
surfel-convert cloud_ply/binary.ply -o cloud_ply/text.ply --ascii --quiet
surfel-convert cloud_ply/binary.ply -o cloud_pcd/binary.pcd --quiet
printf 'VERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH 2\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA ascii\n0 0 0 255\n1 nan 2 65280\n' > cloud_pcd/text.pcd
{
  printf 'ply\nformat ascii 1.0\nelement vertex 5\n'
  printf 'property float %s\n' x y z nx ny nz variance
  printf 'property uchar level\nelement surfel_cluster 3\n'
  printf 'property uint %s\n' begin count first_child child_count
  printf 'property uchar level\n'
  printf 'property float %s\n' x y z radius spacing max_deviation cone_x cone_y cone_z cone_cosine min_x min_y min_z max_x max_y max_z
  printf 'end_header\n0 0 0 0 0 1 4 1\n0 0 0 0 0 1 1 0\n1 0 0 0 0 1 1 0\n0 1 0 0 0 1 1 0\n1 1 0 0 0 1 1 0\n'
  printf '0 1 1 2 1 0.5 0.5 0 4 2 2 0 0 1 0.9 -4 -4 -4 4 4 4\n'
  printf '1 2 0 0 0 0.5 0 0 2 1 1 0 0 1 0.9 -4 -4 -4 4 4 4\n3 2 0 0 0 0.5 1 0 2 1 1 0 0 1 0.9 -4 -4 -4 4 4 4\n'
} > cloud_levels/levels.ply
printf 'ply\nformat ascii 1.0\ncomment surfel_up 0 0 1\ncomment surfel_viewpoint 0 0 1 1 0 0 0\ncomment surfel_color recorded\nelement vertex 2\nproperty double x\nproperty double y\nproperty double z\nproperty float nx\nproperty float ny\nproperty float nz\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nproperty float variance_u\nproperty float variance_v\nproperty float tx\nproperty float ty\nproperty float tz\nproperty ushort extra\nelement other 1\nproperty list uchar int indices\nend_header\n1e9 0 0 0 0 1 255 0 0 1 2 1 0 0 7\n1e9 1 2 0 0 1 0 255 9 1 2 0 1 0 8\n2 5 6\n' > cloud_ply/columns.ply
{
  printf 'ply\nformat binary_big_endian 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nproperty float radius\nend_header\n'
  printf '\x3f\x80\0\0\x40\0\0\0\0\0\0\0\x3f\0\0\0'
  printf '\0\0\0\0\x40\0\0\0\xff\xff\xff\xff\x3f\0\0\0'
} > cloud_ply/big.ply
printf 'ply\nformat ascii 1.0\nobj_info num_cols 2\nobj_info num_rows 2\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement range_grid 4\nproperty list uchar int vertex_indices\nend_header\n0 0 1\n1 0 1\n0 1 1\n1 0\n1 1\n1 2\n0\n' > cloud_ply/range.ply
surfel-convert cloud_ply/columns.ply -o cloud_pcd/columns.pcd --quiet
printf 'VERSION 0.7\nFIELDS x y z normal_x normal_y normal_z curvature\nSIZE 8 8 8 4 4 4 2\nTYPE F F F F F F I\nCOUNT 1 1 1 1 1 1 2\nWIDTH 2\nHEIGHT 2\nVIEWPOINT 1 2 3 1 0 0 0\nPOINTS 4\nDATA ascii\n0 0 0 0 0 1 1 2\n1 0 0 0 0 1 1 2\n0 1 0 0 0 1 1 2\n1 1 nan 0 0 1 1 2\n' > cloud_pcd/organised.pcd
printf '0 0 0\n1 0 0.5\n0 1 0\n' > cloud_text/plain.xyz
printf 'x,y,z,r,g,b\n0,0,0,255,0,0\n1,2,3,0,255,0\n' > cloud_text/names.xyz
printf '2\n0 0 0 10 1 2 3\n1 1 1 20 4 5 6\n' > cloud_text/count.xyz
printf '0,0,0,7,255,0,0\n1,2,3,8,0,255,0\n' > cloud_columns/seven.csv
printf '# colors are linear\na;b;c;d;e;f;g\n1;2;3;4;0.5;0;1\n' > cloud_columns/linear.csv
printf '1,5 2,5 3,5 0 1 2 3\n' > cloud_columns/commas.csv
printf '2\n2\n1 2 3\n0 1 0\n-1 0 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 1 0\n1 2 3 1\n1 0 0 0.5 255 0 0\n0 0 0 0 0 0 0\n1 2 3 1 0 255 0\n4 5 nan 0 1 2 3\n' > cloud_ptx/grid.ptx
printf '1\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n1 2 3 0.5\n1\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n1 2 4 0.5\n' > cloud_ptx/scans.ptx
{
  printf '[Expe/PointSet/Binary/0.1]\nproperty position 12\nproperty radius 4\nproperty normal 12\nproperty color 4\nnofpoints 2\ndata\n'
  printf '\0\0\x80\x3f\0\0\0\x40\0\0\0\0\0\0\0\x3f\0\0\0\0\0\0\0\0\0\0\x80\x3f\xff\x80\0\0'
  printf '\0\0\0\x40\0\0\0\x40\0\0\0\0\0\0\x80\x3f\0\0\0\0\0\0\0\0\0\0\x80\x3f\0\xff\0\0'
} > cloud_expe/two.pts

# number VALUE BYTES: a number of so many bytes, the lowest first.
number() {
  local i
  for ((i = 0; i < $2; ++i)); do printf "\\x$(printf %02x $((($1 >> (8 * i)) & 255)))"; done
}
# e57 PACKET XML: what the pages of an E57 file hold; its points are at byte 48.
e57() {
  local packet=$1 xml=$2
  printf 'ASTM-E57'
  number 1 4
  number 0 4
  number 1024 8
  number $((80 + packet)) 8
  number ${#xml} 8
  number 1024 8
  number 1 8
  number $((32 + packet)) 8
  number 80 8
  number 0 8
  cat
  printf %s "$xml"
}
{
  number 1 2
  number 51 2
  number 7 2
  number 8 2
  number 8 2
  number 8 2
  number 2 2
  number 2 2
  number 2 2
  number 1 2
  printf '\0\0\x80\x3f\0\0\0\x40\0\0\x80\x3f\0\0\0\0\0\0\x80\x3f\0\0\0\x40\xff\0\0\xff\x80\0\x02\0'
} | e57 52 '<e57Root><data3D><v><pose><rotation><w>1</w></rotation><translation><x>5</x></translation></pose><points type="CompressedVector" fileOffset="48" recordCount="2"><prototype><cartesianX type="Float" precision="single"/><cartesianY type="Float" precision="single"/><cartesianZ type="Float" precision="single"/><colorRed type="Integer" minimum="0" maximum="255"/><colorGreen type="Integer" minimum="0" maximum="255"/><colorBlue type="Integer" minimum="0" maximum="255"/><cartesianInvalidState type="Integer" minimum="0" maximum="1"/></prototype></points></v></data3D></e57Root>' > cloud_e57/cartesian.e57
{
  number 1 2
  number 27 2
  number 4 2
  number 2 2
  number 8 2
  number 1 2
  number 2 2
  printf '\x10\x20\0\0\0\0\0\0\x80\x3f\x05\x64\x65\0'
} | e57 28 '<e57Root><data3D><v><points type="CompressedVector" fileOffset="48" recordCount="2"><prototype><sphericalRange type="ScaledInteger" minimum="0" maximum="255" scale="0.1" offset="1"/><sphericalAzimuth type="Float" precision="single"/><sphericalElevation type="Integer" minimum="-1" maximum="1"/><intensity type="Integer" minimum="0" maximum="255"/></prototype></points></v><v><name>a</name><points type="CompressedVector" fileOffset="48" recordCount="1"><prototype><cartesianX type="ScaledInteger" minimum="0" maximum="255"/><cartesianY type="Float" precision="single"/><cartesianZ type="Integer" minimum="0" maximum="3"/><rowIndex type="Integer" minimum="0" maximum="200"/></prototype></points></v></data3D></e57Root>' > cloud_e57/spherical.e57

# Splats: trained PLY, packed PLY, .splat, .spz of all versions, .ksplat of all levels.
surfel-convert cloud_ply/binary.ply -o gaussian_ply/trained.ply --gaussians --quiet
surfel-lod gaussian_ply/trained.ply -o gaussian_ply/levels.ply --quiet
surfel-convert cloud_ply/binary.ply -o gaussian_splat/six.splat --quiet
{
  printf 'ply\nformat ascii 1.0\ncomment SplatRenderMode: mip\ncomment surfel_origin 1 2 3\nelement vertex 2\nproperty double x\nproperty float y\nproperty float z\n'
  printf 'property float f_dc_%s\n' 0 1 2
  printf 'property float f_rest_%s\n' 0 1 2 3 4 5 6 7 8
  printf 'property float %s\n' opacity scale_0 scale_1 rot_0 rot_1 rot_2 rot_3 filter_3D
  printf 'end_header\n'
  printf '1 2 3 1 1 1 1 2 3 4 5 6 7 8 9 0 -1 -2 1 0 0 0 0.5\n'
  printf 'nan 2 3 1 1 1 1 2 3 4 5 6 7 8 9 inf -1 99 0 0 0 0 0\n'
} > gaussian_ply/text.ply
{
  printf 'ply\nformat ascii 1.0\nelement chunk 1\n'
  printf 'property float %s\n' min_x min_y min_z max_x max_y max_z min_scale_x min_scale_y min_scale_z max_scale_x max_scale_y max_scale_z
  printf 'property float %s\n' min_r min_g min_b max_r max_g max_b
  printf 'element vertex 2\n'
  printf 'property uint packed_%s\n' position rotation scale color
  printf 'element sh 2\n'
  printf 'property uchar f_rest_%s\n' 0 1 2 3 4 5 6 7 8
  printf 'end_header\n0 0 0 1 1 1 -3 -3 -3 1 1 1 0 0 0 1 1 1\n1 2 3 4\n4294967295 1 2 3\n1 2 3 4 5 6 7 8 9\n0 255 3 4 5 6 7 8 9\n'
} > gaussian_ply/packed.ply
spz() {
  printf 'NGSP'
  number "$1" 4
  number 1 4
  number "$2" 1
  number 12 1
  number "$3" 1
  number "$4" 1
}
# A Zstandard frame with one block that is not compressed.
frame() {
  printf '\x28\xb5\x2f\xfd\x20'
  number "$1" 1
  number $((8 * $1 + 1)) 3
  head -c "$1" /dev/zero
}
{ spz 1 0 0 0; printf 'position/abc/abc/abc'; } > gaussian_spz/one.spz
{ spz 2 1 1 0; printf 'positions/abcabcabcsphericalharmonics'; } > gaussian_spz/two.spz
{ spz 3 0 0 0; printf 'positions/abcabc1234'; } > gaussian_spz/three.spz
gzip -nc gaussian_spz/three.spz > gaussian_spz/packed.spz
{
  spz 4 0 2 5
  number 44 4
  head -c 12 /dev/zero
  number $((0xADBE0003)) 4
  number 4 4
  number 6 4
  for size in 9 1 3 3 4; do
    number $((size + 9)) 8
    number $size 8
  done
  for size in 9 1 3 3 4; do frame $size; done
} > gaussian_spz/four.spz
for level in 0 1 2; do
  {
    number 256 4
    number 1 4
    number 1 4
    number 1 4
    number 1 4
    number $level 2
    head -c 26 /dev/zero
    for word in 1 1 1 1; do number $word 4; done
    printf '\0\0\x80\x3f'
    number 12 4
    number 1000 4
    number 0 4
    number 1 4
    number 0 4
    number 1 2
    head -c 54 /dev/zero
    head -c 92 /dev/zero | tr '\0' '1'
  } > gaussian_ksplat/level$level
done

nrrd() {
  printf 'NRRD0004\ntype: %s\ndimension: 3\nsizes: 2 3 2\nendian: little\nencoding: %s\n%b\n' "$@"
}
{ nrrd uchar raw ''; printf 'abcdefghijkl'; } > volume_nrrd/raw.nrrd
{ nrrd short raw 'space: left-posterior-superior\nspace directions: (1,0,0) (0,2,0) (0,0,3)\nspace origin: (4,5,6)\n'; printf 'abcdefghijklabcdefghijkl'; } > volume_nrrd/space.nrrd
{ nrrd uchar gzip 'spacings: 1 2 3\n'; printf 'abcdefghijkl' | gzip -nc; } > volume_nrrd/gzip.nrrd
mha() {
  printf 'ObjectType = Image\nNDims = 3\nDimSize = 2 3 2\nElementSpacing = 1 2 3\nOffset = 4 5 6\nTransformMatrix = 1 0 0 0 1 0 0 0 1\nCompressedData = %s\nElementType = %s\nElementDataFile = LOCAL\n' "$@"
}
{ mha False MET_UCHAR; printf 'abcdefghijkl'; } > volume_mha/raw.mha
{ mha True MET_UCHAR; printf 'abcdefghijkl' | gzip -nc; } > volume_mha/gzip.mha

quad='1 2 3 4'
printf 'v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvn 0 0 1\nvt 0 0\nf %s\nf -4 -3 -2\nf 1/1/1 2/1/1 3/1/1\n' "$quad" > mesh_obj/quad.obj
printf 'mtllib none.mtl\nv 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nusemtl a\nf 1 2 3\n' > mesh_obj/colours.obj
printf 'v 0 0 0\nv 2 0 0\nv 2 2 0\nv 1 0.5 0\nv 0 2 0\nv 0 0 1\ng a\no b\ns 1\nf 1 2 3 4 5\nf 1//  2// 6//\nl 1 2\nusemtl none\nf 1 3 6 \\\n2\n' > mesh_obj/concave.obj
printf 'OFF BINARY\n' > mesh_off/binary.off
printf 'STCNOFF\n3 1 0\n0 0 0 0 0 1 1 0 0 1 0 0\n1 0 0 0 0 1 1 0 0 1 1 0\n0 1 0 0 0 1 1 0 0 1 0 1\n3 0 1 2 0.5 0.5 0.5\n' > mesh_off/all.off
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

printf 'ply\nformat ascii 1.0\ncomment TextureFile a.png\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nproperty float u\nproperty float v\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement tristrips 1\nproperty list int int vertex_indices\nend_header\n0 0 0 0 0 1 2 3\n1 0 0 1 0 1 2 3\n1 1 0 1 1 1 2 3\n0 1 0 0 1 1 2 3\n6 0 1 2 -1 1 2\n' > mesh_ply/strips.ply

# A number as four bytes, and a GLB of a JSON text and the bytes of a triangle.
u32() { printf "$(printf '\\x%02x\\x%02x\\x%02x\\x%02x' $(($1 & 255)) $(($1 >> 8 & 255)) $(($1 >> 16 & 255)) $(($1 >> 24)))"; }
glb() {
  local json=$1
  while [ $((${#json} % 4)) -ne 0 ]; do json+=' '; done
  printf 'glTF'; u32 2; u32 $((28 + ${#json} + 40))
  u32 ${#json}; printf 'JSON%s' "$json"
  u32 40; printf 'BIN\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\x80\x3f\0\0\0\0\0\0\0\0\0\0\0\0\0\0\x80\x3f\0\0\0\0\0\1\2\1'
}
start='{"asset":{"version":"2.0"},"scenes":[{"nodes":[0]}],"buffers":[{"byteLength":40}],"bufferViews":[{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":4}],'
vertices='{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}'
glb "$start"'"nodes":[{"mesh":0}],"accessors":['"$vertices"',{"bufferView":1,"componentType":5121,"count":3,"type":"SCALAR"}],"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}]}' > mesh_gltf/indexed.glb
glb "$start"'"nodes":[{"children":[1],"rotation":[0,0,1,0]},{"mesh":0,"skin":0,"scale":[1,-1,2],"weights":[0.5]}],"skins":[{"joints":[0]}],"accessors":['"$vertices"',{"count":3,"type":"VEC3","componentType":5126,"sparse":{"count":1,"indices":{"bufferView":1,"componentType":5121},"values":{"bufferView":0}}}],"meshes":[{"primitives":[{"mode":5,"attributes":{"POSITION":0,"NORMAL":0,"COLOR_0":0},"targets":[{"POSITION":1}]}]}],"animations":[{"channels":[{"sampler":0,"target":{"node":1,"path":"translation"}}],"samplers":[{"input":0,"output":0}]}]}' > mesh_gltf/moved.glb
printf '%s' '{"asset":{"version":"2.0"},"extensionsRequired":["KHR_texture_transform"],"nodes":[{"mesh":0,"matrix":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]}],"buffers":[{"byteLength":36,"uri":"data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}],"bufferViews":[{"buffer":0,"byteLength":36}],"accessors":['"$vertices"',{"bufferView":0,"componentType":5126,"count":3,"type":"VEC2"}],"images":[{"uri":"a.png"}],"samplers":[{"wrapS":33648}],"textures":[{"source":0,"sampler":0}],"materials":[{"alphaMode":"MASK","normalTexture":{"index":0},"pbrMetallicRoughness":{"baseColorFactor":[1,0,0,1],"baseColorTexture":{"index":0,"extensions":{"KHR_texture_transform":{"scale":[2,2],"rotation":1}}}}}],"meshes":[{"primitives":[{"mode":6,"material":0,"attributes":{"POSITION":0,"TEXCOORD_0":1}}]}]}' > mesh_gltf/textured.gltf

surfel-render cloud_ply/binary.ply -o image_png/8.png --size 9x7 --quiet
surfel-render cloud_ply/binary.ply -o image_exr/plain.exr --size 3x2 --quiet
surfel-render cloud_ply/binary.ply -o image_png/background.png --size 5x4 --background 1,1,1 --quiet
printf 'ambient = [0.2, 0.2, 0.2]\nrefraction = "multi"\n[sky]\nup = [0, 1, 0]\n[[light]]\ntype = "point"\nposition = [1, 2, 3]\ncolor = [1, 1, 1]\n[[material]]\nname = "glass"\nior = 1.5\n' > scene/scene.toml
printf '[environment]\nimage = "sky.exr"\nintensity = 2.0\nrotation = 90\nvisible = false\n[sky]\ncolor = [1, 1, 1]\nground = [0.1, 0.1, 0.1]\n[[light]]\ntype = "directional"\ndirection = [0, -1, 0]\n[[light]]\ntype = "headlight"\n[[material]]\nambient = 0.1\ndiffuse = 0.5\nspecular = 0.3\nshininess = 20\nopacity = 0.5\nreflectivity = 0.1\nior = 1.3\ndispersion = 0.01\nroughness = 0.2\nabsorption = 0.1\n' > scene/all.toml
printf '[[camera]]\neye = [0, 0, 3]\ntarget = [0, 0, 0]\nfov = 30\nwidth = 64\nheight = 48\n[[camera]]\northo = 2.0\n' > camera/cameras.toml
printf 'from = [0, 0, 3]\nup = [0, 1, 0]\nsize = [640, 480]\nnear = 0.1\nzoom = 2\nframe-all = true\n' > camera/one.toml
printf '# cameras\n1 SIMPLE_PINHOLE 8 6 9 4 3\n2 OPENCV 8 6 9 9 4 3 0 0 0 0\n' > colmap_text/cameras.txt
printf '# images\n3 1 0 0 0 0.5 0 2 1 b c.jpg\n1 2 -1 3 4 5\n2 0 1 0 0 0 0 0 1 a.jpg\n\n' > colmap_text/images.txt
{
  printf '\1\0\0\0\0\0\0\0\2\0\0\0\0\0\0\0\10\0\0\0\0\0\0\0\6\0\0\0\0\0\0\0'
  printf '\0\0\0\0\0\0\x20\x40\0\0\0\0\0\0\x10\x40\0\0\0\0\0\0\x10\x40'
} > colmap_binary/cameras.bin
{
  printf '\1\0\0\0\0\0\0\0\1\0\0\0\0\0\0\0\0\0\xf0\x3f'
  head -c 48 /dev/zero
  printf '\1\0\0\0a.jpg\0\1\0\0\0\0\0\0\0'
  head -c 24 /dev/zero
} > colmap_binary/images.bin
unit='[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]'
printf '{"fl_x": 9, "w": 8, "h": 6, "frames": [{"file_path": "a.jpg", "transform_matrix": %s}]}' "$unit" > views/transforms.json
printf '{"camera_angle_x": 0.7, "applied_transform": %s, "applied_scale": 2, "frames": [{"cx": 3, "cy": 2, "camera_angle_y": 1, "k1": 0, "camera_model": "OPENCV", "transform_matrix": %s}]}' "$unit" "$unit" > views/angles.json
printf '[{"name": "a", "width": 8, "height": 6, "intrinsics": [[9, 0, 4], [0, 9, 3], [0, 0, 1]], "world_to_camera": %s}, {"width": 8, "height": 6, "fx": 9, "axes": "opengl", "near": 0.1, "camera_to_world": %s}]' "$unit" "$unit" > views/poses.json
printf '{"views": [{"id": 0, "img_name": "a", "width": 8, "height": 6, "fx": 9, "fy": 9, "position": [0, 0, 1], "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}]}' > views/gaussians.json
printf 'newmtl a\nKd 0.5 0.5 0.5\nmap_Kd -s 1 1 1 none.png\nbump -bm 0.1 none.png\nnewmtl b\nd 0.5\nnorm n.png\nmap_bump -imfchan r -clamp on -mm 0 1 "a b.png"\n' > material/two.mtl
printf '1,2,3' > options/numbers
printf '640x480' > options/size
printf '#ff8800cc' > options/color
printf 'number = 1.5\nword = "text"\nflag = true\ncount = 7\nwords = ["a", 1, 2.5]\n' > options/config
printf '# comment\n[table]\nnumber = [1, 2]\nword = """a\nb"""\n' > options/tables
printf '0.5 -1e3 inf' > options/blanks
printf '1.5GiB' > options/bytes
# A kind of file that names others, and the name; the byte 1 is the folder of all.
printf '\0data.raw' > names/data
printf '\0away/secret.raw' > names/away
printf '\0\1/out/secret.raw' > names/absolute
printf '\1data.raw\n\n' > names/nrrd
printf '\1pipe\n\n' > names/nrrd_pipe
printf '\2data.raw\n' > names/meta_image
printf '\2zero\n' > names/meta_image_zero
printf '\3m.mtl' > names/mtl
printf '\3link' > names/mtl_link
printf '\4sub/a b.png' > names/ply
printf '\4..\\out\\secret.raw' > names/ply_out
printf '\5data.raw' > names/buffer
printf '\6sub/a%%20b.png' > names/image
printf '\6file://\1/out/secret.raw' > names/image_out
printf '\7whole' > names/scene
get() { printf 'GET /token/%s HTTP/1.1\r\nHost: 127.0.0.1\r\n%b\r\n' "$@"; }
get '' '' > requests/page
get '0/records?first=0&end=2' '' > requests/records
get '1/clusters?list=0,1' '' > requests/clusters
get '1/clusters?list=0' 'Range: bytes=0-9,20-\r\n' > requests/range
get '0/records?first=0&end=1' 'Content-Length: 3\r\n\r\nabc' > requests/body
get '0/records' 'Transfer-Encoding: chunked\r\n\r\n3\r\nabc\r\n0\r\n' > requests/chunked
printf 'HEAD /token HTTP/1.0\r\nConnection: keep-alive\r\nExpect: 100-continue\r\n\r\n' > requests/head
printf 'POST /%%74oken/ HTTP/1.1\r\nContent-Type: application/x-www-form-urlencoded\r\nContent-Length: 3\r\n\r\na=b' > requests/post
printf '/token/0/clusters?list=0' > requests/address
# A kind of settings, and a text in which bytes from 128 on repeat the last bytes: 188 + n the last 1 + n of them 32768
# times.
printf '\0a.\275b = 1\n' > settings/dots
printf '\0a = [\274]' > settings/brackets
printf '\0a = "\\"\274"\nb = """#\274"""\n[[c]]\nd.e = { f = 1 }\n' > settings/quotes
printf '\1[[camera]]\neye = [0, 0, 3]\n\277' > settings/cameras
printf '\2{"frames": [[],\276]}' > settings/arrays
printf '\3{"a":\274' > settings/objects
# A kind of file, types of coordinates and colours, columns by name and type, and numbers by their kind.
for kind in 0 1 2 3 4 5; do
  {
    printf "\\$kind\\5\\3\\0\\7\\3\\3\\25\\0"
    printf '\3\1\2\3\3\1\2\4\3\1\2\5\7\100\0\2\0\7'
    printf '\3\1\2\6\3\1\2\7\3\1\2\10\6\0\0\50\0\1'
    printf '\0\0\0\0\0\0\1\201\0\6\12\0\3\0\2'
  } > written/stray_$kind
  {
    printf "\\$kind\\2\\2\\24\\7\\25\\1"
    head -c 60 "$script"
  } > written/coloured_$kind
done
for name in polygon estimate gaussians render; do
  head -c 400 "$script" > "$name/text"
  printf '\0\x20\x10\x10\x70\x10\x70\x70\x10\x70\x20\x30\x40\x50' > "$name/few"
done
# Each profile with both kinds of cameras, numbers of one scale and any.
for choice in $(seq 0 4 127) 131 147; do
  { printf "\\x$(printf %02x "$choice")\\x1f"; head -c 300 "$script" | tail -c 240; } > "gaussians/choice_$choice"
done
