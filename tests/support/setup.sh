# Sourced by the scripts that need the project built. surfel_install_packages PACKAGE... installs the packages that a
# Debian 12 lacks; surfel_build PRESET [TARGET...] configures and builds in build/PRESET, everything if no target is
# named. Both are quick when there is nothing to do.

surfel_root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)

# The compiler, and the libraries of the core.
surfel_demo_packages=(
  g++ cmake ninja-build pkg-config
  libcli11-dev libeigen3-dev libfmt-dev libhwy-dev libpng-dev libpugixml-dev libtbb-dev libtomlplusplus-dev libzstd-dev nlohmann-json3-dev zlib1g-dev
)
# The plug-ins, and the server of surfel-view. CMake finds OpenImageIO only where its tools are, too.
surfel_plugin_packages=(
  libceres-dev libcpp-httplib-dev libdraco-dev libembree-dev libflann-dev libimath-dev liblz4-dev libmeshoptimizer-dev
  libopenexr-dev libopenimageio-dev libopenmesh-dev libopenmpi-dev libpcl-dev openimageio-tools openmpi-bin
)
# The Python module.
surfel_python_packages=(pybind11-dev python3-dev)
# The site of the documents, and the reference of the headers.
surfel_documents_packages=(doxygen mkdocs python3)
# What CPack makes packages with (packaging/build.sh), and what they are checked with (tests/packages.sh).
surfel_packaging_packages=(dpkg-dev file)
surfel_packages_check_packages=(debootstrap lintian)
surfel_packages=(
  "${surfel_demo_packages[@]}"
  "${surfel_plugin_packages[@]}"
  # surfel-chart draws its plots with it.
  gnuplot-nox
  # surfel-render joins pictures to films with it.
  ffmpeg
  "${surfel_python_packages[@]}"
  # Its tests.
  python3-numpy python3-pytest
  # Tests and checks.
  libgtest-dev clang-format-14 clang-tidy-14
  # Pages are compared with pictures in it.
  chromium
  # Tests of the scripts for clusters.
  munge parallel slurm-wlm
  "${surfel_documents_packages[@]}"
  # The benchmarks, which CI builds.
  libbenchmark-dev
  # The sanitizers.
  clang-14 libclang-rt-14-dev
)
# Tests read our LAZ files by a module of npm, whichever npm there is.
if ! command -v npm >/dev/null; then surfel_packages+=(nodejs npm); fi

surfel_install_packages() {
  local missing=() package
  for package in "$@"; do
    if [ "$(dpkg-query -W -f='${db:Status-Status}' "$package" 2>/dev/null)" != installed ]; then
      missing+=("$package")
    fi
  done
  if [ ${#missing[@]} -eq 0 ]; then return 0; fi
  echo "Installing: ${missing[*]}"
  local sudo=()
  if [ "$(id -u)" -ne 0 ]; then sudo=(sudo); fi
  "${sudo[@]}" apt-get update -q
  "${sudo[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -qy --no-install-recommends "${missing[@]}"
}

surfel_build() {
  local preset=$1
  shift
  (cd "$surfel_root" && cmake --preset "$preset" >/dev/null &&
    cmake --build --preset "$preset" ${@:+--target "$@"})
}
