"""Measure how long reconstruct() takes for wrong input, and by how much it overruns deadlines.

python benches/answering.py [DIR] [--only TEXT] [--part perturbed|foreign|deadline] [--limit SECONDS]
    [--every N]

Without DIR the scenes are those of benches/lib/collection.py. There are three tables:

- scenes with wrong poses, intrinsics, radius or number of ropes,
- scenes without a rope, with and without a radius,
- the overrun of several deadlines.

Each call runs on one thread in a process of its own, which is killed after the limit. The first two tables
have processor time, so that other work of the machine does not count; the third has time by the clock.
"""

from __future__ import annotations

import multiprocessing
import statistics
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np

import strand
from lib import collection
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from strand.synthetic import SyntheticScene

PARTS = ("perturbed", "foreign", "deadline")
DEADLINES = (0.001, 0.05, 0.2, 1.0)  # seconds
NOISE = 5e-4  # metres: standard deviation of foreign points

Call = Callable[[], tuple[list[strand.View], dict[str, Any]]]


def displace_views(scene: SyntheticScene, metres: float, seed: int = 0) -> list[strand.View]:
    """Return views whose poses are off by a distance, each in a direction of its own."""
    rng = np.random.default_rng(seed)
    views = []
    for depth, pose in zip(scene.depth, scene.poses, strict=True):
        aside = rng.normal(size=3)
        wrong = pose.copy()
        wrong[:3, 3] += metres * aside / np.linalg.norm(aside)
        views.append(strand.View.from_depth(depth, scene.intrinsics, wrong, depth_scale=scene.depth_scale))
    return views


def zoom_views(scene: SyntheticScene, factor: float) -> list[strand.View]:
    """Return views whose focal length is wrong by a factor."""
    intrinsics = scene.intrinsics * np.array([[factor, 1, 1], [1, factor, 1], [1, 1, 1]])
    return [
        strand.View.from_depth(depth, intrinsics, pose, depth_scale=scene.depth_scale)
        for depth, pose in zip(scene.depth, scene.poses, strict=True)
    ]


def list_perturbed(scene: SyntheticScene) -> Iterator[tuple[str, Call]]:
    """Yield the name of each mistake, and the arguments of its call."""
    number = len(scene.truth)
    known: dict[str, Any] = {"radius": scene.radius, "bounds": scene.bounds}

    def make_call(views: Callable[[], Any], **more: Any) -> Call:
        return lambda: (list(views()), {**known, **more})

    right = lambda: scene.views  # noqa: E731
    yield "nothing", make_call(right)
    yield "nothing, number of ropes given", make_call(right, ropes=number)
    for off in (7e-3, 10e-3):
        for ropes in (None, number):
            said = f"poses off by {off * 1e3:.0f} mm" + ("" if ropes is None else ", number of ropes given")
            yield said, make_call(lambda off=off: displace_views(scene, off), ropes=ropes)
    for factor in (0.9, 0.95, 1.05, 1.1):
        yield (
            f"focal length {factor - 1:+.0%}, number of ropes given",
            make_call(lambda factor=factor: zoom_views(scene, factor), ropes=number),
        )
    yield "half the radius, number of ropes given", make_call(right, radius=0.5 * scene.radius, ropes=number)
    yield "twice the radius, number of ropes given", make_call(right, radius=2.0 * scene.radius, ropes=number)
    for ropes in (1, 2, 3, 6):
        if ropes != number:
            yield f"{ropes} ropes given, wrong", make_call(right, ropes=ropes)
    yield (
        "poses off by 7 mm, length given",
        make_call(lambda: displace_views(scene, 7e-3), length=[0.4] * number),
    )


def sample_plane(n: int, rng: np.random.Generator, side: float = 0.4) -> np.ndarray:
    """Return points of a square."""
    points = rng.uniform(-0.5 * side, 0.5 * side, (n, 3))
    points[:, 2] = 0.0
    return points + rng.normal(scale=NOISE, size=(n, 3))


