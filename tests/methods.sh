#!/usr/bin/env bash
# Makes docs/methods.md, docs/methods.png, docs/balls.png and docs/refraction.png: the rendering methods of SP06 beside the A-buffer, depth
# peeling and the reference (SP06 figures 1, 8, 9, 12, 13 and 14). Needs the real data, and a build with SURFEL_BUILD_BENCH.
# Takes minutes. Usage: tests/methods.sh [folder of the tools] [output]
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
tools=${1:-$root/build/release/bin}
out=${2:-$root/docs/methods.md}
command -v oiiotool >/dev/null || { echo "oiiotool is missing: apt-get install openimageio-tools" >&2; exit 1; }
data=${SURFEL_TEST_DATA:-$root/../shared/data}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
view=(--size 400x400 --from 0,0.36,1 --shading none --threads 2 --quiet)

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

# What is timed does not wait for other programs, where that is allowed.
first=()
if chrt -f 50 true 2> /dev/null; then first=(chrt -f 50); fi

# milliseconds SURFELS OPTION...: of the fastest of nine frames.
milliseconds() {
  local surfels=$1
  shift
  "${first[@]}" "$tools/surfel-render" "$work/$surfels.ply" -o "$work/t%d.exr" "${view[@]}" --turntable 9 --stats "$work/s.json" "$@"
  sed -n 's/^ *"ms": \([0-9.]*\).*/\1/p' "$work/s.json" | sort -g | head -1 | awk '{printf "%.0f ms", $1}'
}

# groups_of STATS
groups_of() { sed -n 's/.*"groups": \([0-9]*\).*/\1/p' "$1" | head -1; }

overlaps=(1.0 0.8 0.6 0.4)
opaque_tables() {
  echo "| surfels | method | K | against abuffer | against --reference |"
  echo "|---|---|---|---|---|"
  local scene overlap voronoi
  for scene in sphere head; do
    "$tools/surfel-generate" "$scene" --count 100000 -o "$work/$scene.ply" --quiet
    render "$scene-reference" "$scene" --reference --samples 8
    render "$scene-abuffer" "$scene"
    echo "| $scene | abuffer | | | $(psnr "$scene-abuffer" "$scene-reference") dB |"
    local layers
    for layers in 3 1; do
      render "$scene-two-pass-$layers" "$scene" --method two-pass --layers "$layers"
      echo "| $scene | two-pass, --layers $layers | | $(psnr "$scene-two-pass-$layers" "$scene-abuffer") dB | $(psnr "$scene-two-pass-$layers" "$scene-reference") dB |"
    done
    for overlap in "${overlaps[@]}"; do
      "$tools/surfel-group" "$work/$scene.ply" --overlap "$overlap" -o "$work/$scene-$overlap.ply" --stats "$work/g.json" --quiet
      for voronoi in windowed quantised off; do
        local name=$scene-$overlap-$voronoi
        render "$name" "$scene-$overlap" --method deferred --voronoi "$voronoi"
        echo "| $scene | deferred, overlap $overlap, $voronoi | $(groups_of "$work/g.json") | $(psnr "$name" "$scene-abuffer") dB | $(psnr "$name" "$scene-reference") dB |"
      done
    done
  done
}

# one_pass_less_row SURFELS METHOD FILE OPTION...: what the passes of a picture take.
one_pass_less_row() {
  local surfels=$1 method=$2 file=$3 key counts=""
  shift 3
  "$tools/surfel-render" "$work/$file.ply" -o "$work/p.exr" "${view[@]}" --stats "$work/p.json" "$@"
  for key in geometry_passes splats fragments; do
    counts+=" $(sed -n "s/.*\"$key\": \([0-9]*\).*/\1/p" "$work/p.json" | head -1) |"
  done
  echo "| $surfels | $method |$counts"
}

