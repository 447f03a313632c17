#!/usr/bin/env bash
# Makes docs/simplify.md and docs/simplify.png: simplified clouds against evenly thinned ones. Needs
# the real data. Takes minutes.
# Usage: tests/simplify.sh [folder of the tools] [output]
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
tools=${1:-$root/build/release/bin}
out=${2:-$root/docs/simplify.md}
data=${SURFEL_TEST_DATA:-$root/../shared/data}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
spot=$data/textured/spot/spot_triangulated.obj
image=$data/textured/spot/spot_texture.png

# scene NAME: the full cloud, $work/NAME.ply, the number of views, and the camera.
scene() {
  name=$1 views=3
  case $1 in
    spot) camera=(--eye 1.6,0.95,-2.5 --target 0,0.108,0.19)
      cow 400000 "$work/spot.ply" ;;
    lion) camera=(--eye=-9.5,10.5,0.8 --target=-2.9,3.9,-1.16 --up=0,0,1 --fov 26)
      "$tools/surfel-estimate" "$data/colour_clouds/lion_takanawa_third.ply" --orient align -o "$work/lion.ply" --quiet ;;
    room) camera=(--eye=2.33,1.9,-2 --target=2.33,1.79,1.23 --up=0,-1,0 --fov 42) views=1
      "$tools/surfel-estimate" "$data/colour_clouds/fragment_normals_rgb.pcd" --orient align -o "$work/room.ply" --quiet ;;
  esac
  camera+=(--turntable "$views" --size 512x512 --shading none --quiet)
  "$tools/surfel-render" "$work/$name.ply" -o "$work/${name}_%04d.exr" "${camera[@]}"
  surfels=$(sed -n 's/^element vertex //p;/^end_header/q' < "$work/$name.ply")
}

# cow COUNT FILE: evenly spread over the mesh, textured.
cow() {
  "$tools/surfel-from-mesh" "$spot" --count "$1" -o "$work/bare.ply" --quiet
  "$tools/surfel-texture" "$work/bare.ply" --mesh "$spot" --image "$image" -o "$2" --quiet
}

# thin N FILE: evenly, 1 surfel of N: every N-th of a scan, with sizes estimated anew; of the cow, that many samples of the mesh.
thin() {
  if [ "$name" = spot ]; then
    cow $((surfels / $1)) "$2"
    return
  fi
  "$tools/surfel-convert" "$work/$name.ply" --ascii -o "$work/text.ply" --quiet
  awk -v n="$1" '/^element vertex/ && !body {$3 = int(($3 + n - 1) / n)} !body || i++ % n == 0; /^end_header/ {body = 1}' \
    "$work/text.ply" > "$work/thin.ply"
  "$tools/surfel-estimate" "$work/thin.ply" --orient align -o "$2" --quiet
}

# number KEY < JSON: the first of that name.
number() { sed -n "s/.*\"$1\": \\(-\\{0,1\\}[0-9.e+-]*\\).*/\\1/p" | head -1; }

# mean_psnr VALUE...: of the mean squared error.
mean_psnr() { printf '%s\n' "$@" | awk '{s += 10 ^ (-$1 / 10)} END {printf "%.2f", -10 * log(s / NR) / log(10)}'; }

# measure FILE: sets whole, inside, holes (of the worst view) against the full cloud's pictures, and count.
measure() {
  local a=() b=() v json
  holes=0
  count=$(sed -n 's/^element vertex //p;/^end_header/q' < "$1")
  "$tools/surfel-render" "$1" -o "$work/v_%04d.exr" "${camera[@]}"
  for ((v = 0; v < views; ++v)); do
    json=$("$tools/surfel-compare" "$work/v_000$v.exr" "$work/${name}_000$v.exr" --json --quiet)
    a+=("$(number psnr <<< "$json")")
    holes=$(awk -v a="$holes" -v b="$(number holes <<< "$json")" 'BEGIN {printf "%.2g", (b > a ? b : a)}')
    b+=("$("$tools/surfel-compare" "$work/v_000$v.exr" "$work/${name}_000$v.exr" --json --quiet --inside | number psnr)")
  done
  whole=$(mean_psnr "${a[@]}")
  inside=$(mean_psnr "${b[@]}")
}

