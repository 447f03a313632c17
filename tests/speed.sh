#!/usr/bin/env bash
# Makes docs/speed.md: what Surfelkit takes and what its peers take beside it, in turns in one run, with
# the ratio, what it must reach and what it aims at. Needs a build with -DSURFEL_BUILD_BENCH=ON in
# build/release and an idle machine. Takes minutes.
#
# Usage: tests/speed.sh [SECTION]...   (default: all). Sections that are not run keep their rows.
#   -o FILE    instead of docs/speed.md
#   -n N       runs of each, of which the best counts (default 3)
#   -c COUNTS  points of the clouds (default "1000000 4000000")
#
# A section is a function section_NAME that calls `row` for each of its rows and is named in `sections`.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bin=build/release/bin
out=docs/speed.md
runs=3
counts="1000000 4000000"
sections=(neighbors estimate)
while getopts o:n:c: option; do
  case $option in
    o) out=$OPTARG ;;
    n) runs=$OPTARG ;;
    c) counts=$OPTARG ;;
    *) exit 2 ;;
  esac
done
shift $((OPTIND - 1))
[[ $# -gt 0 ]] && chosen=("$@") || chosen=("${sections[@]}")
for section in "${chosen[@]}"; do
  [[ " ${sections[*]} " == *" $section "* ]] || {
    echo "speed.sh: there is no section '$section'; there are: ${sections[*]}" >&2
    exit 2
  }
done
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# calc EXPRESSION [DIGITS]: its value.
calc() { awk "BEGIN { printf \"%.${2:-2}f\", $1 }"; }
# run COMMAND...: "ms WALL cpu_ms ALL-THREADS" of a whole process.
run() {
  local TIMEFORMAT='ms %R cpu_ms %U+%S' line
  line=$({ time "$@" > /dev/null 2>&3; } 3>&2 2>&1)
  awk '{ split($4, cpu, "+"); printf "ms %.1f cpu_ms %.1f\n", 1e3 * $2, 1e3 * (cpu[1] + cpu[2]) }' <<< "$line"
}
# best FILE FIELD: the least value of a field over the lines of a file.
best() { awk -v name="$2" '{ for (i = 1; i < NF; ++i) if ($i == name && (!n++ || $(i + 1) + 0 < b)) b = $(i + 1) + 0 }
  END { printf "%.1f", b }' "$1"; }
# row WORK OURS PEER_NAME PEER MUST AIM BOUND COMMAND: a row of the table. OURS and PEER are files of lines
# with "ms" and "cpu_ms", a line a run; the ratio is the peer's best by ours, in time and in work of all cores.
row() {
  local ours peer
  ours=$(best "$2" ms)
  peer=$(best "$4" ms)
  printf '| %s | %s ms | %s %s ms | %s x | %s x | %s | %s | %s | `%s` |\n' "$1" "$ours" "$3" "$peer" \
    "$(calc "$peer / $ours")" "$(calc "$(best "$4" cpu_ms) / $(best "$2" cpu_ms)")" "$5" "$6" "$7" "$8"
}

# k = 16 of all points, in random order and along the curve, beside FLANN and nanoflann.
section_neighbors() {
  local order count peer threads must aim log=$work/times command="neighbors_bench --work neighbors"
  for order in random morton; do
    for count in $counts; do
      "$bin/neighbors_bench" --work neighbors --count $count --order $order --repeats "$runs" > "$log"
      for peer in surfelkit flann nanoflann; do grep " $peer " "$log" > "$log.$peer" || true; done
      for peer in flann nanoflann; do
        must=- aim=-
        [[ $order$peer$count == randomflann1000000 ]] && must="3 x" aim="6 x"
        [[ $order$peer$count == randomflann4000000 ]] && must="4 x" aim="10 x"
        [[ -s $log.$peer ]] && row "k = 16 of $count points, $order order" "$log.surfelkit" $peer \
          "$log.$peer" "$must" "$aim" "arithmetic; sorting" "$command --count $count --order $order"
      done
    done
  done
  command="neighbors_bench --work our-neighbors --count $count"
  for threads in 1 2; do
    "$bin"/$command --repeats "$runs" --threads $threads > "$log.$threads"
  done
  row "the same on 2 threads, by 1 thread" "$log.2" "1 thread" "$log.1" "1.7 x" "1.95 x" "memory" "$command --threads 1"
}

# Whole processes, PLY in and out, beside PCL's normals alone.
section_estimate() {
  local count orient must aim log=$work/times command="surfel-estimate POINTS.ply -o OUT.ply"
  for count in $counts; do
    must=- aim=-
    [[ $count == 1000000 ]] && must="4 x" aim="8 x"
    [[ $count == 4000000 ]] && must="5 x" aim="10 x"
    "$bin/neighbors_bench" --count $count --write "$work/points.ply"
    rm -f "$log".*
    for ((i = 0; i < runs; ++i)); do
      "$bin/neighbors_bench" --work pcl-normals --count $count --repeats 1 >> "$log.pcl"
      for orient in mst none; do
        run "$bin/surfel-estimate" "$work/points.ply" -o "$work/out.ply" --orient $orient --quiet >> "$log.$orient"
      done
      run "$bin/surfel-estimate" "$work/points.ply" -o "$work/out.ply" --threads 1 --quiet >> "$log.one"
    done
    for orient in mst none; do
      row "surfel-estimate, $count points, random order, whole process, --orient $orient" "$log.$orient" \
        "PCL NormalEstimationOMP, kernel alone" "$log.pcl" "$must" "$aim" "arithmetic of the splat sizes" \
        "$command --orient $orient"
    done
    row "the same on 2 threads, by 1 thread" "$log.mst" "1 thread" "$log.one" "1.7 x" "1.95 x" \
      "the forest's last edges, on one core" "$command --threads 1"
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
  echo "$(sed -n 's/^model name[^:]*: //p' /proc/cpuinfo | head -1). Ratio: the peer's time by ours;"
  echo "ratio of work: of all cores' time, which a shared machine disturbs less."
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
    echo "| work | Surfelkit | peer | ratio | ratio of work | must | aim | bound by | command |"
    echo "|---|---|---|---|---|---|---|---|---|"
    cat "$rows"
  done
} > "$work/speed.md"
cp "$work/speed.md" "$out"
