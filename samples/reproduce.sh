#!/usr/bin/env bash
# Makes the figures and tables of the two papers that Surfelkit follows again, with its own surfaces and real meshes,
# as one HTML page that needs no other file: what the paper shows, our pictures and numbers, the commands.
#   samples/reproduce.sh [-o PAGE] [-s PART] [FIGURE]...
#   -o PAGE    default: out/reproduce.html in the project
#   -s PART    part of the surfels to take, 0.001 to 1, for a quick look; default: 1
#   FIGURE     ss01-1 ss01-6 ss01-7 ss01-8 ss01-table2 (Zwicker et al. 2001), sp06-1 sp06-8 sp06-9 sp06-10 sp06-11
#              sp06-12 sp06-13 sp06-14 sp06-table1 sp06-table2 (Zhang and Pajarola 2006); default: all
# Real meshes (for sp06) are looked for in $SURFEL_TEST_DATA (default: ../shared/data beside the project). Installs on a
# fresh Debian 12 what building needs, and builds, unless $SURFEL_BIN names a folder with the tools. Takes minutes.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/../tests/support/setup.sh"

figures=(ss01-1 ss01-6 ss01-7 ss01-8 ss01-table2
  sp06-1 sp06-8 sp06-9 sp06-10 sp06-11 sp06-12 sp06-13 sp06-14 sp06-table1 sp06-table2)
declare -A title=(
  [ss01-1]="SS01 figure 1: a textured scan, a terrain, semi-transparent surfaces"
  [ss01-6]="SS01 figure 6: a checkerboard on irregular points"
  [ss01-7]="SS01 figure 7: semi-transparent surfaces that intersect"
  [ss01-8]="SS01 figure 8: filters from magnification to minification"
  [ss01-table2]="SS01 table 2: frame rates"
  [sp06-1]="SP06 figure 1: transparent bodies and glass"
  [sp06-8]="SP06 figure 8: blending with fewer and fewer groups"
  [sp06-9]="SP06 figure 9: Voronoi rasterisation"
  [sp06-10]="SP06 figure 10: opaque models, and a ball of glass beside geometrical optics"
  [sp06-11]="SP06 figure 11: what one group covers"
  [sp06-12]="SP06 figure 12: transparency beside depth peeling"
  [sp06-13]="SP06 figure 13: opaque things about a transparent body"
  [sp06-14]="SP06 figure 14: one refracting surface, or all"
  [sp06-table1]="SP06 table 1: numbers of groups"
  [sp06-table2]="SP06 table 2: frame rates of opaque surfaces"
)

# fail STATUS TEXT: 1 the run failed, 2 wrong usage.
fail() {
  echo "reproduce.sh: error: $2" >&2
  exit "$1"
}

page=$surfel_root/out/reproduce.html
part=1
while getopts o:s: option; do
  case $option in
    o) page=$OPTARG ;;
    s) part=$OPTARG ;;
    *) exit 2 ;;
  esac
done
shift $((OPTIND - 1))
[[ $part =~ ^[0-9]*\.?[0-9]+$ ]] && awk "BEGIN { exit $part < 0.001 || $part > 1 }" ||
  fail 2 "the part of the surfels is '$part'; it must be in 0.001..1"
