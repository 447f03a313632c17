#!/usr/bin/env bash
# Makes the Debian packages, in build/package/packages; installs on a fresh Debian 12 what that needs.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/../tests/support/setup.sh"
surfel_install_packages "${surfel_demo_packages[@]}" "${surfel_plugin_packages[@]}" "${surfel_python_packages[@]}" \
  "${surfel_documents_packages[@]}" "${surfel_packaging_packages[@]}"
cd "$surfel_root"
cmake --workflow --preset package
