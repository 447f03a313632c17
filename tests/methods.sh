#!/usr/bin/env bash
# Makes docs/methods.md and docs/methods.png: the rendering methods of SP06 beside the A-buffer, depth peeling and the
# reference (SP06 figures 8, 9 and 12). Takes minutes. Usage: tests/methods.sh [folder of the tools] [output]
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
tools=${1:-$root/build/release/bin}
out=${2:-$root/docs/methods.md}
command -v oiiotool >/dev/null || { echo "oiiotool is missing: apt-get install openimageio-tools" >&2; exit 1; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
view=(--size 400x400 --shading none --threads 2 --quiet)

# render NAME SURFELS OPTION...: the picture NAME.exr.
render() {
  local name=$1 surfels=$2
  shift 2
  "$tools/surfel-render" "$work/$surfels.ply" -o "$work/$name.exr" "${view[@]}" "$@"
}

# psnr A B: of two pictures, whole.
psnr() {
  "$tools/surfel-compare" "$work/$1.exr" "$work/$2.exr" --json |
    sed -n 's/.*"psnr": \([0-9.]*\|null\).*/\1/p' | head -1 | awk '{ if ($1 == "null") print "same"; else printf "%.1f", $1 }'
}

# milliseconds SURFELS OPTION...: of the fastest of nine frames.
milliseconds() {
  local surfels=$1
  shift
  "$tools/surfel-render" "$work/$surfels.ply" -o "$work/t%d.exr" "${view[@]}" --turntable 9 --stats "$work/s.json" "$@"
  sed -n 's/^ *"ms": \([0-9.]*\).*/\1/p' "$work/s.json" | sort -g | head -1 | awk '{printf "%.0f ms", $1}'
}

# groups_of STATS
groups_of() { sed -n 's/.*"groups": \([0-9]*\).*/\1/p' "$1" | head -1; }

overlaps=(1.0 0.8 0.6 0.4)
opaque_tables() {
  echo "| surfels | method | K | against abuffer | against --reference | frame |"
  echo "|---|---|---|---|---|---|"
  local scene overlap voronoi
  for scene in sphere head; do
    "$tools/surfel-generate" "$scene" --count 100000 -o "$work/$scene.ply" --quiet
    render "$scene-reference" "$scene" --reference --samples 8
    render "$scene-abuffer" "$scene"
    echo "| $scene | abuffer | | | $(psnr "$scene-abuffer" "$scene-reference") dB | $(milliseconds "$scene") |"
    for overlap in "${overlaps[@]}"; do
      "$tools/surfel-group" "$work/$scene.ply" --overlap "$overlap" -o "$work/$scene-$overlap.ply" --stats "$work/g.json" --quiet
      for voronoi in windowed quantised off; do
        local name=$scene-$overlap-$voronoi
        render "$name" "$scene-$overlap" --method deferred --voronoi "$voronoi"
        echo "| $scene | deferred, overlap $overlap, $voronoi | $(groups_of "$work/g.json") | $(psnr "$name" "$scene-abuffer") dB | $(psnr "$name" "$scene-reference") dB | $(milliseconds "$scene-$overlap" --method deferred --voronoi "$voronoi") |"
      done
    done
  done
}

transparent_table() {
  "$tools/surfel-generate" transparent --count 60000 -o "$work/t.ply" --quiet
  "$tools/surfel-group" "$work/t.ply" --groups 4 --cover enlarge-each -o "$work/tg.ply" --quiet
  render t-reference t --reference --samples 8
  render t-depth-peel t --method depth-peel --peel 16
  render t-abuffer t --layers 16
  render t-transparent-high tg --method transparent-high
  render t-transparent tg --method transparent
  echo "| method | against depth peeling | against --reference | frame |"
  echo "|---|---|---|---|"
  local row
  for row in "abuffer t --layers 16" "depth-peel t --method depth-peel --peel 16" \
    "transparent-high tg --method transparent-high" "transparent tg --method transparent"; do
    # shellcheck disable=SC2086  # words
    set -- $row
    local name=$1 surfels=$2
    shift 2
    echo "| $name | $( [ "$name" = depth-peel ] || echo "$(psnr "t-$name" t-depth-peel) dB") | $(psnr "t-$name" t-reference) dB | $(milliseconds "$surfels" "$@") |"
  done
}

{
  echo "# The methods of SP06: measured"
  echo
  echo "Made by \`tests/methods.sh\`. PSNR of sRGB values, whole pictures of 400 x 400 pixels, c = 1, unlit, 2 threads; time of the fastest of nine frames."
  echo
  echo "![Methods](methods.png)"
  echo
  echo "Above: the A-buffer, \`deferred\` at overlap 1.0 and at 0.4 (SP06 figure 8). Middle: overlap 0.4 near by, without Voronoi rasterisation,"
  echo "quantised (10), windowed (figure 9). Below: depth peeling, \`transparent-high\`, \`transparent\` with four groups (figure 12)."
  echo
  echo "## Deferred blending of opaque surfaces (Algorithm 1)"
  echo
  opaque_tables
  echo
  echo "## Transparent surfaces (Algorithms 2 and 3)"
  echo
  echo "60,000 surfels of nested and intersecting surfaces; four groups, \`--cover enlarge-each\`."
  echo
  transparent_table
  echo
  cat "$root/tests/methods_notes.md"
} > "$out"

tiles=()
tile() {
  local name=$1 surfels=$2
  shift 2
  "$tools/surfel-render" "$work/$surfels.ply" -o "$work/$name.png" --size 256x256 --quiet --background 1,1,1,1 "$@"
  tiles+=("$work/$name.png")
}
tile a1 head
tile a2 head-1.0 --method deferred
tile a3 head-0.4 --method deferred
near=(--zoom 12 --method deferred)
tile b1 head-0.4 "${near[@]}" --voronoi off
tile b2 head-0.4 "${near[@]}" --voronoi quantised
tile b3 head-0.4 "${near[@]}" --voronoi windowed
tile c1 t --method depth-peel --peel 16
tile c2 tg --method transparent-high
tile c3 tg --method transparent
oiiotool "${tiles[@]}" --mosaic:pad=2 3x3 -o "$(dirname "$out")/methods.png"
