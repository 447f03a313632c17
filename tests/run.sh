#!/usr/bin/env bash
# Builds Surfelkit and runs all tests; installs on a fresh Debian 12 what that needs.
#   tests/run.sh [PRESET] [ctest options]     PRESET: release (default), debug, asan+ubsan, tsan, ci
# Real data is looked for in $SURFEL_TEST_DATA (default: ../shared/data beside the project).
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/support/setup.sh"

preset=release
if [ $# -gt 0 ] && [[ $1 != -* ]]; then
  preset=$1
  shift
fi
surfel_install_packages "${surfel_packages[@]}"
surfel_build "$preset"
cd "$surfel_root"
# Many tests wait for something: one more than there are processors leaves none of these idle.
exec ctest --preset "$preset" -j "$(($(nproc) + 1))" "$@"
