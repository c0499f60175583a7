"""Measure the time of `Model.next_view`, and compare its proposal with a random second view.

python benches/next_view.py [--scenes 100] [--first 90000] [--below 0.9] [--repeats 5]

Each seed draws ropes, noise and a camera, with a bar before the ropes in some scenes. One view gives the
first answer. The proposed view and a random one then each join it. Both look at the middle of the ropes from
the proposal's distance. The random direction is even over the part of the sky that proposals come from.
Scenes with a surer first answer than `--below`, or none, are passed over: nobody needs another view there.

Processor times are of all threads; the least of a few calls counts, and so does the wall time.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

import strand
from lib.measure import measure_chains
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from strand.synthetic import CAMERAS, SHAPES, Camera, Noise, random_ropes, render_depth, scene, sense
from strand.synthetic.camera import FOCAL_LENGTH

Array = NDArray[np.float64]

MIN_ELEVATION = math.radians(25.0)  # radians: of random views, as of proposed ones
DEPTH_SCALE = 1e-4  # metres per unit of depth
FLYING = 0.05  # share of pixels at steps that fly
RANDOM_ROPES = 0.4  # probability of random ropes instead of a shape
WITH_DEVICE = 0.5  # probability of an imitated camera
WITH_MASKS = 0.5  # probability of masks with another camera
WITH_BAR = 0.4  # probability of a bar in scenes with masks


@dataclass(frozen=True, eq=False)
class Stage:
    """Ropes and a bar on a table, and the camera that looks at them.

    Attributes
    ----------
    ropes : tuple of (M, 3) ndarray
        Centrelines, world frame, metres.
    radius, noise, distance : float
        Of the ropes, of the depths, and from the camera to their middle, metres.
    camera : Camera
    masked : bool
        Whether views have masks.
    bar : (array, float) or None
        Nodes and radius of the bar, metres.
    """

    ropes: tuple[Array, ...]
    radius: float
    noise: float
    distance: float
    camera: Camera
    masked: bool
    bar: tuple[Array, float] | None = None

    @property
    def middle(self) -> Array:
        """(3,) Middle of the ropes' box, metres."""
        nodes = np.concatenate(self.ropes)
        return np.asarray(0.5 * (nodes.min(axis=0) + nodes.max(axis=0)))

    def take(self, pose: Array, reported: Array, rng: np.random.Generator) -> strand.View:
        """Return the view from a pose, with another pose as the caller knows it."""
        intrinsics, size, side = self.camera.intrinsics, self.camera.size, max(1.0, 3.0 * self.distance)
        bars = [] if self.bar is None else [self.bar]
        lines, radii = [line for line, _ in bars], [radius for _, radius in bars]
        exact = render_depth(
            [*self.ropes, *lines], [self.radius] * len(self.ropes) + radii, intrinsics, pose, size, side
        )
        if self.camera.device is None:
            depth = sense(
                exact, noise=self.noise, flying=FLYING, step=self.radius, depth_scale=DEPTH_SCALE, rng=rng
            )
        else:
            device = CAMERAS[str(self.camera.device)]
            device = device.with_noise(self.noise, self.camera.focal_length, self.distance)
            depth = device.sense(exact, intrinsics, depth_scale=DEPTH_SCALE, rng=rng)
        mask = None
        if self.masked:
            bare = render_depth(lines, radii, intrinsics, pose, size, side)
            mask = (exact > 0) & ((exact < bare) | (bare == 0))
        return strand.View.from_depth(depth, intrinsics, reported, depth_scale=DEPTH_SCALE, mask=mask)

    def answer(self, views: list[strand.View]) -> strand.Model | None:
        """Reconstruct the ropes; None if strand refuses."""
        nodes = np.concatenate(self.ropes)
        low, high = nodes.min(axis=0) - 6.0 * self.radius, nodes.max(axis=0) + 6.0 * self.radius
        if not self.masked:
            low[2], high[2] = 0.6 * self.radius, nodes[:, 2].max() + 3.0 * self.radius
        try:
            return strand.reconstruct(views, self.radius, (low, high))
        except strand.StrandError:
            return None