# Two passes over the geometry beside one.
one_pass_less_table() {
  echo "| surfels | method | geometry passes | splats | fragments |"
  echo "|---|---|---|---|---|"
  local scene
  "$tools/surfel-generate" sphere --count 1000000 -o "$work/million.ply" --quiet
  for scene in sphere head million; do
    [ -e "$work/$scene-0.4.ply" ] || "$tools/surfel-group" "$work/$scene.ply" --overlap 0.4 -o "$work/$scene-0.4.ply" --quiet
    one_pass_less_row "$scene" two-pass "$scene" --method two-pass
    one_pass_less_row "$scene" "two-pass, --layers 1" "$scene" --method two-pass --layers 1
    one_pass_less_row "$scene" "deferred, overlap 0.4" "$scene-0.4" --method deferred
    one_pass_less_row "$scene" "deferred, overlap 0.4, --layers 1" "$scene-0.4" --method deferred --layers 1
    one_pass_less_row "$scene" abuffer "$scene"
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
  render t-transparent-high-group tg --method transparent-high --layers-by group
  render t-transparent-group tg --method transparent --layers-by group
  echo "| method | against depth peeling | against --reference |"
  echo "|---|---|---|"
  local name
  for name in abuffer depth-peel transparent-high transparent transparent-high-group transparent-group; do
    echo "| ${name/%-group/, \`--layers-by group\`} | $( [ "$name" = depth-peel ] || echo "$(psnr "t-$name" t-depth-peel) dB") | $(psnr "t-$name" t-reference) dB |"
  done
}

# Times of one thread; the surfels are made by the tables before.
times_table() {
  local view=(--size 400x400 --from 0,0.36,1 --shading none --threads 1 --quiet)
  echo "| surfels | method | frame |"
  echo "|---|---|---|"
  local scene row name surfels
  for scene in sphere head; do
    echo "| $scene | abuffer | $(milliseconds "$scene") |"
    echo "| $scene | two-pass | $(milliseconds "$scene" --method two-pass) |"
    echo "| $scene | deferred, overlap 1.0 | $(milliseconds "$scene-1.0" --method deferred) |"
    echo "| $scene | deferred, overlap 0.4 | $(milliseconds "$scene-0.4" --method deferred) |"
  done
  for row in "abuffer t --layers 16" "depth-peel t --method depth-peel --peel 16" \
    "transparent-high tg --method transparent-high" "transparent tg --method transparent" \
    "transparent-high-group tg --method transparent-high --layers-by group" "transparent-group tg --method transparent --layers-by group"; do
    # shellcheck disable=SC2086  # words
    set -- $row
    name=$1
    surfels=$2
    shift 2
    echo "| transparent | ${name/%-group/, \`--layers-by group\`} | $(milliseconds "$surfels" "$@") |"
  done
}

# Share of the pixels where steps of the depth change the picture by more than a level of 8 bits.
seam_table() {
  echo "| surfels | overlap 1.0 | 0.8 | 0.6 | 0.4 |"
  echo "|---|---|---|---|---|"
  local scene overlap row
  for scene in sphere head; do
    row="| $scene |"
    for overlap in "${overlaps[@]}"; do
      row+=$("$tools/surfel-compare" "$work/$scene-$overlap-quantised.exr" "$work/$scene-$overlap-windowed.exr" --json |
        sed -n 's/.*"beyond": \([0-9.e-]*\).*/\1/p' | awk '{printf " %.1f %% |", 100 * $1}')
    done
    echo "$row"
  done
}

# A bunny with three balls inside; `balls` and `balls-g`, in groups.
make_balls() {
  "$tools/surfel-from-mesh" "$data/meshes/stanford_bunny.obj" --count 150000 --variance-scale 1 -o "$work/body.ply" --quiet
  "$tools/surfel-generate" sphere --count 20000 -o "$work/ball.ply" --quiet
  local files=()
  while read -r name scale place; do
    "$tools/surfel-convert" "$work/ball.ply" --scale "$scale" --translate="$place" -o "$work/$name.ply" --quiet
    files+=("$work/$name.ply")
  done <<'PLACES'
large 0.024 -0.042,0.072,0.004
middle 0.019 0.006,0.068,0.006
small 0.015 -0.06,0.135,0.004
PLACES
  "$tools/surfel-convert" "$work/body.ply" "${files[@]}" --material 0,1,1,1 -o "$work/balls.ply" --quiet
  "$tools/surfel-group" "$work/balls.ply" --groups 4 --cover enlarge-each -o "$work/balls-g.ply" --quiet
  "$tools/surfel-group" "$work/body.ply" --groups 4 --cover enlarge-each -o "$work/body-g.ply" --quiet
}