def sample_mug(n: int, rng: np.random.Generator) -> np.ndarray:
    """Return points of a cup, 8 cm wide and 10 cm high, with a handle 1 cm thick."""
    angle, height = rng.uniform(0, 2 * np.pi, n), rng.uniform(0, 0.1, n)
    points = np.stack([0.04 * np.cos(angle), 0.04 * np.sin(angle), height], axis=1)
    some = n // 10
    turn, around = rng.uniform(-0.5 * np.pi, 0.5 * np.pi, some), rng.uniform(0, 2 * np.pi, some)
    reach = 0.03 + 0.005 * np.cos(around)
    points[:some] = np.stack(
        [0.04 + reach * np.cos(turn), 0.005 * np.sin(around), 0.05 + reach * np.sin(turn)], axis=1
    )
    return points + rng.normal(scale=NOISE, size=points.shape)


def sample_ball(n: int, rng: np.random.Generator) -> np.ndarray:
    """Return points of a sphere with a radius of 6 cm."""
    points = rng.normal(size=(n, 3))
    return 0.06 * points / np.linalg.norm(points, axis=1)[:, None] + rng.normal(scale=NOISE, size=(n, 3))


def sample_box(n: int, rng: np.random.Generator) -> np.ndarray:
    """Return points that fill a box."""
    return rng.uniform(-0.15, 0.15, (n, 3))


