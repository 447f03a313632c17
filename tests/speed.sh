#!/usr/bin/env bash
# Makes docs/speed.md: what Surfelkit takes and what its peers take beside it, in turns in one run, with
# the ratio, what it must reach and what it aims at. Needs a build with -DSURFEL_BUILD_BENCH=ON in
# build/release and an idle machine. Takes minutes.
#
# Usage: tests/speed.sh [SECTION]...   (default: all). Sections that are not run keep their rows.
#   -o FILE    instead of docs/speed.md
#   -n N       runs of each, of which the best counts (default 3)
#   -c COUNTS  points of the clouds (default "1000000 4000000")
#   -p PREFIX  words before every command that is timed: "chrt -f 50" keeps other programs from disturbing
#
#   render     frames, by Z: the loop that puts every point into one pixel of a z-buffer; Embree's discs
#   lod        the same with levels of detail, and growth from 1 to 32 million surfels (a few minutes, 5 GB of disk)
#   files      reading and whole processes, beside cat
#   memory     200 million surfels at --memory 2G (ten minutes, 8 GB of disk)
#   neighbors, estimate   beside FLANN, nanoflann, PCL
#
# A section is a function section_NAME that calls `row` for each of its rows and is named in `sections`.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bin=build/release/bin
out=docs/speed.md
runs=3
counts="1000000 4000000"
prefix=()
sections=(render lod files memory neighbors estimate)
while getopts o:n:c:p: option; do
  case $option in
    o) out=$OPTARG ;;
    n) runs=$OPTARG ;;
    c) counts=$OPTARG ;;
    p) read -ra prefix <<< "$OPTARG" ;;
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
# Threads of the peers' loops would otherwise keep a core busy for milliseconds after their turn.
export OMP_WAIT_POLICY=passive
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# calc EXPRESSION [DIGITS]: its value.
calc() { awk "BEGIN { printf \"%.${2:-2}f\", $1 }"; }
# run COMMAND...: "ms WALL cpu_ms ALL-THREADS" of a whole process.
run() {
  local TIMEFORMAT='ms %R cpu_ms %U+%S' line
  line=$({ time "${prefix[@]}" "$@" > /dev/null 2>&3; } 3>&2 2>&1)
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

# times_row WORK OURS PEER_NAME PEER UNIT MUST AIM BOUND COMMAND: a row that says how many times the peer's
# milliseconds ours are.
times_row() {
  printf '| %s | %.1f ms | %s %.1f ms | %s %s | - | %s | %s | %s | `%s` |\n' "$1" "$2" "$3" "$4" \
    "$(calc "$2 / $4" 1)" "$5" "$6" "$7" "$8" "$9"
}

views=6
# frames THREADS FILE [LOD_FILE]: means over views all around of a frame's milliseconds and of Z's.
frames() {
  local view
  for ((view = 0; view < views; ++view)); do
    "${prefix[@]}" "$bin/render_peers" "$2" --size 512x512 --turntable $views --view $view --threads "$1" \
      --repeats "$((2 * runs))" --unlit --no-embree ${3:+--lod "$3"}
  done | awk '{ sum[$1] += $5; ++n[$1] } END {
    printf "%.2f %.2f\n", sum["surfelkit"] / n["surfelkit"], sum["z-buffer"] / n["z-buffer"] }'
}
# thread_row TWO ONE BOUND COMMAND
thread_row() {
  printf '| the same, by 1 thread | %.1f ms | 1 thread %.1f ms | %s x | - | 1.7 x | 1.95 x | %s | `%s` |\n' \
    "$1" "$2" "$(calc "$2 / $1")" "$3" "$4 --threads 1"
}
# frame_rows WORK FILE MUST AIM BOUND OPTION...: a frame of render_peers by Z, by one thread, and by Embree's discs.
frame_rows() {
  local name=$1 file=$2 must=$3 aim=$4 bound=$5 threads spp two order peer
  shift 5
  local command=(render_peers "${file##*/}" --size 512x512 --unlit "$@")
  for threads in 1 2; do
    "${prefix[@]}" "$bin/render_peers" "$file" "${command[@]:2}" --threads $threads --repeats $((3 * runs)) > "$work/peers.$threads"
  done
  # time_of THREADS NAME
  time_of() { awk -v name="$2" '$1 == name { print $5 }' "$work/peers.$1"; }
  two=$(time_of 2 surfelkit)
  times_row "$name" "$two" "one pixel a point" "$(time_of 2 z-buffer)" Z "$must" "$aim" "$bound" "${command[*]}"
  thread_row "$two" "$(time_of 1 surfelkit)" "blocks of unequal work" "${command[*]}"
  [[ -n $(time_of 2 embree-trace-1spp) ]] || return 0
  # The targets are of discs in random order.
  for order in random space-filling; do
    [[ $order = random ]] && peer=embree-random || peer=embree
    for spp in 1 4; do
      printf '| the same, by Embree, discs in %s order, rays a pixel: %s | %.1f ms | trace alone %.1f ms | %s x | - | %s | %s | `%s` |\n' \
        $order $spp "$two" "$(time_of 2 "$peer-trace-${spp}spp")" \
        "$(calc "$(time_of 2 "$peer-trace-${spp}spp") / $two")" \
        "$([[ $order$spp = random1 ]] && echo "4 x | 6 x" || echo "- | -")" "$bound" "${command[*]}"
    done
  done
}

