"""Measure how time and memory grow with the points: every kernel on every layout of points.

python benches/layouts.py [--kernels TEXT ...] [--layouts TEXT ...] [--most N] [--limit SECONDS] [--memory GB]

Each kernel runs on 10^4, 10^5 and 10^6 points of each layout, on one thread, in a process of its own with
limited memory and time. Times are processor time. There are three tables:

- exponents of time, log(t2 / t1) / log(n2 / n1), from the fewest to the most points: 1 is linear, 2
  quadratic. Times below a millisecond count as one;
- seconds for the most points;
- growth of memory for each of them, bytes.

A radius is twice the distance between neighbouring points where they lie loosely, as a user would choose it.
The exit code is 1 if an exponent is above 1.2 or a run did not end.
"""

from __future__ import annotations

import argparse
import math
import resource
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

import strand
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row

Array = NDArray[np.float64]
Layout = Callable[[np.random.Generator, int], tuple[Array, float]]

MAX_EXPONENT = 1.2
MIN_TIME = 1e-3  # seconds: shorter times count as this
REPEAT_BELOW = 0.3  # seconds: shorter runs are repeated
RUNS = 5  # most repetitions
NO_ANSWER = "no answer"
MAX_CURVE_NODES = 20_000  # points from which the curve of `fit_tubes` is made


def fill_volume(rng: np.random.Generator, count: int) -> tuple[Array, float]:
    """Return points of a cube, and the distance between neighbours, as all layouts do."""
    return rng.random((count, 3)), count ** (-1 / 3)


def fill_rope(rng: np.random.Generator, count: int) -> tuple[Array, float]:
    """Fill a wavy tube 10 mm wide, seen from above: so long that points are a millimetre apart."""
    radius, spacing = 5e-3, 1e-3
    length = count * spacing**2 / (math.pi * radius)
    s = rng.random(count) * length
    turn = math.pi * rng.random(count)
    # the tube runs back and forth
    lane, along = np.divmod(s, 2.0)
    lateral = 0.05 * lane + 0.01 * np.sin(7.0 * along)
    points = np.column_stack([along, lateral + radius * np.cos(turn), radius * np.sin(turn)])
    return points, spacing


def fill_one_place(rng: np.random.Generator, count: int) -> tuple[Array, float]:
    return np.tile([0.3, -0.2, 0.7], (count, 1)), 0.01


def fill_half_one_place(rng: np.random.Generator, count: int) -> tuple[Array, float]:
    points, spacing = fill_volume(rng, count)
    points[::2] = points[0]
    return points, spacing


