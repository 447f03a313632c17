#!/usr/bin/env bash
# Makes docs/texture.md and docs/figure6.png: the fits of surfel-texture beside each other. Needs a
# build with -DSURFEL_BUILD_BENCH=ON and, for `meshes`, `relief` and `options`, the real data.
# Usage: tests/fits.sh [section...], the folder of the tools in SURFEL_BIN. Sections:
#   figure       SS01 figure 6, seconds           quality    checkers on a plane, minutes
#   right_sides  both of gram, seconds            views      far and near, a minute
#   stability    where fits may fail, seconds     meshes     real textured meshes, minutes
#   options      one by one on the cow, a minute  relief   normal and bump maps, a minute
#   timing       up to 4 million surfels, some 10 minutes and 14 GB: on an idle machine
# All of them if none is named; what is not made again stays as it stands in docs/texture.md.
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
tools=${SURFEL_BIN:-$root/build/release/bin}
data=${SURFEL_TEST_DATA:-$root/../shared/data}
page=$root/docs/texture.md
all=(figure quality right_sides views stability meshes relief options timing)
fits=(ewa gram normalised render)  # normalised: gram with the other right side.
command -v oiiotool >/dev/null || { echo "oiiotool is missing: apt-get install openimageio-tools" >&2; exit 1; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# number KEY < JSON
number() { sed -n "s/.*\"$1\": \\(-\\{0,1\\}[0-9.e+-]*\\).*/\\1/p" | head -1; }
seconds() { number total_ms < "$1" | awk '{printf "%.1f", $1 / 1000}'; }

# fit_options FIT CUTOFF: the options of surfel-texture; only render has a cutoff to fit for.
fit_options() {
  case $1 in
    render) echo "--fit render --cutoff $2" ;;
    normalised) echo "--fit gram --right-side normalised" ;;
    *) echo "--fit $1" ;;
  esac
}

# SS01 figure 6: rows are magnifications, columns the fits and the texture itself.
figure() {
  local cutoff=4
  "$tools/surfel-generate" plane --count 40000 --variance-scale 0.7 -o "$work/plane.ply" \
    --mesh "$work/plane.obj" --resolution 4 --quiet
  "$tools/surfel-generate" checker --frequency 40 --size 2560x2560 -o "$work/black.png" --quiet
  oiiotool "$work/black.png" --mulc 0.62,0.55,0.42,1 --addc 0.28,0.31,0.36,0 -o "$work/checker.png"
  for fit in "${fits[@]}"; do
    # shellcheck disable=SC2046 # Words of options.
    "$tools/surfel-texture" "$work/plane.ply" --image "$work/checker.png" --reconstruction 1 $(fit_options "$fit" "$cutoff") \
      -o "$work/$fit.ply" --quiet
  done
  local tiles=()
  for view in "--eye 0,-1.25,0.5 --target 0,-0.3,-0.02 --up 0,0,1 --fov 42" \
    "--eye 0.115,0.055,3 --target 0.115,0.055,0 --ortho 0.23" \
    "--eye 0.1,0.1,3 --target 0.1,0.1,0 --ortho 0.065"; do
    # shellcheck disable=SC2086 # Words of options.
    for picture in "${fits[@]}" texture; do
      local source=("$work/$picture.ply" --cutoff "$cutoff")
      [ "$picture" != texture ] || source=("$work/plane.ply" --mesh "$work/plane.obj" --image "$work/checker.png")
      tiles+=("$work/tile${#tiles[@]}.png")
      "$tools/surfel-render" "${source[@]}" -o "${tiles[-1]}" $view --shading none --size 196x196 \
        --background 1,1,1,1 --quiet
    done
  done
  oiiotool --nosoftwareattrib "${tiles[@]}" --mosaic:pad=5 5x3 --ch R,G,B --attrib png:compressionLevel 9 \
    -o "$root/docs/figure6.png"
  cat <<'TEXT'
## SS01 figure 6

![Checker: ewa, gram, gram normalised, render, the texture; minified, magnified, extremely magnified](figure6.png)

Columns: ewa, gram, gram with `--right-side normalised`, render, the texture itself; rows: in perspective, magnified, extremely magnified. 40,000 surfels on a jittered
grid, squares of 5 spacings, sigma = 0.7 spacings, c = 4. What can be seen inside squares is the fits' own: overshoot beside edges
that are sharper than the surfels can show.
TEXT
}

