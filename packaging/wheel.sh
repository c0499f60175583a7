#!/usr/bin/env bash
# Builds this checkout's wheel for Linux and its source archive: packaging/wheel.sh [OUT [TARGET]]
# The same commit, Rust and tools (requirements.txt) give the same bits in any folder.
set -euo pipefail
cd "$(dirname "$0")/.."
out=${1:-dist}
target=${2:-$(rustc -vV | sed -n 's/^host: //p')}
platform=manylinux_2_17 # the oldest glibc that Rust's standard library runs on
tag=${platform}_${target%%-*}

export CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-$PWD/target}
export SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct)}
tools=$CARGO_TARGET_DIR/wheel-tools
[ -x "$tools/bin/python" ] || python3 -m venv "$tools"
"$tools/bin/python" -m pip install --quiet --disable-pip-version-check -r packaging/requirements.txt
export PATH=$tools/bin:$PATH

# panics name source files: removes this machine's folders from these names
cargo fetch --quiet --locked --target "$target"
cargo_home=${CARGO_HOME:-$HOME/.cargo}
commit=$(rustc -vV | sed -n 's/^commit-hash: //p')
flags="--remap-path-prefix=$PWD=."
flags+=$'\x1f'"--remap-path-prefix=$CARGO_TARGET_DIR=target"
flags+=$'\x1f'"--remap-path-prefix=$(rustc --print sysroot)/lib/rustlib/src/rust=/rustc/$commit"
for crates in "$cargo_home"/registry/src/*; do
    flags+=$'\x1f'"--remap-path-prefix=$crates=crates"
done
export CARGO_ENCODED_RUSTFLAGS=$flags

built=$CARGO_TARGET_DIR/wheel
rm -rf "$built"
mkdir -p "$built" "$out"
python packaging/sbom.py "$target" >"$built/rust.cdx.json"
maturin build --zig --release --locked --target "$target" --compatibility "$platform" --auditwheel check \
    --sbom-include "$built/rust.cdx.json" --out "$built"
maturin sdist --out "$built"

shown=$(auditwheel show "$built"/*.whl | tr '\n' ' ')
echo "wheel.sh: $shown"
if [[ $shown != *"following platform tag: \"$tag\""* ]]; then
    echo "wheel.sh: the wheel does not have the tag $tag" >&2
    exit 1
fi
if unzip -p "$built"/*.whl '*.so' | grep -aqF -e "$PWD/" -e "$CARGO_TARGET_DIR/" -e "$cargo_home/"; then
    echo "wheel.sh: the wheel names folders of this machine" >&2
    exit 1
fi
mv "$built"/*.whl "$built"/*.tar.gz "$out"
