#!/usr/bin/env bash
# A film, whose pictures are made by an array of Slurm jobs, and joined by a last job.
#
# Usage: samples/slurm/film.sh FILM PICTURES JOBS FILE [OPTION OF surfel-render]...
#   samples/slurm/film.sh city.mp4 720 48 city-lod.ply --turntable 720 --size 1920x1080
#
# PICTURES is their number, as the options ask for (--turntable, --path-pictures). They are files in FILM.pictures, on
# a disk that all nodes share. Where jobs have failed, the pictures that are missing are named, and the same command
# makes these alone; for other options remove the folder. What sbatch is to be told besides goes into SURFEL_SBATCH, such
# as "--mem=4G --time=30".
set -euo pipefail
if [[ $# -lt 4 || ! $2 =~ ^[1-9][0-9]*$ || ! $3 =~ ^[1-9][0-9]*$ ]]; then
  sed -n '2,5s/^# \{0,1\}//p' "$0" >&2
  exit 2
fi
film=$1 pictures=$2 jobs=$(($3 < $2 ? $3 : $2)) folder=$1.pictures
shift 3
read -ra options <<< "${SURFEL_SBATCH:-}"
mkdir -p "$folder"
# quoted WORD...: the words for a shell.
quoted() { printf ' %q' "$@"; }

# Job k makes the pictures from pictures * k / jobs on.
sbatch "${options[@]}" --wait --job-name=surfel-pictures --array="0-$((jobs - 1))" --output="$folder/%a.log" --wrap \
  "surfel-render$(quoted "$@") -o$(quoted "$folder")/%06d.png --skip-existing --threads \${SLURM_CPUS_PER_TASK:-1} \
    --frames \$(($pictures * SLURM_ARRAY_TASK_ID / $jobs))-\$(($pictures * (SLURM_ARRAY_TASK_ID + 1) / $jobs - 1))" \
  > /dev/null || true
missing=()
for ((i = 0; i < pictures; ++i)); do
  [[ -f $(printf '%s/%06d.png' "$folder" $i) ]] || missing+=("$i")
done
if [[ ${#missing[@]} -gt 0 ]]; then
  echo "$film: ${#missing[@]} of $pictures pictures are missing: ${missing[*]:0:20}; $folder/*.log tell why" >&2
  exit 1
fi
surfel-join "$folder"/*.png -o "$film"
