#!/usr/bin/env bash
# Makes docs/groups.md: the groups of surfel-group beside those of SP06. Needs the real data, and a build with
# SURFEL_BUILD_BENCH. Takes minutes.
# Usage: tests/groups.sh [folder of the tools] [output]
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
tools=${1:-$root/build/release/bin}
out=${2:-$root/docs/groups.md}
data=${SURFEL_TEST_DATA:-$root/../shared/data}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
# Mean degree = 25.1 cutoff - 1 for sigma = spacing: near SP06's 17 at c = 1.
cutoff=(--cutoff 0.72)
orders=(largest-first smallest-last dsatur)
# What is timed does not wait for other programs, where that is allowed.
first=()
if chrt -f 50 true 2> /dev/null; then first=(chrt -f 50); fi

# number KEY < JSON: the first of that name.
number() { sed -n "s/.*\"$1\": \\(-\\{0,1\\}[0-9.e+-]*\\).*/\\1/p" | head -1; }

# surfels NAME MESH COUNT
surfels() { "$tools/surfel-from-mesh" "$data/meshes/$2" --count "$3" --variance-scale 1 -o "$work/$1.ply" --quiet; }

# samples NAME MESH: to count what is covered.
samples() { "$tools/surfel-from-mesh" "$data/meshes/$2" --count 1000000 --seed 7 -o "$work/$1-samples.ply" --quiet; }

# row NAME TEXT OPTION...: of the table, with a text in the third column.
row() {
  local name=$1 text=$2
  shift 2
  "$tools/surfel-group" "$work/$name.ply" "${cutoff[@]}" --print-table --quiet "$@" |
    tail -1 | awk -F'|' -v text="$text" '{printf "|%s|%s| %s |%s|%s|%s|%s|\n", $2, $3, text, $4, $5, $6, $7}'
}

