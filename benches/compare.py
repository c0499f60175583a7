"""Compare strand's kernels with their peers on the same arrays in one process.

python benches/compare.py [--points 12000 100000 1000000 10000000] [--orders random along] [--repeats 7]
    [--slow] [--plot FILE]

The clouds show a rope. Their points come in random order, as those of several views do, and in order along
the rope. The second is the friendliest order: near points are near in memory.

strand and its peers take turns (A B C A B C ...), so that other work of the machine slows all of them. A time
is the median of the turns, a ratio that of the least times. A time covers a kernel's work and its search
structures, but not the peers' own point clouds. The bench compares the answers, and exits with 1 if they
differ. A second table has, for strand alone:

- the time on one thread over the time on two,
- the memory at a kernel's peak, above the memory before it; the answer is part of it,
- the exponent b of t = a n^b, fitted to the times.

The bench runs on Linux.
"""

from __future__ import annotations

import argparse
import ctypes
import math
import statistics
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import open3d as o3d
from matplotlib.figure import Figure

import strand
from lib.peers import THREADS, Stage, Timed, list_stages
from lib.results import make_parser, run_bench
from lib.tables import format_head, format_row, print_head, print_row

MAX_PEER_POINTS = 1_000_000  # above this the peers take minutes and gigabytes
FEW_TURNS_POINTS = 1_000_000  # from this many points on a turn takes many seconds
FEW_TURNS = 3
ORDERS = {"random": "random", "along": "along the rope"}
M_MMAP_THRESHOLD = -3  # number of an option of mallopt
MMAP_THRESHOLD = 1 << 16  # bytes: larger blocks go back to the system when they are freed


@dataclass(frozen=True)
class Turns:
    """Times of a kernel's turns, and its answer."""

    seconds: list[float]
    answer: Any

    @property
    def median(self) -> float:
        return statistics.median(self.seconds)

    def ratio(self, other: Turns) -> float:
        return min(other.seconds) / min(self.seconds)


@dataclass(frozen=True)
class Line:
    """One stage at one number of points in one order: times of all libraries, and needs of strand."""

    stage: str
    count: int
    order: str
    seconds: dict[str, float]  # medians by library
    one_thread: float  # least time of strand on one thread over that on two
    bytes_per_point: float


def take_turns(
    runs: list[Callable[[], Timed]], repeats: int, once: frozenset[int] = frozenset()
) -> list[Turns]:
    """Run all by turns. Those in `once` take part in the first turn only."""
    seconds: list[list[float]] = [[] for _ in runs]
    answers: list[Any] = [None] * len(runs)
    for turn in range(repeats):
        for i, run in enumerate(runs):
            if turn == 0 or i not in once:
                time_taken, answers[i] = run()
                seconds[i].append(time_taken)
    return [Turns(*both) for both in zip(seconds, answers, strict=True)]


def read_status(name: str) -> int:
    """Return a size from /proc/self/status, bytes."""
    for row in Path("/proc/self/status").read_text().splitlines():
        if row.startswith(name + ":"):
            return 1024 * int(row.split()[1])
    raise RuntimeError(f"/proc/self/status has no {name}")


def measure_peak(name: str, count: int, order: str) -> int:
    """Return a stage's peak memory above the memory before it, bytes, from a process of its own."""
    command = [sys.executable, __file__, "--points", str(count), "--orders", order, "--peak", name]
    run = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    return int(run.stdout)


def measure_own_peak(name: str, count: int, order: str) -> int:
    """Return the same for this process."""
    libc = ctypes.CDLL(None)
    # the allocator gives freed memory back at once, so that none is left from before
    libc.mallopt(M_MMAP_THRESHOLD, MMAP_THRESHOLD)
    run = next(stage.run for stage in list_stages(count, order, slow=False) if stage.name == name)
    libc.malloc_trim(0)
    Path("/proc/self/clear_refs").write_text("5")  # forgets the peak until now
    before = read_status("VmRSS")
    run()
    return read_status("VmHWM") - before


def run_on_one_thread(run: Callable[[], Timed]) -> Timed:
    """Run a kernel of strand on one thread."""
    strand.set_num_threads(1)
    try:
        return run()
    finally:
        strand.set_num_threads(THREADS)


