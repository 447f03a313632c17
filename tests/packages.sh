#!/usr/bin/env bash
# Checks the Debian packages: that packing gives the same bytes again, what lintian finds, that they install and work on a
# clean Debian, without what was here when they were built.
#   tests/packages.sh [BUILD] [--all] [--twice]
# BUILD    a build tree to pack, such as build/ci; default: build/package, which packaging/build.sh makes first
# --all    the plug-ins that need hundreds of megabytes work as well, and a program is compiled against libsurfel-dev
# --twice  all is built again by the Dockerfile where Docker is at hand, else by its steps in a clean Debian, and has the
#          same bytes (those of the default BUILD)
# Needs the rights of root, for chroot. The clean Debian is kept in $TMPDIR for the next time.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/support/setup.sh"
build=
all=
twice=
for argument in "$@"; do
  case $argument in
    --all) all=1 ;;
    --twice) twice=1 ;;
    *) build=$(realpath "$argument") ;;
  esac
done
surfel_install_packages "${surfel_packaging_packages[@]}" "${surfel_packages_check_packages[@]}"
if [ -z "$build" ]; then
  "$surfel_root/packaging/build.sh"
  build=$surfel_root/build/package
fi
sudo=()
if [ "$(id -u)" -ne 0 ]; then sudo=(sudo); fi
work=$(mktemp -d)
trap '"${sudo[@]}" rm -rf "$work"' EXIT

say() { echo "packages: $* (after $SECONDS s)"; }
fail() { echo "tests/packages.sh: $*" >&2; exit 1; }
# quietly COMMAND...: what it says is shown only if it fails.
quietly() { "$@" >"$work/log" 2>&1 || { cat "$work/log"; fail "$* failed"; }; }

# same_bytes FOLDER FOLDER: the packages in them have the same names and bytes.
same_bytes() { diff <(cd "$1" && sha256sum -- *.deb) <(cd "$2" && sha256sum -- *.deb) || fail "$1 and $2 differ"; }

pack() { (cd "$build" && cpack -B "$1" >"$1.log" 2>&1) || { cat "$1.log"; fail "cpack failed"; }; }

