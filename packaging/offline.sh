#!/usr/bin/env bash
# Builds, installs and tests a source archive without a network, from vendored crates: packaging/offline.sh SDIST PYTHON
# PYTHON has maturin, NumPy, rustworkx and the tests' packages. Needs root or user namespaces, for `unshare`.
set -euo pipefail
sdist=$(realpath "$1")
python=$(realpath -s "$2")
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
tar -xzf "$sdist" -C "$folder" --strip-components=1
cd "$folder"
# the only step with a network: a distribution packs these crates in an archive of its own
mkdir .cargo
cargo vendor --locked 2>/dev/null >.cargo/config.toml
export CARGO_HOME=$folder/no-crates CARGO_TARGET_DIR=$folder/target PATH=$(dirname "$python"):$PATH
unshare --net --map-root-user bash -euo pipefail -c '
    "$0" -m pip wheel --quiet --no-index --no-deps --no-build-isolation --wheel-dir wheels .
    "$0" -m pip install --quiet --no-index --no-deps --target installed wheels/*.whl
    PYTHONPATH=$PWD/installed "$0" -m pytest -p no:cacheprovider --ignore tests/python/kernels/test_open3d.py \
        tests/python/kernels tests/python/geometry/test_line.py tests/python/views/test_{pose,view}.py
    cargo test --locked --quiet
' "$python"
echo "offline.sh: built and tested without a network"
