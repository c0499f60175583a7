"""Make the mistakes that users make when they hand over views, and say what strand answers.

python benches/mistakes.py [--scenes N] [--only TEXT]

Each mistake is made in scenes of three kinds: a rope with bounds, seen by seven cameras and by one, and a
rope among other things seen by three, with nothing told but the radius. An answer is wrong if it is more than
1.5 radii off the true rope in the true world frame. The table has how many answers there are, how many are
wrong, the greatest confidence of these, and what the greatest doubt of that one says, or an error.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from measure import measured
from numpy.typing import NDArray
from tables import head, row

import strand
from strand.synthetic import SHAPES, SyntheticScene, cluttered, scene

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Given:
    """What a user hands over."""

    depth: Array
    intrinsics: Array
    poses: Array
    radius: float
    bounds: tuple[Array, Array] | None

    def views(self) -> list[strand.View]:
        return [
            strand.View.from_depth(depth, self.intrinsics, pose)
            for depth, pose in zip(self.depth, self.poses, strict=True)
        ]


def changed(given: Given, **fields: object) -> Given:
    return Given(**{**given.__dict__, **fields})


def scaled_translation(poses: Array, scale: float) -> Array:
    found = poses.copy()
    found[:, :3, 3] *= scale
    return found


def in_degrees(poses: Array) -> Array:
    """Turns made of angles in degrees that are taken for radians."""
    found = poses.copy()
    for pose in found:
        angle = np.arccos(np.clip(0.5 * (np.trace(pose[:3, :3]) - 1.0), -1.0, 1.0))
        axis = np.array([pose[2, 1] - pose[1, 2], pose[0, 2] - pose[2, 0], pose[1, 0] - pose[0, 1]]) / max(
            2.0 * np.sin(angle), 1e-12
        )
        wrong = np.degrees(angle)
        skew = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
        pose[:3, :3] = np.linalg.qr(np.eye(3) + np.sin(wrong) * skew + (1.0 - np.cos(wrong)) * (skew @ skew))[
            0
        ]
        if np.linalg.det(pose[:3, :3]) < 0:
            pose[:3, :3] *= -1.0
    return found


def along_rays(given: Given) -> Given:
    height, width = given.depth.shape[1:]
    v, u = np.mgrid[:height, :width]
    K = given.intrinsics
    ray = np.sqrt(((u - K[0, 2]) / K[0, 0]) ** 2 + ((v - K[1, 2]) / K[1, 1]) ** 2 + 1.0)
    return changed(given, depth=given.depth * ray)


def hand_eye(given: Given) -> Given:
    """The camera sits a centimetre and a degree from where the arm's calibration says."""
    error = strand.pose_from_angles(np.radians(1.0), 0.0, 0.0, [0.006, 0.008, 0.0])
    return changed(given, poses=given.poses @ error)


MISTAKES: dict[str, Callable[[Given], Given]] = {
    "nothing": lambda g: g,
    "poses from world to camera": lambda g: changed(g, poses=np.linalg.inv(g.poses)),
    "poses of the next view": lambda g: changed(g, poses=np.roll(g.poses, 1, axis=0)),
    "angles in degrees": lambda g: changed(g, poses=in_degrees(g.poses)),
    "poses in millimetres": lambda g: changed(g, poses=scaled_translation(g.poses, 1e3)),
    "depth in millimetres": lambda g: changed(g, depth=1e3 * g.depth),
    "depth along the rays": along_rays,
    "depth mirrored": lambda g: changed(g, depth=g.depth[:, :, ::-1]),
    "depth upside down": lambda g: changed(g, depth=g.depth[:, ::-1]),
    "intrinsics of twice the size": lambda g: changed(
        g, intrinsics=g.intrinsics * np.array([[2.0, 1.0, 2.0], [1.0, 2.0, 2.0], [1.0, 1.0, 1.0]])
    ),
    "intrinsics of half the size": lambda g: changed(
        g, intrinsics=g.intrinsics * np.array([[0.5, 1.0, 0.5], [1.0, 0.5, 0.5], [1.0, 1.0, 1.0]])
    ),
    "the diameter as the radius": lambda g: changed(g, radius=2.0 * g.radius),
    "the radius halved": lambda g: changed(g, radius=0.5 * g.radius),
    "hand-eye error of 10 mm": hand_eye,
}


def victims(count: int) -> Iterator[tuple[str, SyntheticScene, bool]]:
    names = [name for name in SHAPES if name != "coil"]
    for k in range(count):
        yield "seven", scene(names[k % len(names)], seed=k, views=7), True
        yield "one", scene(names[(k + 2) % len(names)], seed=k, views=1), True
        yield "things", cluttered(2 * k + 1, views=3), False


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=4, metavar="N", help="of each kind (default: 4)")
    parser.add_argument("--only", metavar="TEXT", default="", help="mistakes with TEXT in their name")
    arguments = parser.parse_args()
    scenes = list(victims(arguments.scenes))
    print(head("mistake", "views", "answers", "wrong", "greatest confidence when wrong", "what is said"))
    worst = 0.0
    for mistake, make in MISTAKES.items():
        if arguments.only not in mistake:
            continue
        for kind in ("seven", "one", "things"):
            answers, wrong, sure, said = 0, 0, 0.0, ""
            for victim, synthetic, bounded in scenes:
                if victim != kind:
                    continue
                depth = synthetic.depth * synthetic.depth_scale
                bounds = synthetic.bounds if bounded else None
                given = make(Given(depth, synthetic.intrinsics, synthetic.poses, synthetic.radius, bounds))
                try:
                    model = strand.reconstruct(given.views(), given.radius, given.bounds)
                except (strand.StrandError, ValueError) as error:
                    said = said or f"{type(error).__name__}: {error}"
                    continue
                answers += 1
                confidence = max(chain.confidence for chain in model.chains)
                score = measured([chain.points for chain in model.chains], synthetic.truth, synthetic.radius)
                if (
                    not score.right
                    and not measured([model.chains[0].points], synthetic.truth, synthetic.radius).right
                ):
                    wrong += 1
                    if confidence >= sure and model.doubts:
                        sure = confidence
                        said = f"{model.doubts[0].kind}: {model.doubts[0].reason}"
            worst = max(worst, sure)
            print(row(mistake, kind, answers, wrong, f"{sure:.2f}" if wrong else "", said[:300]), flush=True)
    print(f"\ngreatest confidence of a wrong answer: {worst:.2f}")
    return int(worst >= 0.5)


if __name__ == "__main__":
    sys.exit(main())
