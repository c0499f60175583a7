"""Make the mistakes that users make with views, and print strand's answers.

python benches/mistakes.py [--scenes N] [--first SEED] [--only TEXT] [--all]

Each mistake is made in three kinds of scenes: a rope with bounds, seen by seven cameras or by one, and a rope
among other things, seen by three cameras, where only the radius is given. An answer is wrong if it is more
than 1.5 radii off the true rope in the true world frame. The table has the number of answers and of wrong
answers, and the greatest confidence of a wrong one. The last column is the greatest doubt of that answer, or
the error where no answer is wrong. Mistakes that no data can show are marked, and do not count.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

import strand
from lib.collection import SHAPES
from lib.measure import measure_chains
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from strand.synthetic import SyntheticScene, cluttered_scene, scene

Array = NDArray[np.float64]

MAX_CONFIDENCE = 0.5  # of wrong answers
HAND_EYE = (0.006, 0.008, 0.0)  # metres: error of a camera's place
KINDS = ("seven", "one", "things")


@dataclass(frozen=True)
class Given:
    """Input of a caller.

    Attributes
    ----------
    depth : (V, H, W) ndarray
        Metres.
    intrinsics : (3, 3) ndarray
    poses : (V, 4, 4) ndarray
    radius : float
        Metres.
    bounds : pair of (3,) ndarray or None
    make_view : callable
        Makes a view from a depth image, the intrinsics and a pose.
    """

    depth: Array
    intrinsics: Array
    poses: Array
    radius: float
    bounds: tuple[Array, Array] | None
    make_view: Callable[[Array, Array, Array], strand.View] = strand.View.from_depth

    def make_views(self) -> list[strand.View]:
        """Return all views."""
        return [
            self.make_view(depth, self.intrinsics, pose)
            for depth, pose in zip(self.depth, self.poses, strict=True)
        ]


def scale_translations(given: Given) -> Given:
    """Give the poses' places in millimetres."""
    poses = given.poses.copy()
    poses[:, :3, 3] *= 1e3
    return replace(given, poses=poses)


def turn_by_degrees(given: Given) -> Given:
    """Make the poses' rotations from angles in degrees, taken as radians."""
    poses = given.poses.copy()
    for pose in poses:
        angle = np.arccos(np.clip(0.5 * (np.trace(pose[:3, :3]) - 1.0), -1.0, 1.0))
        if angle > 0.0:
            axis = np.array([pose[2, 1] - pose[1, 2], pose[0, 2] - pose[2, 0], pose[1, 0] - pose[0, 1]])
            pose[:3, :3] = make_rotation(axis / np.linalg.norm(axis), np.degrees(angle))
    return replace(given, poses=poses)


def make_rotation(axis: Array, angle: float) -> Array:
    """Return (3, 3) a rotation about a unit axis by radians."""
    skew = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * (skew @ skew))


def measure_along_rays(given: Given) -> Given:
    """Measure depth along the rays instead of the optical axis."""
    height, width = given.depth.shape[1:]
    v, u = np.mgrid[:height, :width]
    K = given.intrinsics
    ray = np.sqrt(((u - K[0, 2]) / K[0, 0]) ** 2 + ((v - K[1, 2]) / K[1, 1]) ** 2 + 1.0)
    return replace(given, depth=given.depth * ray)


def resize(scale: float) -> Callable[[Given], Given]:
    """Return a mistake: intrinsics of an image that is larger by a factor."""
    return lambda given: replace(given, intrinsics=given.intrinsics * [[scale], [scale], [1.0]])


def add_hand_eye_error(given: Given) -> Given:
    """Put each camera a centimetre and a degree off its place on the arm."""
    error = strand.pose_from_angles(np.radians(1.0), 0.0, 0.0, HAND_EYE)
    return replace(given, poses=given.poses @ error)


def move_last_camera(given: Given) -> Given:
    """Put the last view's camera a centimetre beside its pose."""
    poses = given.poses.copy()
    poses[-1, :3, 3] += HAND_EYE
    return replace(given, poses=poses)


def give_world_points(depth: Array, intrinsics: Array, pose: Array) -> strand.View:
    """Give points in the world frame as points in the camera frame."""
    return strand.View(strand.View.from_depth(depth, intrinsics, pose).world_points, pose)


def give_world_points_alone(depth: Array, intrinsics: Array, pose: Array) -> strand.View:
    """Give points in the world frame without a pose."""
    return strand.View(strand.View.from_depth(depth, intrinsics, pose).world_points)


def give_inner_viewpoint(depth: Array, intrinsics: Array, pose: Array) -> strand.View:
    """Give a viewpoint in the middle of the points."""
    points = strand.View.from_depth(depth, intrinsics, pose).world_points
    return strand.View.from_world(points, points.mean(axis=0))


