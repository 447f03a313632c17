#!/usr/bin/env bash
# Makes docs/first-pictures.md and docs/first-pictures.jpg again: every file of the test data by the one command
# `surfel-render FILE picture.jpg`, its time, and what was said. Beside each stands the picture of two steps without guesses:
# surfels made by surfel-from-mesh or surfel-estimate with their defaults, rendered with the defaults of a folder of older tools.
# Usage: tests/first_pictures.sh [folder of the tools] [folder of the output] [folder of the older tools]
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
tools=$(realpath "${1:-$root/build/release/bin}")
output=$(realpath "${2:-$root/docs}")
older=${3:-}
data=$(realpath "${SURFEL_TEST_DATA:-$root/../shared/data}")
command -v oiiotool >/dev/null || { echo "oiiotool is missing: apt-get install openimageio-tools" >&2; exit 1; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
tiles=()
pictures=0 refused=0

# older_picture FILE PICTURE: what the older tools make of a file.
older_picture() {
  local surfels=$work/older.ply
  "$older/surfel-render" "$1" -o "$2" --size 512x512 --background 1,1,1,1 --quiet 2>/dev/null && return
  { "$older/surfel-from-mesh" "$1" --count 500000 -o "$surfels" --quiet ||
    "$older/surfel-estimate" "$1" -o "$surfels" --quiet; } 2>/dev/null &&
    "$older/surfel-render" "$surfels" -o "$2" --size 512x512 --background 1,1,1,1 --quiet 2>/dev/null && return
  oiiotool --create 512x512 3 --fill:color=0.5,0.5,0.5 512x512 -o "$2"
}

# Models, scans and splats; pictures, materials and broken files are others' parts.
files=$(cd "$data" && find meshes textured colour_clouds raw_scans lidar surfels formats -type f \
  ! -name '*.md' ! -name '*.txt' ! -name '*.mtl' ! -name '*.png' ! -name '*.jpg' | sort)
for file in $files; do
  cd "$data/$(dirname "$file")"
  name=$(basename "$file")
  start=$(date +%s%N)
  if said=$("$tools/surfel-render" "$name" "$work/$pictures.jpg" --size 512 2>&1); then
    seconds=$(awk -v ns=$(($(date +%s%N) - start)) 'BEGIN { printf "%.1f s", ns / 1e9 }')
    if [ -n "$older" ]; then
      older_picture "$name" "$work/$pictures-older.png"
      oiiotool "$work/$pictures-older.png" --ch R,G,B "$work/$pictures.jpg" --mosaic 2x1 -o "$work/$pictures-both.png"
      tiles+=("$work/$pictures-both.png")
    else
      tiles+=("$work/$pictures.jpg")
    fi
    pictures=$((pictures + 1))
    number=$pictures
  else
    seconds="" number=""
    refused=$((refused + 1))
  fi
  said=$(sed '/ pixels, /d; s/^surfel-render: //; s/|/\\|/g' <<< "$said" | paste -sd '\t' | sed 's/\t/<br>/g')
  echo "| $number | \`$file\` | $seconds | $said |" >> "$work/table.md"
done
columns=$([ -n "$older" ] && echo 3 || echo 6)
oiiotool --nosoftwareattrib "${tiles[@]}" --mosaic:pad=2 "${columns}x$(((pictures + columns - 1) / columns))" --resize 1230x0 \
  --compression jpeg:85 -o "$work/first-pictures.jpg"
mv "$work/first-pictures.jpg" "$output/first-pictures.jpg"
{
  cat <<TEXT
# First pictures

\`surfel-render FILE picture.jpg\`, without any option but \`--size 512\`, for every model, scan and splat file of the test data: $pictures have a picture,
$refused are refused with a message. What is said is the tool's own: what was made of the file with the commands that do the same, and the
view that was chosen ([views.md](views.md)). Times are of the whole command, on two cores.

![The pictures, row by row](first-pictures.jpg)

TEXT
  [ -z "$older" ] || echo "Left of each picture stands what surfel-from-mesh or surfel-estimate and surfel-render made of the file in two steps by their
defaults before one command did it, on white. Grey: no picture.
"
  cat <<TEXT

| | file | time | said |
|---|---|---|---|
TEXT
  cat "$work/table.md"
  cat <<'TEXT'

Made by `tests/first_pictures.sh`.
TEXT
} > "$work/first-pictures.md"
mv "$work/first-pictures.md" "$output/first-pictures.md"
echo "$output/first-pictures.md"
