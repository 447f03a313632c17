#!/usr/bin/env bash
# Makes docs/adaptive.md and docs/adaptive.png: adaptive against uniform spacing on the textured
# meshes. Needs the real data. Takes minutes.
# Usage: tests/adaptive.sh [folder of the tools] [output]
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
tools=${1:-$root/build/release/bin}
out=${2:-$root/docs/adaptive.md}
data=${SURFEL_TEST_DATA:-$root/../shared/data}/textured
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
views=3

# scene NAME: mesh, image and camera.
scene() {
  case $1 in
    spot) mesh=$data/spot/spot_triangulated.obj image=$data/spot/spot_texture.png
      camera=(--eye 1.6,0.95,-2.5 --target 0,0.108,0.19) ;;
    head) mesh=$data/head_scan/lee_perry_smith.obj image=$data/head_scan/lee_perry_smith_color.png
      camera=(--eye 3,4,14 --target 0,0,0) ;;
    scissors) mesh=$data/scissors/scissors.obj image=$data/scissors/scissors_texture.png
      camera=(--eye 0.05,0.2,0.25 --target 0.002,0.006,0.097) ;;
  esac
  camera+=(--turntable "$views" --size 512x512 --shading none --quiet)
}

# number KEY < JSON: the first of that name.
number() { sed -n "s/.*\"$1\": \\(-\\{0,1\\}[0-9.e+-]*\\).*/\\1/p" | head -1; }

# compare VIEW OPTION...: the report as JSON.
compare() {
  local view=$1
  shift
  "$tools/surfel-compare" "$work/v_000$view.exr" "$work/${name}_000$view.exr" --json --quiet "$@"
}

# mean_psnr VALUE...: of the mean squared error.
mean_psnr() { printf '%s\n' "$@" | awk '{s += 10 ^ (-$1 / 10)} END {printf "%.2f", -10 * log(s / NR) / log(10)}'; }

# measure FILE: sets whole, inside, holes (of the worst view) and linear (RMSE inside, linear light).
measure() {
  local a=() b=() squares=() v json
  holes=0
  "$tools/surfel-texture" "$1" --mesh "$mesh" --image "$image" -o "$work/t.ply" --quiet
  "$tools/surfel-render" "$work/t.ply" -o "$work/v_%04d.exr" "${camera[@]}"
  for ((v = 0; v < views; ++v)); do
    json=$(compare $v)
    a+=("$(number psnr <<< "$json")")
    holes=$(awk -v a="$holes" -v b="$(number holes <<< "$json")" 'BEGIN {print (b > a ? b : a)}')
    b+=("$(compare $v --inside | number psnr)")
    squares+=("$(compare $v --inside --encoding linear | number rmse)")
  done
  whole=$(mean_psnr "${a[@]}")
  inside=$(mean_psnr "${b[@]}")
  linear=$(printf '%s\n' "${squares[@]}" | awk '{s += $1 * $1} END {printf "%.4f", sqrt(s / NR)}')
}

# equal PSNR COLUMN COUNT: how many times COUNT uniform surfels are needed for that PSNR, between the measured counts.
equal() {
  awk -v p="$1" -v c="$2" -v n="$3" '
    {x[NR] = log($1); y[NR] = $c}
    END {
      for (i = 1; i < NR; ++i) if (p >= y[i] && p <= y[i + 1]) {
        printf "%.1f", exp(x[i] + (p - y[i]) / (y[i + 1] - y[i]) * (x[i + 1] - x[i])) / n; exit
      }
      if (p > y[NR]) printf "> %.1f", exp(x[NR]) / n; else printf "-"
    }' "$work/$name.uniform"
}

