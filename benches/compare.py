"""Compare strand's kernels with their peers on the same arrays in one process, and print a table.

python benches/compare.py [--points 12000 100000 1000000 10000000] [--orders random along] [--repeats 7]
    [--slow] [--markdown FILE] [--plot FILE]

The clouds are of a rope. Their points come in random order, as those of several views or of a filtered cloud
do, and then in order along the rope, which is the friendliest order: what is near is near in memory too.

strand and its peers run by turns (A B C A B C ...), so that whatever else the machine does falls on all of
them; a time is the median of the turns, a ratio that of the least times. A time covers a kernel's work with
its search structures, not the making of the peers' own point clouds from the arrays. Answers are compared as
well: the exit code is 1 if any of them differ. A second table has strand's times on one thread over those on
two, the memory at the peak of a kernel's work above what was there before (its answer is part of it), and the
exponents b of t = a n^b fitted to the times. Runs on Linux.
"""
# ruff: noqa: E402

from __future__ import annotations

import ctypes
import math
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

THREADS = 2
# Open3D has no setting for its threads: they are as many as the processors it may use when it is imported
os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:THREADS])

import numpy as np
import open3d as o3d
import small_gicp
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import strand
from lib import tables
from lib.results import make_parser, run_bench

Array = NDArray[np.float64]
T = TypeVar("T")
Timed = tuple[float, Any]  # seconds, answer

RADIUS = 4.2e-3  # metres, of the rope
SPACING = 0.4e-3  # metres between points of the surface
NOISE = 0.3e-3  # metres, standard deviation along each axis
BEND, PITCH = 0.05, 0.5  # metres, amplitude and period of the rope's curve
FILTER_RADIUS = RADIUS / 2
FILTER_NEIGHBORS = 45  # about half of what a point on top of the rope has: its flanks are dropped
NEAREST = 16
REACH = RADIUS / 2  # of ICP's correspondences
ITERATIONS = 20
CENTERLINE_NEIGHBORS = 20
NEAR, FAR = RADIUS, 2.5 * RADIUS  # of the tracing
SCIPY_POINTS, SLOW_SCIPY_POINTS = 12_000, 100_000  # SciPy's centreline takes 13 s for 100000 points
PEER_POINTS = 1_000_000  # above this the peers take minutes and gigabytes
FEWER_POINTS, FEWER_REPEATS = 1_000_000, 3  # from this many points on a turn takes many seconds
ORDERS = {"random": "random", "along": "along the rope"}
SCIPY_LOT = 1000  # queries at a time: SciPy's neighbours are Python integers
M_MMAP_THRESHOLD = -3  # of mallopt
PAUSE = 0.02  # seconds before each run: the threads of OpenMP and BLAS spin for a while after their work


def rope(count: int, seed: int) -> Array:
    """(count, 3) Points of a rope in the plane z = 0 as cameras above it see them, in order along it."""
    rng = np.random.default_rng(seed)
    across = round(math.pi * RADIUS / SPACING)
    row, column = np.divmod(np.arange(count), across)
    x = (row + rng.random(count)) * SPACING
    angle = (column + rng.random(count)) * math.pi / across
    wave = 2 * math.pi / PITCH
    slope = BEND * wave * np.cos(wave * x)
    side = np.stack([-slope, np.ones(count), np.zeros(count)], axis=1) / np.hypot(1.0, slope)[:, None]
    axis = np.stack([x, BEND * np.sin(wave * x), np.zeros(count)], axis=1)
    up = np.array([0.0, 0.0, 1.0])
    surface = axis + RADIUS * (np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * up)
    return np.asarray(surface + rng.normal(scale=NOISE, size=(count, 3)))


def cloud(count: int, seed: int, order: str) -> Array:
    """The rope's points in one of `ORDERS`."""
    points = rope(count, seed)
    if order == "random":
        np.random.default_rng(seed).shuffle(points)
    return points


def misplaced(points: Array) -> Array:
    """The points as a camera with a small pose error puts them."""
    return np.asarray(points @ strand.rotation_xyz(math.radians(2.0), 0.0, 0.0).T + [3e-4, 5e-4, -4e-4])


def timed(work: Callable[[], T]) -> tuple[float, T]:
    time.sleep(PAUSE)
    start = time.perf_counter()
    result = work()
    return time.perf_counter() - start, result


def open3d_cloud(points: Array) -> Any:
    return o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))


def open3d_mask(points: Array) -> Timed:
    cloud = open3d_cloud(points)
    seconds, (_, kept) = timed(lambda: cloud.remove_radius_outlier(FILTER_NEIGHBORS, FILTER_RADIUS))
    mask = np.zeros(len(points), dtype=bool)
    mask[np.asarray(kept)] = True
    return seconds, mask


