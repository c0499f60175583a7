"""Fuzz the Rust kernels by coverage: libFuzzer seeks inputs that reach new code, and answers are checked.

python benches/fuzz.py [--inputs N] [--seconds T] [--only NAME ...] [--corpus DIR]

The targets are in `rust/src/fuzzing/`, the program in `fuzz/`. The stable compiler builds it, with a counter
for each edge between blocks of code. Each target runs with short inputs, then with long ones. It starts with
the inputs in `tests/data/fuzzing/`, those of `--corpus`, and some at random. Inputs that reach something new
go to `--corpus`. An answer that is not finite or not within limits ends a target, as do two minutes and 2 GB
for one input. The input stays beside the corpus as `NAME-crash-...`, and `--again FILE --only NAME` runs it
once more. The exit code is 1 if there are crashes. Findings belong in `tests/data/fuzzing/`, whose inputs
`cargo test` runs.
"""

from __future__ import annotations

import os
import random
import re
import subprocess
import tempfile
from pathlib import Path

from lib.libfuzzer import Table, run_fuzzer
from lib.results import make_parser, run_bench

ROOT = Path(__file__).resolve().parents[1]
KEPT = ROOT / "tests" / "data" / "fuzzing"
COVERAGE = (
    "--cfg fuzzing -Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4"
    " -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table"
)
LENGTHS = (150, 700)  # bytes of an input at most, in turn: short inputs run by the ten thousand a second
AT_RANDOM = 60  # first inputs that are made at random
TARGETS = sorted(path.name for path in KEPT.iterdir() if path.is_dir())


def build() -> Path:
    """Build the program, and return it."""
    version = subprocess.run(["rustc", "-vV"], capture_output=True, text=True, check=True).stdout
    (host,) = re.findall(r"^host: (.*)$", version, re.MULTILINE)
    # only with a target are build scripts built without counters, which they have no runtime for
    command = ["cargo", "build", "--release", "--quiet", "--manifest-path", str(ROOT / "fuzz" / "Cargo.toml")]
    subprocess.run([*command, "--target", host], env=os.environ | {"RUSTFLAGS": COVERAGE}, check=True)
    folder = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "fuzz" / "target"))
    return folder / host / "release" / "strand-fuzz"


def write_random_inputs(folder: Path) -> Path:
    """Write first inputs, the same in each run."""
    draw = random.Random(1)
    for number in range(AT_RANDOM):
        (folder / str(number)).write_bytes(draw.randbytes(draw.randrange(40, LENGTHS[-1])))
    return folder


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--inputs", type=int, default=10**9, metavar="N", help="of each length at most")
    parser.add_argument("--seconds", type=int, default=60, metavar="T", help="of each length (default: 60)")
    parser.add_argument("--only", nargs="*", default=TARGETS, metavar="NAME", choices=TARGETS)
    parser.add_argument(
        "--corpus", type=Path, default=ROOT / "fuzz" / "corpus", metavar="DIR", help="keep inputs here"
    )
    parser.add_argument("--again", type=Path, metavar="FILE", help="run one input of the target --only")
    options = parser.parse_args()
    program = build()
    if options.again:
        environment = os.environ | {"STRAND_FUZZ_TARGET": options.only[0]}
        return subprocess.run([program, options.again], env=environment, check=False).returncode
    table = Table("target", "crashes")
    with tempfile.TemporaryDirectory() as parent:
        first = write_random_inputs(Path(parent))
        for name in options.only:
            own = options.corpus / name
            own.mkdir(parents=True, exist_ok=True)
            for length in LENGTHS:
                found = run_fuzzer(
                    [str(program)],
                    [own, KEPT / name, first],
                    options.corpus / f"{name}-",
                    environment=os.environ | {"STRAND_FUZZ_TARGET": name, "RUST_BACKTRACE": "0"},
                    inputs=options.inputs,
                    seconds=options.seconds,
                    length=length,
                )
                table.add(f"{name}, {length} bytes", found)
    return table.end()


if __name__ == "__main__":
    run_bench(main)
