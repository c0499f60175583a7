"""Perturbations of a scene's input in one respect: errors of cameras, stages and callers.

Each kind has strengths in ascending order of harm. A perturbation changes images, poses, intrinsics, masks,
radius, number or length of ropes. The truth stays in the world frame. If all poses or depths have the same
error, the answer is wrong: a gripper would close beside the rope.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import strand
from strand.support.checks import Array
from strand.synthetic import SyntheticScene, render_depth
from strand.synthetic.fields import dilate, draw_field
from strand.views.pose import make_rotation

FOREIGN = 500  # added to a seed: the scene of foreign views


@dataclass(frozen=True, eq=False)
class Given:
    """Input of `strand.reconstruct`.

    Attributes
    ----------
    depth : list of (H, W) ndarray
        Metres.
    poses : list of (4, 4) ndarray
    intrinsics : (3, 3) ndarray
    masks : list of (H, W) ndarray or None
    radius : float
        Metres.
    scene : SyntheticScene
        The scene in the images.
    other : callable
        Makes another scene with as many views.
    ropes : int, optional
    length : list of float, optional
        Metres.
    """

    depth: list[Array]
    poses: list[Array]
    intrinsics: Array
    masks: list[NDArray[Any]] | None
    radius: float
    scene: SyntheticScene
    other: Callable[[], SyntheticScene]
    ropes: int | None = None
    length: list[float] | None = None

    @classmethod
    def of(cls, scene: SyntheticScene, other: Callable[[], SyntheticScene]) -> Given:
        """Return the right input of a scene."""
        masks = None if scene.mask is None else list(scene.mask)
        depth = list(scene.depth * scene.depth_scale)
        return cls(depth, list(scene.poses), scene.intrinsics, masks, scene.radius, scene, other)

    def make_views(self) -> list[strand.View]:
        """Return all views."""
        masks = self.masks or [None] * len(self.depth)
        return [
            strand.View.from_depth(image, self.intrinsics, pose, mask=mask)
            for image, pose, mask in zip(self.depth, self.poses, masks, strict=True)
        ]

    @property
    def arguments(self) -> dict[str, Any]:
        """Keyword arguments of `strand.reconstruct`: the caller's knowledge of the ropes."""
        known = {"ropes": self.ropes, "length": self.length}
        given = {name: value for name, value in known.items() if value is not None}
        return {"radius": self.radius, "bounds": self.scene.bounds, **given}

    def reconstruct(self) -> strand.Model:
        """Reconstruct the scene."""
        return strand.reconstruct(self.make_views(), **self.arguments)

    def change_images(self, change: Callable[[Array], Array]) -> Given:
        """Change each depth image, but for pixels without a return."""
        return replace(self, depth=[np.where(z > 0, change(z), 0.0) for z in self.depth])


Change = Callable[[Given, float, np.random.Generator], Given]


@dataclass(frozen=True)
class Kind:
    """A kind of perturbation.

    Attributes
    ----------
    change : callable
        Takes input, a strength and a random generator; returns perturbed input.
    strengths : tuple of float
    unit : str
        The strengths' unit.
    masked : bool
        Whether it needs views with masks.
    """

    change: Change
    strengths: tuple[float, ...]
    unit: str = ""
    masked: bool = False


_UP = np.array([0.0, 0.0, 1.0])
PIXEL_ROPE = 1e-6  # metres: a rope too thin for any pixel, to render the table alone


def _draw_direction(rng: np.random.Generator) -> Array:
    """Draw a direction in the table's plane, so that table and ropes stay on their side of the bounds."""
    angle = rng.uniform(0.0, 2.0 * math.pi)
    return np.array([math.cos(angle), math.sin(angle), 0.0])