quality() { "$tools/fit_table" quality; }
views() { "$tools/fit_table" views; }
right_sides() { "$tools/fit_table" right_sides; }
stability() { "$tools/fit_table" stability; }

# mesh_rows NAME MESH IMAGE FROM: rows of PSNR and seconds for several numbers of surfels and cutoffs.
mesh_rows() {
  local view=(--from "$4" --size 400x400 --shading none --quiet)
  for count in 5000 20000 100000; do
    "$tools/surfel-from-mesh" "$2" --count "$count" -o "$work/s.ply" --quiet
    "$tools/surfel-render" "$work/s.ply" --mesh "$2" --image "$3" -o "$work/truth.exr" "${view[@]}"
    for cutoff in 1 2; do
      local row="| $1 | $count | $cutoff |"
      for fit in "${fits[@]}"; do
        # shellcheck disable=SC2046 # Words of options.
        "$tools/surfel-texture" "$work/s.ply" --mesh "$2" --image "$3" $(fit_options "$fit" "$cutoff") \
          -o "$work/t.ply" --stats "$work/t.json" --quiet
        "$tools/surfel-render" "$work/t.ply" -o "$work/t.exr" --cutoff "$cutoff" "${view[@]}"
        row+=$(printf ' %.1f dB, %s s |' \
          "$("$tools/surfel-compare" "$work/t.exr" "$work/truth.exr" --inside --json | number psnr)" \
          "$(seconds "$work/t.json")")
      done
      echo "$row"
    done
  done
}

meshes() {
  cat <<'TEXT'
## Real textured meshes

PSNR of sRGB values inside the silhouette, 400 x 400 pixels, of the rendered surfels against the ray-traced textured mesh
(`surfel-render --mesh`); whole time of `surfel-texture`, reading and writing included, with 2 threads. Surfels of
`surfel-from-mesh`, sigma = 0.7 spacings (its default).

| mesh | surfels | c | ewa | gram | normalised | render |
|---|---|---|---|---|---|---|
TEXT
  mesh_rows spot "$data/textured/spot/spot_triangulated.obj" "$data/textured/spot/spot_texture.png" 0.6,0.3,-1
  mesh_rows head "$data/textured/head_scan/lee_perry_smith.obj" "$data/textured/head_scan/lee_perry_smith_color.jpg" 0.3,0.1,1
  mesh_rows scissors "$data/textured/scissors/scissors.obj" "$data/textured/scissors/scissors_texture.png" 0.3,1,0.5
}

# relief_row NAME MESH SCENE OPTION...: PSNR of surfels without and with the relief of these options.
relief_row() {
  local row="| $1 |" mesh=$2 scene=$3 view
  shift 3
  "$tools/surfel-from-mesh" "$mesh" --count 100000 -o "$work/s.ply" --quiet
  "$tools/surfel-texture" "$work/s.ply" --mesh "$mesh" "$@" -o "$work/t.ply" --quiet
  for view in "--size 400x400 --zoom 4" "--size 400x400" "--size 50x50"; do
    # shellcheck disable=SC2206 # Words of options.
    local options=($view --scene "$scene" --from 0.3,0.2,1 --quiet)
    "$tools/surfel-render" "$work/s.ply" --mesh "$mesh" "$@" -o "$work/truth.exr" --samples 8 "${options[@]}"
    for surfels in s t; do
      "$tools/surfel-render" "$work/$surfels.ply" -o "$work/$surfels.exr" "${options[@]}"
      row+=$(printf ' %.1f |' "$("$tools/surfel-compare" "$work/$surfels.exr" "$work/truth.exr" --inside --json | number psnr)")
    done
  done
  echo "$row"
}

