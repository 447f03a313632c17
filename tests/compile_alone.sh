#!/usr/bin/env bash
# Checks that sources of the library and the tools compile alone: the builds of the presets join the sources of a folder
# (unity builds), where one may use what another has included. Nothing is built (-fsyntax-only): a source takes 4 s.
#   tests/compile_alone.sh             sources that the last 20 commits changed, and sources whose own header changed
#   tests/compile_alone.sh REVISION    changed since a revision; in both cases no more than 40, the latest first
#   tests/compile_alone.sh --all       all sources, which takes half an hour of one core
# Changes that are not committed count as well. In a clone without earlier commits sources from all over the project are
# checked instead. Ends with 0 if all sources that were checked compile.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
most=40
database=build/alone/compile_commands.json

all_sources() { find lib tools -name '*.cpp' | sort; }

# The files that were changed since a revision, the latest first.
changed_files() {
  git diff --name-only HEAD
  git log --name-only --format= "$1..HEAD"
}

# The sources of the files of standard input, each once: those that are sources, and the sources of headers.
sources_of() {
  grep -E '^(lib|tools)/.*\.(h|cpp)$' | sed 's/\.h$/.cpp/' | awk '!seen[$0]++' |
    while read -r file; do if [ -f "$file" ]; then echo "$file"; fi; done
}

choose_sources() {
  local since=${1:-}
  if [ -z "$since" ]; then
    since=$(git rev-parse --quiet --verify HEAD~20 2>/dev/null || git rev-list --max-parents=0 HEAD 2>/dev/null | tail -n 1) || true
    if [ -z "$since" ] || [ "$since" = "$(git rev-parse HEAD)" ]; then
      all_sources | awk -v step="$(($(all_sources | wc -l) / most + 1))" 'NR % step == 0'
      return
    fi
  fi
  local changed
  mapfile -t changed < <(changed_files "$since" | sources_of)
  if [ ${#changed[@]} -gt $most ]; then
    echo "${#changed[@]} sources changed since $since; the latest $most are checked" >&2
  fi
  printf '%s\n' "${changed[@]:0:$most}"
}

# The commands that check the sources of standard input, each ended by a zero byte. Of a source that several targets
# compile, the first target's options count.
check_commands() {
  python3 -c '
import json, os, shlex, sys
commands = {}
for entry in json.load(open(sys.argv[1])):
    commands.setdefault(os.path.relpath(entry["file"]), entry)
for source in sys.stdin.read().split():
    if source not in commands:
        print(f"{source} is not part of this build", file=sys.stderr)
        continue
    words = shlex.split(commands[source]["command"])
    output = words.index("-o")
    del words[output:output + 2]
    words[1:1] = ["-fsyntax-only", "-w"]
    print(shlex.join(words + ["-O0"]), end="\0")
' "$database"
}

if [ "${1:-}" = --all ]; then
  sources=$(all_sources)
else
  sources=$(choose_sources "$@")
fi
if [ -z "$sources" ]; then
  echo "No source has changed"
  exit 0
fi
cmake --preset lint -B build/alone -DSURFEL_BUILD_TESTS=OFF >/dev/null
mapfile -d '' -t commands < <(check_commands <<<"$sources")
printf '%s\0' "${commands[@]}" | xargs -0 -n 1 -P "$(nproc)" bash -c
echo "${#commands[@]} sources compile alone"
