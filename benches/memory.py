"""Reconstruct and filter many times, and print processor time, page faults and resident memory.

python benches/memory.py [--calls N]

The table tells allocators apart. Memory that goes back to the system and returns shows in page faults and the
system's time, memory that stays shows in the resident size. Small scenes have 160 x 120 pixels, the cloud has
2,000,000 points. The resident size is that after the calls, and the greatest during them. It includes Python
and NumPy.
"""

from __future__ import annotations

import resource
from collections.abc import Callable
from pathlib import Path

import numpy as np

import strand
from lib import collection
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from strand.synthetic import SHAPES, Camera, scene

STATUS = Path("/proc/self/status")
CLEAR = Path("/proc/self/clear_refs")
FORGET_PEAK = "5"  # written there: the peak of the resident size starts anew


def read_megabytes(what: str) -> float:
    """Return a size of this process from the system, MB."""
    lines = dict(line.split(":", 1) for line in STATUS.read_text().splitlines())
    return float(lines[what].split()[0]) / 1e3


def measure_calls(call: Callable[[int], object], calls: int) -> list[str]:
    """Call once, then often. Return the processor time and page faults of a call, and memory."""
    call(0)
    CLEAR.write_text(FORGET_PEAK)
    before = resource.getrusage(resource.RUSAGE_SELF)
    for number in range(calls):
        call(number)
    after = resource.getrusage(resource.RUSAGE_SELF)
    user, system = after.ru_utime - before.ru_utime, after.ru_stime - before.ru_stime
    faults = after.ru_minflt - before.ru_minflt
    each = [f"{1e3 * user / calls:.1f}", f"{1e3 * system / calls:.1f}", f"{faults / calls:.0f}"]
    return [*each, f"{read_megabytes('VmRSS'):.0f}", f"{read_megabytes('VmHWM'):.0f}"]


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--calls", type=int, default=500, metavar="N", help="of small scenes (default: 500)")
    calls = parser.parse_args().calls
    small = [
        scene(SHAPES[k], views=1 + k % 3, camera=Camera(size=(160, 120)), seed=k) for k in range(len(SHAPES))
    ]
    fine = collection.make_scene("paper_fine")
    cloud = np.random.default_rng(0).random((2_000_000, 3))

    def reconstruct(number: int) -> None:
        made = small[number % len(small)]
        strand.reconstruct(made.views, made.radius, made.bounds, ropes=1)

    work: dict[str, tuple[Callable[[int], object], int]] = {
        "small scenes": (reconstruct, calls),
        "paper_fine": (
            lambda _: strand.reconstruct(fine.views, fine.radius, fine.bounds),
            max(calls // 20, 1),
        ),
        "normals of the cloud": (lambda _: strand.estimate_normals(cloud, k=16), max(calls // 100, 1)),
        "small scenes again": (reconstruct, max(calls // 5, 1)),
    }
    print_head("work", "calls", "user, ms", "system, ms", "page faults", "resident, MB", "greatest, MB")
    for name, (call, times) in work.items():
        print_row(name, times, *measure_calls(call, times))
    return 0


if __name__ == "__main__":
    run_bench(main)
