"""Make the mistakes that users make when they hand over views, and say what strand answers.

python benches/mistakes.py [--scenes N] [--first SEED] [--only TEXT] [--all]

Each mistake is made in scenes of three kinds: a rope with bounds, seen by seven cameras and by one, and a
rope among other things seen by three, with nothing told but the radius. An answer is wrong if it is more than
1.5 radii off the true rope in the true world frame. The table has how many answers there are, how many are
wrong, the greatest confidence of these, and what is said of that one: its greatest doubt, or the error where
there is no wrong answer. Mistakes that no data can show are marked, and do not count.
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

SURE = 0.5
KINDS = ("seven", "one", "things")


@dataclass(frozen=True)
class Given:
    """What a user hands over.

    Attributes
    ----------
    depth : (V, H, W) ndarray
        Metres.
    intrinsics : (3, 3) ndarray
    poses : (V, 4, 4) ndarray
    radius : float
        Metres.
    bounds : pair of (3,) ndarray or None
    made : callable
        Makes a view of a depth image, the intrinsics and a pose.
    """

    depth: Array
    intrinsics: Array
    poses: Array
    radius: float
    bounds: tuple[Array, Array] | None
    made: Callable[[Array, Array, Array], strand.View] = strand.View.from_depth

    def views(self) -> list[strand.View]:
        return [
            self.made(depth, self.intrinsics, pose)
            for depth, pose in zip(self.depth, self.poses, strict=True)
        ]


def scale_translations(given: Given) -> Given:
    poses = given.poses.copy()
    poses[:, :3, 3] *= 1e3
    return replace(given, poses=poses)


def turn_by_degrees(given: Given) -> Given:
    """Turns made of angles in degrees that are taken for radians."""
    poses = given.poses.copy()
    for pose in poses:
        angle = np.arccos(np.clip(0.5 * (np.trace(pose[:3, :3]) - 1.0), -1.0, 1.0))
        if angle > 0.0:
            axis = np.array([pose[2, 1] - pose[1, 2], pose[0, 2] - pose[2, 0], pose[1, 0] - pose[0, 1]])
            pose[:3, :3] = make_rotation(axis / np.linalg.norm(axis), np.degrees(angle))
    return replace(given, poses=poses)


def make_rotation(axis: Array, angle: float) -> Array:
    """(3, 3) Rotation about a unit axis, radians."""
    skew = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * (skew @ skew))


def measure_along_rays(given: Given) -> Given:
    height, width = given.depth.shape[1:]
    v, u = np.mgrid[:height, :width]
    K = given.intrinsics
    ray = np.sqrt(((u - K[0, 2]) / K[0, 0]) ** 2 + ((v - K[1, 2]) / K[1, 1]) ** 2 + 1.0)
    return replace(given, depth=given.depth * ray)


def resize(scale: float) -> Callable[[Given], Given]:
    """Intrinsics of an image that is so many times as large."""
    return lambda given: replace(given, intrinsics=given.intrinsics * [[scale], [scale], [1.0]])


def add_hand_eye_error(given: Given) -> Given:
    """The camera sits a centimetre and a degree from where the arm's calibration says."""
    error = strand.pose_from_angles(np.radians(1.0), 0.0, 0.0, [0.006, 0.008, 0.0])
    return replace(given, poses=given.poses @ error)


def move_last_camera(given: Given) -> Given:
    """The last view's camera stood a centimetre beside where it is said to have stood."""
    poses = given.poses.copy()
    poses[-1, :3, 3] += [0.006, 0.008, 0.0]
    return replace(given, poses=poses)


def give_world_points(depth: Array, intrinsics: Array, pose: Array) -> strand.View:
    return strand.View(strand.View.from_depth(depth, intrinsics, pose).world_points, pose)


def give_world_points_alone(depth: Array, intrinsics: Array, pose: Array) -> strand.View:
    return strand.View(strand.View.from_depth(depth, intrinsics, pose).world_points)


def give_inner_viewpoint(depth: Array, intrinsics: Array, pose: Array) -> strand.View:
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
    "world points in View(points, pose)": lambda g: replace(g, made=give_world_points),
    "world points in View(points)": lambda g: replace(g, made=give_world_points_alone),
    "the camera inside the cloud": lambda g: replace(g, made=give_inner_viewpoint),
    "the diameter as the radius": lambda g: replace(g, radius=2.0 * g.radius),
    "the radius halved": lambda g: replace(g, radius=0.5 * g.radius),
    "hand-eye error of 10 mm": add_hand_eye_error,
    "one camera 10 mm aside": move_last_camera,
}

# what no data can show: nothing that one view sees contradicts it
SILENT = {
    ("depth mirrored", "one"),
    ("hand-eye error of 10 mm", "one"),
    ("one camera 10 mm aside", "one"),
}


def list_scenes(first: int, count: int) -> Iterator[tuple[str, SyntheticScene, bool]]:
    names = [name for name in SHAPES if name != "coil"]
    for k in range(first, first + count):
        yield "seven", scene(names[k % len(names)], seed=k, views=7), True
        yield "one", scene(names[(k + 2) % len(names)], seed=k, views=1), True
        yield "things", cluttered_scene(2 * k + 1, views=3), False


@dataclass(frozen=True)
class Answer:
    """What is answered: right, and how sure; or why not. What is said is the greatest doubt, or the error."""

    right: bool
    confidence: float
    said: str


def reconstruct(given: Given, synthetic: SyntheticScene) -> Answer | str:
    """Return the answer, or the error."""
    try:
        model = strand.reconstruct(given.views(), given.radius, given.bounds)
    except (strand.StrandError, ValueError) as error:
        return f"{type(error).__name__}: {error}"
    chains = [chain.points for chain in model.chains]
    # among other things the longest chain is to be the rope
    right = any(
        measure_chains(some, synthetic.truth, synthetic.radius).right for some in (chains, chains[:1])
    )
    said = f"{model.doubts[0].kind}: {model.doubts[0].reason}" if model.doubts else ""
    return Answer(right, max(chain.confidence for chain in model.chains), said)


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--scenes", type=int, default=6, metavar="N", help="of each kind (default: 6)")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="the first seed (default: 0)")
    parser.add_argument("--only", metavar="TEXT", default="", help="mistakes with TEXT in their name")
    parser.add_argument("--all", action="store_true", help="say what each answer says, too")
    arguments = parser.parse_args()
    scenes = list(list_scenes(arguments.first, arguments.scenes))
    print_head("mistake", "views", "answers", "wrong", "greatest confidence when wrong", "what is said")
    worst = 0.0
    for mistake, make in MISTAKES.items():
        if arguments.only not in mistake:
            continue
        for kind in KINDS:
            answers: list[Answer] = []
            errors: list[str] = []
            for victim, synthetic, bounded in scenes:
                if victim != kind:
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
            said = wrong[0].said if wrong else (errors or [""])[0]
            print_row(mistake, kind, len(answers), len(wrong), sure, said)
    print(f"\ngreatest confidence of a wrong answer that data could contradict: {worst:.2f}")
    return int(worst >= SURE)


if __name__ == "__main__":
    run_bench(main)