make_sphere() { [[ -f $work/sphere.ply ]] || "$bin/surfel-generate" sphere --count 1000000 -o "$work/sphere.ply" --quiet; }
make_terrain() {
  [[ -f $work/terrain.ply ]] || "$bin/surfel-generate" terrain --count 4782011 -o "$work/terrain.ply" --quiet
}

section_render() {
  local bound="arithmetic of the footprints"
  make_sphere
  make_terrain
  "$bin/surfel-generate" transparent --count 987552 -o "$work/transparent.ply" --quiet
  frame_rows "sphere, 1,000,000, one layer" "$work/sphere.ply" "3.5 Z" "2 Z" "$bound" --layers 1 --cull-back
  frame_rows "terrain, 4,782,011, 3 layers" "$work/terrain.ply" "6 Z" "4 Z" "$bound; the A-buffer" --layers 3 --no-embree
  frame_rows "transparent, 987,552, 3 layers" "$work/transparent.ply" "8 Z" "5 Z" "$bound; tests against layers" --layers 3 --no-embree
}

make_levels() {
  make_terrain
  [[ -f $work/terrain-lod.ply ]] || "$bin/surfel-lod" "$work/terrain.ply" -o "$work/terrain-lod.ply" --quiet
}

section_lod() {
  local count before ms one z psnr lod command
  make_levels
  for lod in on off; do
    "$bin/surfel-render" "$work/terrain-lod.ply" -o "$work/lod-$lod.exr" --size 512x512 --shading none --lod $lod --quiet
  done
  psnr=$("$bin/surfel-compare" "$work/lod-on.exr" "$work/lod-off.exr" --json | sed -n 's/.*"psnr": \([0-9.]*\).*/\1/p')
  read -r ms z < <(frames 2 "$work/terrain.ply" "$work/terrain-lod.ply")
  command="render_peers terrain.ply --lod terrain-lod.ply --size 512x512 --turntable $views --unlit"
  times_row "terrain, 4,782,011, 3 layers, --lod on, $(printf %.1f "$psnr") dB (must 42) against off" "$ms" "one pixel a point" \
    "$z" Z "1.5 Z" "0.8 Z" "arithmetic of the footprints" "$command"
  read -r one z < <(frames 1 "$work/terrain.ply" "$work/terrain-lod.ply")
  thread_row "$ms" "$one" "blocks of unequal work" "$command"
  before=
  for count in 1 2 4 8 16 32; do
    "$bin/surfel-generate" terrain --count ${count}000000 --no-uv -o "$work/grow.ply" --quiet
    "$bin/surfel-lod" "$work/grow.ply" -o "$work/grow-lod.ply" --quiet
    read -r ms z < <(views=1 frames 2 "$work/grow.ply" "$work/grow-lod.ply")
    [[ -z $before ]] || printf '| terrain, %s M, --lod on, by half as many | %.1f ms | half %.1f ms | %s | - | 1.3 x | 1 x | %s | `%s` |\n' \
      $count "$ms" "$before" "grows $(calc "$ms / $before") x" "pixels" "render_peers grow.ply --lod grow-lod.ply --size 512x512 --unlit"
    before=$ms
    rm "$work/grow.ply" "$work/grow-lod.ply"
  done
}

# cat_ms FILE: least time of cat FILE > /dev/null.
cat_ms() {
  local i
  for ((i = 0; i < runs + 2; ++i)); do run cat "$1"; done > "$work/cat"
  best "$work/cat" ms
}
section_files() {
  local i kind cat about
  make_levels
  "$bin/surfel-generate" terrain --count 4782011 --no-uv -o "$work/terrain-plain.ply" --quiet
  for kind in terrain terrain-plain terrain-lod; do
    cat=$(cat_ms "$work/$kind.ply")
    rm -f "$work/whole" "$work/load"
    for ((i = 0; i < runs; ++i)); do
      # A file that is replaced is written to the disk first, and that waits for others who use it.
      rm -f "$work/whole.png" "$work/whole.json"
      run "$bin/surfel-render" "$work/$kind.ply" -o "$work/whole.png" --size 512x512 --stats "$work/whole.json" --quiet \
        >> "$work/whole"
      sed -n 's/^  "load_ms": \(.*\),/ms \1 cpu_ms 0/p' "$work/whole.json" >> "$work/load"
    done
    if [[ $kind = terrain-lod ]]; then
      times_row "whole surfel-render, PLY to PNG, with uv and levels of detail" "$(best "$work/whole" ms)" "cat" "$cat" x "8 x" "4 x" \
        "the frame; PNG" "surfel-render $kind.ply -o whole.png --size 512x512"
      continue
    fi
    about=$([[ $kind = terrain ]] && echo "with uv and derivatives" || echo "without uv")
    times_row "binary PLY of 4,782,011 read, ready to render, $about" "$(best "$work/load" ms)" "cat" "$cat" x "3 x" "2 x" \
      "first touch of memory" "surfel-render --stats"
    times_row "whole surfel-render, PLY to PNG, $about" "$(best "$work/whole" ms)" "cat" "$cat" x "8 x" "4 x" \
      "the frame" "surfel-render $kind.ply -o whole.png --size 512x512"
  done
}

