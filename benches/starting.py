"""Time what passes before strand does any work: its import, the first reconstruction's import, `strand info`.

python benches/starting.py [--runs N]

Each run is a new process. Imports are timed after that of NumPy, and the commands as whole processes. The
table has the quickest run: wall time and, for commands, processor time.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time

from lib.collection import DATA
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row

IMPORTS = ("import strand", "from strand import reconstruct", "from strand import Tracker")
COMMANDS = (("--version",), ("info", str(DATA / "scenes" / "paper_mid.npz")), ("reconstruct", "--help"))


# Python compiles changed modules in each run if it may not keep them, unlike in an installation of users
ENVIRONMENT = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}


def time_import(statement: str) -> float:
    """Return the seconds of a statement in a new process that has imported NumPy."""
    clock = "time.perf_counter()"
    program = f"import time, numpy\nstart = {clock}\n{statement}\nprint({clock} - start)"
    command = [sys.executable, "-c", program]
    return float(subprocess.run(command, env=ENVIRONMENT, capture_output=True, check=True).stdout)


def time_command(words: tuple[str, ...]) -> tuple[float, float]:
    """Return the wall time and the processor time of a command in seconds."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    command = [sys.executable, "-m", "strand", *words]
    subprocess.run(command, env=ENVIRONMENT, capture_output=True, check=True)
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--runs", type=int, default=15, metavar="N", help="of each (default: 15)")
    runs = range(parser.parse_args().runs)
    print_head("what", "wall, ms", "processor, ms")
    for statement in IMPORTS:
        print_row(statement, f"{min(time_import(statement) for _ in runs) * 1e3:.0f}", "")
    for words in COMMANDS:
        wall, used = (min(times) * 1e3 for times in zip(*(time_command(words) for _ in runs), strict=True))
        print_row(f"strand {words[0]}", f"{wall:.0f}", f"{used:.0f}")
    return 0


if __name__ == "__main__":
    run_bench(main)
