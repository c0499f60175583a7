"""Fuzz the readers of files by coverage of their Python code: Atheris seeks bytes that reach new code.

python benches/fuzz_readers.py [--inputs N] [--seconds T] [--only NAME ...] [--findings DIR]

It needs Atheris, which is no dependency of strand: `python -m pip install atheris` (3.0 for Python 3.11 to
3.13). Files start whole. Half of the mutations know the format (`lib/mutations.py`), the others are those of
libFuzzer. Each kind of file has a process of its own (`lib/fuzzed_reader.py`). As in `mutated_files.py`, a
file may give an answer, `strand.FileFormatError`, or `OSError` where it names another file. All else is a
finding and ends its kind, as do two minutes and 2 GB for one file. The exit code is 1 if there are findings.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from lib.libfuzzer import Table, run_fuzzer
from lib.results import make_parser, run_bench

BENCHES = Path(__file__).resolve().parent
READER = (sys.executable, "-m", "lib.fuzzed_reader")
LENGTH = 1 << 15  # bytes of a file at most


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--inputs", type=int, default=10**9, metavar="N", help="of each kind at most")
    parser.add_argument("--seconds", type=int, default=30, metavar="T", help="of each kind (default: 30)")
    parser.add_argument("--only", nargs="*", metavar="NAME", help="kinds of files, such as a.ply")
    parser.add_argument("--findings", type=Path, default=Path(), metavar="DIR", help="keep files here")
    options = parser.parse_args()
    paths = [str(BENCHES), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
    names = options.only
    if not names:
        listed = subprocess.run(READER, env=environment, stdout=subprocess.PIPE, text=True, check=True)
        names = listed.stdout.split()
    findings = options.findings.resolve()
    findings.mkdir(parents=True, exist_ok=True)
    table = Table("file", "findings")
    for name in names:
        with tempfile.TemporaryDirectory() as folder:
            done = run_fuzzer(
                [*READER, name],
                [Path(folder)],
                findings / f"{name}-",
                environment=environment,
                inputs=options.inputs,
                seconds=options.seconds,
                length=LENGTH,
            )
        table.add(name, done)
    return table.end()


if __name__ == "__main__":
    run_bench(main)