section_memory() {
  local cat peak
  "$bin/surfel-generate" terrain --no-uv --count 200000000 -o "$work/big.ply" --quiet
  cat=$(cat_ms "$work/big.ply")
  for ((i = 0; i < runs; ++i)); do
    run "$bin/surfel-render" "$work/big.ply" --memory 2G -o "$work/big.png" --size 512x512 --stats "$work/big.json" --quiet
  done > "$work/big.times"
  peak=$(sed -n 's/^  "peak_memory_bytes": \([0-9]*\).*/\1/p' "$work/big.json")
  times_row "200,000,000 surfels at --memory 2G, peak $((peak / 1000000)) MB (must 2500)" "$(best "$work/big.times" ms)" cat "$cat" x \
    "done" "2 x" "arithmetic of the footprints" "surfel-render big.ply --memory 2G --size 512x512"
  rm "$work/big.ply"
}

# k = 16 of all points, in random order and along the curve, beside FLANN and nanoflann.
section_neighbors() {
  local order count peer threads must aim log=$work/times command="neighbors_bench --work neighbors"
  for order in random morton; do
    for count in $counts; do
      "${prefix[@]}" "$bin/neighbors_bench" --work neighbors --count $count --order $order --repeats "$runs" > "$log"
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
    "${prefix[@]}" "$bin"/$command --repeats "$runs" --threads $threads > "$log.$threads"
  done
  row "the same on 2 threads, by 1 thread" "$log.2" "1 thread" "$log.1" "1.7 x" "1.95 x" "memory" "$command --threads 1"
}

# Whole processes, PLY in and out, beside PCL's normals alone.
section_estimate() {
  local count orient log_to must aim log=$work/times command="surfel-estimate POINTS.ply -o OUT.ply"
  # Into a new file: to put one in the place of another waits for the disk.
  estimate() { rm -f "$work/out.ply" && run "$bin/surfel-estimate" "$work/points.ply" -o "$work/out.ply" --quiet "$@"; }
  for count in $counts; do
    must=- aim=-
    [[ $count == 1000000 ]] && must="4 x" aim="8 x"
    [[ $count == 4000000 ]] && must="5 x" aim="10 x"
    "$bin/neighbors_bench" --count $count --write "$work/points.ply"
    rm -f "$log" "$log".*
    for ((i = 0; i < runs; ++i)); do
      "${prefix[@]}" "$bin/neighbors_bench" --work pcl-normals --count $count --repeats 1 >> "$log.pcl"
      # The first run of a process after another's may get memory that the system has to fetch and clear
      # first, and takes up to a third longer: it does not count.
      for orient in mst none; do
        for log_to in /dev/null "$log.$orient"; do
          estimate --orient $orient >> "$log_to"
        done
      done
      estimate --threads 1 >> "$log.one"
    done
    for orient in mst none; do
      row "surfel-estimate, $count points, random order, whole process, --orient $orient" "$log.$orient" \
        "PCL NormalEstimationOMP, kernel alone" "$log.pcl" "$must" "$aim" "arithmetic: cells, neighbours, forest; first touch of memory" \
        "$command --orient $orient"
    done
    row "the same on 2 threads, by 1 thread" "$log.mst" "1 thread" "$log.one" "1.7 x" "1.95 x" \
      "first touch of memory; the forest's last edges" "$command --threads 1"
  done
}

for section in "${chosen[@]}"; do
  echo "speed.sh: $section" >&2
  "section_$section" > "$work/$section.rows"
done
grep -qw avx512dq /proc/cpuinfo && instructions=AVX-512 || instructions="no AVX-512"
# Sections that were not run stay as they are.
{
  echo "# Speed: measured"
  echo
  echo "Made by \`tests/speed.sh\`: best of several runs, Surfelkit and its peers in turns, $(nproc) threads,"
  echo "$(sed -n 's/^model name[^:]*: //p' /proc/cpuinfo | head -1), $instructions. Ratio: the peer's time by ours;"
  echo "ratio of work: of all cores' time, which a shared machine disturbs less."
  for section in "${sections[@]}"; do
    rows=$work/$section.rows
    if [[ -s $rows ]]; then
      echo
      echo "## $section"
      echo
      echo "Best of $runs runs or more."
      echo
      echo "| work | Surfelkit | peer | ratio | ratio of work | must | aim | bound by | command |"
      echo "|---|---|---|---|---|---|---|---|---|"
      cat "$rows"
    elif [[ -f $out ]] && grep -qx "## $section" "$out"; then
      echo
      awk -v title="## $section" '/^## / { on = $0 == title; blank = "" }
        on && /^$/ { blank = blank "\n" }
        on && !/^$/ { printf "%s%s\n", blank, $0; blank = "" }' "$out"
    fi
  done
} > "$work/speed.md"
cp "$work/speed.md" "$out"
