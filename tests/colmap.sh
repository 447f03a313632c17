#!/usr/bin/env bash
# Prints the table of docs/formats.md, section "With COLMAP": pictures of a scene are given to COLMAP (Debian: colmap),
# which finds their views, and the scene is drawn again from the views that it found. Needs a build in build/release;
# says so and does nothing where colmap is not installed. Takes a few minutes on two cores.
# Usage: tests/colmap.sh [SIZE of the pictures, 1280]
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bin=$PWD/build/release/bin
size=${1:-1280}
rings=3 each=16 # Cameras stand on rings around the scene.
command -v colmap >/dev/null || { echo "colmap is not installed" >&2; exit 0; }
export QT_QPA_PLATFORM=offscreen
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
run() { nice colmap "$@" >>colmap.log 2>&1 || { tail -n 20 colmap.log >&2; exit 1; }; }

# A head on the ground, both full of detail.
"$bin/surfel-generate" head --count 400000 --texture noise --frequency 24 -o head.ply --quiet
"$bin/surfel-generate" plane --count 600000 --texture noise --frequency 40 --seed 5 -o plane.ply --quiet
"$bin/surfel-convert" plane.ply --scale 3 --rotate 1,0,0,-90 --translate 0,-0.8,0 -o ground.ply --quiet
"$bin/surfel-convert" head.ply ground.ply -o scene.ply --quiet

# views.toml: the cameras; eyes.txt: their places; pairs.txt: the pictures that see much of the same.
awk -v rings="$rings" -v each="$each" -v size="$size" '
  function name(r, k) { return sprintf("v%02d", r * each + (k + each) % each) }
  BEGIN {
    pi = atan2(0, -1)
    for (r = 0; r < rings; ++r) for (k = 0; k < each; ++k) {
      a = 2 * pi * (k + r / rings) / each
      e = (15 + 22 * r) * pi / 180
      x = 4.5 * cos(e) * cos(a); y = 4.5 * sin(e) - 0.2; z = 4.5 * cos(e) * sin(a)
      printf "[[camera]]\nname = \"%s\"\neye = [%.9f, %.9f, %.9f]\ntarget = [0, -0.2, 0]\n", name(r, k), x, y, z > "views.toml"
      printf "up = [0, 1, 0]\nfov = 40\nsize = [%d, %d]\n\n", size, size > "views.toml"
      printf "%s.png %.9f %.9f %.9f\n", name(r, k), x, y, z > "eyes.txt"
      for (d = 1; d <= 3; ++d) printf "%s.png %s.png\n", name(r, k), name(r, k + d) > "pairs.txt"
      for (d = -1; d <= 1 && r + 1 < rings; ++d) printf "%s.png %s.png\n", name(r, k), name(r + 1, k + d) > "pairs.txt"
      if (r + 2 < rings) printf "%s.png %s.png\n", name(r, k), name(r + 2, k) > "pairs.txt"
    }
  }'

# draw VIEWS FOLDER: the scene from all views.
draw() { mkdir -p "$2"; "$bin/surfel-render" scene.ply --views "$1" -o "$2/{name}.png" --shading none --background 0,0,0,1 --quiet; }
draw views.toml given

focal=$(awk -v size="$size" 'BEGIN { a = atan2(0, -1) / 9; printf "%.9f", size / 2 / (sin(a) / cos(a)) }')
known=(--Mapper.ba_refine_focal_length 0 --Mapper.ba_refine_extra_params 0)
run feature_extractor --database_path db --image_path given --ImageReader.single_camera 1 --ImageReader.camera_model PINHOLE \
  --ImageReader.camera_params "$focal,$focal,$((size / 2)),$((size / 2))" --SiftExtraction.use_gpu 0 --SiftExtraction.max_num_features 6000
run matches_importer --database_path db --match_list_path pairs.txt --match_type pairs --SiftMatching.use_gpu 0
mkdir found refined aligned
run mapper --database_path db --image_path given --output_path found "${known[@]}"
run bundle_adjuster --input_path found/0 --output_path refined --BundleAdjustment.max_num_iterations 200 \
  --BundleAdjustment.function_tolerance 0 --BundleAdjustment.refine_focal_length 0 --BundleAdjustment.refine_extra_params 0
# A reconstruction has a frame of its own: the similarity that takes its eyes to the given ones.
run model_aligner --input_path refined --output_path aligned --ref_images_path eyes.txt --ref_is_gps 0 \
  --robust_alignment 1 --robust_alignment_max_error 0.01
draw aligned again

error=$(colmap model_analyzer --path aligned 2>&1 | sed -n 's/.*Mean reprojection error: \([0-9.]*\)px.*/\1/p')
echo "| pictures | views found | reprojection error | dB, mean | median | least |"
echo "|---|---|---|---|---|---|"
for picture in again/*.png; do
  "$bin/surfel-compare" "$picture" "given/${picture##*/}" | sed -n 's/^psnr *\([0-9.]*\).*/\1/p'
done | sort -n | awk -v all=$((rings * each)) -v size="$size" -v error="$error" '
  { v[NR] = $1; sum += $1 }
  END { printf "| %d of %d x %d | %d | %.2f pixels | %.1f | %.1f | %.1f |\n", all, size, size, NR, error, sum / NR, v[int((NR + 1) / 2)], v[1] }'
