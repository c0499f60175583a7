"""Make situations that look right and are not, and count the wrong answers that are sure.

python benches/witnesses.py [--scenes N] [--first SEED] [--only TEXT] [--all]

Each situation is one that strand's data contradict only in one place: a witness must lower the confidence. An
answer is right if it has as many chains as there are ropes, each within three radii of its rope in the true
world frame, or 1.5 radii with wrong poses. Sure is a confidence of 0.9 or more. An error counts as an answer
that is not sure.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import strand
from lib.measure import compute_arc_lengths, measure_chains
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from strand.synthetic import Noise, Segmentation, SyntheticScene, random_ropes, scene
from strand.views.pose import make_rotation

Array = NDArray[np.float64]

SURE = 0.9  # confidence
MAX_FRECHET = 3.0  # radii: a chain within this distance follows its rope
RADII = (3e-3, 6e-3)  # metres: range of the ropes' radii
NOISE = 0.1  # radii: deviation of depths
HAND_EYE = (3e-3, math.radians(0.9))  # metres and radians: error of a hand-eye matrix
THIN = (0.3, 0.7)  # radii of the given rope: range of a second rope's radius
PEN = 0.12  # metres: length of a pen
GAPS = (2.0, 4.0)  # radii: range of the gaps between the ends of axes of a rope and a pen
LOST = (4.0, 8.0)  # radii: range of the length of rope that shows as its table


@dataclass(frozen=True)
class Situation:
    """Views of a scene, the caller's arguments, and the distance of chains that are right, radii."""

    made: SyntheticScene
    truth: tuple[Array, ...]
    views: list[strand.View]
    arguments: dict[str, Any]
    max_frechet: float = MAX_FRECHET


def draw_random(seed: int) -> tuple[np.random.Generator, float]:
    """Return the random numbers of a seed, and a radius, metres."""
    rng = np.random.default_rng(seed)
    return rng, float(rng.uniform(*RADII))


def see(made: SyntheticScene, poses: Array | None = None) -> list[strand.View]:
    """Return views of a scene, with other poses if these are given."""
    depth, poses = made.depth * made.depth_scale, made.poses if poses is None else poses
    return [strand.View.from_depth(z, made.intrinsics, pose) for z, pose in zip(depth, poses, strict=True)]


def misplace_hand_eye(seed: int, size: float = 1.0) -> Situation:
    """Give all poses the same error in the camera frame."""
    rng, radius = draw_random(seed)
    ropes = random_ropes(int(rng.integers(0, 4)), 1, radius, seed)
    made = scene(chains=ropes, radius=radius, seed=seed, noise=Noise(depth=NOISE * radius), views=3)
    axis, shift = rng.normal(size=3), rng.normal(size=3)
    error = np.eye(4)
    error[:3, :3] = make_rotation(axis / np.linalg.norm(axis), size * HAND_EYE[1])
    error[:3, 3] = size * HAND_EYE[0] * shift / np.linalg.norm(shift)
    arguments = {"radius": radius, "bounds": made.bounds}
    return Situation(made, made.truth, see(made, made.poses @ error), arguments, 0.5 * MAX_FRECHET)


def add_thin_rope(seed: int) -> Situation:
    """Lay a thinner second rope beside the one whose radius is given."""
    rng, radius = draw_random(seed)
    ropes = random_ropes(int(rng.integers(0, 3)), 2, radius, seed)
    thin = float(rng.uniform(*THIN)) * radius
    noise, views = Noise(depth=NOISE * radius), int(rng.choice([1, 3, 5]))
    made = scene(chains=ropes, radius=(radius, thin), seed=seed, noise=noise, views=views)
    arguments = {"radius": radius} | ({"bounds": made.bounds} if seed % 2 else {})
    return Situation(made, made.truth, list(made.views), arguments)


def add_pen(seed: int) -> Situation:
    """Lay a pen in line with an end of the rope."""
    rng, radius = draw_random(seed)
    views = int(rng.choice([1, 3]))
    for attempt in range(100):
        (rope,) = random_ropes(int(rng.integers(0, 3)), 1, radius, 1000 * attempt + seed)
        rope = rope[:: int(rng.choice([-1, 1]))]
        ahead = rope[-1] - rope[np.searchsorted(compute_arc_lengths(rope[::-1]), 2.0 * radius) * -1 - 1]
        ahead[2] = 0.0
        ahead /= np.linalg.norm(ahead)
        start = rope[-1] + rng.uniform(*GAPS) * radius * ahead
        start[2] = radius
        pen = start + np.arange(0.0, PEN, 1e-3)[:, None] * ahead
        away = np.linalg.norm(pen[:, None] - rope[None, ::4], axis=2)
        away[:, -math.ceil(3.0 * radius / 4e-3) :] = np.inf
        if away.min() > 5.0 * radius:
            break
    noise = Noise(depth=NOISE * radius)
    made = scene(chains=[rope, pen], radius=radius, seed=seed, noise=noise, views=views)
    arguments = {"radius": radius, "ropes": 1} | ({"bounds": made.bounds} if seed % 2 else {})
    return Situation(made, made.truth[:1], list(made.views), arguments)


