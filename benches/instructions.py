"""Count each kernel's instructions, which do not depend on other work of the machine.

python benches/instructions.py [--update]

The bench needs valgrind. It counts on one thread, with the instructions that valgrind knows, up to AVX2. The
exit code is 1 if a kernel needs over 3 % more than `benches/instructions.json` says. `--update` writes that
file.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from lib.results import make_parser, run_bench

KERNELS = ["filter", "nearest", "within", "icp", "centerline", "chains", "tubes", "fit", "crop"]
POINTS = 20_000  # of the cloud
TOLERANCE = 0.03  # share of instructions
RECORD = Path(__file__).with_suffix(".json")
ROOT = Path(__file__).resolve().parent.parent


def build_program() -> Path:
    """Build the program that runs one kernel, and return its path."""
    command = ["cargo", "build", "--locked", "--quiet", "--release", "--example", "once"]
    output = subprocess.run(
        [*command, "--message-format=json"], cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True
    ).stdout
    messages = [json.loads(line) for line in output.splitlines()]
    return next(Path(m["executable"]) for m in messages if m.get("target", {}).get("name") == "once")


def count_instructions(program: Path, kernel: str, times: int) -> int:
    """Return the instructions of a number of calls, with those that make the cloud."""
    with tempfile.TemporaryDirectory() as folder:
        command = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={folder}/out", str(program)]
        run = subprocess.run(
            [*command, kernel, str(POINTS), str(times), "1"], capture_output=True, text=True, check=False
        )
    found = re.search(r"Collected : (\d+)", run.stderr)
    if run.returncode or not found:
        raise RuntimeError(f"valgrind failed on {kernel}:\n{run.stderr}")
    return int(found[1])


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--update", action="store_true", help="write the counts")
    arguments = parser.parse_args()
    if shutil.which("valgrind") is None:
        print("instructions.py: valgrind is missing: install the system package valgrind", file=sys.stderr)
        return 1
    program = build_program()
    # without those that make the cloud
    counts = {}
    for kernel in KERNELS:
        cloud, both = (count_instructions(program, kernel, times) for times in (0, 1))
        counts[kernel] = both - cloud
    if arguments.update:
        RECORD.write_text(json.dumps({"points": POINTS, "instructions": counts}, indent=2) + "\n")
        return 0
    record = json.loads(RECORD.read_text())["instructions"]
    slower = False
    for kernel, count in counts.items():
        change = count / record[kernel] - 1.0
        slower |= change > TOLERANCE
        verdict = (
            "MORE THAN BEFORE"
            if change > TOLERANCE
            else "less: --update"
            if change < -TOLERANCE
            else "as before"
        )
        print(f"{kernel}: {count / POINTS:.0f} instructions a point, {100 * change:+.1f} %, {verdict}")
    return int(slower)


if __name__ == "__main__":
    run_bench(main)
