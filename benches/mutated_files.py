"""Read damaged files of every kind, and count what is neither an answer nor a documented error.

python benches/mutated_files.py [--files N] [--seed N] [--only N] [--kind NAME] [--findings DIR]

The bench damages files at random (`lib/mutations.py`), in folders in memory. Three outcomes are allowed: a
value; `strand.FileFormatError` that names the file; and `OSError` where one file names another one that
cannot be opened. All else is a finding, and so are:

- a warning, but for Pillow's own about damage beside the pixels,
- more than two seconds of processor time for one file,
- more than 200 MB of memory for one file.

`--findings` keeps the files of findings. `--seed S --only N` reads one file again.
"""

from __future__ import annotations

import resource
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from pathlib import Path

from lib.damaged_files import ALLOWED, TooLong, damage_file, list_kinds, make_folder, read_file, try_file
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row

MAX_SECONDS = 2.0  # processor time of one file
WAIT = 120.0  # seconds by the clock for one file
MAX_GROWTH = 200_000  # kB of memory that one file may take
MEMORY = 4 << 30  # bytes for the whole process


def raise_too_long(*_: object) -> None:
    """End the reading of a file, as a handler of signals."""
    raise TooLong


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--files", type=int, default=10_000, metavar="N", help="how many (default: 10000)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of all files (default: 0)")
    parser.add_argument("--only", type=int, metavar="N", help="read only the file of this number")
    parser.add_argument("--kind", help="read only files of this name, such as a.ply")
    parser.add_argument("--findings", type=Path, metavar="DIR", help="keep files of findings here")
    options = parser.parse_args()
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    signal.signal(signal.SIGALRM, raise_too_long)
    signal.signal(signal.SIGVTALRM, raise_too_long)
    warned: list[str] = []
    warnings.simplefilter("always")
    warnings.filterwarnings("ignore", module="PIL")
    warnings.showwarning = lambda message, category, *_, **__: warned.append(f"{category.__name__} {message}")
    every = list_kinds()
    chosen = tuple(kind for kind in every if options.kind in (None, kind.name))
    files: Counter[tuple[str, str]] = Counter()
    findings: Counter[tuple[str, str]] = Counter()
    started = time.monotonic()
    shared = "/dev/shm" if Path("/dev/shm").is_dir() else None
    with tempfile.TemporaryDirectory(dir=shared) as parent:
        folders = {kind.name: make_folder(Path(parent), kind) for kind in every}
        for kind in every:  # whole files first: they are read, and load modules that load late
            for data in kind.whole:
                (folders[kind.name] / kind.name).write_bytes(data)
                read_file(kind, folders[kind.name])
        numbers = range(options.files) if options.only is None else [options.only]
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        for number in numbers:
            kind, data = damage_file(options.seed, number, chosen, every)
            (folders[kind.name] / kind.name).write_bytes(data)
            warned.clear()
            try:
                signal.setitimer(signal.ITIMER_VIRTUAL, MAX_SECONDS)
                signal.setitimer(signal.ITIMER_REAL, WAIT)  # waits take no processor time
                why = try_file(kind, folders[kind.name])
                signal.setitimer(signal.ITIMER_VIRTUAL, 0)
                signal.setitimer(signal.ITIMER_REAL, 0)
            except TooLong:
                why = "too long"
            grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - most
            most += grown
            if why in ALLOWED and grown > MAX_GROWTH:
                why = f"{grown // 1000} MB"
            if why in ALLOWED and warned:
                why = f"warning: {warned[0][:60]}"
            files[kind.name, why if why in ALLOWED else "finding"] += 1
            if why not in ALLOWED:
                findings[kind.name, why] += 1
                if options.findings and findings[kind.name, why] <= 3:
                    options.findings.mkdir(parents=True, exist_ok=True)
                    (options.findings / f"{options.seed}-{number}-{kind.name}").write_bytes(data)
                    print(f"{number}: {kind.name}: {why}", file=sys.stderr, flush=True)
            if number % 100_000 == 99_999:
                print(f"{number + 1} files, {sum(findings.values())} findings", file=sys.stderr, flush=True)
    print_head("file", "read", "answers", "refused", "findings")
    for name in [kind.name for kind in chosen] + ["all"]:
        counts = {
            outcome: sum(n for (kind, end), n in files.items() if name in (kind, "all") and end == outcome)
            for outcome in (*ALLOWED, "finding")
        }
        refused = counts["FileFormatError"] + counts["OSError"]
        numbers = (sum(counts.values()), counts["answer"], refused, counts["finding"])
        print_row(name, *(f"{number:,}" for number in numbers))
    print(f"\n{sum(files.values()) / (time.monotonic() - started):.0f} files a second")
    for (name, why), count in findings.most_common():
        print(f"{count:8} {name}: {why}")
    return int(bool(findings))


if __name__ == "__main__":
    run_bench(main)
