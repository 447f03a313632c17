#!/usr/bin/env bash
# Prints the tables of docs/reliability.md, section "Adversarial geometry". Needs a build in
# build/release. Takes some minutes.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bin=build/release/bin
"$bin/adversarial_table" "$bin" "${1:-20000}"