# run NAME COUNT: rows for a mesh; adaptive at COUNT, 2 COUNT and 4 COUNT.
run() {
  local n factor
  name=$1
  scene "$name"
  "$tools/surfel-render" --mesh "$mesh" --image "$image" -o "$work/${name}_%04d.exr" "${camera[@]}"
  : > "$work/$name.uniform"
  for factor in 1 2 4 8; do
    n=$((factor * $2))
    "$tools/surfel-from-mesh" "$mesh" --count $n -o "$work/u$n.ply" --quiet
    measure "$work/u$n.ply"
    echo "$n $whole $inside" >> "$work/$name.uniform"
    echo "| $name | uniform | $n | $whole | $inside | | | | $linear | $holes |" >> "$work/table.md"
  done
  for factor in 1 2 4; do
    n=$((factor * $2))
    "$tools/surfel-from-mesh" "$mesh" --adaptive --image "$image" --count $n -o "$work/a$n.ply" --quiet --stats "$work/s.json"
    measure "$work/a$n.ply"
    echo "| $name | adaptive | $n | $whole | $inside | $(equal "$whole" 2 $n) | $(equal "$inside" 3 $n) | $(number color_error < "$work/s.json" |
      awk '{printf "%.4f", $1}') | $linear | $holes |" >> "$work/table.md"
  done
}

# picture FILE OUTPUT: the cow's head.
picture() {
  "$tools/surfel-texture" "$1" --mesh "$mesh" --image "$image" -o "$work/t.ply" --quiet
  "$tools/surfel-render" "$work/t.ply" -o "$work/$2" "${close[@]}"
}

run spot 20000
run head 25000
run scissors 25000
scene spot
close=(--eye 0.9,0.55,-2 --target 0.05,0.4,-0.2 --fov 34 --size 400x400 --background 1,1,1,1 --quiet)
"$tools/surfel-from-mesh" "$mesh" --count 20000 -o "$work/u.ply" --quiet
"$tools/surfel-from-mesh" "$mesh" --adaptive --image "$image" --count 20000 -o "$work/a.ply" --quiet
picture "$work/u.ply" u.png
picture "$work/a.ply" a.png
"$tools/surfel-render" --mesh "$mesh" --image "$image" -o "$work/m.png" "${close[@]}"
oiiotool --nosoftwareattrib "$work"/{u,a,m}.png --mosaic:pad=4 3x1 -o "$(dirname "$out")/adaptive.png"
{
  cat <<'TEXT'
# Adaptive spacing

`surfel-from-mesh --adaptive` makes surfels small where the texture, the colours or the shape have detail, and large elsewhere.

```
surfel-from-mesh spot.obj --adaptive --image spot.png --max-error 0.03 -o spot_a.ply   # the fewest with that error
surfel-from-mesh spot.obj --adaptive --image spot.png --count 40000 -o spot_a.ply      # the least error with that many
surfel-texture spot_a.ply --mesh spot.obj --image spot.png -o spot_at.ply
```

The error is the root mean square over the surface, seen from near, of colour (linear light, 1 is black against white) and of the distance
between surfels and mesh (in units of `--unit-deviation`, 1/30 of the diagonal). Of the cow, 40,000 adaptive surfels are as near to the mesh as
70,000 evenly spread ones, inside the silhouette as 150,000; of a head 25,000 as 40,000, inside as 60,000.

Made by `tests/adaptive.sh`: `surfel-from-mesh --adaptive --count N` against `--count N`, the textured meshes of the test data,
three views of 512x512 each, unlit, against the ray-traced mesh. PSNR (sRGB) of the whole picture and inside the silhouette, of
the mean squared error of the views. *Equal* is how many times more uniform surfels have the same PSNR. Then the error of
colour that was expected beforehand, and the one measured inside the silhouette (root mean square, linear light), and the
share of holes in the worst view.

![20,000 surfels evenly spread, the same number placed adaptively, the mesh](adaptive.png)

20,000 surfels evenly spread; the same number placed adaptively; the mesh.

| mesh | spacing | surfels | PSNR, dB | inside, dB | equal | equal, inside | expected | measured | holes |
|---|---|---|---|---|---|---|---|---|---|
TEXT
  cat "$work/table.md"
  cat "$root/tests/adaptive_notes.md"
} > "$out"
