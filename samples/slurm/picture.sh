#!/usr/bin/env bash
# One large picture, made in parts by an array of Slurm jobs, and joined by a last job.
#
# Usage: samples/slurm/picture.sh PICTURE PARTS FILE [OPTION OF surfel-render]...
#   samples/slurm/picture.sh city.png 64 city-lod.ply --size 32768x16384 --from 0,-1,0.7
#
# The parts are files in PICTURE.parts, on a disk that all nodes share. Where jobs have failed, the last job names the
# parts that are missing; the same command makes these, and leaves alone what it has made before. What sbatch is to be
# told besides goes into SURFEL_SBATCH, such as "--mem=4G --time=30 --cpus-per-task=8".
set -euo pipefail
if [[ $# -lt 3 || ! $2 =~ ^[1-9][0-9]*$ ]]; then
  sed -n '2,5s/^# \{0,1\}//p' "$0" >&2
  exit 2
fi
picture=$1 parts=$2 folder=$1.parts
shift 2
read -ra options <<< "${SURFEL_SBATCH:-}"
mkdir -p "$folder"
# quoted WORD...: the words for a shell.
quoted() { printf ' %q' "$@"; }

array=$(sbatch --parsable "${options[@]}" --job-name=surfel-part --array="1-$parts" --output="$folder/%a.log" --wrap \
  "surfel-render$(quoted "$@") -o$(quoted "$folder")/\$SLURM_ARRAY_TASK_ID-of-$parts.exr \
    --tiles \$SLURM_ARRAY_TASK_ID/$parts --skip-existing --threads \${SLURM_CPUS_PER_TASK:-1}")
sbatch "${options[@]}" --wait --job-name=surfel-join --dependency="afterany:${array%%;*}" --output="$folder/join.log" --wrap \
  "surfel-join$(quoted "$folder")/*-of-$parts.exr -o$(quoted "$picture")" > /dev/null || {
  cat "$folder/join.log" >&2
  exit 1
}
cat "$folder/join.log"