def open3d_normals(points: Array, search: Any) -> Timed:
    cloud = open3d_cloud(points)
    seconds, _ = timed(lambda: cloud.estimate_normals(search))
    return seconds, np.asarray(cloud.normals)


def small_gicp_normals(points: Array) -> Timed:
    cloud = small_gicp.PointCloud(points)

    def work() -> None:
        tree = small_gicp.KdTree(cloud, num_threads=THREADS)
        small_gicp.estimate_normals(cloud, tree, num_neighbors=NEAREST, num_threads=THREADS)

    seconds, _ = timed(work)
    return seconds, cloud.normals()[:, :3]


def strand_icp(source: Array, target: Array) -> Timed:
    seconds, result = timed(
        lambda: strand.icp(source, target, REACH, max_iterations=ITERATIONS, tolerance=0.0)
    )
    if result.iterations != ITERATIONS:
        raise RuntimeError(f"strand.icp ended after {result.iterations} iterations: {result.stop}")
    return seconds, result.transformation


def open3d_icp(source: Array, target: Array) -> Timed:
    registration = o3d.pipelines.registration
    moved, still = open3d_cloud(source), open3d_cloud(target)
    criteria = registration.ICPConvergenceCriteria(0.0, 0.0, ITERATIONS)
    objective = registration.TransformationEstimationPointToPoint()
    seconds, result = timed(
        lambda: registration.registration_icp(moved, still, REACH, np.eye(4), objective, criteria)
    )
    return seconds, result.transformation


def small_gicp_icp(source: Array, target: Array) -> Timed:
    moved, still = small_gicp.PointCloud(source), small_gicp.PointCloud(target)
    seconds, result = timed(
        lambda: small_gicp.align(
            still,
            moved,
            small_gicp.KdTree(still, num_threads=THREADS),
            registration_type="ICP",
            max_correspondence_distance=REACH,
            max_iterations=ITERATIONS,
            rotation_epsilon=0.0,
            translation_epsilon=0.0,
            num_threads=THREADS,
        )
    )
    return seconds, result.T_target_source


def scipy_centerline(points: Array, normals: Array) -> Timed:
    def work() -> tuple[Array, NDArray[np.int64]]:
        tree = cKDTree(points)
        axis = points - RADIUS * normals
        means, indices = [], []
        for first in range(0, len(points), SCIPY_LOT):
            lot = points[first : first + SCIPY_LOT]
            around = tree.query_ball_point(lot, 2 * RADIUS, workers=THREADS)
            for i, neighbors in enumerate(around, start=first):
                if len(neighbors) >= CENTERLINE_NEIGHBORS:
                    means.append(axis[neighbors].mean(axis=0))
                    indices.append(i)
        return np.array(means), np.array(indices)

    return timed(work)


def same_mask(ours: NDArray[np.bool_], theirs: NDArray[np.bool_]) -> tuple[bool, str]:
    different = int((ours != theirs).sum())
    return different == 0, f"{different} of {len(ours)} differ, {int(ours.sum())} kept"


def same_normals(ours: Array, theirs: Array) -> tuple[bool, str]:
    """Up to sign; a normal that only one of them has counts as far off."""
    chord = np.minimum(np.linalg.norm(ours - theirs, axis=1), np.linalg.norm(ours + theirs, axis=1))
    worst = math.degrees(float(chord.max()))
    return worst < 0.01, f"within {worst:.1e}°"


def same_motion(source: Array, tolerance: float) -> Callable[[Array, Array], tuple[bool, str]]:
    """Whether two motions bring every source point to the same place, metres."""

    def check(ours: Array, theirs: Array) -> tuple[bool, str]:
        apart = ours[:3] - theirs[:3]
        worst = float(np.linalg.norm(source @ apart[:, :3].T + apart[:, 3], axis=1).max())
        return worst < tolerance, f"within {worst:.1e} m"

    return check


def same_centerline(ours: Any, theirs: Any) -> tuple[bool, str]:
    if not np.array_equal(ours[1], theirs[1]):
        return False, "axis points at other points"
    worst = float(np.abs(ours[0] - theirs[0]).max())
    return worst < 1e-9, f"within {worst:.1e} m"


@dataclass(frozen=True)
class Peer:
    """Another library's kernel, and whether its answer is ours and by how much it differs."""

    name: str
    run: Callable[[], Timed]
    compare: Callable[[Any, Any], tuple[bool, str]]
    once: bool = False  # only in the first turn, where it takes long


@dataclass(frozen=True)
class Stage:
    name: str
    run: Callable[[], Timed]
    peers: list[Peer] = field(default_factory=list)
    clouds: int = 1  # of as many points each


