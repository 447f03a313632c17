#!/usr/bin/env bash
# Makes the tables of docs/formats.md, section "With other programs": files of other programs read here, and files
# written here read there. Needs a build in build/release, and the programs (Debian: cloudcompare meshlab xvfb
# assimp-utils colmap); rows of a program that is not installed are left out. Takes a minute.
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

row() { echo "| $1 | \`$2\` | $3 | $4 |"; }

"$bin/surfel-from-mesh" "$samples/lee_perry_smith.obj" --count 20000 -o bare.ply --quiet
"$bin/surfel-texture" bare.ply --mesh "$samples/lee_perry_smith.obj" -o head.ply --quiet
for file in head.xyz head.csv head.txt head.obj; do "$bin/surfel-convert" head.ply -o "$file" --quiet 2>/dev/null; done
"$bin/surfel-convert" head.ply --keep-columns normal -o normals.xyz --quiet

echo "| file | format | read by | what is there |"
echo "|---|---|---|---|"
if has CloudCompare; then
  for file in head.ply head.xyz head.csv head.txt head.obj; do
    cloudcompare -O "$file" -C_EXPORT_FMT ASC -PREC 8 -ADD_HEADER -SAVE_CLOUDS FILE back.asc
    row ours "${file##*.}" CloudCompare "$(same head.ply back.asc)"
    rm -f back.asc
  done
fi
if has meshlabserver; then
  for file in head.ply normals.xyz head.obj; do
    meshlab -i "$file" -o back.ply -m vc vn
    row ours "${file##*.}" MeshLab "$(same head.ply back.ply)"
    rm -f back.ply
  done
fi
if has CloudCompare; then
  for format in ASC PLY; do
    file=cc.${format,,}
    cloudcompare -O head.ply -C_EXPORT_FMT "$format" -PREC 8 -ADD_HEADER -SAVE_CLOUDS FILE "$file"
    row CloudCompare "${format,,}" ours "$(same head.ply "$file")"
  done
fi
if has meshlabserver; then
  for format in ply xyz; do
    meshlab -i head.ply -o "ml.$format" -m vc vn
    row MeshLab "$format" ours "$(same head.ply "ml.$format")"
  done
fi