[[ $# -gt 0 ]] && wanted=("$@") || wanted=("${figures[@]}")
for figure in "${wanted[@]}"; do
  [[ " ${figures[*]} " == *" $figure "* ]] || fail 2 "there is no figure '$figure'; there are: ${figures[*]}"
done
data=$(realpath -m "${SURFEL_TEST_DATA:-$surfel_root/../shared/data}")
[[ " ${wanted[*]}" != *" sp06"* || -d $data/meshes ]] ||
  fail 1 "$data: has no folder 'meshes'; set SURFEL_TEST_DATA to the folder of the test data, or ask for figures of ss01"
if [[ -z ${SURFEL_BIN:-} ]]; then
  surfel_install_packages "${surfel_packages[@]}"
  surfel_build release
fi
bin=$(realpath -m "${SURFEL_BIN:-$surfel_root/build/release/bin}")
[[ -x $bin/surfel-render ]] || fail 1 "$bin: has no surfel-render; set SURFEL_BIN to the folder of the tools, or to nothing to build them"
PATH=$bin:$PATH
page=$(realpath -m "$page")
mkdir -p "$(dirname "$page")"
work=$(mktemp -d)
trap 'rm -rf "$work" "$page.part"' EXIT
# The commands run here and name nothing outside but these three.
mkdir "$work/run"
cd "$work/run"
ln -s "$data" data
ln -s "$surfel_root/configs" configs
ln -s "$surfel_root/samples" samples

# ---- Commands and what is read from them -----------------------------------------------------------------------------

commands=""      # Of the figure at hand, a line each.
declare -A made  # Those that have run.

# run COMMAND: notes it for the figure, and runs it where no other figure had it.
run() {
  commands+=$1$'\n'
  [[ -z ${made[$1]:-} ]] || return 0
  made[$1]=1
  eval "$1" > "$work/log" 2>&1 || fail 1 "this failed: $1"$'\n'"$(< "$work/log")"
}

# of COUNT: as many surfels as PART leaves of so many.
of() { awk "BEGIN { printf \"%d\", $1 * $part + 0.5 }"; }

# number KEY FILE: the first of that name in a JSON file.
number() { sed -n "s/.*\"$1\": \\(-\\{0,1\\}[0-9.e+-]*\\).*/\\1/p" "$2" | head -1; }

# compare TESTED TRUTH: sets psnr, such as "31.4 dB", of two whole pictures.
compare() {
  local report=${1%.*}-by-${2%.*}.json
  run "surfel-compare $1 $2 --json > $report"
  psnr=$(number psnr "$report" | awk '{ print $1 == "" ? "the same" : sprintf("%.1f dB", $1) }')
}

# rate SURFELS OPTIONS: sets fps, frames per second by the median of seven frames, and of the frame in the middle `ms`, its time,
# `passes`, how often its geometry was drawn, and `fragments`, such as "1.2 million".
rates=0
rate() {
  local report=frames-$((++rates)).json
  run "surfel-render $1 $2 --turntable 7 -o frame_%d.png --stats $report"
  ms=$(values_of ms "$report")
  fps=$(awk "BEGIN { fps = 1000 / $ms; printf fps < 9.95 ? \"%.1f\" : \"%.0f\", fps }")
  passes=$(values_of geometry_passes "$report")
  fragments=$(values_of fragments "$report" | awk '{ printf "%.1f million", $1 / 1e6 }')
}

# values_of KEY FILE: the median of the values with that name in a JSON file.
values_of() {
  sed -n "s/^ *\"$1\": \([0-9.]*\).*/\1/p" "$2" | sort -g | awk '{ v[NR] = $1 } END { print v[int((NR + 1) / 2)] }'
}

# ---- HTML ------------------------------------------------------------------------------------------------------------

html() { sed 's/&/\&amp;/g; s/</\&lt;/g; s/>/\&gt;/g'; }

# about PAPER OURS: what the paper shows, and what is shown here.
about() { printf '<p><b>The paper:</b> %s</p>\n<p><b>Here:</b> %s</p>\n' "$1" "$2"; }

# tile PICTURE TEXT: one of a row of pictures between `tiles` and `end_tiles`.
tiles() { echo '<div class="tiles">'; }
tile() {
  local plain=${2//<code>/}
  printf '<figure><img alt="%s" src="data:image/png;base64,%s"><figcaption>%s</figcaption></figure>\n' \
    "${plain//<\/code>/}" "$(base64 -w0 "$1")" "$2"
}
end_tiles() { echo '</div>'; }

# cells TAG CELL...: a row of the table between `table HEADING...` and `end_table`.
cells() {
  local tag=$1
  shift
  echo "<tr>$(printf "<$tag>%s</$tag>" "$@")</tr>"
}
table() {
  echo '<table>'
  cells th "$@"
}
row() { cells td "$@"; }
end_table() { echo '</table>'; }

# ---- SS01 ------------------------------------------------------------------------------------------------------------

white="--background 1,1,1,1"

make_ss01_1() {
  about "Surface splatting of a scan of a human face, of a textured terrain, and of a complex object of semi-transparent surfaces: textured
    geometry without holes and without aliasing." \
    "The textured head of the samples, $(of 400000) points from its mesh and image, whole and near by; a terrain of $(of 1000000) points with a
    checkerboard down to its horizon; shells and panes through one another, $(of 500000) points."
  run "surfel-from-mesh samples/head.obj --count $(of 400000) -o head.ply"
  run "surfel-texture head.ply --mesh samples/head.obj --reconstruction 1 -o head-t.ply"
  run "surfel-generate terrain --count $(of 1000000) -o terrain.ply"
  run "surfel-texture terrain.ply --image checker:60 --reconstruction 1 -o terrain-t.ply"
  run "surfel-generate transparent --count $(of 500000) -o shells.ply"
  local size="--size 420x420 --cutoff 2"
  run "surfel-render head-t.ply $size --from 0,0.36,1 --background 1,1,1,1 -o 1-head.png"
  run "surfel-render head-t.ply --zoom 4 --target 0.25,0.05,0.5 $size --from 0,0.36,1 --background 1,1,1,1 -o 1-near.png"
  run "surfel-render terrain-t.ply --eye 0,0.35,1 --target 0,0.05,0 --fov 50 $size --background 0.3,0.5,0.8,1 -o 1-terrain.png"
  run "surfel-render shells.ply --layers 8 --from 0,0.15,1 $size --background 1,1,1,1 -o 1-shells.png"
  tiles
  tile 1-head.png "a textured scan"
  tile 1-near.png "near by"
  tile 1-terrain.png "a textured terrain"
  tile 1-shells.png "semi-transparent surfaces"
  end_tiles
}

make_ss01_6() {
  about "A checkerboard is sampled to irregular points: on the left by the optimised texture sampling of section 5 (R w = c), on the
    right by view-independent EWA. Top row minified, middle row magnified, bottom row extremely magnified, with the points in between.
    The optimised coefficients are much sharper." \
    "Columns: optimised sampling (<code>gram</code>), view-independent EWA (<code>ewa</code>), our least squares in the basis that the
    renderer evaluates (<code>render</code>), the texture itself, the points. $(of 160000) points on a jittered grid, squares of five
    spacings, kernels of 0.7 spacings up to c = 4. Numbers are the PSNR against the texture. <code>gram</code> minimises
    (10), the error of kernels without end that are not divided by their sum; the arcs that it shows near by are where the renderer ends
    and divides them."
  run "surfel-generate plane --count $(of 160000) --variance-scale 0.7 --mesh plane.obj --resolution 4 -o plane.ply"
  run "surfel-generate checker --frequency 80 --size 2560x2560 -o black.png"
  run "oiiotool black.png --mulc 0.62,0.55,0.42,1 --addc 0.28,0.31,0.36,0 -o checker.png"
  run "surfel-texture plane.ply --image checker.png --fit gram --reconstruction 1 -o gram.ply"
  run "surfel-texture plane.ply --image checker.png --fit ewa --reconstruction 1 -o ewa.ply"
  run "surfel-texture plane.ply --image checker.png --fit render --cutoff 4 --reconstruction 1 -o render.ply"
  run "surfel-generate plane --count $(of 160000) --variance-scale 0.12 -o dots.ply"
  run "surfel-texture dots.ply --image checker.png --reconstruction 1 -o points.ply"
  local size="--shading none --size 200x200"
  local extreme="--eye 0.05,0.05,3 --target 0.05,0.05,0 --ortho 0.0325" view options fit
  while read -r view options; do
    run "surfel-render plane.ply --mesh plane.obj --image checker.png --samples 8 $options $size $white -o $view-texture.png"
    tiles
    for fit in gram ewa render; do
      run "surfel-render $fit.ply --cutoff 4 $options $size $white -o $view-$fit.png"
      compare "$view-$fit.png" "$view-texture.png"
      tile "$view-$fit.png" "$fit, $psnr"
    done
    tile "$view-texture.png" "the texture, $view"
    if [[ $view == extreme ]]; then
      run "surfel-render points.ply $options $size --background 0.4,0.4,0.4,1 -o points.png"
      tile points.png "the points"
    fi
    end_tiles
  done <<VIEWS
minified --eye 0,0,3 --target 0,0,0 --ortho 1.9
magnified --eye 0.0575,0.0275,3 --target 0.0575,0.0275,0 --ortho 0.115
extreme $extreme
VIEWS
}

make_ss01_7() {
  about "A geometric object of semi-transparent surfaces that intersect, blended back to front in most places. The close-up shows that
    surfaces are mixed about the lines where they intersect; more points would avoid it." \
    "Two shells, a ring and two panes through one another and a red ball inside, $(of 200000) points, eight layers. The close-up is of the ring where it
    passes through the outer shell and a pane: the pale strips are surfaces within epsilon of one another, taken for one. A smaller
    epsilon makes them narrower, and so do more points."
  run "surfel-generate transparent --count $(of 200000) -o transparent.ply"
  run "surfel-generate transparent --count $(of 2000000) -o transparent-more.ply"
  local view="--layers 8 --from 0,0.15,1 --size 320x320 --cutoff 2 $white"
  local near="--target=-0.75,0.1,0 --zoom 7 $view"
  run "surfel-render transparent.ply $view -o 7.png"
  run "surfel-render transparent.ply $near -o 7-near.png"
  run "surfel-render transparent.ply --depth-epsilon 0.5 $near -o 7-epsilon.png"
  run "surfel-render transparent-more.ply $near -o 7-more.png"
  tiles
  tile 7.png "the whole object"
  tile 7-near.png "close-up"
  tile 7-epsilon.png "with <code>--depth-epsilon 0.5</code>"
  tile 7-more.png "with $(of 2000000) points"
  end_tiles
}

make_ss01_8() {
  about "A high-frequency texture on a regular grid of points, from near to the horizon. Top row: screen space EWA; second row: source space
    EWA, of the same quality; third row: circular splats, which blur what is magnified; bottom row: elliptical splats without
    the band-limiting filter, which alias where the texture is minified." \
    "A checkerboard on $(of 40000) points of a regular grid, c = 2. Numbers are the PSNR against the last picture, for which the points were ray
    cast with 64 rays a pixel."
  run "surfel-generate plane --jitter 0 --count $(of 40000) -o grid.ply"
  run "surfel-texture grid.ply --image checker:50 --fit render --cutoff 2 --reconstruction 1 -o grid-t.ply"
  local view="--eye 0,-1.05,0.2 --target 0,-0.62,0 --up 0,0,1 --fov 45 --size 320x240 --cutoff 2 --shading none $white" filter
  local -A name=([ewa]="screen space EWA" [ewa-source]="source space EWA" [circular]="circular splats" [none]="elliptical splats, no filter")
  run "surfel-render grid-t.ply --reference --samples 8 $view -o cast.png"
  tiles
  for filter in ewa ewa-source circular none; do
    run "surfel-render grid-t.ply --filter $filter $view -o filter-$filter.png"
    compare "filter-$filter.png" cast.png
    tile "filter-$filter.png" "${name[$filter]}, $psnr"
  done
  tile cast.png "the reference"
  end_tiles
  compare filter-ewa.png filter-ewa-source.png
  echo "<p>Screen space against source space EWA: $psnr.</p>"
}

make_ss01_table2() {
  about "Frame rates of an unoptimised C implementation for frame buffers of 256 &times; 256 and 512 &times; 512 pixels and three layers, on
    &ldquo;a 1.1 GHz AMD Athlon system with 1.5 GByte memory&rdquo;." \
    "Our surfaces with as many points, three layers, shaded; the median of seven frames of a turntable, without reading the file, on $machine."
  table "the paper's data" "ours" "points" "256 &times; 256, paper" "here" "512 &times; 512, paper" "here"
  local data kind count small large fps256
  while read -r data kind count small large; do
    run "surfel-generate $kind --no-uv --count $(of "$count") -o table-$kind.ply"
    rate "table-$kind.ply" "--size 256x256"
    fps256=$fps
    rate "table-$kind.ply" "--size 512x512"
    row "${data//_/ }" "$kind" "$(of "$count")" "$small fps" "$fps256 fps" "$large fps" "$fps fps"
  done <<'ROWS'
Scanned_Head head 429075 1.3 0.7
Matterhorn terrain 4782011 0.2 0.1
Helicopter transparent 987552 0.6 0.3
ROWS
  end_table
}

# ---- SP06 ------------------------------------------------------------------------------------------------------------

body_view="--from 0.1,0.25,1 --fov 30 --frame-all $white"

# surfels MESH COUNT FILE: kernels as wide as the spacing, so that discs overlap as the paper's do.
surfels() { run "surfel-from-mesh data/meshes/$1 --count $(of "$2") --variance-scale 1 -o $3"; }

# Splats of figure 8 and of the tables end here, so that they have about as many neighbours as the paper's.
splats="--cutoff 0.72"

# with_balls BODY PLACE...: BODY-balls.ply, with balls, each SCALE@X,Y,Z, and BODY-balls-g.ply in groups.
with_balls() {
  local body=$1 place files="" materials=0 count=0
  run "surfel-generate sphere --count $(of 20000) -o ball.ply"
  for place in "${@:2}"; do
    run "surfel-convert ball.ply --scale ${place%@*} --translate=${place#*@} -o $body-ball-$((++count)).ply"
    files+=" $body-ball-$count.ply"
    materials+=,1
  done
  run "surfel-convert $body.ply$files --material $materials -o $body-balls.ply"
  run "surfel-group $body-balls.ply --groups 4 --cover enlarge-each -o $body-balls-g.ply"
}

make_sp06_1() {
  about "Transparent and opaque objects together by (a) the single-pass algorithm (Algorithm 2) and (b) the two-pass one (Algorithm 3); a body that
    reflects and refracts its environment, (c) at its nearest surface alone and (d) at every one." \
    "A bunny of $(of 150000) points with three balls inside, four groups; in (c) and (d) the body is of glass."
  surfels stanford_bunny.obj 150000 body.ply
  with_balls body 0.024@-0.042,0.072,0.004 0.019@0.006,0.068,0.006 0.015@-0.06,0.135,0.004
  local view="$body_view --size 400x400"
  run "surfel-render body-balls-g.ply --method transparent --scene configs/scene-balls.toml $view -o 1a.png"
  run "surfel-render body-balls-g.ply --method transparent-high --scene configs/scene-balls.toml $view -o 1b.png"
  local glass="--method transparent-high --scene configs/scene-glass-balls.toml"
  run "surfel-render body-balls-g.ply $glass --refraction single $view -o 1c.png"
  run "surfel-render body-balls-g.ply $glass --refraction multi $view -o 1d.png"
  tiles
  tile 1a.png "a) single pass, <code>transparent</code>"
  tile 1b.png "b) two passes, <code>transparent-high</code>"
  tile 1c.png "c) glass, the nearest surface refracts"
  tile 1d.png "d) glass, every surface refracts"
  end_tiles
}

make_sp06_8() {
  about "Smooth blending by deferred compositing of groups in which splats may overlap up to a factor c of the sum of their radii, c = 1.0 to
    0.4, beside standard blending: hardly any visible artifacts even at 0.4." \
    "A dragon of $(of 300000) points; the A-buffer is our standard blending. K is the number of groups; PSNR of the whole picture against the A-buffer; last,
    what differs at 0.4, ten times amplified. The specks along rims: a group keeps one fragment of each surface in a pixel, of three surfaces
    at most (<code>--layers</code>), so that with few groups a rim's colour is the mean of few fragments. More layers change little."
  surfels dragon_vrip_res2.ply 300000 dragon.ply
  local view="$splats $body_view --size 360x260" overlap
  run "surfel-render dragon.ply $view -o 8.png"
  tiles
  tile 8.png "standard blending (A-buffer)"
  for overlap in 1.0 0.8 0.6 0.4; do
    run "surfel-group dragon.ply $splats --overlap $overlap -o dragon-$overlap.ply --stats 8-$overlap.json"
    run "surfel-render dragon-$overlap.ply --method deferred $view -o 8-$overlap.png"
    compare "8-$overlap.png" 8.png
    tile "8-$overlap.png" "c = $overlap, K = $(number groups "8-$overlap.json"), $psnr"
  done
  run "surfel-compare 8-0.4.png 8.png --scale 10 -o 8-difference.png"
  tile 8-difference.png "difference at c = 0.4, times 10"
  end_tiles
}

make_sp06_9() {
  about "Splats that overlap within a group, rasterised and shaded: in (a) and (b) the nearest fragment wins, and flaps of splats hide others; in (c) and
    (d) the one nearest to its splat's centre wins (equation 10), which gives facets like Voronoi cells." \
    "An armadillo of $(of 12000) points near by. Top row, rasterisation: all splats in one group, so that every pixel shows one splat alone.
    Bottom row, shading: groups with c = 0.4, blended. Left: the nearest fragment wins; middle: equation 10, with steps of depth; right: our
    default, which compares depths with epsilon and has no steps."
  surfels armadillo.ply 12000 coarse.ply
  run "surfel-group coarse.ply --groups 1 -o coarse-1.ply"
  run "surfel-group coarse.ply --overlap 0.4 -o coarse-0.4.ply"
  local groups voronoi view="--from 0.4,0.2,1 --frame-all --zoom 3 --size 340x340 $white"
  local -A name=([1]="one group" [0.4]="c = 0.4")
  for groups in 1 0.4; do
    tiles
    for voronoi in off quantised windowed; do
      run "surfel-render coarse-$groups.ply --method deferred --voronoi $voronoi $view -o 9-$groups-$voronoi.png"
      tile "9-$groups-$voronoi.png" "${name[$groups]}, <code>--voronoi $voronoi</code>"
    done
    end_tiles
  done
}

make_sp06_10() {
  about "A head, a ball joint and a female, opaque, by deferred blending of groups with c = 0.4 and Voronoi rasterisation: smooth pictures." \
    "A head of our own, a bunny and an armadillo, with as many points as in table 1, in the same way. Below, how far the refraction of section 5.2.3
    is from optics, for which the paper has no picture: a ball of glass of $(of 20000) points, whose layers each refract (12) but stay where they are,
    beside its mesh, ray-traced by Snell's law and Fresnel's equations at up to eight surfaces, without caustics. Where every surface
    refracts, the equation shows the environment upside down, nearly where optics shows it; one surface alone does not turn it over. What
    the ball mirrors inside, such as the orange arc below, is in the optics alone; splats, whose normals are few, blur what is seen through."
  local ours mesh count view
  tiles
  while read -r _ ours mesh count; do
    [[ $ours != dragon ]] || continue
    surfels "$mesh" "$count" "table-$ours.ply"
    run "surfel-group table-$ours.ply $splats --overlap 0.4 -o table-$ours-0.4.ply"
    # The head of the data stands on its crown.
    [[ $ours == head ]] && view="--from=-1,-0.2,-0.6 --up 0,-1,0 --fov 30 --frame-all $white" || view=$body_view
    run "surfel-render table-$ours-0.4.ply --method deferred $splats $view --size 330x330 -o 10-$ours.png"
    tile "10-$ours.png" "$ours, c = 0.4, $(of "$count") points"
  done < <(models)
  end_tiles
  run "surfel-generate sphere --count $(of 20000) --mesh ball.obj --resolution 200 -o ball.ply"
  run "surfel-group ball.ply --groups 4 -o ball-g.ply"
  view="--scene configs/scene-glass.toml $body_view --size 250x250"
  run "surfel-render ball-g.ply --method transparent-high --refraction single $view -o 10-single.png"
  run "surfel-render ball-g.ply --method transparent-high --refraction multi $view -o 10-multi.png"
  run "surfel-render --mesh ball.obj --samples 8 $view -o 10-straight.png"
  run "surfel-render --mesh ball.obj --samples 8 --bounces 8 $view -o 10-optics.png"
  tiles
  tile 10-single.png "the nearest surface refracts"
  tile 10-multi.png "every surface refracts"
  compare 10-multi.png 10-straight.png
  tile 10-straight.png "the same equation on the mesh's surfaces, $psnr"
  compare 10-multi.png 10-optics.png
  tile 10-optics.png "geometrical optics, $psnr"
  end_tiles
}

make_sp06_11() {
  about "The splats of one group: (a) with K = 8 groups they overlap less and leave more of the surface open, (b) with K = 4 they overlap more and
    cover it better. Duplicating points so that four groups cover the dragon adds 45 % to its points." \
    "The first group of a bunny of $(of 20000) points: splats are transparent, so that they are brighter where they overlap. Below, as means over
    the groups: the shares of samples of the surface that a group's discs reach and do not reach, and in shares of the surface's area what discs have beyond
    their Voronoi cells."
  surfels stanford_bunny.obj 20000 few.ply
  local groups view="--from 0.1,0.25,1 --frame-all --zoom 2.5 --size 400x400 --cull back --background 0,0,0,1"
  tiles
  for groups in 8 4; do
    run "surfel-group few.ply --groups $groups --cover none -o few-$groups.ply --stats 11-$groups-none.json"
    run "surfel-convert few-$groups.ply --ascii -o few-$groups-a.ply"
    # In the text, \`group\` is the last column of what follows the header.
    run "awk 'FNR == 1 {body = 0} NR == FNR {n += body && \$NF == 0} /^element vertex/ {\$3 = n} NR > FNR && (!body || \$NF == 0); /^end_header/ {body = 1}' few-$groups-a.ply few-$groups-a.ply > first-of-$groups.ply"
    run "surfel-render first-of-$groups.ply --method transparent --layers-by group --voronoi off --scene configs/scene-balls.toml --shading none $view -o 11-$groups.png"
    tile "11-$groups.png" "K = $groups"
  done
  end_tiles
  table "groups" "covered" "left open" "overlap" "points added"
  coverage_row "bunny, K = 8" 11-8-none.json
  coverage_row "bunny, K = 4" 11-4-none.json
  run "surfel-group few.ply --groups 4 --cover enlarge-each -o few-e.ply --stats 11-enlarged.json"
  coverage_row "bunny, K = 4, a radius for every splat (<code>--cover enlarge-each</code>)" 11-enlarged.json
  surfels dragon_vrip_res2.ply 100000 dragon-100k.ply
  run "surfel-group dragon-100k.ply --groups 4 --cover duplicate -o dragon-d.ply --stats 11-duplicated.json"
  coverage_row "dragon, $(of 100000) points, K = 4, duplicated (<code>--cover duplicate</code>; the paper: 45 % added)" 11-duplicated.json
  end_table
}

# coverage_row NAME STATS: the totals, which come after those of the groups.
coverage_row() {
  local key totals=()
  for key in area missed_share overlap_area points_added points_before; do
    totals+=("$(sed -n "/\"coverage\"/,/^  }/s/^    \"$key\": \([0-9.e+-]*\).*/\1/p" "$2")")
  done
  # shellcheck disable=SC2046 # A word a cell.
  row "$1" $(awk -v v="${totals[*]}" 'BEGIN { split(v, t)
    printf "%.1f&nbsp;%% %.1f&nbsp;%% %.0f&nbsp;%% %.0f&nbsp;%%", 100 - 100 * t[2], 100 * t[2], 100 * t[3] / t[1], 100 * t[4] / t[5] }')
}

make_sp06_12() {
  about "A transparent model by (a) depth peeling, which composites every layer correctly, (b) Algorithm 3, virtually without a difference, and
    (c) Algorithm 2, with artifacts that are hardly visible. The text gives the frame rates below, without naming the model." \
    "A dragon of $(of 300000) points in four groups; PSNR of the whole picture against depth peeling. First groups that cover the surface, by
    <code>--cover enlarge-each</code>; then by <code>--cover duplicate</code>, the paper's choice for four groups; then the groups as they are.
    On the left the discs of all groups tell the layers; on the right, with <code>--layers-by group</code>, each group tells its own, as published: the
    mottles there are enlarged and added discs that stick out of the bent surface and count as one more layer."
  surfels dragon_vrip_res2.ply 300000 dragon.ply
  run "surfel-group dragon.ply --groups 4 --cover enlarge-each -o dragon-covered.ply"
  run "surfel-group dragon.ply --groups 4 --cover duplicate -o dragon-duplicated.ply"
  run "surfel-group dragon.ply --groups 4 -o dragon-plain.ply"
  local scene="--scene configs/scene-balls.toml" groups by
  local -A name=([covered]="enlarged" [duplicated]="duplicated" [plain]="groups as they are")
  local view="$scene $body_view --size 360x260"
  run "surfel-render dragon.ply --method depth-peel --peel 16 $view -o 12a.png"
  tiles
  tile 12a.png "a) depth peeling"
  end_tiles
  for groups in covered duplicated plain; do
    tiles
    for by in surface group; do
      run "surfel-render dragon-$groups.ply --method transparent-high --layers-by $by $view -o 12b-$groups-$by.png"
      run "surfel-render dragon-$groups.ply --method transparent --layers-by $by $view -o 12c-$groups-$by.png"
      compare "12b-$groups-$by.png" 12a.png
      tile "12b-$groups-$by.png" "b) Algorithm 3, ${name[$groups]}, by $by, $psnr"
      compare "12c-$groups-$by.png" 12a.png
      tile "12c-$groups-$by.png" "c) Algorithm 2, ${name[$groups]}, by $by, $psnr"
    done
    end_tiles
  done
  table "frames per second" "paper, $paper_machine" "here, 512 &times; 512, $machine"
  rate dragon-covered.ply "--method transparent $scene --size 512x512"
  row "Algorithm 2" "9" "$fps"
  rate dragon-covered.ply "--method transparent-high $scene --size 512x512"
  row "Algorithm 3" "5" "$fps"
  rate dragon-covered.ply "--method transparent --layers-by group $scene --size 512x512"
  row "Algorithm 2, layers by group" "&ndash;" "$fps"
  rate dragon-covered.ply "--method transparent-high --layers-by group $scene --size 512x512"
  row "Algorithm 3, layers by group" "&ndash;" "$fps"
  rate dragon.ply "--method depth-peel --peel 8 $scene --size 512x512"
  row "depth peeling, up to 8 layers" "less than 2" "$fps"
  rate dragon.ply "--size 512x512"
  row "standard, opaque" "14" "$fps"
  rate dragon.ply "--layers 8 $scene --size 512x512"
  row "A-buffer of SS01, 8 layers, transparent" "&ndash;" "$fps"
  end_table
}

make_sp06_13() {
  about "Small opaque balls bounce about a transparent body, by (a) Algorithm 2 and (b) Algorithm 3: opaque and transparent things are composited
    correctly, and the single pass does well unless seen from very near." \
    "An armadillo of $(of 200000) points with a ball inside and four around it; PSNR of the whole picture against depth peeling."
  surfels armadillo.ply 200000 armadillo.ply
  with_balls armadillo 0.10@0,0.02,0 0.07@0.26,-0.08,-0.1 0.06@-0.26,0,0.35 0.05@-0.12,-0.42,-0.12 0.05@0.15,-0.3,0.25
  local view="--scene configs/scene-balls.toml --from 0.4,0.2,1 --fov 30 --frame-all $white --size 360x360"
  run "surfel-render armadillo-balls-g.ply --method transparent $view -o 13a.png"
  run "surfel-render armadillo-balls-g.ply --method transparent-high $view -o 13b.png"
  run "surfel-render armadillo-balls.ply --method depth-peel --peel 16 $view -o 13.png"
  tiles
  compare 13a.png 13.png
  tile 13a.png "a) Algorithm 2, <code>transparent</code>, $psnr"
  compare 13b.png 13.png
  tile 13b.png "b) Algorithm 3, <code>transparent-high</code>, $psnr"
  tile 13.png "depth peeling"
  end_tiles
}

make_sp06_14() {
  about "Glass with Fresnel reflection and chromatic dispersion, with refraction (a) at the nearest layer alone and (b) at all of them; close-ups show the
    further refractions and the stronger absorption." \
    "A glass bunny of $(of 150000) points in four groups, whole and near by."
  surfels stanford_bunny.obj 150000 body.ply
  run "surfel-group body.ply --groups 4 --cover enlarge-each -o body-g.ply"
  local zoom refraction
  local -A name=([single]="a) the nearest layer refracts" [multi]="b) all layers refract")
  for zoom in 1 3; do
    tiles
    for refraction in single multi; do
      run "surfel-render body-g.ply --method transparent-high --scene configs/scene-glass.toml --refraction $refraction $body_view --zoom $zoom --size 440x440 -o 14-$refraction-$zoom.png"
      tile "14-$refraction-$zoom.png" "${name[$refraction]}$([[ $zoom == 1 ]] || echo ', near by')"
    done
    end_tiles
  done
}

# Models of tables 1 and 2: the paper's, ours, its mesh, points.
models() {
  cat <<'MODELS'
David_Head head mri_head_surface.ply 2000000
Dragon dragon dragon_vrip_res2.ply 1100000
Female armadillo armadillo.ply 303000
BallJoint bunny stanford_bunny.obj 137000
MODELS
}

make_sp06_table1() {
  about "Groups K by largest-first colouring of the graph of overlapping splats, with the largest and the mean degree of the graph, for factors c
    by which overlaps are relaxed (3): K falls quickly with c. Splats of one plane (1) and with opposite normals (2) may overlap." \
    "Meshes of ours with as many points, without the relaxations (1) and (2) and with them. Degrees depend on how large splats are, which the
    paper does not say; at <code>$splats</code>, the splats of figure 8, the mean degree is near the paper's. The largest degree, and K with it,
    comes from where sheets lie close together, which (2) lets share groups."
  table "K / largest / mean degree" "points" "c = 1.0" "c = 0.8" "c = 0.6" "c = 0.4"
  local -A paper=(
    [head]="18 / 37 / 17.2|14 / 31 / 11.6|11 / 24 / 9.4|7 / 8 / 3.9"
    [dragon]="14 / 34 / 8.8|12 / 29 / 6.3|8 / 15 / 3.0|5 / 7 / 0.8"
    [armadillo]="19 / 49 / 18.9|15 / 32 / 13.2|10 / 18 / 6.9|8 / 9 / 2.3"
    [bunny]="17 / 31 / 18.6|12 / 23 / 13.6|9 / 14 / 7.1|5 / 7 / 2.3")
  local theirs ours mesh count values relaxed
  local -A options=(["(3)"]="" ["(1), (2), (3)"]="--relax-coplanar --relax-opposite ")
  while read -r theirs ours mesh count; do
    surfels "$mesh" "$count" "table-$ours.ply"
    IFS='|' read -ra values <<< "${paper[$ours]}"
    row "paper: ${theirs/_/ }" "${count%000}K" "${values[@]}"
    for relaxed in "(3)" "(1), (2), (3)"; do
      run "surfel-group table-$ours.ply $splats ${options[$relaxed]}--print-table > table-$ours.txt"
      IFS='|' read -ra values <<< "$(tail -1 "table-$ours.txt" | cut -d'|' -f4-7)"
      row "here: $ours, $relaxed" "$(of "$count")" "${values[@]}"
    done
  done < <(models)
  end_table
}

make_sp06_table2() {
  about "Frames per second of opaque models: a standard renderer of two geometry passes and one over the picture (2+1), and deferred blending of
    groups with c = 0.8, without Voronoi rasterisation, and c = 0.4, with it, on &ldquo;$paper_machine&rdquo;: up to 50 % faster for large models." \
    "The models of table 1 at 512 &times; 512 pixels, shaded; 2+1 is <code>--method two-pass</code>, and the A-buffer our standard renderer;
    median of seven frames of a turntable on $machine. Below, passes over the splats, fragments that were evaluated in them, and time
    of a frame. Splats are set up once for both passes, as they stay in a processor's cache; on a graphics card the second pass sets them up again."
  local counts=""
  table "paper's model" "ours" "points" "2+1, paper" "here" "c = 0.8, paper" "here" "c = 0.4, paper" "here" "A-buffer, here"
  local -A paper=([head]="0.96 1.2 1.4" [dragon]="15.04 19.70 22.62" [armadillo]="32.65 32.11 37.76" [bunny]="65.68 52.96 70.37")
  local theirs ours mesh count values two loose tight
  while read -r theirs ours mesh count; do
    surfels "$mesh" "$count" "table-$ours.ply"
    run "surfel-group table-$ours.ply $splats --overlap 0.8 -o table-$ours-0.8.ply"
    run "surfel-group table-$ours.ply $splats --overlap 0.4 -o table-$ours-0.4.ply"
    rate "table-$ours.ply" "--method two-pass $splats --size 512x512"
    two=$fps
    counts+=$(counts_row "$ours" "2+1 passes")
    rate "table-$ours-0.8.ply" "--method deferred --voronoi off $splats --size 512x512"
    loose=$fps
    counts+=$(counts_row "$ours" "deferred, c = 0.8")
    rate "table-$ours-0.4.ply" "--method deferred $splats --size 512x512"
    tight=$fps
    counts+=$(counts_row "$ours" "deferred, c = 0.4")
    rate "table-$ours.ply" "$splats --size 512x512"
    counts+=$(counts_row "$ours" "A-buffer")
    read -ra values <<< "${paper[$ours]}"
    row "${theirs/_/ }" "$ours" "$(of "$count")" "${values[0]}" "$two" "${values[1]}" "$loose" "${values[2]}" "$tight" "$fps"
  done < <(models)
  end_table
  table "ours" "method" "geometry passes" "fragments" "frame"
  echo "$counts"
  end_table
}

# counts_row MODEL METHOD: a row with what `rate` has set.
counts_row() { row "$1" "$2" "$passes" "$fragments" "$(printf '%.1f ms' "$ms")"; }

# ---- The page --------------------------------------------------------------------------------------------------------

paper_machine="a PC with a 2.8GHz CPU and NVidia GeForce 7800GTX GPU"
machine="$(nproc) threads of $(sed -n 's/^model name[^:]*: //p' /proc/cpuinfo | head -1 | html)"

head_of_page() {
  cat <<HTML
<!DOCTYPE html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width">
<title>Surfelkit: two papers, made again</title>
<style>
body { font: 16px/1.45 sans-serif; max-width: 1120px; margin: 1.5em auto; padding: 0 1em; color: #222; }
h2 { margin: 2.5em 0 0.5em; border-top: 1px solid #bbb; padding-top: 0.7em; font-size: 1.3em; }
p { max-width: 62em; margin: 0.5em 0; }
.tiles { display: flex; flex-wrap: wrap; gap: 12px; margin: 0.8em 0; }
figure { display: table; margin: 0; }
img { display: block; }
figcaption { display: table-caption; caption-side: bottom; font-size: 0.85em; }
table { border-collapse: collapse; margin: 0.8em 0; font-size: 0.92em; }
th, td { border: 1px solid #ccc; padding: 0.25em 0.6em; text-align: left; }
th { background: #f2f2f2; }
pre { background: #f6f6f6; border: 1px solid #ddd; padding: 0.6em; font-size: 0.78em; white-space: pre-wrap; overflow: auto; max-height: 16em; }
</style>
<h1>Two papers, made again</h1>
<p>Figures and tables of <b>SS01</b>, Zwicker, Pfister, van Baar and Gross, <i>Surface Splatting</i>, 2001, and of <b>SP06</b>, Zhang and Pajarola,
<i>Single-Pass Point Rendering and Transparent Shading</i>, 2006, by Surfelkit $(surfel-render --version | sed 's/.* //') with surfaces of its own and the
meshes of its test data. All pictures and numbers were made in one run of <code>samples/reproduce.sh</code> on $machine$(
    [[ $part == 1 ]] || echo ", with $part of the surfels"). PSNR is of sRGB values.</p>
<p>The commands run as they stand, after</p>
<pre>$(printf 'mkdir again && cd again\nln -s %q data\nln -s %q configs\nln -s %q samples\nPATH=%q:$PATH\n' \
  "$data" "$surfel_root/configs" "$surfel_root/samples" "$bin" | html)</pre>
<ul>
HTML
  for figure in "${wanted[@]}"; do echo "<li><a href=\"#$figure\">${title[$figure]}</a></li>"; done
  echo '</ul>'
}

{
  head_of_page
  for figure in "${wanted[@]}"; do
    start=$SECONDS
    commands=""
    echo "<h2 id=\"$figure\">${title[$figure]}</h2>"
    "make_${figure/-/_}"
    echo "<pre>$(html <<< "${commands%$'\n'}")</pre>"
    echo "${title[$figure]}, $((SECONDS - start)) s" >&2
  done
  echo '</html>'
} > "$work/page.html"
cp "$work/page.html" "$page.part"
mv "$page.part" "$page"
echo "$page"