# lit_row NAME SURFELS TRUTH OPTION...: a picture with a scene, and how far it is from another.
lit_row() {
  local name=$1 surfels=$2 truth=$3
  shift 3
  render "$name" "$surfels" "$@"
  echo "| $name | $( [ "$name" = "$truth" ] || echo "$(psnr "$name" "$truth") dB") |"
}

body_tables() {
  local view=(--size 400x400 --threads 2 --quiet --from "0.1,0.25,1" --fov 30 --frame-all)
  local scene
  make_balls
  "$tools/surfel-from-mesh" "$data/meshes/dragon_vrip_res2.ply" --count 200000 --variance-scale 1 -o "$work/dragon.ply" --quiet
  "$tools/surfel-group" "$work/dragon.ply" --groups 4 --cover enlarge-each -o "$work/dragon-g.ply" --quiet
  echo "| picture | against depth peeling |"
  echo "|---|---|"
  for scene in "balls balls" "balls glass-balls" "body glass" "dragon glass"; do
    # shellcheck disable=SC2086  # words
    set -- $scene
    local with=(--scene "$root/configs/scene-$2.toml")
    lit_row "$1, scene-$2, depth-peel" "$1" "$1, scene-$2, depth-peel" --method depth-peel --peel 16 "${with[@]}"
    lit_row "$1, scene-$2, transparent-high" "$1-g" "$1, scene-$2, depth-peel" --method transparent-high "${with[@]}"
    lit_row "$1, scene-$2, transparent" "$1-g" "$1, scene-$2, depth-peel" --method transparent "${with[@]}"
    lit_row "$1, scene-$2, transparent-high, by group" "$1-g" "$1, scene-$2, depth-peel" --method transparent-high --layers-by group "${with[@]}"
    lit_row "$1, scene-$2, transparent, by group" "$1-g" "$1, scene-$2, depth-peel" --method transparent --layers-by group "${with[@]}"
    lit_row "$1, scene-$2, abuffer" "$1" "$1, scene-$2, depth-peel" --layers 16 "${with[@]}"
  done
}

