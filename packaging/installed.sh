#!/usr/bin/env bash
# Installs a wheel for one Python, tests it, and prints a row of the table in packaging/README.md:
#   packaging/installed.sh WHEEL PYTHON [REQUIREMENT...]
# REQUIREMENT narrows pip's choice, as in numpy==1.24.*. The tests are those of this checkout that need no peers.
set -euo pipefail
wheel=$(realpath "$1")
python=$2
shift 2
cd "$(dirname "$0")/.."
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"$python" -m venv "$folder/venv"
inside=$folder/venv/bin/python
"$inside" -m pip install --quiet --disable-pip-version-check --only-binary :all: \
    "${wheel}[cli]" pytest hypothesis jsonschema scipy "$@"

versions=$("$inside" -c 'import platform, numpy; print(platform.python_version(), "|", numpy.__version__)')
# processor time of the import after NumPy's, with bytecode written
seconds=$("$inside" - <<'END'
import statistics, subprocess, sys
def once(modules):
    code = f"import time, numpy; a = time.process_time(); import {modules}; print(time.process_time() - a)"
    return float(subprocess.check_output([sys.executable, "-c", code]))
once("strand")
print(f"{min(once('strand') for _ in range(7)):.2f}")
END
)
"$folder/venv/bin/strand" demo --out "$folder/demo" >"$folder/demo.txt" 2>&1 || { cat "$folder/demo.txt" >&2; exit 1; }
failed=0
"$inside" -m pytest -p no:cacheprovider --ignore tests/python/kernels/test_open3d.py \
    tests/python/kernels tests/python/geometry/test_line.py tests/python/views/test_{pose,view}.py >"$folder/tests.txt" 2>&1 || failed=$?
grep -E '^(FAILED|ERROR)' "$folder/tests.txt" >&2 || true
echo "| $versions | $(getconf GNU_LIBC_VERSION), $(uname -m) | $seconds s | yes | $(tail -n 1 "$folder/tests.txt") |"
exit $failed
