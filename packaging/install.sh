#!/bin/sh
# Installs PACKAGEs of those in FOLDER, with the libraries that they need and nothing else, and leaves no downloads behind.
#   packaging/install.sh FOLDER PACKAGE...
set -eu
folder=$1
shift
for package in "$@"; do
  set -- "$@" "$folder/$package"_*.deb
  shift
done
apt-get update -q
DEBIAN_FRONTEND=noninteractive apt-get install -qy --no-install-recommends "$@"
apt-get clean
rm -rf /var/lib/apt/lists/*