# times NAME CUTOFF: at c = 1, for every order: the least wall time of five runs, and the least processor time.
times() {
  local line= order TIMEFORMAT='%R %U %S'
  for order in "${orders[@]}"; do
    for _ in 1 2 3 4 5; do
      { time "${first[@]}" "$tools/surfel-group" "$work/$1.ply" --cutoff "$2" --order "$order" -o "$work/out.ply" \
        --stats "$work/s.json" --threads 2 --quiet; } 2>> "$work/time.txt"
    done
    line+=$(awk 'NR == 1 || $1 < wall {wall = $1} NR == 1 || $2 + $3 < cpu {cpu = $2 + $3}
      END {printf " %.2f s, %.2f s |", wall, cpu}' "$work/time.txt")
    rm "$work/time.txt"
  done
  echo "| $1 | $(number mean_degree < "$work/s.json" | awk '{printf "%.1f", $1}') |$line $(number peak_memory_bytes < "$work/s.json" | awk '{printf "%.0f MB", $1 / 1e6}') |"
}

# fixed NAME K
fixed() {
  local row="| $1 | $2 |"
  for order in "${orders[@]}"; do
    "$tools/surfel-group" "$work/$1.ply" "${cutoff[@]}" --order "$order" --groups "$2" -o "$work/out.ply" \
      --stats "$work/s.json" --quiet
    row+=$(awk -v o="$(number overlap_area < "$work/s.json")" -v d="$(number disc_area < "$work/s.json")" \
      'BEGIN {printf " %.1f %% |", 100 * o / d}')
  done
  echo "$row"
}

# cover NAME [OPTION...]: four groups that each cover the surface; what is covered, missing and overlaps, in shares of its
# area; with options by enlarge-each alone.
cover() {
  local name=$1 method methods=(enlarge enlarge-each duplicate)
  shift
  if [ $# -gt 0 ]; then methods=(enlarge-each); fi
  for method in "${methods[@]}"; do
    "$tools/surfel-group" "$work/$name.ply" --groups 4 --cover $method "$@" -o "$work/out.ply" --stats "$work/s.json" --quiet
    # The totals come after those of the groups, in the order of the alphabet.
    coverage() { sed -n "/\"coverage\"/,/^  }/s/^    \"$1\": \([0-9.e+-]*\).*/\1/p" "$work/s.json" | head -1; }
    local missed
    missed=$("$tools/group_table" coverage "$work/$name-samples.ply" "$work/out.ply")
    awk -v name="$name" -v missed="$missed" -v method="$method${*:+, \`$*\`}" -v area="$(coverage area)" -v covered="$(coverage covered_area)" \
      -v missing="$(coverage uncovered_area)" -v overlap="$(coverage overlap_area)" -v mean="$(coverage growth_mean)" \
      -v most="$(coverage growth_max)" -v added="$(coverage points_added)" -v before="$(coverage points_before)" \
      'BEGIN {printf "| %s | %s | %s | %.1f %% | %.2f %% | %.0f %% | %.2f, %.1f | %.0f %% |\n", name, method, missed,
        100 * covered / area, 100 * missing / area, 100 * overlap / area, mean, most, 100 * added / before}'
  done
}

# worth NAME MESH: how near Algorithms 2 and 3 come to depth peeling, with groups as they are, with a radius for every splat, and with copies.
worth() {
  local name=$1 zoom method by cover image
  local view=(--scene "$root/configs/scene-balls.toml" --frame-all --fov 30 --size 400x400 --quiet)
  "$tools/surfel-from-mesh" "$data/meshes/$2" --count 150000 --variance-scale 1 -o "$work/w.ply" --quiet
  for cover in none enlarge-each duplicate; do
    "$tools/surfel-group" "$work/w.ply" --groups 4 --cover $cover -o "$work/w-$cover.ply" --quiet
  done
  for zoom in 1 4 10; do
    "$tools/surfel-render" "$work/w.ply" --method depth-peel --peel 32 --zoom $zoom "${view[@]}" -o "$work/truth.png"
    local row="| $name | $zoom |"
    for by in surface group; do
      for method in transparent transparent-high; do
        local values=()
        for cover in none enlarge-each duplicate; do
          image="$work/worth.png"
          "$tools/surfel-render" "$work/w-$cover.ply" --method $method --layers-by $by --zoom $zoom "${view[@]}" -o "$image"
          values+=("$("$tools/surfel-compare" "$image" "$work/truth.png" --json | sed -n 's/.*"psnr": \([0-9.]*\).*/\1/p' | head -1 | awk '{printf "%.1f", $1}')")
        done
        row+=" ${values[0]} / ${values[1]} / ${values[2]} |"
      done
    done
    echo "$row"
  done
}

surfels head mri_head_surface.ply 2000000
surfels dragon dragon_vrip_res2.ply 1100000
surfels armadillo armadillo.ply 303000
surfels bunny stanford_bunny.obj 137000
{
  cat <<'TEXT'
# Groups

`surfel-group` divides surfels into groups whose members do not overlap, so that a renderer can draw a group without blending, or into K groups
that overlap least and each cover the surface (Zhang, Pajarola 2006, *Single-Pass Point Rendering and Transparent Shading*, "SP06").

```
surfel-from-mesh dragon_vrip_res2.ply --count 300000 -o dragon.ply
surfel-group dragon.ply --order dsatur --relax-opposite -o grouped.ply      # as few groups as can be
surfel-group dragon.ply --groups 4 --cover enlarge-each -o covered.ply      # four that each cover the dragon
```

Made by `tests/groups.sh`. Surfels of `surfel-from-mesh --count N` (sigma = spacing), grouped at `--cutoff 0.72`, where the mean degree is
near SP06's 17. An entry is K / largest degree / mean degree.

## Minimal groups: table 1 of SP06

| SP06 | points | order | c = 1.0 | c = 0.8 | c = 0.6 | c = 0.4 |
|---|---|---|---|---|---|---|
| David head | 2000K | largest-first | 18 / 37 / 17.2 | 14 / 31 / 11.6 | 11 / 24 / 9.4 | 7 / 8 / 3.9 |
| Dragon | 1100K | largest-first | 14 / 34 / 8.8 | 12 / 29 / 6.3 | 8 / 15 / 3.0 | 5 / 7 / 0.8 |
| Female | 303K | largest-first | 19 / 49 / 18.9 | 15 / 32 / 13.2 | 10 / 18 / 6.9 | 8 / 9 / 2.3 |
| BallJoint | 137K | largest-first | 17 / 31 / 18.6 | 12 / 23 / 13.6 | 9 / 14 / 7.1 | 5 / 7 / 2.3 |

Ours; *relaxed* lets splats of one plane and splats with opposite normals overlap, SP06's relaxations (1) and (2):

| surfels | points | order | c = 1.0 | c = 0.8 | c = 0.6 | c = 0.4 |
|---|---|---|---|---|---|---|
TEXT
  for name in head dragon armadillo bunny; do
    for order in "${orders[@]}"; do row $name "$order" --order "$order"; done
    row $name "largest-first, relaxed" --relax-opposite --relax-coplanar
  done
  cat <<'TEXT'

The largest degree, and with it K, comes from where sheets lie close together: `--relax-opposite` lets them share groups.
DSATUR:

| surfels | points | relaxations | c = 1.0 | c = 0.8 | c = 0.6 | c = 0.4 |
|---|---|---|---|---|---|---|
TEXT
  for name in dragon bunny; do
    row $name none --order dsatur
    row $name opposite --order dsatur --relax-opposite
    row $name coplanar --order dsatur --relax-coplanar
    row $name both --order dsatur --relax-opposite --relax-coplanar
  done
  cat <<'TEXT'

## Times

Wall time of the whole run at c = 1.0 with two threads, reading and writing included, its processor time over all threads, and its
memory; the least of five runs. `million` is `surfel-generate sphere --count 1000000`.

| surfels | mean degree | largest-first | smallest-last | dsatur | peak memory |
|---|---|---|---|---|---|
TEXT
  "$tools/surfel-generate" sphere --count 1000000 -o "$work/million.ply" --quiet
  times million 0.72
  times million 1.2
  times dragon 0.72
  times bunny 0.72
  cat <<'TEXT'

Beside Boost.Graph's `sequential_vertex_coloring`, one thread, in one process: least of five runs. Ours includes making the
order (largest first), which Boost.Graph's is given, and its graph, a copy of ours.

| splats | mean degree | K | Boost.Graph's K | pairs, 2 threads | colouring | Boost.Graph | ratio |
|---|---|---|---|---|---|---|---|
TEXT
  "${first[@]}" "$tools/group_table" coloring "$work/million.ply" 0.72 5
  "${first[@]}" "$tools/group_table" coloring "$work/million.ply" 1.2 5
  cat <<'TEXT'

## Blocks

Up to 262,144 splats are divided at once, more in blocks of 65,536 along a Morton curve, whatever the memory ([scale.md](scale.md)). Groups that it takes, in blocks and all at once (degrees are the same):

| surfels | points | order | c = 1.0, blocks | at once | c = 0.6, blocks | at once |
|---|---|---|---|---|---|---|
| dragon | 1100000 | largest-first | 27 | 27 | 11 | 11 |
| dragon | 1100000 | smallest-last | 25 | 24 | | |
| dragon | 1100000 | dsatur | 24 | 25 | 10 | 10 |
| armadillo | 303000 | largest-first | 14 | 14 | 7 | 6 |
| armadillo | 303000 | smallest-last | 14 | 11 | | |
| armadillo | 303000 | dsatur | 14 | 13 | 6 | 6 |

The other tables are of all splats at once.

## A fixed number of groups

Overlap within groups as a share of the area of all discs.

| surfels | K | largest-first | smallest-last | dsatur |
|---|---|---|---|---|
TEXT
  for k in 4 8; do
    fixed dragon $k
    fixed bunny $k
  done
  cat <<'TEXT'

## Coverage by four groups

Means over the groups. Missed: the share of a million other samples of the surface (500,000 of plane and sphere) that none of the
group's discs that face the same way reaches, counted by a program that shares nothing with the cells. Then, in shares of the surface's
area A, what `surfel-group` reports: what discs cover of the group's Voronoi cells, what they leave of them, and what they have beyond
them; growth of the radii, mean and largest; splats added (SP06: 45 % on the dragon). Plane and sphere have the areas 1 and 4 pi.

| surfels | method | missed | covered | uncovered | overlap | growth | added |
|---|---|---|---|---|---|---|---|
TEXT
  for kind in plane sphere; do
    "$tools/surfel-generate" $kind --count 50000 -o "$work/$kind.ply" --quiet
    "$tools/surfel-generate" $kind --count 500000 --seed 7 -o "$work/$kind-samples.ply" --quiet
  done
  samples bunny stanford_bunny.obj
  samples dragon dragon_vrip_res2.ply
  for name in plane sphere bunny; do cover $name; done
  "$tools/surfel-from-mesh" "$data/meshes/dragon_vrip_res2.ply" --count 200000 --variance-scale 1 -o "$work/dragon.ply" --quiet
  cover dragon
  cover dragon --most-growth 1000
  cat <<'TEXT'

## What covering is worth

PSNR to depth peeling, dB: four groups as they are / with `--cover enlarge-each` / with `--cover duplicate`. 150,000 surfels (sigma = spacing), whole and near
by, where groups have holes; `configs/scene-balls.toml`, 400 x 400 pixels. Left as `surfel-render` draws them, right with `--layers-by group`, as
published: discs that stick out of a bent surface are layers of their own there, so that covering makes pictures worse.

| mesh | zoom | Algorithm 2 | Algorithm 3 | Algorithm 2, by group | Algorithm 3, by group |
|---|---|---|---|---|---|
TEXT
  worth bunny stanford_bunny.obj
  worth armadillo armadillo.ply
  worth fandisk fandisk.obj
  worth dragon dragon_vrip_res2.ply
  echo
  cat "$root/tests/groups_notes.md"
} > "$out"
