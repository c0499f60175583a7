"""Count the instructions that common cases execute, by part of the program.

python benches/executed.py [CASE ...] [--scene N]

The cases are those of `cases.py`, one scene each, on one thread. The bench needs valgrind, which knows
instructions up to AVX2. A call's instructions are those of two calls in a process less those of one. "core"
is the compiled module. Counts do not depend on other work of the machine.
"""

from __future__ import annotations

import itertools
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from cases import CASES, WORKER
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row

# parts of the program, by what the names of their files hold; the first that fits
PARTS = {
    "core": ("/strand/_core",),
    "NumPy": ("numpy",),
    "Python": ("libpython", "/python3"),
    "C library": ("libc.so", "libm.so", "ld-linux"),
}
OTHER = "other"
MILLION = 1e6


def count_parts(lines: Iterable[str]) -> Counter[str]:
    """Sum the instructions of each part, from the lines of callgrind's output."""
    counts: Counter[str] = Counter()
    parts: dict[str, str] = {}
    part, is_call = OTHER, False
    for line in lines:
        if named := re.match(r"(c?)ob=(\(\d+\))(?: (.*))?", line):
            called, number, name = named.groups()
            if name is not None:
                parts[number] = find_part(name)
            part = part if called else parts[number]
        elif line.startswith("calls="):
            is_call = True
        elif line[:1] in "+-*0123456789":
            # the line after a call has what the called function executed, which is counted there
            counts[part] += 0 if is_call else int(line.split()[-1])
            is_call = False
    return counts


def find_part(name: str) -> str:
    """Return the part of the program that a file belongs to."""
    return next((part for part, keys in PARTS.items() if any(key in name for key in keys)), OTHER)


def count_calls(call: dict[str, object], calls: int) -> Counter[str]:
    """Return the instructions of a process that reconstructs a scene some times."""
    environment = os.environ | {"STRAND_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONHASHSEED": "0"}
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        run = subprocess.run(
            ["valgrind", "--tool=callgrind", f"--callgrind-out-file={out}", sys.executable, str(WORKER)],
            env=environment,
            input=json.dumps(call | {"calls": calls}) + "\n",
            capture_output=True,
            text=True,
            check=False,
        )
        if run.returncode:
            raise RuntimeError(f"valgrind failed:\n{run.stderr}")
        with out.open(encoding="utf-8", errors="replace") as lines:
            return count_parts(lines)


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("cases", metavar="CASE", nargs="*", help=f"of {', '.join(CASES)} (default: all)")
    parser.add_argument("--scene", type=int, default=0, metavar="N", help="of each case (default: 0)")
    arguments = parser.parse_args()
    unknown = [case for case in arguments.cases if case not in CASES]
    if unknown:
        parser.error(f"CASE: expected some of {', '.join(CASES)}; got {', '.join(unknown)}")
    if shutil.which("valgrind") is None:
        print("executed.py: valgrind is missing: install the system package valgrind", file=sys.stderr)
        return 1
    print_head("case", "instructions, millions", *(f"{part}, %" for part in (*PARTS, OTHER)))
    with tempfile.TemporaryDirectory() as kept:
        path = Path(kept) / "scene.npz"
        for case in arguments.cases or CASES:
            draw, facts = CASES[case]
            next(itertools.islice(draw(), arguments.scene, None)).save(path)
            call: dict[str, object] = {"path": str(path), "facts": facts}
            one, two = (count_calls(call, calls) for calls in (1, 2))
            two.subtract(one)
            whole = sum(two.values())
            shares = (f"{100.0 * two[part] / whole:.0f}" for part in (*PARTS, OTHER))
            print_row(case, f"{whole / MILLION:.0f}", *shares)
    return 0


if __name__ == "__main__":
    run_bench(main)