def draw_stage(rng: np.random.Generator, seed: int) -> Stage:
    """Draw the ropes, the noise and the camera of a scene."""
    radius = float(np.exp(rng.uniform(math.log(2e-3), math.log(10e-3))))
    ropes = draw_ropes(rng, radius, seed)
    device = str(rng.choice(sorted(CAMERAS))) if rng.random() < WITH_DEVICE else None
    camera = Camera(device, size=(320, 240) if device is None else (640, 480))
    nodes = np.concatenate(ropes)
    reach = 0.5 * float(np.linalg.norm(np.ptp(nodes, axis=0))) + 2.0 * radius
    fitting = 1.2 * reach / (0.5 * camera.size[1] / camera.focal_length)
    pixels = rng.uniform(3.0, 8.0)
    usual = 76.0 * radius if device is None else FOCAL_LENGTH * camera.size[0] * radius / pixels
    return Stage(
        ropes=ropes,
        radius=radius,
        noise=float(rng.uniform(0.1, 1.0)) * radius,
        distance=float(max(usual, fitting)),
        camera=camera,
        masked=device is not None or rng.random() < WITH_MASKS,
    )


def draw_ropes(rng: np.random.Generator, radius: float, seed: int) -> tuple[Array, ...]:
    """Draw a shape, or one to three random ropes with one to four crossings."""
    if rng.random() >= RANDOM_ROPES:
        name = str(rng.choice(SHAPES))
        return scene(name, radius=radius, seed=seed, views=1, camera=Camera(size=(32, 24))).truth
    ropes, crossings = int(rng.choice([1, 2, 3], p=[0.5, 0.3, 0.2])), int(rng.integers(1, 5))
    while True:
        try:
            return tuple(random_ropes(crossings, ropes, radius, seed))
        except ValueError:
            # few ropes rarely have many crossings
            ropes, crossings = min(ropes + 1, 3), crossings - (ropes == 3)


def add_bar(stage: Stage, pose: Array, rng: np.random.Generator) -> Stage:
    """Return the stage with a level bar between a place of the ropes and the first camera."""
    nodes = np.concatenate(stage.ropes)
    place = nodes[rng.integers(len(nodes))]
    middle = place + 0.3 * (pose[:3, 3] - place)
    turn = rng.uniform(0.0, np.pi)
    half = 0.4 * stage.distance * np.array([math.cos(turn), math.sin(turn), 0.0])
    bar = (np.linspace(middle - half, middle + half, 60), stage.radius * float(rng.uniform(1.2, 3.0)))
    return replace(stage, bar=bar)


def draw_direction(rng: np.random.Generator, lowest: float, highest: float) -> Array:
    """Draw a direction (3,) from the ropes to a camera, evenly over the sky between two elevations."""
    height, turn = rng.uniform(math.sin(lowest), math.sin(highest)), rng.uniform(0.0, 2.0 * np.pi)
    level = math.sqrt(1.0 - height**2)
    return np.array([level * math.cos(turn), level * math.sin(turn), height])


def point_camera(middle: Array, direction: Array, distance: float) -> Array:
    """Return the (4, 4) pose of an upright camera that looks at a place."""
    right = np.cross(-direction, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(-direction, right), -direction], axis=1)
    pose[:3, 3] = middle + distance * direction
    return pose


def time_call(model: strand.Model, repeats: int) -> tuple[float, float]:
    """Return the least processor time and wall time of a first call on a model, seconds."""
    times = []
    for _ in range(repeats):
        fresh = replace(model)
        wall, processor = time.perf_counter(), time.process_time()
        fresh.next_view()
        times.append((time.process_time() - processor, time.perf_counter() - wall))
    return min(one for one, _ in times), min(one for _, one in times)