def sample_person(n: int, rng: np.random.Generator) -> np.ndarray:
    """Return points of the trunk, head, arms and legs of someone 1.8 m tall."""
    parts = [
        ((0, 0, 1.2), (0.2, 0.12, 0.35), 5),
        ((0, 0, 1.68), (0.09, 0.1, 0.12), 1),
        ((0.27, 0, 1.15), (0.05, 0.05, 0.33), 1),
        ((-0.27, 0, 1.15), (0.05, 0.05, 0.33), 1),
        ((0.1, 0, 0.45), (0.08, 0.08, 0.45), 2),
        ((-0.1, 0, 0.45), (0.08, 0.08, 0.45), 2),
    ]
    total = sum(weight for *_, weight in parts)
    found = []
    for centre, axes, weight in parts:
        around = rng.normal(size=(n * weight // total, 3))
        around /= np.linalg.norm(around, axis=1)[:, None]
        found.append(np.array(centre) + around * np.array(axes))
    points = np.concatenate(found)
    return points + rng.normal(scale=2e-3, size=points.shape)


SHAPES = {
    "plane": sample_plane,
    "mug": sample_mug,
    "ball": sample_ball,
    "noise in a box": sample_box,
    "person": sample_person,
}


def make_views(points: np.ndarray, distance: float, whole: bool) -> list[strand.View]:
    """Return three views, each of the points that face its camera, or of all."""
    views = []
    centre = points.mean(axis=0)
    for azimuth in (-0.7, 0.0, 0.7):
        camera = centre + distance * np.array([np.sin(azimuth), -np.cos(azimuth) * 0.6, 0.8])
        away = np.linalg.norm(points - camera, axis=1)
        near = points if whole else points[away < np.median(away) + 1e-9]
        views.append(strand.View.from_world(near, camera))
    return views


def list_foreign(scenes: Iterable[SyntheticScene], sizes: tuple[int, ...]) -> Iterator[tuple[str, str, Call]]:
    """Yield scenes without ropes, the input that is given, and the arguments of the call."""
    radius = 4.2e-3
    for name, shape in SHAPES.items():
        for n in sizes:
            points = shape(n, np.random.default_rng(1))
            distance = 2.5 if name == "person" else 0.5
            for given, known in (
                ("radius", {"radius": radius}),
                ("nothing", {}),
                ("ropes", {"radius": radius, "ropes": 1}),
            ):
                whole = name in ("plane", "noise in a box")
                yield (
                    f"{name}, {n:,} points",
                    given,
                    lambda points=points, known=known, distance=distance, whole=whole: (
                        make_views(points, distance, whole),
                        known,
                    ),
                )
    for scene in scenes:
        for given, known in (
            ("radius", {"radius": scene.radius}),
            ("nothing", {}),
            ("ropes", {"radius": scene.radius, "ropes": 1}),
        ):
            yield (
                f"{scene.name} with its table",
                given,
                lambda scene=scene, known=known: (list(scene.views), known),
            )


def send_answer(call: Call, pipe: Any, deadline: float | None) -> None:
    """Run a call in this process, and send the outcome, times, number of points and kinds of doubts."""
    strand.set_num_threads(1)
    views, arguments = call()
    if deadline is not None:
        arguments = {**arguments, "deadline": deadline}
    points = sum(len(view.points) for view in views)
    start, clock = time.process_time(), time.perf_counter()
    try:
        model = strand.reconstruct(views, **arguments)
    except strand.StrandError as error:
        outcome, doubts = f"{type(error).__name__}: {error}", []
    else:
        outcome = f"{len(model.chains)} chains, confidence {model.confidence:.2f}"
        doubts = [doubt.kind for doubt in model.doubts]
    pipe.send((outcome, time.process_time() - start, time.perf_counter() - clock, points, doubts))


def time_call(
    call: Call, limit: float, deadline: float | None = None
) -> tuple[str, float, float, int, list[str]]:
    """Return a call's outcome, processor time, time by the clock, points, and kinds of doubts."""
    ours, theirs = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.get_context("fork").Process(target=send_answer, args=(call, theirs, deadline))
    process.start()
    theirs.close()
    try:
        if ours.poll(limit):
            return ours.recv()
        return "ended", limit, limit, 0, []
    except EOFError:
        return "crashed", 0.0, 0.0, 0, []
    finally:
        process.kill()
        process.join()


def print_perturbed(scenes: list[SyntheticScene], limit: float) -> None:
    """Print the table of mistakes."""
    print_head("what is wrong", "scenes", "answered", "refused", "median s", "worst s", "worst scene")
    kinds: dict[str, list[tuple[str, Call]]] = {}
    for scene in scenes:
        for kind, call in list_perturbed(scene):
            kinds.setdefault(kind, []).append((scene.name, call))
    for kind, calls in kinds.items():
        found = [(name, *time_call(call, limit)) for name, call in calls]
        times = [each[2] for each in found]
        worst = max(found, key=lambda each: each[2])
        refused = sum("Error" in each[1] for each in found)
        print_row(
            kind,
            len(found),
            len(found) - refused,
            refused,
            f"{statistics.median(times):.2f}",
            f"{worst[2]:.2f}",
            worst[0],
        )
        bad = [each for each in found if each[1] in ("ended", "crashed")]
        print(*(f"{each[0]}: {each[1]}" for each in bad), sep="\n", file=sys.stderr, flush=True)


def print_foreign(scenes: list[SyntheticScene], limit: float, sizes: tuple[int, ...]) -> None:
    """Print the table of scenes without ropes."""
    print_head("scene", "given", "points", "s", "s per 100,000 points", "answer")
    for name, given, call in list_foreign(scenes, sizes):
        outcome, seconds, _, points, _ = time_call(call, limit)
        print_row(name, given, points, f"{seconds:.2f}", f"{1e5 * seconds / max(points, 1):.2f}", outcome)


def print_deadlines(scenes: list[SyntheticScene], limit: float) -> None:
    """Print the table of deadlines."""
    print_head(
        "deadline s",
        "calls",
        "answered",
        "with the doubt",
        "DeadlineError",
        "median overrun s",
        "worst",
        "worst call",
    )
    for deadline in DEADLINES:
        found = []
        for scene in scenes:
            for kind, call in list_perturbed(scene):
                if kind.startswith(("nothing", "poses off by 7 mm", "focal length +10%")):
                    found.append((f"{scene.name}, {kind}", *time_call(call, limit, deadline)))
        over = [max(each[3] - deadline, 0.0) for each in found]
        print_row(
            deadline,
            len(found),
            sum("Error" not in each[1] for each in found),
            sum("deadline" in each[5] for each in found),
            sum("DeadlineError" in each[1] for each in found),
            f"{statistics.median(over):.3f}",
            f"{max(over):.3f}",
            found[int(np.argmax(over))][0],
        )


def main() -> int:
    parser = make_parser(__doc__)
    collection.add_arguments(parser)
    parser.add_argument("--part", choices=PARTS, help="one of the tables (default: all)")
    parser.add_argument(
        "--limit", type=float, default=120.0, metavar="SECONDS", help="for a call (default: 120)"
    )
    parser.add_argument(
        "--every", type=int, default=1, metavar="N", help="take only every Nth scene (default: 1)"
    )
    arguments = parser.parse_args()
    scenes = list(collection.choose_scenes(arguments))[:: arguments.every]
    if arguments.part in (None, "perturbed"):
        print_perturbed(scenes, arguments.limit)
        print()
    if arguments.part in (None, "foreign"):
        print_foreign(scenes[:3], arguments.limit, (10_000, 100_000))
        print()
    if arguments.part in (None, "deadline"):
        print_deadlines(scenes, arguments.limit)
    return 0


if __name__ == "__main__":
    run_bench(main)
