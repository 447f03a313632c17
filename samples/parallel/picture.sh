#!/usr/bin/env bash
# One large picture, made in parts by GNU parallel, on this machine or on several, and joined.
#
# Usage: samples/parallel/picture.sh PICTURE PARTS FILE [OPTION OF surfel-render]...
#   samples/parallel/picture.sh city.png 64 city-lod.ply --size 32768x16384 --from 0,-1,0.7
#
# The parts are files in PICTURE.parts. Where some have failed, the same command makes these, and leaves alone what it
# has made before. What parallel is to be told besides, such as the machines (which share the folder, and are reached by
# ssh), goes into SURFEL_PARALLEL: SURFEL_PARALLEL="--sshlogin one,two --workdir . --jobs 2".
set -euo pipefail
if [[ $# -lt 3 || ! $2 =~ ^[1-9][0-9]*$ ]]; then
  sed -n '2,5s/^# \{0,1\}//p' "$0" >&2
  exit 2
fi
picture=$1 parts=$2
shift 2
read -ra options <<< "${SURFEL_PARALLEL:-}"
folder=$picture.parts
mkdir -p "$folder"
failed=0
seq "$parts" | parallel --will-cite --halt never --quote "${options[@]}" \
  surfel-render "$@" -o "$folder/{}-of-$parts.exr" --tiles "{}/$parts" --skip-existing --quiet || failed=$?
[[ $failed -eq 0 ]] || echo "$failed of $parts parts have failed; the same command makes them again" >&2
surfel-join "$folder"/*"-of-$parts.exr" -o "$picture"
