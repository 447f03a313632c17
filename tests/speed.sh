#!/usr/bin/env bash
# Makes docs/speed.md: what Surfelkit takes and what its peers take beside it, in turns in one run, with
# the ratio, what it must reach and what it aims at. Needs a build with -DSURFEL_BUILD_BENCH=ON in
# build/release and an idle machine. Takes minutes.
#
# Usage: tests/speed.sh [SECTION]...   (default: all). Sections that are not run keep their rows.
#   -o FILE  instead of docs/speed.md     -n N  runs of each, of which the best counts (default 3)
#
# A section is a function section_NAME that calls `row` for each of its rows and is named in `sections`.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bin=build/release/bin
out=docs/speed.md
runs=3
sections=(neighbors estimate)
while getopts o:n: option; do
  case $option in
    o) out=$OPTARG ;;
    n) runs=$OPTARG ;;
    *) exit 2 ;;
  esac
done
shift $((OPTIND - 1))
[[ $# -gt 0 ]] && chosen=("$@") || chosen=("${sections[@]}")
for section in "${chosen[@]}"; do
  declare -F "section_$section" > /dev/null || [[ " ${sections[*]} " == *" $section "* ]] || {
    echo "speed.sh: there is no section '$section'; there are: ${sections[*]}" >&2
    exit 2
  }
done
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# calc EXPRESSION [DIGITS]: its value.
calc() { awk "BEGIN { printf \"%.${2:-2}f\", $1 }"; }
# field NAME FILE...: the value after NAME in lines of "key value" pairs.
field() { awk -v name="$1" '{ for (i = 1; i < NF; ++i) if ($i == name) { print $(i + 1); exit } }' "${@:2}"; }
# milliseconds COMMAND...: wall-clock time of a whole process.
milliseconds() {
  local begin end
  begin=$(date +%s%N)
  "$@" > /dev/null
  end=$(date +%s%N)
  calc "($end - $begin) / 1e6" 1
}
# least A B: the smaller number; A may be empty.
least() { [[ -z $1 ]] && echo "$2" || calc "$1 < $2 ? $1 : $2" 1; }
# row WORK VALUE PEER RATIO MUST AIM BOUND COMMAND: one row of the section's table.
row() { printf '| %s | %s | %s | %s | %s | %s | %s | `%s` |\n' "$@"; }
times() { calc "$1 / $2" 2; }

# k = 16 of all points, in random order and along the curve, beside FLANN and nanoflann.
section_neighbors() {
  local order count log=$work/neighbors.log ours
  for order in random morton; do
    for count in 1000000 4000000; do
      local command="neighbors_bench --count $count --order $order --repeats $runs"
      "$bin"/$command | grep '^neighbors' > "$log"
      ours=$(field ms <(grep ' surfelkit ' "$log"))
      local must=- aim=-
      if [[ $order == random ]]; then
        [[ $count == 1000000 ]] && must="3 x" aim="6 x" || must="4 x" aim="10 x"
      fi
      row "k = 16 of $((count / 1000000)) M points, $order order" "$ours ms" \
        "FLANN $(field ms <(grep ' flann ' "$log")) ms" \
        "$(field ratio <(grep ' flann ' "$log")) x" "$must" "$aim" "arithmetic, sorting" "$command"
      if grep -q ' nanoflann ' "$log"; then
        row "the same" "$ours ms" "nanoflann $(field ms <(grep ' nanoflann ' "$log")) ms" \
          "$(field ratio <(grep ' nanoflann ' "$log")) x" - - "" "$command"
      fi
    done
  done
  local one two
  one=$("$bin/neighbors_bench" --count 1000000 --repeats "$runs" --threads 1 --ours | field ms /dev/stdin)
  two=$("$bin/neighbors_bench" --count 1000000 --repeats "$runs" --threads 2 --ours | field ms /dev/stdin)
  row "k = 16 of 1 M points, 1 to 2 threads" "$two ms" "1 thread $one ms" "$(times "$one" "$two") x" \
    "1.7 x" "1.95 x" "" "neighbors_bench --count 1000000 --ours --threads 1"
}

# Whole processes, PLY in and out, beside PCL's normals alone.
section_estimate() {
  local count orient must aim
  for count in 1000000 4000000; do
    "$bin/neighbors_bench" --count "$count" --write "$work/points.ply"
    [[ $count == 1000000 ]] && must="4 x" aim="8 x" || must="5 x" aim="10 x"
    local pcl="" one=""
    local -A best=()
    for ((i = 0; i < runs; ++i)); do
      pcl=$(least "$pcl" "$("$bin/neighbors_bench" --count "$count" --repeats 1 --pcl | field ms /dev/stdin)")
      for orient in mst none; do
        best[$orient]=$(least "${best[$orient]:-}" \
          "$(milliseconds "$bin/surfel-estimate" "$work/points.ply" -o "$work/out.ply" --orient $orient --quiet)")
      done
      one=$(least "$one" \
        "$(milliseconds "$bin/surfel-estimate" "$work/points.ply" -o "$work/out.ply" --threads 1 --quiet)")
    done
    for orient in mst none; do
      row "surfel-estimate --orient $orient, $((count / 1000000)) M points, random order, whole process" \
        "${best[$orient]} ms" "PCL NormalEstimationOMP, kernel alone $pcl ms" "$(times "$pcl" "${best[$orient]}") x" \
        "$must" "$aim" "arithmetic of the splat sizes" "surfel-estimate POINTS.ply -o OUT.ply --orient $orient"
    done
    row "surfel-estimate, $((count / 1000000)) M points, 1 to 2 threads" "${best[mst]} ms" "1 thread $one ms" \
      "$(times "$one" "${best[mst]}") x" "1.7 x" "1.95 x" "" "surfel-estimate POINTS.ply -o OUT.ply --threads 1"
  done
}

for section in "${chosen[@]}"; do
  echo "speed.sh: $section" >&2
  "section_$section" > "$work/$section.rows"
done
# Rows of the sections that were not run stay as they are.
{
  echo "# Speed: measured"
  echo
  echo "Made by \`tests/speed.sh\`: best of $runs runs, Surfelkit and its peers in turns, $(nproc) threads,"
  echo "$(sed -n 's/^model name[^:]*: //p' /proc/cpuinfo | head -1). Ratio: the peer's time by ours, or as the row says."
  for section in "${sections[@]}"; do
    rows=$work/$section.rows
    if [[ ! -f $rows && -f $out ]]; then
      awk -v title="## $section" '$0 == title { on = 1; next } /^## / { on = 0 }
        on && /^\|/ && !/^\| work / && !/^\|---/' "$out" > "$rows"
    fi
    [[ -s $rows ]] || continue
    echo
    echo "## $section"
    echo
    echo "| work | Surfelkit | peer | ratio | must | aim | bound by | command |"
    echo "|---|---|---|---|---|---|---|---|"
    cat "$rows"
  done
} > "$work/speed.md"
cp "$work/speed.md" "$out"