def stages(count: int, order: str, slow: bool) -> list[Stage]:
    points, source = cloud(count, 1, order), misplaced(cloud(count, 2, order))
    viewpoint = np.array([0.0, 0.0, 1.0])
    nearest = o3d.geometry.KDTreeSearchParamKNN(NEAREST)
    within = o3d.geometry.KDTreeSearchParamRadius(FILTER_RADIUS)
    normals = strand.estimate_normals(points, radius=FILTER_RADIUS, viewpoint=viewpoint)
    axis_points, _ = strand.centerline(points, normals, RADIUS, CENTERLINE_NEIGHBORS)
    scipy_peer = Peer(
        "SciPy", lambda: scipy_centerline(points, normals), same_centerline, once=count > SCIPY_POINTS
    )
    return [
        Stage(
            "radius filter",
            lambda: timed(lambda: strand.radius_outlier_mask(points, FILTER_RADIUS, FILTER_NEIGHBORS)),
            [Peer("Open3D", lambda: open3d_mask(points), same_mask)],
        ),
        Stage(
            f"normals, {NEAREST} nearest",
            lambda: timed(lambda: strand.estimate_normals(points, k=NEAREST, viewpoint=viewpoint)),
            [
                Peer("Open3D", lambda: open3d_normals(points, nearest), same_normals),
                Peer("small_gicp", lambda: small_gicp_normals(points), same_normals),
            ],
        ),
        Stage(
            "normals, radius",
            lambda: timed(lambda: strand.estimate_normals(points, radius=FILTER_RADIUS, viewpoint=viewpoint)),
            [Peer("Open3D", lambda: open3d_normals(points, within), same_normals)],
        ),
        Stage(
            f"ICP, {ITERATIONS} iterations",
            lambda: strand_icp(source, points),
            [
                Peer("Open3D", lambda: open3d_icp(source, points), same_motion(source, 1e-9)),
                # linearised steps instead of a closed form: on its way to the same optimum it is elsewhere
                Peer("small_gicp", lambda: small_gicp_icp(source, points), same_motion(source, SPACING / 10)),
            ],
            clouds=2,
        ),
        Stage(
            "centreline",
            lambda: timed(lambda: strand.centerline(points, normals, RADIUS, CENTERLINE_NEIGHBORS)),
            [scipy_peer] if count <= (SLOW_SCIPY_POINTS if slow else SCIPY_POINTS) else [],
        ),
        Stage("tracing", lambda: timed(lambda: strand.trace_chains(axis_points, NEAR, FAR))),
    ]


@dataclass(frozen=True)
class Turns:
    """What the turns of one kernel gave."""

    seconds: list[float]
    answer: Any

    @property
    def median(self) -> float:
        return statistics.median(self.seconds)

    def ratio(self, other: Turns) -> float:
        return min(other.seconds) / min(self.seconds)


@dataclass(frozen=True)
class Line:
    """One stage at one number of points in one order: times of everyone, and what strand alone needs."""

    stage: str
    count: int
    order: str
    seconds: dict[str, float]  # by library, medians
    one_thread: float  # least seconds of strand on one thread over those on two
    bytes_per_point: float


def take_turns(
    runs: list[Callable[[], Timed]], repeats: int, once: frozenset[int] = frozenset()
) -> list[Turns]:
    """Everyone's turns; those in `once` take part in the first only."""
    seconds: list[list[float]] = [[] for _ in runs]
    answers: list[Any] = [None] * len(runs)
    for turn in range(repeats):
        for i, run in enumerate(runs):
            if turn == 0 or i not in once:
                time_taken, answers[i] = run()
                seconds[i].append(time_taken)
    return [Turns(*both) for both in zip(seconds, answers, strict=True)]


def status(name: str) -> int:
    """A size from /proc/self/status, bytes."""
    for row in Path("/proc/self/status").read_text().splitlines():
        if row.startswith(name + ":"):
            return 1024 * int(row.split()[1])
    raise RuntimeError(f"/proc/self/status has no {name}")


def peak_bytes(name: str, count: int, order: str) -> int:
    """Memory at the peak of a stage above what was there before, in a process of its own."""
    command = [sys.executable, __file__, "--points", str(count), "--orders", order, "--peak", name]
    # strand's allocator gives back at once what is freed, so that none of it is there before
    environment = {**os.environ, "MIMALLOC_PURGE_DELAY": "0"}
    run = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, env=environment)
    return int(run.stdout)


def own_peak_bytes(name: str, count: int, order: str) -> int:
    """The same, of this process."""
    libc = ctypes.CDLL(None)
    # so does the system's
    libc.mallopt(M_MMAP_THRESHOLD, 1 << 16)
    run = next(stage.run for stage in stages(count, order, slow=False) if stage.name == name)
    libc.malloc_trim(0)
    Path("/proc/self/clear_refs").write_text("5")  # the peak starts anew
    before = status("VmRSS")
    run()
    return status("VmHWM") - before


