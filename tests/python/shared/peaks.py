"""Measure the memory and the time that it takes to read files, in a process of its own.

python tests/python/shared/peaks.py [WORDS ...]

Each trick runs in a fork of this small process, as Python's heap may hide what a long process takes. It
prints a line of JSON for each: name, bytes of the high-water mark, processor seconds, outcome.
"""

from __future__ import annotations

import json
import os
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

sys.path[:0] = [
    str(Path(__file__).resolve().parents[1]),
    str(Path(__file__).resolve().parents[3] / "benches"),
]

SECONDS = 60  # processor time after which a trick is killed
MEMORY = 12 << 30  # address space after which it is refused, bytes


def read_high_water() -> int:
    """Return the most memory that this process ever had, bytes; a fork starts with what it has."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM:"):
            return 1024 * int(line.split()[1])
    raise OSError("no VmHWM in /proc/self/status")


def run_fork(work: Callable[[], Any]) -> dict[str, Any]:
    """Run a function in a fork, and return its memory, its time and its outcome."""
    reading, writing = os.pipe()
    child = os.fork()
    if child:
        os.close(writing)
        with os.fdopen(reading, "rb") as answer:
            said = answer.read()
        status = os.waitpid(child, 0)[1]
        return (
            json.loads(said) if said else {"memory": 0, "seconds": SECONDS, "outcome": f"ended by {status}"}
        )
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    start, began = read_high_water(), time.process_time()
    try:
        work()
        outcome = "answer"
    except BaseException as error:
        outcome = f"{type(error).__name__}: {error}"[:200]
    found = {"memory": read_high_water() - start, "seconds": time.process_time() - began, "outcome": outcome}
    os.write(writing, json.dumps(found).encode())
    os._exit(0)


def main(words: list[str]) -> None:
    from shared.tricks.all_tricks import list_tricks, load_modules

    load_modules()
    for trick in list_tricks():
        if words and not any(word in trick.name for word in words):
            continue
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            made = run_fork(partial(trick.make, folder))
            assert made["outcome"] == "answer", (trick.name, made)
            print(json.dumps({"name": trick.name, **run_fork(partial(trick.read, folder))}), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
