#!/usr/bin/env bash
# Builds the last commit's wheel and source archive twice, and compares their bits: packaging/reproducible.sh [OUT]
# The second build has other folders, another time zone and other permissions. Copies them to OUT or dist/.
set -euo pipefail
cd "$(dirname "$0")/.."
out=${1:-dist}
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
git clone --quiet . "$folder/one"
git clone --quiet . "$folder/the/other/checkout"
unset CARGO_TARGET_DIR SOURCE_DATE_EPOCH
"$folder/one/packaging/wheel.sh" "$folder/first"
(
    umask 027
    TZ=Pacific/Auckland CARGO_HOME=$folder/cargo CARGO_TARGET_DIR=$folder/built \
        "$folder/the/other/checkout/packaging/wheel.sh" "$folder/second"
)
(cd "$folder/first" && sha256sum -- *)
(cd "$folder/second" && sha256sum -- *)
diff -r "$folder/first" "$folder/second"
mkdir -p "$out"
cp "$folder"/first/* "$out"
echo "reproducible.sh: the same bits twice"