def _draw_half(given: Given, rng: np.random.Generator) -> set[int]:
    """Draw half of the views; with an odd number one more or one less."""
    count = len(given.poses)
    return set(rng.permutation(count)[: (count + int(rng.integers(2))) // 2 or 1].tolist())


def _turn(pose: Array, axis: Array, angle: float, own: bool) -> Array:
    """Turn a pose about the camera's centre or the world's origin."""
    motion = np.eye(4)
    motion[:3, :3] = make_rotation(axis, angle)
    if own:
        motion[:3, 3] = pose[:3, 3] - motion[:3, :3] @ pose[:3, 3]
    return np.asarray(motion @ pose)


def _shift(pose: Array, by: Array) -> Array:
    other = pose.copy()
    other[:3, 3] += by
    return other


def shift_half(given: Given, strength: float, rng: np.random.Generator) -> Given:
    by, half = strength * _draw_direction(rng), _draw_half(given, rng)
    return replace(given, poses=[_shift(p, by) if i in half else p for i, p in enumerate(given.poses)])


def turn_half(given: Given, strength: float, rng: np.random.Generator) -> Given:
    angle, half, own = strength * rng.choice([-1.0, 1.0]), _draw_half(given, rng), bool(rng.integers(2))
    poses = [_turn(p, _UP, angle, own) if i in half else p for i, p in enumerate(given.poses)]
    return replace(given, poses=poses)


def shift_all(given: Given, strength: float, rng: np.random.Generator) -> Given:
    errors = strength * rng.normal(size=(len(given.poses), 3)) * [1.0, 1.0, 0.0]
    return replace(given, poses=[_shift(p, by) for p, by in zip(given.poses, errors, strict=True)])


def _draw_sign(given: Given, rng: np.random.Generator) -> float:
    """Draw a sign; without masks only the one that does not raise the table into the bounds."""
    return 1.0 if given.masks is None else float(rng.choice([-1.0, 1.0]))


def add_depth_bias(given: Given, strength: float, rng: np.random.Generator) -> Given:
    by = strength * _draw_sign(given, rng)
    return given.change_images(lambda z: z + by)


def scale_depth(given: Given, strength: float, rng: np.random.Generator) -> Given:
    factor = 1.0 + strength * _draw_sign(given, rng)
    return given.change_images(lambda z: z * factor)


def change_focal_length(given: Given, strength: float, rng: np.random.Generator) -> Given:
    camera = given.intrinsics.copy()
    camera[[0, 1], [0, 1]] *= 1.0 + strength * rng.choice([-1.0, 1.0])
    return replace(given, intrinsics=camera)


def move_principal_point(given: Given, strength: float, rng: np.random.Generator) -> Given:
    camera, angle = given.intrinsics.copy(), rng.uniform(0.0, 2.0 * math.pi)
    camera[:2, 2] += strength * given.depth[0].shape[1] * np.array([math.cos(angle), math.sin(angle)])
    return replace(given, intrinsics=camera)


def change_radius(given: Given, strength: float, rng: np.random.Generator) -> Given:
    return replace(given, radius=given.radius * strength)


def change_ropes(given: Given, strength: float, rng: np.random.Generator) -> Given:
    return replace(given, ropes=max(len(given.scene.truth) + int(strength), 1))


def change_length(given: Given, strength: float, rng: np.random.Generator) -> Given:
    lengths = [
        float(np.linalg.norm(np.diff(nodes, axis=0), axis=1).sum()) * strength for nodes in given.scene.truth
    ]
    return replace(given, length=lengths)


def _pick_views(given: Given, numbers: list[int]) -> Given:
    masks = None if given.masks is None else [given.masks[i] for i in numbers]
    return replace(
        given,
        depth=[given.depth[i] for i in numbers],
        poses=[given.poses[i] for i in numbers],
        masks=masks,
    )


def drop_views(given: Given, strength: float, rng: np.random.Generator) -> Given:
    count = max(len(given.depth) - int(strength), 1)
    return _pick_views(given, sorted(rng.permutation(len(given.depth))[:count].tolist()))


def double_views(given: Given, strength: float, rng: np.random.Generator) -> Given:
    numbers = list(range(len(given.depth)))
    return _pick_views(given, numbers + rng.choice(numbers, int(strength)).tolist())


def swap_poses(given: Given, strength: float, rng: np.random.Generator) -> Given:
    poses, pairs = list(given.poses), rng.permutation(len(given.poses)).tolist()
    for _ in range(int(strength)):
        a, b = pairs.pop(), pairs.pop()
        poses[a], poses[b] = poses[b], poses[a]
        pairs = pairs if len(pairs) > 1 else rng.permutation(len(poses)).tolist()
    return replace(given, poses=poses)


def insert_foreign_views(given: Given, strength: float, rng: np.random.Generator) -> Given:
    other, depth = given.other(), list(given.depth)
    for i in rng.permutation(len(depth))[: int(strength)].tolist():
        depth[i] = other.depth[i] * other.depth_scale
    return replace(given, depth=depth)


def corrupt_pixels(given: Given, strength: float, rng: np.random.Generator) -> Given:
    def change(z: Array) -> Array:
        wild = np.median(z[z > 0]) * rng.uniform(0.5, 1.5, z.shape)
        return np.where(rng.random(z.shape) < strength, wild, z)

    return given.change_images(change)


def quantize(given: Given, strength: float, rng: np.random.Generator) -> Given:
    return given.change_images(lambda z: np.rint(z / strength) * strength)


def add_correlated_noise(smoothness: float) -> Change:
    def change(given: Given, strength: float, rng: np.random.Generator) -> Given:
        sd = strength * given.scene.radius
        return given.change_images(lambda z: z + sd * draw_field(z.shape, smoothness, rng))

    return change


def add_flying_pixels(given: Given, strength: float, rng: np.random.Generator) -> Given:
    """Give pixels next to a step a depth between the two sides."""
    step = given.scene.radius

    def change(z: Array) -> Array:
        around = np.pad(z, 1, mode="edge")
        height, width = z.shape
        sides = np.stack([around[v : v + height, u : u + width] for v in range(3) for u in range(3)])
        sides = np.where(sides > 0, sides, z)
        gap = np.take_along_axis(sides - z, np.abs(sides - z).argmax(axis=0)[None], axis=0)[0]
        flies = (np.abs(gap) > step) & (rng.random(z.shape) < strength)
        return z + np.where(flies, rng.random(z.shape) * gap, 0.0)

    return given.change_images(change)


def lose_pixels(given: Given, strength: float, rng: np.random.Generator) -> Given:
    return given.change_images(lambda z: np.where(rng.random(z.shape) < strength, 0.0, z))


def grow_masks(given: Given, strength: float, rng: np.random.Generator) -> Given:
    reach = abs(int(strength))
    assert given.masks is not None
    masks = [mask != 0 for mask in given.masks]
    masks = [dilate(m, reach) if strength > 0 else ~dilate(~m, reach) for m in masks]
    return replace(given, masks=masks)


def put_table_at_ends(given: Given, strength: float, rng: np.random.Generator) -> Given:
    """Give discs of the images about the ropes' ends the depth of the table."""
    scene = given.scene
    ends = np.array([nodes[i] for nodes in scene.truth for i in (0, -1)])
    camera, depth = scene.intrinsics, []
    for image, pose in zip(given.depth, scene.poses_true, strict=True):
        table = render_depth([scene.truth[0]], PIXEL_ROPE, camera, pose, image.shape[::-1])
        rows, columns = np.indices(image.shape)
        changed = image.copy()
        for end in (ends - pose[:3, 3]) @ pose[:3, :3]:
            u, v, z = camera @ end / [end[2], end[2], 1.0]
            near = (np.hypot(columns - u, rows - v) < strength * camera[0, 0] / z) & (image > 0)
            changed[near] = table[near] + scene.noise * rng.normal(size=np.count_nonzero(near))
        depth.append(changed)
    return replace(given, depth=depth)


def change_nothing(given: Given, strength: float, rng: np.random.Generator) -> Given:
    return given


_SHARES = (0.01, 0.02, 0.05)  # strengths: shares of a quantity

# all kinds by name
KINDS = {
    "nothing": Kind(change_nothing, (0.0,)),
    "nothing, masks": Kind(change_nothing, (0.0,), masked=True),
    "half the poses shifted": Kind(shift_half, (2e-3, 4e-3, 7e-3, 10e-3), "m"),
    "half the poses turned": Kind(turn_half, tuple(map(math.radians, (0.5, 1.0, 2.0, 3.0))), "rad"),
    "poses noisy": Kind(shift_all, (2e-3, 4e-3, 8e-3), "m"),
    "depth off": Kind(add_depth_bias, (1e-3, 2e-3, 4e-3, 8e-3), "m"),
    "depth off, masks": Kind(add_depth_bias, (2e-3, 4e-3, 8e-3), "m", masked=True),
    "depth scaled": Kind(scale_depth, _SHARES),
    "depth scaled, masks": Kind(scale_depth, _SHARES, masked=True),
    "focal length off": Kind(change_focal_length, _SHARES),
    "principal point off": Kind(move_principal_point, _SHARES, "of the width"),
    "radius too small": Kind(change_radius, (0.9, 0.75, 0.5), "times"),
    "radius too large": Kind(change_radius, (1.1, 1.25, 1.5), "times"),
    "radius wrong, masks": Kind(change_radius, (1.2, 0.8, 1.5, 0.6), "times", masked=True),
    "ropes wrong": Kind(change_ropes, (1.0, -1.0), "more"),
    "length wrong": Kind(change_length, (0.95, 1.1, 1.3), "times"),
    "views dropped": Kind(drop_views, (1.0, 2.0), "views"),
    "views doubled": Kind(double_views, (1.0, 3.0), "views"),
    "poses swapped": Kind(swap_poses, (1.0, 2.0), "pairs"),
    "foreign views": Kind(insert_foreign_views, (1.0,), "view"),
    "corrupt pixels": Kind(corrupt_pixels, (0.01, 0.05, 0.1, 0.2)),
    "quantised": Kind(quantize, (1e-3, 2e-3, 5e-3), "m"),
    "correlated noise, 1 px": Kind(add_correlated_noise(1.0), (0.25, 0.5, 1.0), "r"),
    "correlated noise, 3 px": Kind(add_correlated_noise(3.0), (0.25, 0.5, 1.0), "r"),
    "flying pixels": Kind(add_flying_pixels, (0.2, 0.5, 1.0)),
    "pixels lost": Kind(lose_pixels, (0.5, 0.8, 0.9)),
    "masks grown": Kind(grow_masks, (1.0, 2.0, 3.0), "pixels", masked=True),
    "masks eaten": Kind(grow_masks, (-1.0, -2.0, -3.0), "pixels", masked=True),
    "table at the ends": Kind(put_table_at_ends, (5e-3, 10e-3, 15e-3), "m"),
    "table at the ends, masks": Kind(put_table_at_ends, (5e-3, 15e-3), "m", masked=True),
}
