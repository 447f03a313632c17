#!/usr/bin/env bash
# Makes docs/views.md and docs/views.jpg again: what surfel-render guesses to be up and front of each file of
# the test data, and its picture without a camera. Usage: tests/views.sh [folder of the tools] [folder of the output]
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
tools=${1:-$root/build/release/bin}
output=${2:-$root/docs}
data=${SURFEL_TEST_DATA:-$root/../shared/data}
command -v oiiotool >/dev/null || { echo "oiiotool is missing: apt-get install openimageio-tools" >&2; exit 1; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
tiles=()
files=0 right=0

# is_one_of X Y Z LIST: is the direction nearest to one of the axes in the list?
is_one_of() {
  [ "$4" = any ] || awk -v x="$1" -v y="$2" -v z="$3" -v list="$4" 'BEGIN {
    d["x"] = x; d["y"] = y; d["z"] = z
    n = split(list, words, ",")
    for (i = 1; i <= n; ++i) {
      axis = words[i]; sign = sub(/^-/, "", axis) ? -1 : 1
      if (sign * d[axis] > 0.7071) exit 0
    }
    exit 1
  }'
}

while read -r file tool option up front; do
  surfels=$work/surfels.ply
  options=()
  [ "$option" = - ] || options+=("$option")
  [ "$tool" = surfel-from-mesh ] && options+=(--count 150000 --seed 1)
  "$tools/$tool" "$data/$file" "${options[@]}" -o "$surfels" --quiet
  said=$("$tools/surfel-render" "$surfels" -o "$work/$files.png" --size 200x200 --background 0.6,0.6,0.65,1 2>&1 | grep '^surfel-render: up ')
  # "view   front 0 0 1, reason ..., up 0 1 0"
  view=$("$tools/surfel-info" "$surfels" --samples 10 | sed -n 's/^view  *//p')
  # shellcheck disable=SC2046  # three numbers each
  if is_one_of $(sed 's/.*up \([^,]*\).*/\1/' <<< "$view") "$up" &&
    is_one_of $(sed 's/.*front \([^,]*\).*/\1/' <<< "$view") "$front"; then
    verdict=right right=$((right + 1))
  else
    verdict=**wrong**
  fi
  files=$((files + 1))
  tiles+=("$work/$((files - 1)).png")
  echo "| $files | \`${file##*/}\` | ${up//,/ or } | ${front//,/ or } | ${said#surfel-render: } | $verdict |" >> "$work/table.md"
done < <(grep -v '^#' "$root/tests/views.txt")

oiiotool --nosoftwareattrib "${tiles[@]}" --mosaic:pad=2 "6x$(((files + 5) / 6))" --compression jpeg:85 -o "$work/views.jpg"
mv "$work/views.jpg" "$output/views.jpg"
{
  echo "# Views: which way is up, and where the front is"
  echo
  echo "Without a camera \`surfel-render\` guesses how a scene stands and from where it is best seen, and says so. The guess is right on"
  echo "$right of $files files of the test data. Up and front as they are, in the axes of the file (any: it has no front, or stands"
  echo "on several sides), and what was said:"
  echo
  echo "| | file | up | front | said | |"
  echo "|---|---|---|---|---|---|"
  cat "$work/table.md"
  echo
  echo "![The pictures, row by row](views.jpg)"
  echo
  echo "Made by \`tests/views.sh\` with the options of \`tests/views.txt\`; \`tests/cli/view_test.cpp\` holds the share to nine of ten. Not in"
  echo "the table are files of a few points and \`gaussians_train_1000.ply\`, of whose thousand points nobody can tell what is up."
  cat "$root/tests/views_notes.md"
} > "$work/views.md"
mv "$work/views.md" "$output/views.md"
echo "$output/views.md"
