#!/usr/bin/env bash
# Installs a wheel in a Debian system that has Python, and neither Rust nor a compiler: packaging/clean.sh WHEEL [SUITE]
# Then makes the demo there. Needs root and debootstrap.
set -euo pipefail
wheel=$(realpath "$1")
suite=${2:-bookworm}
. "$(dirname "$0")/root.sh"
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
system "$folder/root" "$suite" --include=ca-certificates,python3-venv
for tool in cargo rustc cc gcc clang ld; do
    if inside "$folder/root" sh -c "command -v $tool"; then
        echo "clean.sh: $tool is there" >&2
        exit 1
    fi
done
cp "$wheel" "$folder/root/tmp/"
inside "$folder/root" python3 -m venv /opt/strand
inside "$folder/root" /opt/strand/bin/pip install --quiet --disable-pip-version-check "/tmp/$(basename "$wheel")[cli]"
inside "$folder/root" /opt/strand/bin/strand demo --out /tmp/demo
inside "$folder/root" sh -c 'echo "clean.sh: Debian $(cat /etc/debian_version), $(python3 -VV), $(getconf GNU_LIBC_VERSION)"'
