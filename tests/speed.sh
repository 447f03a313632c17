#!/usr/bin/env bash
# Makes docs/speed.md: the time that Surfelkit takes, the time of its peers, in turns in one run, and the
# ratio. Needs a build with -DSURFEL_BUILD_BENCH=ON in build/release and an idle machine. Takes minutes.
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
#   scale      from LAS to levels of detail at --memory 2G: 10 and 100 million points (half an hour, 45 GB of disk)
#   neighbors, estimate   beside FLANN, nanoflann, PCL
#   gaussians  frames of trained splats, beside a plain loop
#
# A section is a function section_NAME that calls `row` for each of its rows and is named in `sections`.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bin=build/release/bin
out=docs/speed.md
runs=3
counts="1000000 4000000"
prefix=()
sections=(render lod files memory scale neighbors estimate gaussians)
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
# run COMMAND...: "ms WALL" of a whole process.
run() {
  local TIMEFORMAT=%R line
  line=$({ time "${prefix[@]}" "$@" > /dev/null 2>&3; } 3>&2 2>&1)
  awk '{ printf "ms %.1f\n", 1e3 * $1 }' <<< "$line"
}
# best FILE FIELD: the least value of a field over the lines of a file.
best() { awk -v name="$2" '{ for (i = 1; i < NF; ++i) if ($i == name && (!n++ || $(i + 1) + 0 < b)) b = $(i + 1) + 0 }
  END { printf "%.1f", b }' "$1"; }
# row WORK OURS PEER_NAME PEER COMMAND: a row of the table. OURS and PEER are files of lines with "ms", a line
# a run; the ratio is the peer's best by ours.
row() {
  local ours peer
  ours=$(best "$2" ms)
  peer=$(best "$4" ms)
  printf '| %s | %s ms | %s %s ms | %s x | `%s` |\n' "$1" "$ours" "$3" "$peer" "$(calc "$peer / $ours")" "$5"
}

# times_row WORK OURS PEER_NAME PEER UNIT COMMAND: a row that says how many times the peer's milliseconds
# ours are: UNIT names the peer.
times_row() {
  printf '| %s | %.1f ms | %s %.1f ms | %s %s | `%s` |\n' "$1" "$2" "$3" "$4" "$(calc "$2 / $4" 1)" "$5" "$6"
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
# thread_row WORK TWO ONE COMMAND
thread_row() {
  printf '| %s, 2 threads | %.1f ms | 1 thread %.1f ms | %s x | `%s` |\n' \
    "$1" "$2" "$3" "$(calc "$3 / $2")" "$4 --threads 1"
}
# frame_rows WORK FILE OPTION...: a frame of render_peers by Z, by one thread, and by Embree's discs.
frame_rows() {
  local name=$1 file=$2 threads spp two order peer
  shift 2
  local command=(render_peers "${file##*/}" --size 512x512 --unlit "$@")
  for threads in 1 2; do
    "${prefix[@]}" "$bin/render_peers" "$file" "${command[@]:2}" --threads $threads --repeats $((3 * runs)) > "$work/peers.$threads"
  done
  # time_of THREADS NAME
  time_of() { awk -v name="$2" '$1 == name { print $5 }' "$work/peers.$1"; }
  two=$(time_of 2 surfelkit)
  times_row "$name" "$two" "one pixel a point" "$(time_of 2 z-buffer)" Z "${command[*]}"
  thread_row "$name" "$two" "$(time_of 1 surfelkit)" "${command[*]}"
  [[ -n $(time_of 2 embree-trace-1spp) ]] || return 0
  for order in random space-filling; do
    [[ $order = random ]] && peer=embree-random || peer=embree
    for spp in 1 4; do
      printf '| %s | %.1f ms | Embree, discs in %s order, rays a pixel: %s, trace alone %.1f ms | %s x | `%s` |\n' \
        "$name" "$two" $order $spp "$(time_of 2 "$peer-trace-${spp}spp")" \
        "$(calc "$(time_of 2 "$peer-trace-${spp}spp") / $two")" "${command[*]}"
    done
  done
}

make_sphere() { [[ -f $work/sphere.ply ]] || "$bin/surfel-generate" sphere --count 1000000 -o "$work/sphere.ply" --quiet; }
make_terrain() {
  [[ -f $work/terrain.ply ]] || "$bin/surfel-generate" terrain --count 4782011 -o "$work/terrain.ply" --quiet
}

section_render() {
  make_sphere
  make_terrain
  "$bin/surfel-generate" transparent --count 987552 -o "$work/transparent.ply" --quiet
  frame_rows "sphere, 1,000,000, one layer" "$work/sphere.ply" --layers 1 --cull-back
  frame_rows "terrain, 4,782,011, 3 layers" "$work/terrain.ply" --layers 3 --no-embree
  frame_rows "transparent, 987,552, 3 layers" "$work/transparent.ply" --layers 3 --no-embree
}

make_levels() {
  make_terrain
  [[ -f $work/terrain-lod.ply ]] || "$bin/surfel-lod" "$work/terrain.ply" -o "$work/terrain-lod.ply" --quiet
}

section_lod() {
  local count before ms one z psnr lod about command
  make_levels
  for lod in on off; do
    "$bin/surfel-render" "$work/terrain-lod.ply" -o "$work/lod-$lod.exr" --size 512x512 --from 0,0.36,1 --shading none --lod $lod --quiet
  done
  psnr=$("$bin/surfel-compare" "$work/lod-on.exr" "$work/lod-off.exr" --json | sed -n 's/.*"psnr": \([0-9.]*\).*/\1/p')
  read -r ms z < <(frames 2 "$work/terrain.ply" "$work/terrain-lod.ply")
  command="render_peers terrain.ply --lod terrain-lod.ply --size 512x512 --turntable $views --unlit"
  about="terrain, 4,782,011, 3 layers, --lod on, $(printf %.1f "$psnr") dB against off"
  times_row "$about" "$ms" "one pixel a point" "$z" Z "$command"
  read -r one z < <(frames 1 "$work/terrain.ply" "$work/terrain-lod.ply")
  thread_row "$about" "$ms" "$one" "$command"
  before=
  for count in 1 2 4 8 16 32; do
    "$bin/surfel-generate" terrain --count ${count}000000 --no-uv -o "$work/grow.ply" --quiet
    "$bin/surfel-lod" "$work/grow.ply" -o "$work/grow-lod.ply" --quiet
    read -r ms z < <(views=1 frames 2 "$work/grow.ply" "$work/grow-lod.ply")
    [[ -z $before ]] || printf '| terrain, %s M, --lod on | %.1f ms | half as many surfels %.1f ms | %s | `%s` |\n' \
      $count "$ms" "$before" "grows $(calc "$ms / $before") x" "render_peers grow.ply --lod grow-lod.ply --size 512x512 --unlit"
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
      run "$bin/surfel-render" "$work/$kind.ply" -o "$work/whole.png" --size 512x512 --from 0,0.36,1 --stats "$work/whole.json" --quiet \
        >> "$work/whole"
      sed -n 's/^  "load_ms": \(.*\),/ms \1/p' "$work/whole.json" >> "$work/load"
    done
    if [[ $kind = terrain-lod ]]; then
      times_row "whole surfel-render, PLY to PNG, with uv and levels of detail" "$(best "$work/whole" ms)" "cat" "$cat" x \
        "surfel-render $kind.ply -o whole.png --size 512x512 --from 0,0.36,1"
      continue
    fi
    about=$([[ $kind = terrain ]] && echo "with uv and derivatives" || echo "without uv")
    times_row "binary PLY of 4,782,011 read, ready to render, $about" "$(best "$work/load" ms)" "cat" "$cat" x \
      "surfel-render $kind.ply -o whole.png --size 512x512 --from 0,0.36,1 --stats whole.json"
    times_row "whole surfel-render, PLY to PNG, $about" "$(best "$work/whole" ms)" "cat" "$cat" x \
      "surfel-render $kind.ply -o whole.png --size 512x512 --from 0,0.36,1"
  done
}

section_memory() {
  local cat peak
  "$bin/surfel-generate" terrain --no-uv --count 200000000 -o "$work/big.ply" --quiet
  cat=$(cat_ms "$work/big.ply")
  for ((i = 0; i < runs; ++i)); do
    run "$bin/surfel-render" "$work/big.ply" --memory 2G -o "$work/big.png" --size 512x512 --from 0,0.36,1 --stats "$work/big.json" --quiet
  done > "$work/big.times"
  peak=$(sed -n 's/^  "peak_memory_bytes": \([0-9]*\).*/\1/p' "$work/big.json")
  times_row "200,000,000 surfels at --memory 2G, peak $((peak / 1000000)) MB" "$(best "$work/big.times" ms)" cat "$cat" x \
    "surfel-render big.ply --memory 2G --size 512x512 --from 0,0.36,1"
  rm "$work/big.ply"
}

# From LAS, whose third axis points up, to levels of detail in bounded memory: time beside a tenth of the points, peak
# memory, and bytes written for each that is read.
section_scale() {
  local count step peak scratch written from to words
  local -A ms tool=([sort]="surfel-convert --sort curve" [estimate]="surfel-estimate --orient up" [lod]="surfel-lod")
  local -A input=([sort]=points.las [estimate]=sorted.ply [lod]=surfels.ply) output=([sort]=sorted.ply [estimate]=surfels.ply [lod]=levels.ply)
  field() { sed -n "s/^  \"$1\": \([0-9]*\).*/\1/p" "$work/scale.json"; }
  for count in 10000000 100000000; do
    "$bin/surfel-generate" terrain --no-uv --count $count -o "$work/terrain-$count.ply" --quiet
    "$bin/surfel-convert" "$work/terrain-$count.ply" --keep-columns color --rotate 1,0,0,90 -o "$work/points.las" --quiet
    rm "$work/terrain-$count.ply"
    for step in sort estimate lod; do
      read -ra words <<< "${tool[$step]}"
      from=${input[$step]} to=${output[$step]}
      ms[$step.$count]=$(run "$bin/${words[0]}" "${words[@]:1}" "$work/$from" -o "$work/$to" --memory 2G --stats "$work/scale.json" --quiet)
      ms[$step.$count]=${ms[$step.$count]#ms }
      peak=$(field peak_memory_bytes) scratch=$(field scratch_bytes)
      written=$(calc "(${scratch:-0} + $(stat -c %s "$work/$to")) / $(stat -c %s "$work/$from")" 1)
      rm "$work/$from"
      [[ $count = 100000000 ]] || continue
      times_row "100,000,000 points, peak $((peak / 1000000)) MB, $written bytes written for each read" "${ms[$step.$count]}" \
        "10,000,000 points" "${ms[$step.10000000]}" "x (10 is linear)" "${tool[$step]} $from -o $to --memory 2G"
    done
    rm "$work/levels.ply"
  done
}

# k = 16 of all points, in random order and along the curve, beside FLANN and nanoflann.
section_neighbors() {
  local order count peer threads log=$work/times command="neighbors_bench --work neighbors"
  for order in random morton; do
    for count in $counts; do
      "${prefix[@]}" "$bin/neighbors_bench" --work neighbors --count $count --order $order --repeats "$runs" > "$log"
      for peer in surfelkit flann nanoflann; do grep " $peer " "$log" > "$log.$peer" || true; done
      for peer in flann nanoflann; do
        [[ -s $log.$peer ]] && row "k = 16 of $count points, $order order" "$log.surfelkit" $peer \
          "$log.$peer" "$command --count $count --order $order"
      done
    done
  done
  command="neighbors_bench --work our-neighbors --count $count"
  for threads in 1 2; do
    "${prefix[@]}" "$bin"/$command --repeats "$runs" --threads $threads > "$log.$threads"
  done
  row "k = 16 of $count points, random order, 2 threads" "$log.2" "1 thread" "$log.1" "$command --threads 1"
}

# Whole processes, PLY in and out, beside PCL's normals alone.
section_estimate() {
  local count orient log_to log=$work/times command="surfel-estimate POINTS.ply -o OUT.ply"
  # Into a new file: to put one in the place of another waits for the disk.
  estimate() { rm -f "$work/out.ply" && run "$bin/surfel-estimate" "$work/points.ply" -o "$work/out.ply" --quiet "$@"; }
  for count in $counts; do
    "$bin/neighbors_bench" --count $count --write "$work/points.ply"
    rm -f "$log" "$log".*
    for ((i = 0; i < runs; ++i)); do
      "${prefix[@]}" "$bin/neighbors_bench" --work pcl-normals --count $count --repeats 1 >> "$log.pcl"
      # The first run of a process after another's may get memory that the system has to fetch and clear
      # first, and takes up to a third longer: it does not count.
      for orient in auto none; do
        for log_to in /dev/null "$log.$orient"; do
          estimate --orient $orient >> "$log_to"
        done
      done
      estimate --threads 1 >> "$log.one"
    done
    for orient in auto none; do
      row "surfel-estimate, $count points, random order, whole process, --orient $orient" "$log.$orient" \
        "PCL NormalEstimationOMP, kernel alone" "$log.pcl" "$command --orient $orient"
    done
    row "surfel-estimate, $count points, random order, whole process, 2 threads" "$log.auto" "1 thread" "$log.one" \
      "$command --threads 1"
  done
}

section_gaussians() {
  local profile loop
  build/release/bench/gaussian_bench --benchmark_repetitions="$runs" 2> /dev/null |
    awk '/real_time / { print $1, "ms", $2 }' > "$work/gaussians.log"
  grep '^plain_loop' "$work/gaussians.log" > "$work/gaussians.loop"
  for profile in kInria kGsplat kMip k2dgs kExact; do
    grep "$profile>/500000" "$work/gaussians.log" > "$work/gaussians.ours"
    row "500,000 Gaussians, 1920 x 1080, profile $profile" "$work/gaussians.ours" \
      "plain loop of profile inria, -O3, AVX2, 2 threads" "$work/gaussians.loop" "gaussian_bench"
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
  echo "$(sed -n 's/^model name[^:]*: //p' /proc/cpuinfo | head -1), $instructions."
  cat tests/speed_notes.md
  for section in "${sections[@]}"; do
    rows=$work/$section.rows
    if [[ -s $rows ]]; then
      echo
      echo "## $section"
      echo
      echo "Best of $runs runs or more."
      echo
      echo "| work | Surfelkit | peer | ratio | command |"
      echo "|---|---|---|---|---|"
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
