#!/usr/bin/env bash
# Makes docs/first-pictures.md and docs/first-pictures.jpg again: every file of the test data by the one command
# `surfel-render FILE picture.jpg`, its time, and what was said.
# Usage: tests/first_pictures.sh [folder of the tools] [folder of the output]
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
tools=$(realpath "${1:-$root/build/release/bin}")
output=$(realpath "${2:-$root/docs}")
data=$(realpath "${SURFEL_TEST_DATA:-$root/../shared/data}")
command -v oiiotool >/dev/null || { echo "oiiotool is missing: apt-get install openimageio-tools" >&2; exit 1; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
tiles=()
pictures=0 refused=0

# Models, scans and splats; pictures, materials and broken files are others' parts.
files=$(cd "$data" && find meshes textured colour_clouds raw_scans lidar surfels formats -type f \
  ! -name '*.md' ! -name '*.txt' ! -name '*.mtl' ! -name '*.png' ! -name '*.jpg' | sort)
# What else the machine does changes the processors' time least.
TIMEFORMAT='%U %S'
for file in $files; do
  cd "$data/$(dirname "$file")"
  name=$(basename "$file")
  if { time "$tools/surfel-render" "$name" "$work/$pictures.jpg" --size 512 >"$work/said" 2>&1; } 2>"$work/time"; then
    seconds=$(awk '{ printf "%.1f s", $1 + $2 }' "$work/time")
    tiles+=("$work/$pictures.jpg")
    pictures=$((pictures + 1))
    number=$pictures
  else
    seconds="" number=""
    refused=$((refused + 1))
  fi
  said=$(sed '/ pixels, /d; s/^surfel-render: //; s/|/\\|/g' "$work/said" | paste -sd '\t' | sed 's/\t/<br>/g')
  echo "| $number | \`$file\` | $seconds | $said |" >> "$work/table.md"
done
columns=6
oiiotool --nosoftwareattrib "${tiles[@]}" --mosaic:pad=2 "${columns}x$(((pictures + columns - 1) / columns))" --resize 1230x0 \
  --compression jpeg:85 -o "$work/first-pictures.jpg"
mv "$work/first-pictures.jpg" "$output/first-pictures.jpg"
{
  cat <<TEXT
# First pictures

\`surfel-render FILE picture.jpg\`, without any option but \`--size 512\`, for every model, scan and splat file of the test data: $pictures have a picture,
$refused are refused with a message. What is said is the tool's own: what was made of the file with the commands that do the same, and the
view that was chosen ([views.md](views.md)). Times are those that processors spent on the whole command.

![The pictures, row by row](first-pictures.jpg)

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
