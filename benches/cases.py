"""Time five common reconstructions on one thread and on two, and compare with another installation.

python benches/cases.py [CASE ...] [--scenes N] [--turns N] [--calls N] [--against PATH]

"processor" is the processor time of a call on one thread, "two threads" the wall time on two, both from the
images to the model. Each is the least of a scene's calls, and the table has the median of the scenes. With
`--against`, the package in another folder `python` takes turns with this one on the same scenes. Then the
table has its times and the median ratio, this one's time over the other's; "same" counts equal answers. A
second table has the median time of each stage on one thread; "rest" is all that is in no stage. "load" is the
system's mean number of running processes in the last minute, this bench's included: times suffer if it is
much above 1.
"""

from __future__ import annotations

import itertools
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lib import collection
from lib.imitated_scenes import make_imitated
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from strand.synthetic import (
    Camera,
    Layout,
    Noise,
    Segmentation,
    SyntheticScene,
    frame_scene,
    random_ropes,
    scene,
)
from strand.synthetic.camera import FOCAL_LENGTH

WORKER = Path(__file__).parent / "lib" / "timed_calls.py"
THREADS = (1, 2)
# names of shapes, the others are random ropes, and cameras
MASKED = (("s", "d435"), ("figure8", "zed"), ("overhand", "d435"), ("random", "d435"), ("loop", "tof"))
THREE = (("s", "d435"), ("random", "zed"), ("overhand", "d435"))
PHOTO = (960, 640)  # pixels
PHOTO_RADIUS = 4e-3  # metres: the ropes' in photographs
PHOTO_PIXELS = 6.0  # the same in the image


def draw_paper() -> Iterator[SyntheticScene]:
    yield from map(collection.make_scene, ("paper_0.7mm", "paper_0.3mm", "paper_1.5mm"))


def draw_masked() -> Iterator[SyntheticScene]:
    for seed, (name, camera) in enumerate(MASKED):
        yield make_imitated("one", name, camera, 1, seed)


def draw_three() -> Iterator[SyntheticScene]:
    yield from (
        make_imitated("three", name, camera, 3, seed) for seed, (name, camera) in enumerate(THREE, 10)
    )


def draw_bare() -> Iterator[SyntheticScene]:
    yield from (frame_scene("usual", seed) for seed in range(4))


def draw_photos() -> Iterator[SyntheticScene]:
    """Yield three ropes with nine crossings, seen nearly from above; some seeds have no such ropes."""
    for seed in itertools.count():
        try:
            chains = random_ropes(9, 3, PHOTO_RADIUS, seed)
        except ValueError:
            continue
        distance = FOCAL_LENGTH * PHOTO[0] * PHOTO_RADIUS / PHOTO_PIXELS
        yield scene(
            "photo",
            chains=chains,
            radius=PHOTO_RADIUS,
            seed=seed,
            views=1,
            camera=Camera("zed", size=PHOTO),
            noise=Noise(),
            mask=Segmentation(),
            layout=Layout(distance=distance, elevation=math.radians(80.0)),
        )


# case: scenes, and what is told of them
CASES: dict[str, tuple[Callable[[], Iterator[SyntheticScene]], tuple[str, ...]]] = {
    "paper": (draw_paper, ("radius", "bounds")),
    "published": (draw_paper, ("radius", "bounds", "published")),
    "masked": (draw_masked, ("mask", "ropes", "radius")),
    "masked, no radius": (draw_masked, ("mask", "ropes")),
    "three masked": (draw_three, ("mask", "ropes", "radius")),
    "bare frame": (draw_bare, ()),
    "photograph": (draw_photos, ("mask",)),
}


@dataclass(frozen=True)
class Times:
    """Milliseconds of a scene on one thread, on two, and of each stage on one; and the answer's digest."""

    processor: float
    two_threads: float
    stages: dict[str, float]
    digest: str


