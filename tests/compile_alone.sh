#!/usr/bin/env bash
# Checks that sources and headers of the library and the tools compile alone: the builds of the presets join sources of a
# folder (unity builds), where one may use what another has included. Nothing is built (-fsyntax-only): a file takes 4 s.
#   tests/compile_alone.sh             files that the last 20 commits changed, and the benchmarks, which CI builds nowhere else
#   tests/compile_alone.sh REVISION    the same of what changed since a revision; in both cases 20 files at most, the latest first
#   tests/compile_alone.sh --all       all files, which takes half an hour of one core
# Changes that are not committed count as well. In a clone without earlier commits files from all over the project are
# checked instead. Ends with 0 if all files that were checked compile.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
most=20
database=build/alone/compile_commands.json

# Headers named -inl.h are for sources that Highway compiles several times.
all_files() { find lib tools -name '*.cpp' -o -name '*.h' ! -name '*-inl.h' | sort; }

# The files that were changed since a revision, the latest first.
changed_files() {
  git diff --name-only HEAD
  git log --name-only --format= "$1..HEAD"
}

choose_files() {
  local since=${1:-}
  if [ -z "$since" ]; then
    since=$(git rev-parse --quiet --verify HEAD~20 2>/dev/null || git rev-list --max-parents=0 HEAD 2>/dev/null | tail -n 1) || true
    if [ -z "$since" ] || [ "$since" = "$(git rev-parse HEAD)" ]; then
      all_files | awk -v step="$(($(all_files | wc -l) / most + 1))" 'NR % step == 0'
      return
    fi
  fi
  local changed
  mapfile -t changed < <(changed_files "$since" | awk '!seen[$0]++' | grep -Fxf <(all_files))
  if [ ${#changed[@]} -gt $most ]; then
    echo "${#changed[@]} files changed since $since; the latest $most are checked" >&2
  fi
  printf '%s\n' "${changed[@]:0:$most}"
}

# The commands that check the files of standard input, each ended by a zero byte. A header has the options of a source of
# its folder, and a source that several targets compile the options of the first.
check_commands() {
  python3 -c '
import json, os, shlex, sys
commands = {}
for entry in json.load(open(sys.argv[1])):
    source = os.path.relpath(entry["file"])
    commands.setdefault(source, entry["command"])
    commands.setdefault(os.path.dirname(source), entry["command"])
for path in sys.stdin.read().split():
    header = path.endswith(".h")
    command = commands.get(os.path.dirname(path) if header else path)
    if command is None:
        print(f"{path} is not part of this build", file=sys.stderr)
        continue
    words = shlex.split(command)
    output = words.index("-o")
    del words[output:output + 2]
    if header:
        words[words.index("-c"):] = ["-x", "c++", path]
    words[1:1] = ["-fsyntax-only", "-w"]
    print(shlex.join(words + ["-O0"]), end="\0")
' "$database"
}

if [ "${1:-}" = --all ]; then
  files=$(all_files)
else
  files=$(choose_files "$@")
fi
cmake --preset lint -B build/alone -DSURFEL_BUILD_BENCH=ON -DSURFEL_TEST_FOLDERS=base >/dev/null
mapfile -d '' -t commands < <({ echo "$files"; find tests/bench -name '*.cpp'; } | check_commands)
printf '%s\0' "${commands[@]}" | xargs -0 -n 1 -P "$(nproc)" bash -c
echo "${#commands[@]} files compile alone"