{
  echo "# The methods of SP06"
  echo
  echo "Made by \`tests/methods.sh\`. PSNR of sRGB values, whole pictures of 400 x 400 pixels, c = 1, unlit. SP06 is"
  echo "*Single-Pass Point Rendering and Transparent Shading* (Zhang, Pajarola 2006); [rendering.md](rendering.md) shows the commands."
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
  cat <<'TEXT'
## One pass less (SP06 table 2)

`two-pass` finds depths in one pass over the splats and adds up attributes in another; `deferred` has one. Fragments are pixels of splats with
beta < c that were evaluated, in all passes. Splats are set up once, for both passes: they stay in the cache. `million` has 1,000,000 surfels,
some eleven a pixel.

TEXT
  one_pass_less_table
  echo
  echo "## Transparent surfaces (Algorithms 2 and 3)"
  echo
  echo "60,000 surfels of nested and intersecting surfaces; four groups, \`--cover enlarge-each\`."
  echo
  transparent_table
  echo
  cat <<'TEXT'
## Quantised depth: its seams counted

Share of the pixels of the picture that `--voronoi quantised` changes, against `windowed`, by more than a level of 8 bits: surfaces
are split where they cross a step of the depth.

TEXT
  seam_table
  cat <<'TEXT'

## Opaque things in transparent bodies, glass (SP06 figures 1, 13 and 14)

![A bunny with balls inside](balls.png)

Above: `transparent`, `transparent-high`, depth peeling with `configs/scene-balls.toml`. Below, with `scene-glass-balls.toml`:
`transparent-high` with `--refraction single` and `multi`, and depth peeling, `multi`. The first picture is made by

```
surfel-from-mesh stanford_bunny.obj --count 150000 --variance-scale 1 -o body.ply
surfel-generate sphere --count 20000 -o ball.ply
surfel-convert ball.ply --scale 0.024 --translate=-0.042,0.072,0.004 -o large.ply    # and two more
surfel-convert body.ply large.ply middle.ply small.ply --material 0,1,1,1 -o balls.ply
surfel-group balls.ply --groups 4 --cover enlarge-each -o balls-g.ply
surfel-render balls-g.ply --method transparent --scene configs/scene-balls.toml --from 0.1,0.25,1 --fov 30 --frame-all -o b.png
```

TEXT
  echo "![Glass, one surface or all refracting](refraction.png)"
  echo
  echo "SP06 figure 14, 150,000 surfels of glass: \`transparent-high\` with \`--refraction single\` and \`multi\`, depth peeling with \`multi\`; below at \`--zoom 3\`."
  echo
  echo "Lit, four groups, \`--cover enlarge-each\`, 16 layers. The dragon has 200,000 surfels and is of glass alone."
  echo
  body_tables
  cat <<'TEXT'

## Times

The fastest of nine frames of a turntable, one thread. The A-buffer's raster is vector code; the other methods are there to compare pictures
with, and their rasters are plain loops over the same tiles' splats. Their times tell what each does more than another, not what a renderer
made for speed would take.

TEXT
  times_table
  cat <<'TEXT'

## Filtered environment lookups beside OpenImageIO's

`venice_sunset_1k.hdr`, 200 directions; root mean square of the error relative to the lobe summed over all texels. OpenImageIO's
`environment()` has the filter's width that suits it best; time of a lookup, least of five runs.

TEXT
  "$tools/environment_table" "$data/envmaps/venice_sunset_1k.hdr"
  echo
  cat "$root/tests/methods_notes.md"
} > "$out"

tiles=()
square=(--size 256x256 --from 0,0.36,1)
tile() {
  local name=$1 surfels=$2
  shift 2
  "$tools/surfel-render" "$work/$surfels.ply" -o "$work/$name.png" "${square[@]}" --quiet --background 1,1,1,1 "$@"
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
oiiotool --nosoftwareattrib "${tiles[@]}" --mosaic:pad=2 3x3 -o "$(dirname "$out")/methods.png"

# SP06 figures 1 and 13.
tiles=()
square=(--size 320x320)
body=(--from "0.1,0.25,1" --fov 30 --frame-all)
tile d1 balls-g "${body[@]}" --method transparent --scene "$root/configs/scene-balls.toml"
tile d2 balls-g "${body[@]}" --method transparent-high --scene "$root/configs/scene-balls.toml"
tile d3 balls "${body[@]}" --method depth-peel --peel 16 --scene "$root/configs/scene-balls.toml"
glass=(--scene "$root/configs/scene-glass-balls.toml")
tile e1 balls-g "${body[@]}" --method transparent-high "${glass[@]}" --refraction single
tile e2 balls-g "${body[@]}" --method transparent-high "${glass[@]}"
tile e3 balls "${body[@]}" --method depth-peel --peel 16 "${glass[@]}"
oiiotool --nosoftwareattrib "${tiles[@]}" --mosaic:pad=2 3x2 -o "$(dirname "$out")/balls.png"

# SP06 figure 14: each surface refracts or the nearest alone, whole and near by.
tiles=()
square=(--size 480x480)
glass=("${body[@]}" --scene "$root/configs/scene-glass.toml")
for near in 1 3; do
  tile "f$near-single" body-g "${glass[@]}" --method transparent-high --refraction single --zoom "$near"
  tile "f$near-multi" body-g "${glass[@]}" --method transparent-high --zoom "$near"
  tile "f$near-peel" body "${glass[@]}" --method depth-peel --peel 16 --zoom "$near"
done
oiiotool --nosoftwareattrib "${tiles[@]}" --mosaic:pad=2 3x2 -o "$(dirname "$out")/refraction.png"