class Worker:
    """A process that times calls of one installation with a number of threads."""

    def __init__(self, threads: int, folder: Path | None) -> None:
        paths = [str(folder)] if folder else []
        inherited = os.environ.get("PYTHONPATH")
        environment = os.environ | {
            "PYTHONPATH": os.pathsep.join([*paths, *([inherited] if inherited else [])]),
            "STRAND_NUM_THREADS": str(threads),
            "OPENBLAS_NUM_THREADS": "1",
        }
        self.process = subprocess.Popen(
            [sys.executable, str(WORKER)],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def ask(self, **call: Any) -> dict[str, Any]:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps(call) + "\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline()
        if not answer:
            raise RuntimeError(f"{WORKER.name} ended with code {self.process.wait()}")
        return dict(json.loads(answer))

    def close(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait()


def time_scene(pairs: list[list[Worker]], call: dict[str, Any], turns: int) -> list[Times]:
    """Return each installation's times of a scene; they take turns."""
    found = [[pair[k].ask(**call) for k in range(len(THREADS))] for _ in range(turns) for pair in pairs]
    times = []
    for number in range(len(pairs)):
        mine = found[number :: len(pairs)]
        digests = {answer["digest"] for both in mine for answer in both}
        assert len(digests) == 1, "the answer depends on the number of threads, or changes from call to call"
        stages = {stage: 1e3 * min(one["stages"][stage] for one, _ in mine) for stage in mine[0][0]["stages"]}
        one, two = min(one["processor"] for one, _ in mine), min(two["wall"] for _, two in mine)
        times.append(Times(1e3 * one, 1e3 * two, stages, digests.pop()))
    return times


def print_stages(found: dict[str, list[Times]]) -> None:
    """Print the median time of each stage of the cases, milliseconds."""
    print()
    print_head("stage, ms", *found)
    for stage in dict.fromkeys(s for times in found.values() for one in times for s in one.stages):
        each = [statistics.median(one.stages.get(stage, 0.0) for one in times) for times in found.values()]
        print_row(stage, *(f"{time:.1f}" if time else "" for time in each))
    rest = (
        statistics.median(one.processor - sum(one.stages.values()) for one in times)
        for times in found.values()
    )
    print_row("rest", *(f"{time:.1f}" for time in rest))


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("cases", metavar="CASE", nargs="*", help=f"of {', '.join(CASES)} (default: all)")
    parser.add_argument("--scenes", type=int, default=5, metavar="N", help="of a case, at most (default: 5)")
    parser.add_argument("--turns", type=int, default=4, metavar="N", help="of each scene (default: 4)")
    parser.add_argument("--calls", type=int, default=8, metavar="N", help="of each turn (default: 8)")
    parser.add_argument("--against", type=Path, metavar="PATH", help="folder with another package `strand`")
    arguments = parser.parse_args()
    unknown = [case for case in arguments.cases if case not in CASES]
    if unknown:
        parser.error(f"CASE: expected some of {', '.join(CASES)}; got {', '.join(unknown)}")
    folders = [None] if arguments.against is None else [None, arguments.against.resolve()]
    pairs = [[Worker(threads, folder) for threads in THREADS] for folder in folders]
    titles = ["case", "scenes", "processor, ms", "two threads, ms"]
    if len(folders) > 1:
        titles += [
            "other's processor, ms",
            "other's two threads, ms",
            "ratio",
            "ratio on two threads",
            "same",
        ]
    print_head(*titles, "load")
    found: dict[str, list[Times]] = {}
    with tempfile.TemporaryDirectory() as kept:
        path = Path(kept) / "scene.npz"
        for case in arguments.cases or CASES:
            draw, facts = CASES[case]
            scenes = []
            for made in itertools.islice(draw(), arguments.scenes):
                made.save(path)
                call = {"path": str(path), "facts": facts, "calls": arguments.calls}
                scenes.append(time_scene(pairs, call, arguments.turns))
            cells = []
            for times in zip(*scenes, strict=True):
                cells.append(f"{statistics.median(one.processor for one in times):.1f}")
                cells.append(f"{statistics.median(one.two_threads for one in times):.1f}")
            if len(folders) > 1:
                ratios = [
                    statistics.median(mine.processor / other.processor for mine, other in scenes),
                    statistics.median(mine.two_threads / other.two_threads for mine, other in scenes),
                ]
                same = sum(mine.digest == other.digest for mine, other in scenes)
                cells += [*(f"{ratio:.2f}" for ratio in ratios), f"{same} of {len(scenes)}"]
            print_row(case, len(scenes), *cells, f"{os.getloadavg()[0]:.1f}")
            found[case] = [each[0] for each in scenes]
    print_stages(found)
    for pair in pairs:
        for worker in pair:
            worker.close()
    return 0


if __name__ == "__main__":
    run_bench(main)