# equal PSNR COLUMN COUNT: how many times COUNT evenly thinned surfels are needed for that PSNR, between the measured counts.
equal() {
  sort -n "$work/$name.even" | awk -v p="$1" -v c="$2" -v n="$3" '
    {x[NR] = log($1); y[NR] = $c}
    END {
      for (i = 1; i < NR; ++i) if (p >= y[i] && p <= y[i + 1]) {
        printf "%.1f", exp(x[i] + (p - y[i]) / (y[i + 1] - y[i]) * (x[i + 1] - x[i])) / n; exit
      }
      if (p > y[NR]) printf "> %.1f", exp(x[NR]) / n; else printf "-"
    }'
}

# run NAME: rows for a cloud.
run() {
  local n
  scene "$1"
  for n in 2 4 8 16 32; do
    thin $n "$work/$name.e$n.ply"
    measure "$work/$name.e$n.ply"
    echo "$count $whole $inside" >> "$work/$name.even"
    echo "| $name | even | $count | 1 / $n | $whole | $inside | | | | $holes |" >> "$work/table.md"
  done
  for n in 4 8 16 32; do
    "$tools/surfel-simplify" "$work/$name.ply" --count $((surfels / n)) --light 0 -o "$work/$name.s$n.ply" --quiet --stats "$work/s.json"
    measure "$work/$name.s$n.ply"
    echo "| $name | simplified | $count | 1 / $n | $whole | $inside | $(equal "$whole" 2 "$count") | $(equal "$inside" 3 "$count") | $(number error < "$work/s.json" |
      awk '{printf "%.4f", $1}') | $holes |" >> "$work/table.md"
  done
}

# picture FILE OUTPUT: the lion's head.
picture() {
  "$tools/surfel-render" "$1" -o "$work/$2" --eye=-5.3,-5.1,0.8 --target=-2.9,3.6,0 --up=0,0,1 --fov 15 --size 400x400 \
    --shading none --background 1,1,1,1 --quiet
}

run lion
run room
run spot
picture "$work/lion.ply" full.png
picture "$work/lion.s8.ply" simplified.png
picture "$work/lion.e8.ply" even.png
oiiotool --nosoftwareattrib "$work"/{full,simplified,even}.png --mosaic:pad=4 3x1 -o "$(dirname "$out")/simplify.png"
{
  cat <<'TEXT'
# Simplification

`surfel-simplify` makes a cloud of fewer surfels that looks the same, for scans and other clouds without a mesh.

```
surfel-estimate lion_takanawa_third.ply --orient align -o lion.ply
surfel-simplify lion.ply --max-error 0.04 -o lion_s.ply    # the fewest surfels with that error
surfel-simplify lion.ply --count 20000 -o lion_s.ply       # the least error with that many
```

Surfels are merged where the surface is flat and its colours are smooth, never across sheets that face differently (`--normal-angle`) or across
materials; coefficients are fitted to what the full cloud shows. The error, measured at every surfel of the input, is that of colour, of
distance, and of the shading by one light (`--light 0` leaves the light out). Every second of the lion's 113,997 points comes less near to
the full cloud than 14,249 simplified surfels do; of the cow, 25,000 of 400,000 are as near as 115,000 evenly spread ones.

Made by `tests/simplify.sh`: `surfel-simplify --count N --light 0` against as many surfels evenly spread, three views (of the room: one) of
512x512, unlit, against the pictures of the full cloud. Evenly spread are every n-th point of the scans, their sizes estimated anew (`lion`, 113,997
surfels of a photographed statue; `room`, 113,662 of a wall from RGB-D frames), and for `spot`, of 400,000, that many blue-noise samples of the mesh with its
texture. PSNR (sRGB) of the whole picture and inside the silhouette, of the mean squared error of the views. *Equal* is how many times more evenly
spread surfels have the same PSNR. Then the error that `surfel-simplify` says it measured, and the share of holes in the worst view.

![The full cloud, 1/8 of its surfels simplified, and 1/8 evenly spread](simplify.png)

The lion, 113,997 surfels; simplified to 14,249; every eighth one.

| cloud | surfels | number | of the full | PSNR, dB | inside, dB | equal | equal, inside | error said | holes |
|---|---|---|---|---|---|---|---|---|---|
TEXT
  cat "$work/table.md"
  cat "$root/tests/simplify_notes.md"
} > "$out"
