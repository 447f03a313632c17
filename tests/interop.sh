#!/usr/bin/env bash
# Prints the tables of docs/formats.md, section "With other programs": files of other programs read here, and files
# written here read there. Needs a build in build/release, and the programs (Debian: cloudcompare meshlab xvfb
# assimp-utils blender gdal-bin); rows of a program that is not installed are left out. Takes two minutes.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bin=$PWD/build/release/bin
samples=$PWD/samples
export QT_QPA_PLATFORM=offscreen
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"

has() { command -v "$1" >/dev/null; }
cloudcompare() { CloudCompare -SILENT "$@" >cc.log 2>&1 || true; }
meshlab() { xvfb-run -a meshlabserver "$@" >ml.log 2>&1 || true; }

# blender_run FILE...: opens each file, a mesh or points, and writes what it holds under all names that follow it, parted by
# commas: "in.obj=a.glb,b.stl". Text gets the vertices. All files keep the axes of the first, y up.
cat > blender.py <<'END'
import os
import sys

import bpy

bpy.ops.wm.read_factory_settings(use_empty=True)
for addon in ("io_mesh_ply", "io_mesh_stl", "io_scene_gltf2"):
    bpy.ops.preferences.addon_enable(module=addon)
AXES = {"axis_forward": "-Z", "axis_up": "Y"}
READ = {"obj": bpy.ops.wm.obj_import, "ply": bpy.ops.import_mesh.ply}
WRITE = {
    "glb": lambda path: bpy.ops.export_scene.gltf(filepath=path, export_format="GLB"),
    "gltf": lambda path: bpy.ops.export_scene.gltf(filepath=path, export_format="GLTF_SEPARATE"),
    "obj": lambda path: bpy.ops.wm.obj_export(filepath=path, path_mode="COPY"),
    "ply": lambda path: bpy.ops.export_mesh.ply(filepath=path, **AXES),
    "stl": lambda path: bpy.ops.export_mesh.stl(filepath=path, **AXES),
}
for task in sys.argv[sys.argv.index("--") + 1:]:
    source, targets = task.split("=")
    bpy.ops.object.select_all(action="SELECT")
    bpy.ops.object.delete()
    READ[source.rsplit(".", 1)[1]](filepath=source)
    for target in map(os.path.abspath, targets.split(",")):
        kind = target.rsplit(".", 1)[1]
        if kind != "xyz":
            WRITE[kind](target)
            continue
        with open(target, "w") as text:
            for vertex in bpy.context.object.data.vertices:
                text.write("%.6f %.6f %.6f\n" % vertex.co[:])
END
blender_run() { blender -b --factory-startup --python blender.py -- "$@" >bl.log 2>&1 || true; }

# points FILE: its points, one a line, x y z [red green blue] with four digits, in the order of the file.
points() {
  "$bin/surfel-convert" "$1" -o points.csv --quiet 2>/dev/null || return 1
  awk -F, 'NR == 1 { for (i = 1; i <= NF; ++i) at[$i] = i; next }
    { printf "%.4f %.4f %.4f", $at["x"], $at["y"], $at["z"]
      if ("red" in at) printf " %d %d %d", $at["red"], $at["green"], $at["blue"]
      printf "\n" }' points.csv
}

# same A B: says what the second file has of the first.
same() {
  points "$1" > a.txt || { echo "cannot be read"; return; }
  points "$2" > b.txt || { echo "cannot be read"; return; }
  paste -d' ' a.txt b.txt | awk -v a="$(wc -l < a.txt)" -v b="$(wc -l < b.txt)" '
    NR == 1 { colors = NF == 12 }
    { for (i = 1; i <= 3; ++i) { d = $i - $(i + (colors ? 6 : (NF == 9 ? 6 : 3))); if (d < 0) d = -d; if (d > far) far = d }
      if (colors) for (i = 4; i <= 6; ++i) { d = $i - $(i + 6); if (d < 0) d = -d; if (d > off) off = d } }
    END { printf "%d of %d points, places within %.4f%s\n", b, a, far, colors ? sprintf(", colours within %d of 255", off) : "" }'
}

row() { echo "| $1 | $2 | $3 | $4 |"; }

"$bin/surfel-from-mesh" "$samples/lee_perry_smith.obj" --count 20000 -o bare.ply --quiet
"$bin/surfel-texture" bare.ply --mesh "$samples/lee_perry_smith.obj" -o head.ply --quiet
for file in head.xyz head.csv head.txt head.obj; do "$bin/surfel-convert" head.ply -o "$file" --quiet 2>/dev/null; done
"$bin/surfel-convert" head.ply --keep-columns normal -o normals.ply --quiet
"$bin/surfel-convert" normals.ply -o normals.xyz --quiet

echo "| written by | format | read by | what is there |"
echo "|---|---|---|---|"
if has CloudCompare; then
  for file in head.ply head.xyz head.csv head.txt head.obj; do
    cloudcompare -O "$file" -C_EXPORT_FMT ASC -PREC 8 -ADD_HEADER -SAVE_CLOUDS FILE back.asc
    row Surfelkit "${file##*.}" CloudCompare "$(same head.ply back.asc)"
    rm -f back.asc
  done
