"""The frames of a simulated sequence: images, masks and truth of one time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import Array, check_bool, check_integer
from strand.synthetic.depth_camera import DepthCamera
from strand.synthetic.grippers import Gripper
from strand.synthetic.noise import DEFAULT_FLYING, sense
from strand.synthetic.objects import Box, add_objects
from strand.synthetic.painting import RGB, Paint, Thing, make_finer, render_color
from strand.synthetic.rendering import render_depth
from strand.synthetic.segmentation import Segmentation
from strand.synthetic.sequence_covers import Cover
from strand.synthetic.sequence_plans import Plan
from strand.synthetic.sequence_truth import TrueCrossing, find_crossings, find_unseen
from strand.synthetic.tabletops import draw_texture
from strand.views.view import View

SIZE = (640, 480)
"""Width and height of images, pixels."""

_DEPTH_SCALE = 1e-4  # metres per unit of depth
_DEPTH_SD = 0.0007  # metres: noise of a camera that imitates no device
_MASK = Segmentation(ragged=0.6, lost=0.01, taken=0.005)
_TABLE = 4.0  # metres: side of the table
_BEHIND = 0.01  # metres before a camera: nearer corners may be anywhere in the image
_STEEL: RGB = (0.2, 0.2, 0.22)
_GREY: RGB = (0.45, 0.46, 0.5)
_ROPE_COLORS: tuple[RGB, ...] = ((0.8, 0.1, 0.1), (0.1, 0.2, 0.75), (0.95, 0.75, 0.1), (0.1, 0.5, 0.2))


@dataclass(frozen=True, eq=False)
class SequenceFrame:
    """The images of one time, and the truth.

    Attributes
    ----------
    number : int
        Number of the frame.
    time : float
        Seconds.
    depth : (V, H, W) ndarray of uint16
        Depth along the camera's z axis, in units of `depth_scale`; 0 for no return.
    depth_scale : float
        Metres per unit of depth.
    intrinsics : (3, 3) ndarray
        The pinhole matrix, pixels.
    poses : (V, 4, 4) ndarray
        Camera-to-world poses.
    mask : (V, H, W) ndarray of bool
        The ropes' pixels, as a segmenter finds them.
    labels : (V, H, W) ndarray of int32
        The exact mask: 0 for no rope, otherwise one more than the rope's number.
    occluders : (V, H, W) ndarray of bool
        The exact pixels of grippers, of the bar and of the plate.
    color : (V, H, W, 3) ndarray of uint8, or None
        None without colour.
    nodes : tuple of (N, 3) ndarray
        Material points of each rope at equal distances along it, world frame, metres.
    hidden : tuple of (N,) ndarray of bool
        Whether no camera sees a node.
    grippers : tuple of Gripper
    crossings : tuple of TrueCrossing
        As seen from above.
    """

    number: int
    time: float
    depth: NDArray[np.uint16]
    depth_scale: float
    intrinsics: Array
    poses: Array
    mask: NDArray[np.bool_]
    labels: NDArray[np.int32]
    occluders: NDArray[np.bool_]
    color: NDArray[np.uint8] | None
    nodes: tuple[Array, ...]
    hidden: tuple[NDArray[np.bool_], ...]
    grippers: tuple[Gripper, ...]
    crossings: tuple[TrueCrossing, ...]

    def view(self, camera: int = 0, *, occluders: bool = False) -> View:
        """Return the image of one camera as a view with its mask.

        Parameters
        ----------
        camera : int
            Number of the camera.
        occluders : bool
            Whether the view gets `occluders`, as of a robot that knows where its grippers are.

        Raises
        ------
        ValueError
            If there is no such camera.
        """
        number = check_integer("camera", camera, 0, len(self.depth) - 1)
        return View.from_depth(
            self.depth[number],
            self.intrinsics,
            self.poses[number],
            None if self.color is None else self.color[number],
            depth_scale=self.depth_scale,
            mask=self.mask[number],
            occluders=self.occluders[number] if check_bool("occluders", occluders) else None,
        )

    @property
    def views(self) -> tuple[View, ...]:
        """The images as views with masks."""
        return tuple(self.view(number) for number in range(len(self.depth)))


@dataclass(frozen=True, eq=False)
class Stage:
    """The parts that all frames of a sequence share.

    `seed` begins the seeds of random numbers. Without a `device`, depths have independent errors.
    """

    seed: tuple[int, ...]
    plan: Plan
    cover: Cover | None
    device: DepthCamera | None
    intrinsics: Array
    poses: Array
    color: bool


def draw_frame(stage: Stage, number: int, time: float, nodes: tuple[Array, ...]) -> SequenceFrame:
    """Return a frame of ropes with these nodes, at a time in seconds."""
    plan, cover = stage.plan, stage.cover
    grippers = [box for path in plan.grippers for box in path.make_objects(time, plan.radius)]
    covers = [] if cover is None else cover.make_objects(time)
    empty = cover is not None and cover.is_empty(time)
    depths, masks, labels, occluders, colors, unseen = [], [], [], [], [], []
    for view, pose in enumerate(stage.poses):
        rng = np.random.default_rng([*stage.seed, number, view])
        exact, label, occluder = _render(nodes, plan.radius, [*grippers, *covers], stage.intrinsics, pose)
        if empty:
            exact, label, occluder = np.zeros_like(exact), np.zeros_like(label), np.zeros_like(occluder)
        unseen.append([find_unseen(rope, plan.radius, exact, stage.intrinsics, pose) for rope in nodes])
        depths.append(_sense(exact, stage, rng))
        masks.append(_MASK.make_mask(label > 0, rng))
        labels.append(label)
        occluders.append(occluder)
        if stage.color:
            image = _paint(stage, nodes, ((grippers, _STEEL), (covers, _GREY)), pose, rng)
            colors.append(np.zeros_like(image) if empty else image)
    return SequenceFrame(
        number=number,
        time=time,
        depth=np.stack(depths),
        depth_scale=_DEPTH_SCALE,
        intrinsics=stage.intrinsics,
        poses=stage.poses,
        mask=np.stack(masks),
        labels=np.stack(labels),
        occluders=np.stack(occluders),
        color=np.stack(colors) if stage.color else None,
        nodes=nodes,
        hidden=tuple(np.all(own, axis=0) for own in zip(*unseen, strict=True)),
        grippers=tuple(path.find_state(time) for path in plan.grippers),
        crossings=find_crossings(nodes, plan.spacings, plan.radius),
    )


def _render(
    nodes: tuple[Array, ...], radius: float, boxes: Sequence[Box], intrinsics: Array, pose: Array
) -> tuple[Array, NDArray[np.int32], NDArray[np.bool_]]:
    """Return exact depths, the number of each pixel's rope or 0, and the pixels of boxes: (H, W) each."""
    depth = _render_table(intrinsics.tobytes(), pose.tobytes()).copy()
    labels = np.zeros(depth.shape, dtype=np.int32)
    for number, rope in enumerate(nodes, 1):
        own = render_depth([rope], radius, intrinsics, pose, SIZE, 0.0)
        nearer = (own > 0) & ((own < depth) | (depth == 0))
        depth[nearer], labels[nearer] = own[nearer], number
    before = depth.copy()
    for box in boxes:
        _add_box(depth, box, intrinsics, pose)
    occluders = depth != before
    labels[occluders] = 0
    return depth, labels, occluders


