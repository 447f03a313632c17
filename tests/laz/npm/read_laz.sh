#!/bin/sh
# read_laz.sh FOLDER FILE...: writes the points that laz-perf of npm reads of LAZ files to FILE.points each. Installs the
# locked version in FOLDER where it is not there yet; ends with 77 where that cannot be done.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
folder=$1
shift
command -v npm >/dev/null || exit 77
mkdir -p "$folder"
(
  flock 9
  if ! cmp -s "$here/package-lock.json" "$folder/installed.json"; then
    cp "$here/package.json" "$here/package-lock.json" "$folder"
    cd "$folder"
    npm ci --no-audit --no-fund --no-update-notifier --fetch-retries 1 >&2 || exit 77
    cp package-lock.json installed.json
  fi
) 9>"$folder/lock"
NODE_PATH=$folder/node_modules exec node "$here/read_laz.js" "$@"