def on_one_thread(run: Callable[[], Timed]) -> Timed:
    strand.set_num_threads(1)
    try:
        return run()
    finally:
        strand.set_num_threads(THREADS)


def measured(stage: Stage, count: int, order: str, repeats: int) -> tuple[bool, list[str], Line]:
    """Whether the answers of a stage agree, its rows of the table, and its numbers."""
    repeats = repeats if count < FEWER_POINTS else min(repeats, FEWER_REPEATS)
    peers = stage.peers if count <= PEER_POINTS else []
    once = frozenset(i for i, peer in enumerate(peers, start=1) if peer.once)
    ours, *theirs = take_turns([stage.run, *(peer.run for peer in peers)], repeats, once)
    two, one = take_turns([stage.run, lambda: on_one_thread(stage.run)], min(repeats, 3))
    line = Line(
        stage.name,
        count,
        order,
        {"strand": ours.median, **{p.name: t.median for p, t in zip(peers, theirs, strict=True)}},
        two.ratio(one),
        peak_bytes(stage.name, count, order) / (count * stage.clouds),
    )
    start = (count, ORDERS[order], stage.name, f"{ours.median * 1e3:.1f}")
    if not peers:
        return True, [tables.row(*start, "left out" if stage.peers else "", "", "", "")], line
    good, rows = True, []
    for peer, turns in zip(peers, theirs, strict=True):
        agree, text = peer.compare(ours.answer, turns.answer)
        good &= agree
        verdict = f"{'agree' if agree else 'DIFFER'}: {text}"
        times = f"{turns.median * 1e3:.1f}", f"{ours.ratio(turns):.1f}"
        rows.append(tables.row(*start, peer.name, *times, verdict))
    return good, rows, line


def exponent(lines: list[Line]) -> float:
    """b of t = a n^b."""
    counts = np.log([line.count for line in lines])
    return float(np.polyfit(counts, np.log([line.seconds["strand"] for line in lines]), 1)[0])


def scaling(lines: list[Line]) -> list[str]:
    """The table of what strand needs, a row for each stage and order."""
    counts = sorted({line.count for line in lines})
    titles = ["exponent"] if len(counts) > 1 else []
    titles += [f"1 thread / {THREADS}, {count}" for count in counts]
    titles += [f"bytes a point, {count}" for count in counts]
    table = [tables.head("stage", "order", *titles)]
    for stage, order in dict.fromkeys((line.stage, line.order) for line in lines):
        own = [line for line in lines if (line.stage, line.order) == (stage, order)]
        own.sort(key=lambda line: line.count)
        cells = [f"{exponent(own):.2f}"] if len(counts) > 1 else []
        cells += [f"{line.one_thread:.2f}" for line in own] + [f"{line.bytes_per_point:.0f}" for line in own]
        table.append(tables.row(stage, ORDERS[order], *cells))
    return table


def draw(lines: list[Line], path: Path) -> None:
    """Times over numbers of points, both logarithmic, a panel for each stage; dashed along the rope."""
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
                # the same colour in both orders, named once for peers
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
    parser.add_argument("--markdown", type=Path, help="write the table to this file too")
    parser.add_argument("--plot", type=Path, help="write a plot of the times to this file")
    parser.add_argument(
        "--peak", metavar="STAGE", help="print the stage's peak memory in bytes, and nothing else"
    )
    parser.add_argument("--slow", action="store_true", help="SciPy's centreline for 100000 points too, once")
    arguments = parser.parse_args()
    strand.set_num_threads(THREADS)
    if arguments.peak:
        print(own_peak_bytes(arguments.peak, arguments.points[0], arguments.orders[0]))
        return 0
    lines = [
        f"{THREADS} threads each: strand {strand.__version__} (set_num_threads), Open3D {o3d.__version__} "
        f"(processors it may use), small_gicp {version('small_gicp')} (num_threads), "
        f"SciPy {version('scipy')} (workers).",
        "",
        tables.head("points", "order", "stage", "strand ms", "peer", "peer ms", "peer / strand", "answers"),
    ]
    print(*lines, sep="\n", flush=True)
    good, all_measured = True, []
    for count in arguments.points:
        for order in arguments.orders:
            for stage in stages(count, order, arguments.slow):
                agree, more, line = measured(stage, count, order, arguments.repeats)
                print(*more, sep="\n", flush=True)
                good &= agree
                lines += more
                all_measured.append(line)
    more = ["", *scaling(all_measured)]
    print(*more, sep="\n", flush=True)
    lines += more
    if arguments.plot:
        draw(all_measured, arguments.plot)
    if arguments.markdown:
        arguments.markdown.write_text("\n".join(lines) + "\n")
    return 0 if good else 1


if __name__ == "__main__":
    run_bench(main)
