"""How long reconstruct() takes for input that is not as it should be, and by how much it overruns deadlines.

python benches/answering.py [DIR] [--only TEXT] [--part perturbed|foreign|deadline] [--limit SECONDS]
    [--every N]

Without DIR the scenes are those of benches/lib/collection.py. Three tables: scenes with poses, intrinsics,
radius or number of ropes that are wrong; scenes without a rope, with and without a radius; and the overrun of
several deadlines. Each call runs on one thread in a process of its own, which is ended after the limit.
Times are processor time, so that a busy machine does not count; deadlines are measured by the clock.
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
DEADLINES = (0.001, 0.05, 0.2, 1.0)

Call = Callable[[], tuple[list[strand.View], dict[str, Any]]]


def moved(scene: SyntheticScene, metres: float, seed: int = 0) -> list[strand.View]:
    """Views whose poses are off by so much, each in a direction of its own."""
    rng = np.random.default_rng(seed)
    views = []
    for depth, pose in zip(scene.depth, scene.poses, strict=True):
        aside = rng.normal(size=3)
        wrong = pose.copy()
        wrong[:3, 3] += metres * aside / np.linalg.norm(aside)
        views.append(strand.View.from_depth(depth, scene.intrinsics, wrong, depth_scale=scene.depth_scale))
    return views


def zoomed(scene: SyntheticScene, factor: float) -> list[strand.View]:
    """Views whose focal length is wrong by a factor."""
    intrinsics = scene.intrinsics * np.array([[factor, 1, 1], [1, factor, 1], [1, 1, 1]])
    return [
        strand.View.from_depth(depth, intrinsics, pose, depth_scale=scene.depth_scale)
        for depth, pose in zip(scene.depth, scene.poses, strict=True)
    ]


def perturbed(scene: SyntheticScene) -> Iterator[tuple[str, Call]]:
    """Yield what is wrong, and the arguments of the call."""
    number = len(scene.truth)
    known: dict[str, Any] = {"radius": scene.radius, "bounds": scene.bounds}

    def told(views: Callable[[], Any], **more: Any) -> Call:
        return lambda: (list(views()), {**known, **more})

    right = lambda: scene.views  # noqa: E731
    yield "nothing", told(right)
    yield "nothing, ropes told", told(right, ropes=number)
    for off in (7e-3, 10e-3):
        for ropes in (None, number):
            said = f"poses off by {off * 1e3:.0f} mm" + ("" if ropes is None else ", ropes told")
            yield said, told(lambda off=off: moved(scene, off), ropes=ropes)
    for factor in (0.9, 0.95, 1.05, 1.1):
        yield (
            f"focal length {factor - 1:+.0%}, ropes told",
            told(lambda factor=factor: zoomed(scene, factor), ropes=number),
        )
    yield "radius halved, ropes told", told(right, radius=0.5 * scene.radius, ropes=number)
    yield "radius doubled, ropes told", told(right, radius=2.0 * scene.radius, ropes=number)
    for ropes in (1, 2, 3, 6):
        if ropes != number:
            yield f"{ropes} ropes told, wrong", told(right, ropes=ropes)
    yield "poses off by 7 mm, length told", told(lambda: moved(scene, 7e-3), length=[0.4] * number)


def plane(n: int, rng: np.random.Generator, side: float = 0.4) -> np.ndarray:
    points = rng.uniform(-0.5 * side, 0.5 * side, (n, 3))
    points[:, 2] = 0.0
    return points + rng.normal(scale=5e-4, size=(n, 3))


def mug(n: int, rng: np.random.Generator) -> np.ndarray:
    """The outside of a cup of 8 cm and 10 cm, with a handle 1 cm thick."""
    angle, height = rng.uniform(0, 2 * np.pi, n), rng.uniform(0, 0.1, n)
    points = np.stack([0.04 * np.cos(angle), 0.04 * np.sin(angle), height], axis=1)
    some = n // 10
    turn, around = rng.uniform(-0.5 * np.pi, 0.5 * np.pi, some), rng.uniform(0, 2 * np.pi, some)
    reach = 0.03 + 0.005 * np.cos(around)
    points[:some] = np.stack(
        [0.04 + reach * np.cos(turn), 0.005 * np.sin(around), 0.05 + reach * np.sin(turn)], axis=1
    )
    return points + rng.normal(scale=5e-4, size=points.shape)


def ball(n: int, rng: np.random.Generator) -> np.ndarray:
    points = rng.normal(size=(n, 3))
    return 0.06 * points / np.linalg.norm(points, axis=1)[:, None] + rng.normal(scale=5e-4, size=(n, 3))


def noise(n: int, rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(-0.15, 0.15, (n, 3))


def person(n: int, rng: np.random.Generator) -> np.ndarray:
    """Trunk, head, arms and legs of someone 1.8 m tall."""
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


SHAPES = {"plane": plane, "mug": mug, "ball": ball, "noise in a box": noise, "person": person}


def seen(points: np.ndarray, distance: float, level: float = 0.0) -> list[strand.View]:
    """Three views of what faces each camera."""
    views = []
    centre = points.mean(axis=0)
    for azimuth in (-0.7, 0.0, 0.7):
        camera = centre + distance * np.array([np.sin(azimuth), -np.cos(azimuth) * 0.6, 0.8])
        away = np.linalg.norm(points - camera, axis=1)
        near = points if level else points[away < np.median(away) + 1e-9]
        views.append(strand.View.from_world(near, camera))
    return views


def foreign(scenes: Iterable[SyntheticScene], sizes: tuple[int, ...]) -> Iterator[tuple[str, str, Call]]:
    """Yield scenes that are no ropes, what is told, and the arguments of the call."""
    radius = 4.2e-3
    for name, shape in SHAPES.items():
        for n in sizes:
            points = shape(n, np.random.default_rng(1))
            distance = 2.5 if name == "person" else 0.5
            for told, known in (
                ("radius", {"radius": radius}),
                ("nothing", {}),
                ("ropes", {"radius": radius, "ropes": 1}),
            ):
                whole = float(name in ("plane", "noise in a box"))
                yield (
                    f"{name}, {n:,} points",
                    told,
                    lambda points=points, known=known, distance=distance, whole=whole: (
                        seen(points, distance, whole),
                        known,
                    ),
                )
    for scene in scenes:
        for told, known in (
            ("radius", {"radius": scene.radius}),
            ("nothing", {}),
            ("ropes", {"radius": scene.radius, "ropes": 1}),
        ):
            yield (
                f"{scene.name} with its table",
                told,
                lambda scene=scene, known=known: (list(scene.views), known),
            )


def answer(call: Call, pipe: Any, deadline: float | None) -> None:
    """Run a call in this process and send what came of it."""
    strand.set_num_threads(1)
    views, arguments = call()
    if deadline is not None:
        arguments = {**arguments, "deadline": deadline}
    points = sum(len(view.points) for view in views)
    start, clock = time.process_time(), time.perf_counter()
    try:
        model = strand.reconstruct(views, **arguments)
    except strand.StrandError as error:
        said, doubts = f"{type(error).__name__}: {error}", []
    else:
        said = f"{len(model.chains)} chains, confidence {model.confidence:.2f}"
        doubts = [doubt.kind for doubt in model.doubts]
    pipe.send((said, time.process_time() - start, time.perf_counter() - clock, points, doubts))


def timed(
    call: Call, limit: float, deadline: float | None = None
) -> tuple[str, float, float, int, list[str]]:
    """What came of a call, its processor time and clock time, its points, and the kinds of its doubts."""
    ours, theirs = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.get_context("fork").Process(target=answer, args=(call, theirs, deadline))
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


def perturbed_table(scenes: list[SyntheticScene], limit: float) -> None:
    print_head("what is wrong", "scenes", "answered", "refused", "median s", "worst s", "of")
    kinds: dict[str, list[tuple[str, Call]]] = {}
    for scene in scenes:
        for kind, call in perturbed(scene):
            kinds.setdefault(kind, []).append((scene.name, call))
    for kind, calls in kinds.items():
        found = [(name, *timed(call, limit)) for name, call in calls]
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


def foreign_table(scenes: list[SyntheticScene], limit: float, sizes: tuple[int, ...]) -> None:
    print_head("scene", "told", "points", "s", "s per 100,000 points", "answer")
    for name, told, call in foreign(scenes, sizes):
        said, seconds, _, points, _ = timed(call, limit)
        print_row(name, told, points, f"{seconds:.2f}", f"{1e5 * seconds / max(points, 1):.2f}", said)


def deadline_table(scenes: list[SyntheticScene], limit: float) -> None:
    print_head(
        "deadline s",
        "calls",
        "answered",
        "with the doubt",
        "DeadlineError",
        "median overrun s",
        "worst",
        "of",
    )
    for deadline in DEADLINES:
        found = []
        for scene in scenes:
            for kind, call in perturbed(scene):
                if kind.startswith(("nothing", "poses off by 7 mm", "focal length +10%")):
                    found.append((f"{scene.name}, {kind}", *timed(call, limit, deadline)))
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
    parser.add_argument("--every", type=int, default=1, metavar="N", help="only every so many scenes")
    arguments = parser.parse_args()
    scenes = list(collection.choose_scenes(arguments))[:: arguments.every]
    if arguments.part in (None, "perturbed"):
        perturbed_table(scenes, arguments.limit)
        print()
    if arguments.part in (None, "foreign"):
        foreign_table(scenes[:3], arguments.limit, (10_000, 100_000))
        print()
    if arguments.part in (None, "deadline"):
        deadline_table(scenes, arguments.limit)
    return 0


if __name__ == "__main__":
    run_bench(main)