@dataclass(frozen=True)
class Outcome:
    """A scene's confidences and rightness with the first view, a random second and the proposed one."""

    confidence: tuple[float, float, float]
    right: tuple[bool, bool, bool]
    processor: float
    wall: float
    bar: bool


def try_scene(seed: int, below: float, repeats: int) -> Outcome | None:
    """Compare second views of a scene; None if it is passed over."""
    rng = np.random.default_rng(seed)
    stage = draw_stage(rng, seed)
    begin = draw_direction(rng, math.radians(35.0), math.radians(65.0))
    first = point_camera(stage.middle, begin, stage.distance)
    if stage.masked and rng.random() < WITH_BAR:
        stage = add_bar(stage, first, rng)
    view = stage.take(first, first, rng)
    model = stage.answer([view])
    if model is None or model.confidence >= below:
        return None
    processor, wall = time_call(model, repeats)
    (proposed,) = model.next_view(count=1)
    distance = float(np.linalg.norm(proposed.position - proposed.look_at))
    away = draw_direction(rng, MIN_ELEVATION, 0.5 * np.pi)
    answers = [model]
    for pose in (point_camera(proposed.look_at, away, distance), proposed.pose):
        # the same errors for both
        errors = np.random.default_rng([seed, 1])
        reported = Noise().misplace(np.stack([pose, first]), errors)[0]
        answers.append(stage.answer([view, stage.take(pose, reported, errors)]))
    confidence = tuple(0.0 if one is None else one.confidence for one in answers)
    right = tuple(
        one is not None
        and measure_chains([chain.points for chain in one.chains], stage.ropes, stage.radius).right
        for one in answers
    )
    return Outcome(confidence, right, processor, wall, stage.bar is not None)


def print_comparison(title: str, outcomes: list[Outcome]) -> None:
    """Print how sure and how often right the answers are."""
    confidence = np.array([one.confidence for one in outcomes])
    right = np.array([one.right for one in outcomes])
    print(f"\n{title}: {len(outcomes)} scenes\n")
    print_head("views", "mean confidence", "median", "at least 0.9", "right")
    for k, name in enumerate(("one", "and a random one", "and the proposed one")):
        column = confidence[:, k]
        sure = f"{(column >= 0.9).mean():.0%}"
        print_row(name, f"{column.mean():.3f}", f"{np.median(column):.3f}", sure, f"{right[:, k].mean():.0%}")
    more = confidence[:, 2] - confidence[:, 1]
    error = more.std() / math.sqrt(len(more))
    print(f"\nproposed over random: {more.mean():+.3f} of confidence, standard error {error:.3f}")


def main() -> None:
    parser = make_parser(__doc__)
    parser.add_argument("--scenes", type=int, default=100, help="scenes to compare (default: 100)")
    parser.add_argument("--first", type=int, default=90_000, help="first seed (default: 90000)")
    parser.add_argument("--below", type=float, default=0.9, help="confidence of the first answers, at most")
    parser.add_argument("--repeats", type=int, default=5, help="timed calls of each scene (default: 5)")
    arguments = parser.parse_args()
    outcomes: list[Outcome] = []
    seed = arguments.first
    while len(outcomes) < arguments.scenes:
        outcome = try_scene(seed, arguments.below, arguments.repeats)
        outcomes += [] if outcome is None else [outcome]
        seed += 1
    print_head("a call, ms", "median", "most")
    for name in ("processor", "wall"):
        taken = 1e3 * np.array([getattr(one, name) for one in outcomes])
        print_row(name, f"{np.median(taken):.1f}", f"{taken.max():.1f}")
    print_comparison(f"Seeds {arguments.first} to {seed - 1}", outcomes)
    barred = [one for one in outcomes if one.bar]
    if barred:
        print_comparison("With a bar", barred)


if __name__ == "__main__":
    run_bench(main)