def lose_middle(seed: int) -> Situation:
    """Show the table's depth in the middle of a rope, with bounds or inside the rope's mask."""
    rng, radius = draw_random(seed)
    ropes = random_ropes(int(rng.integers(0, 2)), 1, radius, seed)
    s = compute_arc_lengths(ropes[0])
    middle, half = rng.uniform(0.4, 0.6) * s[-1], 0.5 * rng.uniform(*LOST) * radius
    parts = [ropes[0][s < middle - half - radius], ropes[0][s > middle + half + radius]]
    common: dict[str, Any] = {
        "radius": radius,
        "seed": seed,
        "noise": Noise(depth=NOISE * radius),
        "views": 1,
    }
    made = scene(chains=parts, **common)
    if seed % 2:
        whole = scene(chains=ropes, mask=Segmentation(), **common)
        assert whole.mask is not None
        depth = made.depth[0] * made.depth_scale
        view = strand.View.from_depth(depth, made.intrinsics, made.poses[0], mask=whole.mask[0])
        return Situation(made, tuple(ropes), [view], {"radius": radius})
    return Situation(made, tuple(ropes), list(made.views), {"radius": radius, "bounds": made.bounds})


def draw_shape(seed: int, **given: Any) -> tuple[np.random.Generator, SyntheticScene]:
    """Draw a simple shape in one view."""
    rng, radius = draw_random(seed)
    name = ("loop", "s", "arc", "figure8")[seed % 4]
    return rng, scene(name, radius=radius, seed=seed, noise=Noise(depth=NOISE * radius), views=1, **given)


def give_gray(seed: int) -> Situation:
    """Give an 8-bit image as depth, with a mask or without."""
    rng, made = draw_shape(seed, mask=Segmentation() if seed % 3 else None)
    depth = made.depth[0] * made.depth_scale
    near = depth[depth > 0].min()
    gray = np.clip((depth - near) / (depth.max() - near) * 254.0 + 1.0, 0.0, 255.0).astype(np.uint8)
    scale = 1e-3 * float(rng.choice([1.0, 2.0, 4.0]))
    mask = None if made.mask is None else made.mask[0]
    view = strand.View.from_depth(gray, made.intrinsics, made.poses[0], depth_scale=scale, mask=mask)
    return Situation(made, made.truth, [view], {"radius": made.radius})


def give_millimeters(seed: int) -> Situation:
    """Give the place of a single camera in millimetres."""
    _, made = draw_shape(seed)
    poses = made.poses.copy()
    poses[:, :3, 3] *= 1e3
    return Situation(made, made.truth, see(made, poses), {"radius": made.radius})


def give_centimeters(seed: int) -> Situation:
    """Give depths in centimetres, in one view."""
    _, made = draw_shape(seed, mask=Segmentation() if seed % 2 else None)
    mask = None if made.mask is None else made.mask[0]
    view = strand.View.from_depth(
        made.depth[0], made.intrinsics, made.poses[0], depth_scale=100.0 * made.depth_scale, mask=mask
    )
    return Situation(made, made.truth, [view], {"radius": made.radius})


SITUATIONS: dict[str, Callable[[int], Situation]] = {
    "hand-eye error of 3 mm and 0.9°": misplace_hand_eye,
    "hand-eye error of 1 mm and 0.3°": lambda seed: misplace_hand_eye(seed, 1.0 / 3.0),
    "a thinner second rope": add_thin_rope,
    "a pen in line with the rope": add_pen,
    "depth of the table in the middle": lose_middle,
    "an 8-bit image as depth": give_gray,
    "a pose in millimetres": give_millimeters,
    "depth in centimetres": give_centimeters,
}


@dataclass(frozen=True)
class Answer:
    """Whether an answer is right, its confidence, and its greatest doubt or the error."""

    right: bool
    confidence: float
    doubt: str


def reconstruct(situation: Situation) -> Answer:
    """Return the answer of a situation."""
    try:
        model = strand.reconstruct(situation.views, **situation.arguments)
    except (strand.StrandError, ValueError) as error:
        return Answer(False, 0.0, f"{type(error).__name__}: {error}")
    found = measure_chains([chain.points for chain in model.chains], situation.truth, situation.made.radius)
    doubt = f"{model.doubts[0].kind}: {model.doubts[0].reason}" if model.doubts else ""
    right = found.chains == found.ropes and found.frechet <= situation.max_frechet
    return Answer(right, model.confidence, doubt)


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--scenes", type=int, default=24, metavar="N", help="of each situation (default: 24)")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="the first seed (default: 0)")
    parser.add_argument("--only", metavar="TEXT", default="", help="situations with TEXT in their name")
    parser.add_argument("--all", action="store_true", help="print each answer too")
    arguments = parser.parse_args()
    print_head("situation", "instances", "right", "sure and right", "sure and wrong", "greatest when wrong")
    bad = 0
    for name, make in SITUATIONS.items():
        if arguments.only not in name:
            continue
        answers = []
        for seed in range(arguments.first, arguments.first + arguments.scenes):
            answers.append(reconstruct(make(seed)))
            if arguments.all:
                print(f"{name}, {seed}: {answers[-1]}", file=sys.stderr, flush=True)
        sure = [answer.right for answer in answers if answer.confidence >= SURE]
        greatest = max((answer.confidence for answer in answers if not answer.right), default=0.0)
        bad += sure.count(False)
        right = sum(answer.right for answer in answers)
        print_row(name, len(answers), right, sure.count(True), sure.count(False), f"{greatest:.2f}")
    return int(bad > 0)


if __name__ == "__main__":
    run_bench(main)