def measure_stage(
    stage: Stage, count: int, order: str, repeats: int
) -> tuple[bool, list[tuple[object, ...]], Line]:
    """Return whether the answers of a stage agree, its rows of the table, and its numbers."""
    repeats = repeats if count < FEW_TURNS_POINTS else min(repeats, FEW_TURNS)
    peers = stage.peers if count <= MAX_PEER_POINTS else []
    once = frozenset(i for i, peer in enumerate(peers, start=1) if peer.once)
    ours, *theirs = take_turns([stage.run, *(peer.run for peer in peers)], repeats, once)
    two, one = take_turns([stage.run, lambda: run_on_one_thread(stage.run)], min(repeats, 3))
    line = Line(
        stage.name,
        count,
        order,
        {"strand": ours.median, **{p.name: t.median for p, t in zip(peers, theirs, strict=True)}},
        two.ratio(one),
        measure_peak(stage.name, count, order) / (count * stage.clouds),
    )
    start = (count, ORDERS[order], stage.name, f"{ours.median * 1e3:.1f}")
    if not peers:
        return True, [(*start, "skipped" if stage.peers else "", "", "", "")], line
    good, rows = True, []
    for peer, turns in zip(peers, theirs, strict=True):
        agree, text = peer.compare(ours.answer, turns.answer)
        good &= agree
        verdict = f"{'agree' if agree else 'DIFFER'}: {text}"
        times = f"{turns.median * 1e3:.1f}", f"{ours.ratio(turns):.1f}"
        rows.append((*start, peer.name, *times, verdict))
    return good, rows, line


def fit_exponent(lines: list[Line]) -> float:
    """Return the exponent b of t = a n^b."""
    counts = np.log([line.count for line in lines])
    return float(np.polyfit(counts, np.log([line.seconds["strand"] for line in lines]), 1)[0])


def format_scaling(lines: list[Line]) -> list[str]:
    """Return the table of strand's needs, a row for each stage and order."""
    counts = sorted({line.count for line in lines})
    titles = ["exponent"] if len(counts) > 1 else []
    titles += [f"1 thread / {THREADS}, {count}" for count in counts]
    titles += [f"bytes a point, {count}" for count in counts]
    table = [format_head("stage", "order", *titles)]
    for stage, order in dict.fromkeys((line.stage, line.order) for line in lines):
        own = [line for line in lines if (line.stage, line.order) == (stage, order)]
        own.sort(key=lambda line: line.count)
        cells = [f"{fit_exponent(own):.2f}"] if len(counts) > 1 else []
        cells += [f"{line.one_thread:.2f}" for line in own] + [f"{line.bytes_per_point:.0f}" for line in own]
        table.append(format_row(stage, ORDERS[order], *cells))
    return table


def draw_times(lines: list[Line], path: Path) -> None:
    """Draw times over numbers of points, both logarithmic, a panel for each stage; dashed along the rope."""
    names = list(dict.fromkeys(line.stage for line in lines))
    figure = Figure(figsize=(11, 6.5))
    axes = figure.subplots(2, math.ceil(len(names) / 2), sharex=True, squeeze=False)
    colors = {"strand": "C0", "Open3D": "C1", "small_gicp": "C2", "SciPy": "C3"}
    styles = {"random": "-o", "along": "--."}
    for axis, name in zip(axes.flat, names, strict=False):
        for order, style in styles.items():
            own = [line for line in lines if (line.stage, line.order) == (name, order)]
            for library in dict.fromkeys(library for line in own for library in line.seconds):
                found = [(line.count, line.seconds[library] * 1e3) for line in own if library in line.seconds]
                # both orders have one colour; the legend names peers once
                label = f"{library}, {ORDERS[order]}" if library == "strand" else library
                named = library == "strand" or order == lines[0].order
                axis.loglog(
                    *zip(*found, strict=True), style, color=colors[library], label=label if named else None
                )
        axis.set(title=name, xlabel="points", ylabel="ms")
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(path, dpi=110)


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--points", type=int, nargs="+", default=[12_000, 100_000, 1_000_000, 10_000_000])
    parser.add_argument("--orders", nargs="+", choices=ORDERS, default=list(ORDERS), help="of the points")
    parser.add_argument("--repeats", type=int, default=7, help="turns of which the median is taken")
    parser.add_argument("--plot", type=Path, help="write a plot of the times to this file")
    parser.add_argument("--peak", metavar="STAGE", help=argparse.SUPPRESS)
    parser.add_argument(
        "--slow", action="store_true", help="run SciPy's centreline on 100000 points too, once"
    )
    arguments = parser.parse_args()
    strand.set_num_threads(THREADS)
    if arguments.peak:
        print(measure_own_peak(arguments.peak, arguments.points[0], arguments.orders[0]))
        return 0
    print(
        f"{THREADS} threads each: strand {strand.__version__} (set_num_threads), Open3D {o3d.__version__} "
        f"(processors it may use), small_gicp {version('small_gicp')} (num_threads), "
        f"SciPy {version('scipy')} (workers).\n"
    )
    print_head("points", "order", "stage", "strand ms", "peer", "peer ms", "peer / strand", "answers")
    good, lines = True, []
    for count in arguments.points:
        for order in arguments.orders:
            for stage in list_stages(count, order, arguments.slow):
                agree, rows, line = measure_stage(stage, count, order, arguments.repeats)
                for row in rows:
                    print_row(*row)
                good &= agree
                lines.append(line)
    print()
    print(*format_scaling(lines), sep="\n")
    if arguments.plot:
        draw_times(lines, arguments.plot)
    return 0 if good else 1


if __name__ == "__main__":
    run_bench(main)
