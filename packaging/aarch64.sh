#!/usr/bin/env bash
# Builds this checkout's wheel for aarch64 and tries it under emulation: packaging/aarch64.sh OUT
# Rust's standard library for arm64 is Debian's. Needs root, debootstrap and qemu-user-static.
set -euo pipefail
cd "$(dirname "$0")/.."
. packaging/root.sh
out=$(realpath -m "$1")
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

build=$folder/build
system "$build" testing --include=ca-certificates
inside "$build" dpkg --add-architecture arm64
inside "$build" apt-get update -qq
inside "$build" apt-get install -y -qq --no-install-recommends \
    cargo rustc libstd-rust-dev libstd-rust-dev:arm64 python3-venv git unzip >/dev/null
git clone --quiet . "$build/strand"
inside "$build" /strand/packaging/wheel.sh /out aarch64-unknown-linux-gnu
mkdir -p "$out"
cp "$build"/out/*.whl "$out"

arm=$folder/arm
system "$arm" trixie --arch=arm64 --include=ca-certificates,python3-venv
cp -r "$build/strand" "$build/out" "$arm/"
inside "$arm" python3 -m venv /opt/strand
inside "$arm" sh -c '/opt/strand/bin/pip install --quiet --only-binary :all: /out/*.whl pytest hypothesis jsonschema scipy'
inside "$arm" sh -c 'cd /strand && /opt/strand/bin/python -m pytest -p no:cacheprovider tests/python/test_{chain,pose,view}.py' ||
    echo "aarch64.sh: tests failed" >&2
# to compare with the same command on x86-64
inside "$arm" sh -c 'cd /strand && /opt/strand/bin/python benches/scenes.py --runs 1 --only paper'