relief() {
  cat > "$work/shiny.toml" <<'TOML'
ambient = [0.1, 0.1, 0.1]
[[light]]
type = "directional"
direction = [-1, -0.6, -0.7]
color = [0.8, 0.8, 0.8]
[[material]]
name = "shiny"
specular = [0.6, 0.6, 0.6]
shininess = 60
TOML
  "$tools/surfel-generate" sphere --count 1000 -o "$work/sphere.ply" --mesh "$work/sphere.obj" --resolution 128 --quiet
  cat <<'TEXT'
## Normal and bump maps

`--normal-map` and `--bump`, or `norm` and `bump` of the mesh's materials, give surfels normals of their own for shading, in the columns `shading_nx`
`shading_ny` `shading_nz`. They are the means of the map's normals under the surfels' kernels, the same as colours are filtered with; bump maps are
averaged by the moments of their slopes. Discs stay on the surface. Where a surfel covers many normals their mean is short, and highlights and
reflections get as wide as the relief below the surfel's size scatters them.

PSNR of sRGB values inside the silhouette of 100,000 surfels against the ray-traced mesh with the same relief, 8 x 8 rays a pixel, without and with
the relief: 400 x 400 pixels at four times the size, 400 x 400, and 50 x 50.

| scene | near, without | with | whole, without | with | far, without | with |
|---|---|---|---|---|---|---|
TEXT
  local head=$data/textured/head_scan/lee_perry_smith.obj
  relief_row "sphere, shiny, \`--bump noise:8\`" "$work/sphere.obj" "$work/shiny.toml" --bump noise:8 --bump-scale 0.1
  relief_row "sphere, shiny, \`--bump noise:64\`" "$work/sphere.obj" "$work/shiny.toml" --bump noise:64 --bump-scale 0.02
  relief_row "sphere, chrome, \`--bump noise:8\`" "$work/sphere.obj" "$root/configs/scene-chrome.toml" --bump noise:8 --bump-scale 0.02
  relief_row "head, shiny, its colours as heights" "$head" "$work/shiny.toml" --bump "${head%.obj}_color.png" --bump-scale 0.2
}

# option_row NAME OPTION...: the cow, whole and at four times the size.
option_row() {
  local row="| $1 |" zoom
  shift
  local TIMEFORMAT=%R
  { time "$tools/surfel-texture" "$work/s.ply" --mesh "$spot.obj" --image "$spot.png" "$@" -o "$work/t.ply" \
    --stats "$work/t.json" --quiet; } 2> "$work/seconds"
  for zoom in 1 4; do
    local view=(--from 0.6,0.3,-1 --size 400x400 --shading none --zoom $zoom --quiet)
    # Framed anew: sizes of surfels, which frame the picture, may be fitted.
    "$tools/surfel-render" "$work/t.ply" --mesh "$spot.obj" --image "$spot.png" -o "$work/truth.exr" "${view[@]}"
    "$tools/surfel-render" "$work/t.ply" -o "$work/t.exr" "${view[@]}"
    row+=$(printf ' %.2f |' "$("$tools/surfel-compare" "$work/t.exr" "$work/truth.exr" --inside --json | number psnr)")
  done
  echo "$row $(tr -d ' \n' < "$work/t.json" | sed 's/.*"coefficient_max":\[\([^],]*\).*"coefficient_min":\[\([^],]*\).*/\2 \1/' |
    awk '{printf "%.2f .. %.2f", $1, $2}') | $(sed 's/ *"iterations": *//' <<< "$(number iterations < "$work/t.json")") | $(cat "$work/seconds") s |"
}

