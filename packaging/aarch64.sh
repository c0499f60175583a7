#!/usr/bin/env bash
# Builds this checkout's wheel for aarch64 and tests it under emulation: packaging/aarch64.sh OUT
# Rust's standard library for arm64 comes from Debian. Needs root, debootstrap and qemu-user-static.
set -euo pipefail
cd "$(dirname "$0")/.."
. packaging/root.sh
out=$(realpath -m "$1")
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

build=$folder/build
make_system "$build" testing --include=ca-certificates
run_inside "$build" dpkg --add-architecture arm64
run_inside "$build" apt-get update -qq
run_inside "$build" apt-get install -y -qq --no-install-recommends \
    cargo rustc libstd-rust-dev libstd-rust-dev:arm64 python3-venv git unzip >/dev/null
git clone --quiet . "$build/strand"
run_inside "$build" /strand/packaging/wheel.sh /out aarch64-unknown-linux-gnu
mkdir -p "$out"
cp "$build"/out/*.whl "$out"

arm=$folder/arm
make_system "$arm" trixie --arch=arm64 --include=python3
# pip takes ten minutes and more under emulation, but it can install for other systems
version=$(run_inside "$arm" python3 -c 'import sys; print("{}{}".format(*sys.version_info))')
platforms=$(printf -- ' --platform manylinux_2_%s_aarch64' 17 24 26 27 28 31 34)
run_inside "$build" bash -c "/strand/target/wheel-tools/bin/python -m pip install --quiet --disable-pip-version-check --no-compile \
    --only-binary :all: --target /site --implementation cp --python-version $version \
    --abi cp$version --abi abi3 --abi none $platforms --platform manylinux2014_aarch64 \
    \$(ls /out/*.whl)[cli] pytest hypothesis jsonschema scipy"
cp -r "$build/strand" "$build/site" "$arm/"
run_python() { run_inside "$arm" env PYTHONPATH=/site bash -c "cd /strand && python3 $1"; }
failed=0
run_python "-m pytest -p no:cacheprovider tests/python/geometry/test_line.py tests/python/views/test_{pose,view}.py" || failed=$?
# compare with the same command on x86-64
run_python packaging/bits.py
exit $failed