fi
if has meshlabserver; then
  for file in head.ply normals.xyz head.obj; do
    meshlab -i "$file" -o back.ply -m vc vn
    "$bin/surfel-convert" back.ply --keep-columns normal -o plain.ply --quiet
    if [ "$file" = normals.xyz ]; then mv plain.ply back.ply; fi
    row Surfelkit "${file##*.}" MeshLab "$(same "${file/head.*/head.ply}" back.ply)"
    rm -f back.ply
  done
fi
if has blender; then
  blender_run head.ply=back.xyz
  row Surfelkit ply Blender "$(same head.ply back.xyz)"
  rm -f back.xyz
fi
if has CloudCompare; then
  for format in ASC PLY; do
    file=cc.${format,,}
    cloudcompare -O head.ply -C_EXPORT_FMT "$format" -PREC 8 -ADD_HEADER -SAVE_CLOUDS FILE "$file"
    row CloudCompare "${format,,}" Surfelkit "$(same head.ply "$file")"
  done
fi
if has meshlabserver; then
  for format in ply xyz; do
    meshlab -i head.ply -o "ml.$format" -m vc vn
    row MeshLab "$format" Surfelkit "$(same head.ply "ml.$format")"
  done
fi

# picture FILE PICTURE: the mesh from the front.
picture() { "$bin/surfel-render" "$1" -o "$2" --size 256 --view front --up y --quiet --shading phong --relief none; }
# picture_row PROGRAM FORMAT FILE ORIGINAL: how the picture of a mesh that a program wrote differs from another picture.
picture_row() {
  if picture "$3" back.png 2>error.txt; then
    row "$1" "$2" Surfelkit "$("$bin/surfel-compare" back.png "$4.png" |
      sed -n "s/^psnr *\([0-9.]*\|inf\).*/picture within \1 dB of the original's/p")"
  else
    row "$1" "$2" Surfelkit "refused: $(head -n 1 error.txt | cut -d: -f 4-)"
  fi
}
cp "$samples"/lee_perry_smith* .
grep -v '^mtllib' lee_perry_smith.obj > untextured.obj
echo
echo "| mesh written by | format | read by | what is there |"
echo "|---|---|---|---|"
picture lee_perry_smith.obj original.png
picture untextured.obj untextured.png
if has assimp; then
  for format in glb2 gltf2 obj; do
    assimp export lee_perry_smith.obj "ai.${format%2}" "-f$format" >ai.log 2>&1 || true
    picture_row Assimp "${format%2}" "ai.${format%2}" original
  done
  for format in ply stl; do
    assimp export untextured.obj "ai.$format" "-f$format" >ai.log 2>&1 || true
    picture_row Assimp "$format, without texture" "ai.$format" untextured
  done
fi
if has meshlabserver && [ -f ai.ply ]; then
  for format in obj ply off stl; do
    meshlab -i ai.ply -o "mesh.$format"
    picture_row MeshLab "$format, without texture" "mesh.$format" untextured
  done
fi
if has blender; then
  "$bin/surfel-generate" head --count 10 -o unused.ply --mesh made.obj --image texture.png --quiet
  picture made.obj made.png
  blender_run lee_perry_smith.obj=bl.glb,bl.gltf,bl.obj untextured.obj=bl.ply,bl.stl made.obj=made.glb
  for format in glb gltf obj; do picture_row Blender "$format" "bl.$format" original; done
  for format in ply stl; do picture_row Blender "$format, without texture" "bl.$format" untextured; done
  picture_row "Surfelkit, as OBJ, then Blender" glb made.glb made
fi

if has gdalinfo; then
  "$bin/surfel-generate" terrain --count 100000 -o terrain.ply --quiet
  "$bin/surfel-convert" terrain.ply --scale 500 --translate 450000,5200000,100 --epsg 25832 -o terrain.laz --quiet
  "$bin/surfel-render" terrain.laz --map 2 -o map.tif --quiet
  gdalinfo map.tif > info.txt
  # The world file, which has the middle of the first pixel, as gdalinfo says it: corner and sides.
  awk '{ v[NR] = $1 } END { printf "Origin = (%.15f,%.15f)\nPixel Size = (%.15f,%.15f)\n", v[5] - v[1] / 2, v[6] - v[4] / 2, v[1], v[4] }' \
    map.tfw > expected.txt
  place=differs
  if grep -E '^(Origin|Pixel Size)' info.txt | cmp -s - expected.txt && grep -q 'AREA_OR_POINT=Area' info.txt; then
    place="as in the world file, pixels are areas"
  fi
  echo
  echo "| map written by | from | read by | place | coordinate system |"
  echo "|---|---|---|---|---|"
  echo "| Surfelkit, \`--map\` | LAZ of EPSG:25832 | GDAL | $place | $(gdalsrsinfo -e map.tif | sed -n 's/^EPSG:/EPSG:/p') |"
fi