MISTAKES: dict[str, Callable[[Given], Given]] = {
    "nothing": lambda g: g,
    "poses from world to camera": lambda g: replace(g, poses=np.linalg.inv(g.poses)),
    "poses of the next view": lambda g: replace(g, poses=np.roll(g.poses, 1, axis=0)),
    "angles of the poses in degrees": turn_by_degrees,
    "poses in millimetres": scale_translations,
    "depth in millimetres": lambda g: replace(g, depth=1e3 * g.depth),
    "depth along the rays": measure_along_rays,
    "depth mirrored": lambda g: replace(g, depth=g.depth[:, :, ::-1]),
    "depth upside down": lambda g: replace(g, depth=g.depth[:, ::-1]),
    "depth transposed": lambda g: replace(g, depth=g.depth.transpose(0, 2, 1)),
    "intrinsics of twice the size": resize(2.0),
    "intrinsics of half the size": resize(0.5),
    "world points in View(points, pose)": lambda g: replace(g, make_view=give_world_points),
    "world points in View(points)": lambda g: replace(g, make_view=give_world_points_alone),
    "the camera inside the cloud": lambda g: replace(g, make_view=give_inner_viewpoint),
    "the diameter as the radius": lambda g: replace(g, radius=2.0 * g.radius),
    "the radius halved": lambda g: replace(g, radius=0.5 * g.radius),
    "hand-eye error of 10 mm": add_hand_eye_error,
    "one camera 10 mm aside": move_last_camera,
}

# mistakes that one view cannot contradict
SILENT = {
    ("depth mirrored", "one"),
    ("hand-eye error of 10 mm", "one"),
    ("one camera 10 mm aside", "one"),
}


def list_scenes(first: int, count: int) -> Iterator[tuple[str, SyntheticScene, bool]]:
    """Yield kinds, scenes, and whether bounds are given."""
    names = [name for name in SHAPES if name != "coil"]
    for k in range(first, first + count):
        yield "seven", scene(names[k % len(names)], seed=k, views=7), True
        yield "one", scene(names[(k + 2) % len(names)], seed=k, views=1), True
        yield "things", cluttered_scene(2 * k + 1, views=3), False


@dataclass(frozen=True)
class Answer:
    """An answer: whether it is right, its confidence, and its greatest doubt."""

    right: bool
    confidence: float
    doubt: str


def reconstruct(given: Given, synthetic: SyntheticScene) -> Answer | str:
    """Return the answer, or the error."""
    try:
        model = strand.reconstruct(given.make_views(), given.radius, given.bounds)
    except (strand.StrandError, ValueError) as error:
        return f"{type(error).__name__}: {error}"
    chains = [chain.points for chain in model.chains]
    # among other things the longest chain must be the rope
    right = any(
        measure_chains(some, synthetic.truth, synthetic.radius).right for some in (chains, chains[:1])
    )
    doubt = f"{model.doubts[0].kind}: {model.doubts[0].reason}" if model.doubts else ""
    return Answer(right, max(chain.confidence for chain in model.chains), doubt)


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--scenes", type=int, default=6, metavar="N", help="of each kind (default: 6)")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="the first seed (default: 0)")
    parser.add_argument("--only", metavar="TEXT", default="", help="mistakes with TEXT in their name")
    parser.add_argument("--all", action="store_true", help="print each answer too")
    arguments = parser.parse_args()
    scenes = list(list_scenes(arguments.first, arguments.scenes))
    print_head("mistake", "views", "answers", "wrong", "greatest confidence when wrong", "doubt or error")
    worst = 0.0
    for mistake, make in MISTAKES.items():
        if arguments.only not in mistake:
            continue
        for kind in KINDS:
            answers: list[Answer] = []
            errors: list[str] = []
            for of_kind, synthetic, bounded in scenes:
                if of_kind != kind:
                    continue
                depth = synthetic.depth * synthetic.depth_scale
                bounds = synthetic.bounds if bounded else None
                given = make(Given(depth, synthetic.intrinsics, synthetic.poses, synthetic.radius, bounds))
                found = reconstruct(given, synthetic)
                if arguments.all:
                    print(f"{mistake}, {kind}, {synthetic.name}: {found}", file=sys.stderr, flush=True)
                if isinstance(found, Answer):
                    answers.append(found)
                else:
                    errors.append(found)
            wrong = sorted((one for one in answers if not one.right), key=lambda one: -one.confidence)
            silent = (mistake, kind) in SILENT
            if wrong and not silent:
                worst = max(worst, wrong[0].confidence)
            sure = f"{wrong[0].confidence:.2f}{' (no witness)' if silent else ''}" if wrong else ""
            reason = wrong[0].doubt if wrong else (errors or [""])[0]
            print_row(mistake, kind, len(answers), len(wrong), sure, reason)
    print(f"\ngreatest confidence of a wrong answer that data could contradict: {worst:.2f}")
    return int(worst >= MAX_CONFIDENCE)


if __name__ == "__main__":
    run_bench(main)