check_bytes() {
  pack "$work/packages" &
  pack "$work/again"
  wait $!
  same_bytes "$work/packages" "$work/again"
  local package
  for package in "$work"/packages/*.deb; do dpkg-deb -x "$package" "$work/files"; done
  if grep -rlF "$surfel_root" "$work/files"; then fail "these files name the folder that they were built in"; fi
  say "packed twice, with the same bytes"
}

# The pages of the site link to nothing that the package lacks.
check_site() {
  local folder=$work/files/usr/share/doc/surfelkit
  if [ -f "$folder/index.html" ]; then
    quietly python3 "$surfel_root/cmake/documents/site.py" check "$surfel_root" "$folder"
    say "the pages are complete"
  else
    [ "$build" != "$surfel_root/build/package" ] || fail "surfelkit-doc lacks the pages"
  fi
}

# What the preset `package` asks compiler and linker for. The protector of stacks is in every file; calls of functions that
# can be fortified are not.
check_hardening() {
  if ! grep -q '^CMAKE_CXX_FLAGS:.*-fstack-protector' "$build/CMakeCache.txt"; then return 0; fi
  local file files wanted count=0 fortified=0
  files=$(LC_ALL=C grep -rlaP '\A\x7fELF' "$work/files")
  while read -r file; do
    readelf --wide --file-header --program-headers --dynamic --dyn-syms "$file" >"$work/elf"
    for wanted in 'Type: *DYN ' 'GNU_RELRO' 'FLAGS_1.* NOW' '__stack_chk_fail@'; do
      grep -q "$wanted" "$work/elf" || fail "${file#"$work"/files} is not hardened: it lacks $wanted"
    done
    if [[ $file == */bin/* ]]; then grep -q 'FLAGS_1.* PIE' "$work/elf" || fail "${file#"$work"/files} is not position-independent"; fi
    count=$((count + 1))
    if grep -q '__[a-z]*_chk@' "$work/elf"; then fortified=$((fortified + 1)); fi
  done <<<"$files"
  if [ "$fortified" -eq 0 ]; then fail "no file calls fortified functions"; fi
  say "$count programs and libraries are hardened, $fortified of them call fortified functions"
}

# results FOLDER PROGRAM-FOLDER: surfels and pictures by the programs, in FOLDER.
results() {
  mkdir "$1"
  (
    cd "$1"
    PATH=$2:$PATH
    surfel-estimate "$surfel_root/samples/milk.ply" -o milk.ply
    surfel-render milk.ply -o milk.png --size 256x256
    surfel-from-mesh "$surfel_root/samples/spot.obj" --spacing 0.02 -o sampled.ply
    surfel-texture sampled.ply --mesh "$surfel_root/samples/spot.obj" --image "$surfel_root/samples/spot.png" --fit gram -o spot.ply
    surfel-render spot.ply -o spot.exr --size 256x256
  ) >"$work/log" 2>&1 || { cat "$work/log"; fail "the programs in $2 failed"; }
}

# Hardening changes no results: what the programs of the packages make has the bytes that the programs of build/ci make,
# where these are there; they have to be of the same sources.
check_results() {
  local programs=$surfel_root/build/ci/bin
  if [ "$build" = "$surfel_root/build/ci" ] || [ ! -x "$programs/surfel-texture" ]; then return 0; fi
  results "$work/ci" "$programs"
  LD_LIBRARY_PATH=$(dirname "$(find "$work/files" -name libsurfel.so.0)") results "$work/packaged" "$work/files/usr/bin"
  diff -r "$work/ci" "$work/packaged" || fail "the packages make other bytes than build/ci"
  say "the programs make the same bytes as those of build/ci"
}

# make_root NAME: the folder $work/NAME is a clean Debian, of this machine's release and from where apt gets its packages.
make_root() {
  local kept=${TMPDIR:-/tmp}/surfelkit-$UID-debian.tar root=$work/$1 sources codename
  mkdir "$root"
  if [ ! -O "$kept" ]; then
    codename=$(. /etc/os-release && echo "$VERSION_CODENAME")
    # shellcheck disable=SC2016 # Fields of apt.
    sources=$(apt-get indextargets --format '$(REPO_URI) $(RELEASE) $(COMPONENT)' 'Created-By: Packages' 'Origin: Debian' | sort -u)
    quietly "${sudo[@]}" debootstrap --variant=minbase "$codename" "$root" \
      "$(awk -v codename="$codename" '$2 == codename { print $1; exit }' <<<"$sources")"
    awk '{ print "deb", $0 }' <<<"$sources" | "${sudo[@]}" tee "$root/etc/apt/sources.list" >/dev/null
    "${sudo[@]}" tar -C "$root" -c . >"$work/kept"
    mv "$work/kept" "$kept"
  else
    "${sudo[@]}" tar -C "$root" -xf "$kept"
  fi
  say "there is a clean Debian"
}
# in_root NAME COMMAND...: runs it there, among processes of its own.
in_root() {
  local root=$work/$1
  shift
  "${sudo[@]}" unshare --mount --pid --fork --mount-proc="$root/proc" chroot "$root" "$@"
}
# run SCRIPT: runs it where the packages are installed, in a folder for results, up to the first command that fails.
run() { quietly in_root root bash -euxc "cd /tmp; $1"; }

# The steps of the Dockerfile.
build_again() {
  local epoch image again=$work/built_again
  mkdir "$again"
  epoch=$(grep -o '[0-9]\+' "$build/packages.cmake")
  if docker info >/dev/null 2>&1; then
    image=$(docker build -q --build-arg SOURCE_DATE_EPOCH="$epoch" --target build "$surfel_root")
    docker run --rm "$image" tar -C /surfelkit/build/package -c packages | tar -C "$again" -x --strip-components=1
    image=$(docker build -q --build-arg SOURCE_DATE_EPOCH="$epoch" "$surfel_root")
    docker run --rm "$image" surfel-info --version
  else
    make_root build
    "${sudo[@]}" mkdir "$work/build/surfelkit"
    git -C "$surfel_root" ls-files -z | tar -C "$surfel_root" -c --null -T - | "${sudo[@]}" tar -C "$work/build/surfelkit" -x
    in_root build env SOURCE_DATE_EPOCH="$epoch" /surfelkit/packaging/build.sh
    cp "$work"/build/surfelkit/build/package/packages/*.deb "$again"
  fi
  same_bytes "$work/packages" "$again"
  say "built again, with the same bytes"
}

install() {
  local before=$SECONDS
  quietly in_root root /install.sh /packages "$@"
  say "installed $* in $((SECONDS - before)) s"
  grep -E 'Need to get|additional disk space' "$work/log"
}

# What apt says of the core's size is in MB where it is more than a MB.
work_with_the_core() {
  install surfelkit libsurfel0
  awk '/Need to get/ { split($0, part, "/"); print part[2] } /additional disk space/ { print $4, $5 }' "$work/log" |
    awk '$2 ~ /^MB/ && $1 >= 20 { exit 1 }' || fail "the core is larger than 20 MB"
  run '
    surfel-generate sphere --count 20000 -o sphere.ply
    surfel-estimate /milk.ply -o milk.ply
    surfel-render sphere.ply -o sphere.png --size 128x128
    surfel-render milk.ply -o milk.png --size 128x128
    surfel-info milk.ply
    head -c 4 sphere.png | grep -q PNG
    zcat /usr/share/man/man1/surfel-render.1.gz | grep -q EXAMPLES
    . /usr/share/bash-completion/completions/surfel-render
    complete -p surfel-render'
  say "worked with the core"
}

# A run that lacks a plug-in names the package, and works when that is installed.
work_with_plugins() {
  run '
    ! surfel-render sphere.ply -o sphere.jpg 2>message
    grep "install the package libsurfel0-plugin-image," message
    ! surfel-render --mesh /spot.obj -o spot.png 2>message
    grep "install the package libsurfel0-plugin-trace," message
    surfel-info /spot.obj 2>&1 | grep "install the package libsurfel0-plugin-openmesh,"'
  install libsurfel0-plugin-{trace,openmesh,flann}
  run '
    surfel-render --mesh /spot.obj -o spot.png --size 64x64
    surfel-info /spot.obj | grep genus
    surfel-estimate /milk.ply --search flann -o milk.ply'
  say "worked with plug-ins"
}
work_with_python() {
  install python3-surfelkit
  run '
    python3 -c "
import numpy, surfelkit
surfels = surfelkit.estimate(surfelkit.SurfelCloud.from_arrays(numpy.random.default_rng(1).random((5000, 3))))
surfelkit.write(\"python.png\", surfelkit.render(surfels, size=(64, 64)))"
    head -c 4 python.png | grep -q PNG'
  say "worked with the Python module"
}
work_with_heavy_plugins() {
  install libsurfel0-plugin-{exr,image,pcd,gltf,filters,ceres,icp,mpi} surfelkit-view surfelkit-doc
  run '
    surfel-render sphere.ply -o sphere.jpg --size 64x64
    surfel-estimate /milk.ply --smooth mls -o milk.ply
    surfel-view sphere.ply -o sphere.html
    cd /usr/share/doc/surfelkit
    surfel-render samples/spot.obj --image samples/spot.png -o /tmp/spot.png'
  say "worked with all plug-ins"
}

# A program outside is built and runs.
work_with_the_library() {
  install libsurfel-dev
  run 'apt-get update -q && DEBIAN_FRONTEND=noninteractive apt-get install -qy --no-install-recommends g++ cmake make'
  run '
    cmake -S /consumer -B consumer
    cmake --build consumer
    consumer/consumer .
    consumer/consumer_native .'
  say "worked with the library"
}

check_bytes
check_hardening
check_results
check_site
lintian --allow-root --fail-on error,warning --tag-display-limit 0 "$work"/packages/*.deb
say "lintian finds nothing"
make_root root
"${sudo[@]}" cp -r "$work/packages" "$surfel_root"/{packaging/install.sh,tests/consumer,samples/milk.ply,samples/spot.obj} "$work/root"
work_with_the_core
work_with_plugins
work_with_python
if [ -n "$all" ]; then
  work_with_heavy_plugins
  work_with_the_library
fi
if [ -n "$twice" ]; then build_again; fi