options() {
  spot=$work/spot
  cp "$data/textured/spot/spot_triangulated.obj" "$spot.obj"
  cp "$data/textured/spot/spot_texture.png" "$spot.png"
  "$tools/surfel-from-mesh" "$spot.obj" --count 20000 -o "$work/s.ply" --quiet
  cat <<'TEXT'
## What each option is for

The cow, 20,000 surfels of `surfel-from-mesh`, c = 1: PSNR as above, whole and at four times the size; range of the red coefficients (the
texture's is 0 to 1); iterations of the solver; whole process.

| options of surfel-texture | whole | near | range | iterations | time |
|---|---|---|---|---|---|
TEXT
  option_row '`--fit ewa`' --fit ewa
  option_row '`--fit render` (lambda 0.03, tolerance 1e-5)' --fit render
  local value
  for value in 0.001 0.01 0.1 0.3 1; do option_row "\`--fit render --lambda $value\`" --fit render --lambda $value; done
  for value in 1e-3 1e-8; do option_row "\`--fit render --tolerance $value\`" --fit render --tolerance $value; done
  option_row '`--fit render --bounds 0,1`' --fit render --bounds 0,1
  option_row '`--fit render --refine-variance`' --fit render --refine-variance
  option_row '`--fit render --solver ceres`' --fit render --solver ceres
}

timing() {
  cat <<'TEXT'
## Time and memory

A plane with an image of 2048 x 2048 texels (fractal noise), sigma = spacing, c = 1, default tolerance, 2 threads. Whole time of
`surfel-texture` with reading and writing of the file; processor time of both threads, which other programs on the machine change
less: half of it is the least that two idle cores need; and peak memory.

| surfels | fit | whole | processor | memory | iterations |
|---|---|---|---|---|---|
TEXT
  local TIMEFORMAT='%U %S'
  "$tools/surfel-generate" noise --size 2048x2048 -o "$work/noise.png" --quiet
  for count in ${SURFEL_TIMING_COUNTS:-250000 1000000 4000000}; do
    "$tools/surfel-generate" plane --count "$count" -o "$work/s.ply" --quiet
    for fit in ewa gram render; do
      { time "$tools/surfel-texture" "$work/s.ply" --image "$work/noise.png" --fit "$fit" -o "$work/t.ply" \
        --threads 2 --stats "$work/t.json" --quiet; } 2> "$work/processor"
      printf '| %s | %s | %s s | %s s | %s GB | %s |\n' "$count" "$fit" "$(seconds "$work/t.json")" \
        "$(awk '{printf "%.1f", $1 + $2}' "$work/processor")" \
        "$(number peak_memory_bytes < "$work/t.json" | awk '{printf "%.2f", $1 / 1e9}')" \
        "$(number iterations < "$work/t.json")"
    done
  done
}

# old SECTION: as it stands in the page.
old() { [ ! -f "$page" ] || sed -n "/^<!-- $1 -->\$/,/^<!-- end of $1 -->\$/{/^<!--/!p}" "$page"; }

wanted=("$@")
[ $# -gt 0 ] || wanted=("${all[@]}")
for section in "${wanted[@]}"; do
  [[ " ${all[*]} " == *" $section "* ]] || { echo "$section is none of: ${all[*]}" >&2; exit 2; }
done
{
  cat <<'TEXT'
# Texture fits

`surfel-texture` gives every surfel a coefficient, so that the renderer, which adds the surfels' Gaussians and divides by their sum, shows the
texture. There are three fits:

- `--fit ewa`, the default, filters the texture with each surfel's kernel. It is fast, blurs a little and never rings; `--prefilter 0.5` blurs less
  ([Prefilter](#prefilter)).
- `--fit gram` solves for the optimal samples of *Surface Splatting* (Zwicker et al. 2001, "SS01"), R w = c; with `--right-side normalised`
  for another c, which takes the renderer's division by the kernels' sum into account.
- `--fit render` solves a least squares problem in the very basis that the renderer evaluates, from near and from afar.

`render` is 1.3 to 8 dB nearer to the ray-traced mesh on real textures where `ewa` has less than 38 dB, and 4 to 14 dB on magnified
checkers. A million surfels under 2048 x 2048 texels take 0.9 s with `ewa`, 12 s with `gram` and 11.5 s with `render`, on 2 threads.

```
surfel-from-mesh spot.obj --count 400000 -o spot.ply
surfel-texture spot.ply --mesh spot.obj --image spot.png -o spot_t.ply                            # ewa
surfel-texture spot.ply --mesh spot.obj --image spot.png --fit render --cutoff 2 -o spot_f.ply    # for surfel-render --cutoff 2
surfel-estimate lion_takanawa_third.ply --orient align -o lion.ply
surfel-texture lion.ply --from colors --fit render -o lion_f.ply    # a scan's own colours, sharper than as they are
surfel-estimate scan.ply -o bare.ply
surfel-texture bare.ply --mesh model.obj -o bare_t.ply              # surfels without uv take it from the mesh they lie on
surfel-texture bare.ply --solid marble -o marble.ply                # a texture that fills space needs no uv
```

`--stats` tells condition, residual and error of a fit. In the tables c is the cutoff, where kernels end (beta = c), sigma the standard
deviation of a surfel's kernel, h the spacing of the surfels and h_s the standard deviation of the pixel filter.

Made by `tests/fits.sh`, section by section, but for [Blocks](#blocks), [Prefilter](#prefilter) and [Solid textures](#solid-textures).
TEXT
  for section in "${all[@]}"; do
    echo
    echo "<!-- $section -->"
    if [[ " ${wanted[*]} " == *" $section "* ]]; then "$section"; else old "$section"; fi
    echo "<!-- end of $section -->"
  done
  echo
  cat "$root/tests/fits_blocks.md" "$root/tests/fits_solid.md" "$root/tests/fits_notes.md"
} > "$work/page.md"
mv "$work/page.md" "$page"
