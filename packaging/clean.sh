#!/usr/bin/env bash
# Installs a wheel in a Debian system with Python, without Rust and compilers: packaging/clean.sh WHEEL [SUITE]
# Then runs the demo there. Needs root and debootstrap.
set -euo pipefail
wheel=$(realpath "$1")
suite=${2:-bookworm}
. "$(dirname "$0")/root.sh"
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
make_system "$folder/root" "$suite" --include=ca-certificates,python3-venv
for tool in cargo rustc cc gcc clang ld; do
    if run_inside "$folder/root" sh -c "command -v $tool"; then
        echo "clean.sh: $tool is installed" >&2
        exit 1
    fi
done
cp "$wheel" "$folder/root/tmp/"
run_inside "$folder/root" python3 -m venv /opt/strand
run_inside "$folder/root" /opt/strand/bin/pip install --quiet --disable-pip-version-check "/tmp/$(basename "$wheel")[cli]"
run_inside "$folder/root" /opt/strand/bin/strand demo --out /tmp/demo
run_inside "$folder/root" sh -c 'echo "clean.sh: Debian $(cat /etc/debian_version), $(python3 -VV), $(getconf GNU_LIBC_VERSION)"'