# cameras at rest see the same table in all frames
@lru_cache(maxsize=16)
def _render_table(intrinsics: bytes, pose: bytes) -> Array:
    camera, motion = np.frombuffer(intrinsics).reshape(3, 3), np.frombuffer(pose).reshape(4, 4)
    return render_depth([], [], camera, motion, SIZE, _TABLE)


def _add_box(depth: Array, box: Box, intrinsics: Array, pose: Array) -> None:
    """Lower (H, W) depths to a box's, in the part of the image that its corners span."""
    cosine, sine = math.cos(box.turn), math.sin(box.turn)
    corners = np.stack(np.meshgrid(*[(-0.5, 0.5)] * 3), axis=-1).reshape(-1, 3) * box.size
    corners = corners @ np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    seen = (corners + box.center - pose[:3, 3]) @ pose[:3, :3]
    if seen[:, 2].max() <= 0:
        return
    low, high = np.zeros(2), np.array(depth.shape[::-1])
    if seen[:, 2].min() > _BEHIND:
        pixels = (seen @ intrinsics.T)[:, :2] / seen[:, 2:]
        low, high = np.floor(pixels.min(axis=0)).clip(0, high), np.ceil(pixels.max(axis=0) + 1).clip(0, high)
    (left, top), (right, bottom) = low.astype(int), high.astype(int)
    if left < right and top < bottom:
        moved = intrinsics.copy()
        moved[:2, 2] -= left, top
        depth[top:bottom, left:right] = add_objects(depth[top:bottom, left:right], [box], moved, pose)


def _sense(exact: Array, stage: Stage, rng: np.random.Generator) -> NDArray[np.uint16]:
    if stage.device is not None:
        return stage.device.sense(exact, stage.intrinsics, depth_scale=_DEPTH_SCALE, rng=rng)
    return sense(
        exact,
        noise=_DEPTH_SD,
        flying=DEFAULT_FLYING,
        step=stage.plan.radius,
        depth_scale=_DEPTH_SCALE,
        rng=rng,
    )


def _paint(
    stage: Stage,
    nodes: tuple[Array, ...],
    bodies: tuple[tuple[Sequence[Box], RGB], ...],
    pose: Array,
    rng: np.random.Generator,
) -> NDArray[np.uint8]:
    """Return the (H, W, 3) colours; the paint, the texture and the light stay in all frames."""
    own = np.random.default_rng(stage.seed)
    order = own.permutation(len(_ROPE_COLORS))
    grey = float(own.uniform(0.3, 0.7))
    paint = Paint(
        tuple((_ROPE_COLORS[number],) for number in order[: len(nodes)]),
        (grey, grey, 0.95 * grey),
        "wood" if own.random() < 0.5 else "plain",
        shadow=float(own.uniform(0.1, 0.4)),
    )
    texture = draw_texture(paint.texture, np.asarray(paint.table), own)
    slope = (float(own.normal()), float(own.normal()))
    fine, size = make_finer(stage.intrinsics, SIZE)
    things = []
    for boxes, color in bodies:
        depth = np.zeros(size[::-1])
        for box in boxes:
            _add_box(depth, box, fine, pose)
        things.append(Thing(depth, color))
    image, _ = render_color(
        nodes, stage.plan.radius, stage.intrinsics, pose, SIZE, paint, texture, rng, things, _TABLE, slope
    )
    return image