def fill_with_outlier(extents: float) -> Layout:
    def layout(rng: np.random.Generator, count: int) -> tuple[Array, float]:
        points, spacing = fill_volume(rng, count)
        points[count // 2] = extents
        return points, spacing

    return layout


def fill_two_clusters(rng: np.random.Generator, count: int) -> tuple[Array, float]:
    points, spacing = fill_volume(rng, count)
    points[::2] += 1e6
    return points, spacing


def fill_with_no_returns(rng: np.random.Generator, count: int) -> tuple[Array, float]:
    points, spacing = fill_rope(rng, count)
    points += [0.1, 0.1, 1.0]
    points[rng.random(count) < 0.3] = 0.0
    return points, spacing


def fill_line(rng: np.random.Generator, count: int) -> tuple[Array, float]:
    return rng.random((count, 1)) * [0.6, -0.3, 0.8], 5.0 / count


def fill_plane(rng: np.random.Generator, count: int) -> tuple[Array, float]:
    return rng.random((count, 2)) @ [[0.8, 0.0, 0.6], [0.0, 1.0, 0.0]], 1.5 * count**-0.5


def fill_dense_cluster(rng: np.random.Generator, count: int) -> tuple[Array, float]:
    points, spacing = fill_volume(rng, count)
    points[::2] = 0.5 + 1e-3 * (points[::2] - 0.5)
    return points, spacing


def fill_power_law(rng: np.random.Generator, count: int) -> tuple[Array, float]:
    """Fill a ball with a density of one over the squared radius, as a scanner sees its surroundings."""
    way = rng.normal(size=(count, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    return way * rng.random((count, 1)), count ** (-1 / 3)


def fill_lattice(rng: np.random.Generator, count: int) -> tuple[Array, float]:
    """Return whole numbers, eight points on each: many distances equal a radius."""
    side = max(2, round((count / 8) ** (1 / 3)))
    return rng.integers(0, side, (count, 3)).astype(float), 1.0


LAYOUTS: dict[str, Layout] = {
    "uniform volume": fill_volume,
    "rope": fill_rope,
    "all in one place": fill_one_place,
    "half in one place": fill_half_one_place,
    "outlier at 1e3 extents": fill_with_outlier(1e3),
    "outlier at 1e6 extents": fill_with_outlier(1e6),
    "two clusters far apart": fill_two_clusters,
    "30 % at (0, 0, 0)": fill_with_no_returns,
    "line": fill_line,
    "plane": fill_plane,
    "dense cluster in sparse cloud": fill_dense_cluster,
    "power law": fill_power_law,
    "lattice, 8 on each": fill_lattice,
}


def make_normals(points: Array) -> Array:
    away = points - points.mean(axis=0)
    length = np.linalg.norm(away, axis=1, keepdims=True)
    return np.divide(away, length, out=np.tile([0.0, 0.0, 1.0], (len(points), 1)), where=length > 0.0)


def place_camera(points: Array) -> Array:
    """Return a place above the middle of the points."""
    return np.asarray(np.median(points, axis=0) + np.array([0.0, 0.0, 2.0]))


def displace(points: Array, spacing: float) -> Array:
    return points + 0.3 * spacing


def fit_curve(points: Array, spacing: float) -> strand.TubeFit:
    """Fit a curve through some of the points."""
    nodes = points[:: max(1, len(points) // MAX_CURVE_NODES)]
    order = np.lexsort(nodes.T)
    curve = nodes[order][:200] + spacing * np.arange(min(200, len(nodes)))[:, None] * [0.0, 0.0, 1e-3]
    return strand.fit_tubes(
        [points],
        [place_camera(points)],
        [curve],
        [np.eye(4)],
        5.0 * spacing,
        pose_sd=(1e-3, 1e-3),
        reference=0,
        iterations=2,
        uncertainty=False,
    )


def make_depth_image(points: Array) -> Array:
    side = math.isqrt(len(points))
    return np.resize(np.abs(points[:, 2]) + 0.1, (side, side))


def unproject(points: Array) -> Array:
    intrinsics = [[600.0, 0.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]]
    return strand.View.from_depth(make_depth_image(points), intrinsics).points


def crop_points(points: Array) -> Array:
    low, high = np.quantile(points, [0.1, 0.9], axis=0)
    return strand.View(points).crop((low - 1.0, high + 1.0)).points


def estimate_radius(points: Array) -> Array:
    try:
        return strand.estimate_radius([strand.View.from_world(points, place_camera(points))])
    except strand.StrandError:
        # an answer too: no stretch of rope
        return np.zeros(0)


KERNELS: dict[str, Callable[[Array, float], object]] = {
    "radius_outlier_mask": lambda p, h: strand.radius_outlier_mask(p, 2.0 * h, 10),
    "count_neighbors": lambda p, h: strand.count_neighbors(p, 2.0 * h),
    "estimate_normals, k": lambda p, h: strand.estimate_normals(p, k=20, viewpoint=place_camera(p)),
    "estimate_normals, radius": lambda p, h: strand.estimate_normals(
        p, radius=2.0 * h, viewpoint=place_camera(p)
    ),
    "icp, points": lambda p, h: strand.icp(displace(p, h), p, 2.0 * h, max_iterations=5),
    "icp, planes": lambda p, h: strand.icp(
        displace(p, h), p, 2.0 * h, target_normals=make_normals(p), max_iterations=5
    ),
    "centerline": lambda p, h: strand.centerline(p, make_normals(p), h, 5),
    "trace_chains": lambda p, h: strand.trace_chains(p, 2.0 * h, 5.0 * h),
    "trace_tubes": lambda p, h: strand.trace_tubes(p, place_camera(p), 5.0 * h),
    "fit_tubes": fit_curve,
    "estimate_radius": lambda p, h: estimate_radius(p),
    "View.crop": lambda p, h: crop_points(p),
    "View.from_depth": lambda p, h: unproject(p),
}


def measure_here(kernel: str, layout: str, counts: list[int], seconds: float, memory: float) -> None:
    """Print the seconds and the growth of peak memory, bytes, for each number of points."""
    if memory > 0.0:
        limit = int(memory * 2**30)
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    if seconds > 0.0:
        resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(seconds), math.ceil(seconds)))
    strand.set_num_threads(1)
    strand.count_neighbors(np.zeros((10, 3)), 1.0)
    for count in counts:
        points, spacing = LAYOUTS[layout](np.random.default_rng(count), count)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        times: list[float] = []
        while len(times) < RUNS and sum(times) < REPEAT_BELOW:
            start = time.process_time()
            KERNELS[kernel](points, spacing)
            times.append(time.process_time() - start)
        grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
        print(min(times), grown, flush=True)


def measure_in_process(
    kernel: str, layout: str, counts: list[int], limit: float, memory: float
) -> list[list[float]]:
    """Measure in another process. Return the numbers that it printed before its end or the limit."""
    options = ["--most", str(counts[-1]), "--limit", str(limit), "--memory", str(memory)]
    done = subprocess.run(
        [sys.executable, __file__, "--measure", kernel, layout, *options],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode > 0:
        print(f"{kernel}, {layout}: {done.stderr.strip().splitlines()[-1]}", file=sys.stderr)
    return [[float(number) for number in printed.split()] for printed in done.stdout.splitlines()]


def fit_exponent(counts: list[int], times: list[float]) -> float:
    """Return the exponent from the fewest to the most points, infinite if a run did not end."""
    if len(times) < len(counts):
        return math.inf
    times = [max(seconds, MIN_TIME) for seconds in times]
    return math.log(times[-1] / times[0]) / math.log(counts[-1] / counts[0])


def choose_names(names: dict[str, object], texts: list[str] | None) -> list[str]:
    """Return the names that hold one of some texts."""
    return [name for name in names if texts is None or any(text in name for text in texts)]


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--kernels", metavar="TEXT", nargs="+", help="only kernels with TEXT in their names")
    parser.add_argument("--layouts", metavar="TEXT", nargs="+", help="only layouts with TEXT in their names")
    parser.add_argument("--most", metavar="N", type=int, default=10**6, help="most points, 10^5 or 10^6")
    parser.add_argument("--limit", metavar="SECONDS", type=float, default=120.0, help="of a run, 0: none")
    parser.add_argument("--memory", metavar="GB", type=float, default=4.0, help="address space, 0: no limit")
    parser.add_argument("--measure", nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    counts = [10**power for power in range(4, 7) if 10**power <= arguments.most]
    if arguments.measure:
        measure_here(*arguments.measure, counts, arguments.limit, arguments.memory)
        return 0
    kernels, layouts = choose_names(KERNELS, arguments.kernels), choose_names(LAYOUTS, arguments.layouts)
    found: dict[tuple[str, str], list[list[float]]] = {}
    worst = []
    for kernel in kernels:
        for layout in layouts:
            numbers = measure_in_process(kernel, layout, counts, arguments.limit, arguments.memory)
            found[kernel, layout] = numbers
            times = " ".join(f"{seconds:.4f}" for seconds, _ in numbers)
            slope = fit_exponent(counts, [seconds for seconds, _ in numbers])
            worst.append((slope, kernel, layout))
            print(f"{kernel}, {layout}: {times} s, exponent {slope:.2f}", file=sys.stderr, flush=True)
    tables: dict[str, Callable[[list[list[float]]], str]] = {
        f"exponents of time from {counts[0]:.0e} to {counts[-1]:.0e} points": lambda numbers: (
            f"{fit_exponent(counts, [seconds for seconds, _ in numbers]):.2f}"
        ),
        f"seconds, {counts[-1]:.0e} points": lambda numbers: f"{numbers[-1][0]:.3g}",
        "growth of memory, bytes a point": lambda numbers: f"{numbers[-1][1] / counts[-1]:.0f}",
    }
    for title, cell in tables.items():
        print_head(title, *kernels)
        for layout in layouts:
            cells = [
                cell(found[kernel, layout]) if len(found[kernel, layout]) == len(counts) else NO_ANSWER
                for kernel in kernels
            ]
            print_row(layout, *cells)
        print()
    slope, kernel, layout = max(worst)
    print(f"worst exponent: {slope:.2f}, {kernel} on {layout}; all answered: {math.isfinite(slope)}")
    return int(slope > MAX_EXPONENT)


if __name__ == "__main__":
    run_bench(main)
