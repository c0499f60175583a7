"""Simulated sequences: a camera sees ropes that grippers move, with the truth at every time."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from strand._core import find_crossed_segments
from strand.support.checks import Array, check_bool, check_choice, check_integer
from strand.synthetic.camera import camera_pose, find_device
from strand.synthetic.depth_camera import DepthCamera
from strand.synthetic.grippers import Gripper
from strand.synthetic.noise import DEFAULT_FLYING, sense
from strand.synthetic.objects import Box, Object, add_objects
from strand.synthetic.rendering import render_depth
from strand.synthetic.rope_motion import simulate
from strand.synthetic.segmentation import Segmentation
from strand.synthetic.sequence_covers import Cover, draw_bar, draw_blackout
from strand.synthetic.sequence_plans import DURATION, Plan, plan_sequence
from strand.views.view import View

SEQUENCES = (
    "carry",
    "wave",
    "loop",
    "unloop",
    "bar",
    "barwave",
    "blackout",
    "two",
    "slide",
    "still",
)
"""The kinds of `sequence`."""

_SIZE = (640, 480)
_FOCAL_LENGTH = 600.0  # pixels
_RATE = 30.0  # images per second
_JITTER = 0.002  # seconds: standard deviation of the times of images
_LEAST_GAP = 0.02  # seconds between two images
_DEPTH_SCALE = 1e-4  # metres per unit of depth
_DEPTH_SD = 0.0007  # metres: noise of a camera that imitates no device
_MASK = Segmentation(ragged=0.6, lost=0.01, taken=0.005)
_DISTANCES = (0.7, 0.9)  # metres: range of the cameras' distance; farther if ropes would leave the image
_FARTHER = 1.03  # factor of the distance until all ropes are in view
_MARGIN = 12.0  # pixels between ropes and the image's border
_SPREAD = math.radians(35.0)  # radians between two cameras
_MAX_VIEWS = 8
_MAX_FRAMES = 3000
_TABLE = 4.0  # metres: side of the table
_NEAR = 0.35  # radii: a visible place this near to a rope's surface is on it
_MIN_BETWEEN = 4.0  # radii of rope between two strands that cross


@dataclass(frozen=True)
class TrueCrossing:
    """One strand over another, as seen from above.

    Attributes
    ----------
    over, under : (int, float)
        Number of the rope and arc length from its first node, metres, of the upper and the lower strand.
    """

    over: tuple[int, float]
    under: tuple[int, float]


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
class SyntheticSequence:
    """Images of ropes that move, and the truth. `sequence[k]` draws frame k; the length is that in frames.

    Attributes
    ----------
    name : str
    kind : str
        One of `SEQUENCES`.
    times : (T,) ndarray
        Of the frames, seconds, rising.
    intrinsics : (3, 3) ndarray
        The pinhole matrix, pixels.
    poses : (V, 4, 4) ndarray
        Camera-to-world poses.
    radius : float
        The ropes' radius, metres.
    nodes : tuple of tuple of (N, 3) ndarray
        The ropes' nodes at each time, metres.
    spacings : tuple of float
        Length of rope between neighbouring nodes of each rope, metres.
    """

    name: str
    kind: str
    times: Array
    intrinsics: Array
    poses: Array
    radius: float
    nodes: tuple[tuple[Array, ...], ...]
    spacings: tuple[float, ...]
    _seed: int = field(repr=False)
    _plan: Plan = field(repr=False)
    _cover: Cover | None = field(repr=False)
    _device: DepthCamera | None = field(repr=False)
    _color: bool = field(repr=False)

    def __len__(self) -> int:
        return len(self.times)

    def __iter__(self) -> Iterator[SequenceFrame]:
        return (self[number] for number in range(len(self)))

    def __getitem__(self, number: int) -> SequenceFrame:
        """Draw a frame; a negative number counts from the last one."""
        at = check_integer("number", number, -len(self))
        if at >= len(self):
            raise IndexError(f"number: expected at most {len(self) - 1}, got {at}")
        return _draw_frame(self, at % len(self))


def sequence(
    kind: str,
    seed: int = 0,
    *,
    camera: str | DepthCamera | None = None,
    views: int = 1,
    frames: int = 90,
    color: bool = False,
) -> SyntheticSequence:
    """Simulate ropes that grippers move, seen by cameras at 30 images per second.

    - `carry`: an end is carried over the table.
    - `wave`: two grippers wave a rope in the air.
    - `loop`, `unloop`: an end is carried over its own rope and laid down; or lies there, and is carried back.
    - `bar`, `barwave`: as `carry` and `wave`, and a bar hides a part of the rope for a while.
    - `blackout`: as `carry`; for 0.5 to 1 s nothing is seen, behind a plate or in empty images.
    - `two`: the end of a rope is carried over another rope.
    - `slide`: a rope is pulled along its own axis.
    - `still`: a rope lies on the table.

    Ropes are 3.5 to 5 mm thick in radius. They lie still for the first 0.2 s. The images have 640 x 480
    pixels, and masks with ragged edges. The movements end within 3 s.

    Parameters
    ----------
    kind : str
        One of `SEQUENCES`.
    seed : int
        Seed of the random numbers, not negative.
    camera : str or DepthCamera, optional
        A key of `CAMERAS`, or a depth camera to imitate. Without one, errors are normal and independent, with
        a standard deviation of 0.7 mm.
    views : int
        Number of cameras, from 1 to 8.
    frames : int
        Number of frames, from 1 to 3000. More frames do not change the first ones.
    color : bool
        Whether frames have colour images.

    Returns
    -------
    SyntheticSequence

    Raises
    ------
    TypeError
        If an argument has the wrong type.
    ValueError
        If there is no such kind or camera, or a number is out of its range.

    Examples
    --------
    >>> from strand.synthetic import sequence
    >>> made = sequence("still", frames=2)
    >>> len(made), made[1].depth.shape
    (2, (1, 480, 640))
    """
    kind, seed = check_choice("kind", kind, SEQUENCES), check_integer("seed", seed, 0)
    device = None if camera is None else _check_camera(camera)
    views = check_integer("views", views, 1, _MAX_VIEWS)
    frames = check_integer("frames", frames, 1, _MAX_FRAMES)
    color = check_bool("color", color)
    number = SEQUENCES.index(kind)
    # cameras and the bar are placed by all of the movement, so that fewer frames are the same frames
    simulated = max(frames, math.ceil(DURATION * _RATE))
    times = _draw_times(np.random.default_rng([seed, number, 1]), simulated)
    planning, placing, covering = (np.random.default_rng([seed, number, part]) for part in (2, 3, 4))
    plan = plan_sequence(kind, planning)
    nodes = _simulate(plan, times)
    whole = math.ceil(DURATION * _RATE)
    intrinsics = np.array(
        [
            [_FOCAL_LENGTH, 0.0, 0.5 * (_SIZE[0] - 1)],
            [0.0, _FOCAL_LENGTH, 0.5 * (_SIZE[1] - 1)],
            [0.0, 0.0, 1.0],
        ]
    )
    poses = _place_cameras(placing, plan, nodes[:whole], intrinsics, views)
    cover = _draw_cover(covering, kind, seed, plan, times[:whole], nodes[:whole], poses)
    return SyntheticSequence(
        name=f"{kind}{seed:02d}",
        kind=kind,
        times=times[:frames],
        intrinsics=intrinsics,
        poses=poses,
        radius=plan.radius,
        nodes=tuple(nodes[:frames]),
        spacings=plan.spacings,
        _seed=seed,
        _plan=plan,
        _cover=cover,
        _device=device,
        _color=color,
    )


def _check_camera(camera: str | DepthCamera) -> DepthCamera:
    try:
        return find_device(camera)
    except (TypeError, ValueError) as error:
        raise type(error)(str(error).replace("device:", "camera:")) from None


def _draw_times(rng: np.random.Generator, count: int) -> Array:
    """Return the times of images, the first 0, at least some time apart."""
    times = np.arange(count) / _RATE + rng.normal(0.0, _JITTER, count)
    times[0] = 0.0
    for i in range(1, count):
        times[i] = max(times[i], times[i - 1] + _LEAST_GAP)
    return times


def _simulate(plan: Plan, times: Array) -> list[tuple[Array, ...]]:
    """Return the ropes' nodes at each time, moved by the plan's grippers."""
    starts = np.cumsum([0, *(len(rope) for rope in plan.ropes)])
    held = []
    for path in plan.grippers:
        along = np.arange(len(plan.ropes[path.rope])) * plan.spacings[path.rope] - path.s
        chosen = np.flatnonzero(np.abs(along) <= path.half + 0.5 * plan.spacings[path.rope])
        held.append((starts[path.rope] + chosen, along[chosen]))

    def drive(time: float) -> tuple[NDArray[np.intp], Array]:
        numbers, places = [np.empty(0, dtype=np.intp)], [np.empty((0, 3))]
        for path, (chosen, along) in zip(plan.grippers, held, strict=True):
            state = path.find_state(time)
            if state.holds:
                numbers.append(chosen)
                places.append(state.pose[:3, 3] + along[:, None] * state.pose[:3, 0])
        return np.concatenate(numbers), np.concatenate(places)

    return simulate(plan.ropes, plan.spacings, plan.radius, drive, times, plan.settle)


def _place_cameras(
    rng: np.random.Generator, plan: Plan, nodes: list[tuple[Array, ...]], intrinsics: Array, views: int
) -> Array:
    """Return (V, 4, 4) poses of cameras that see all nodes at all times."""
    places = np.concatenate([rope for ropes in nodes for rope in ropes])
    middle = 0.5 * (places.max(axis=0) + places.min(axis=0))
    first = float(rng.uniform(-0.15, 0.15))
    # the second camera stands to the right of the first, the third to its left, and so on
    sides = [(k + 1) // 2 * (1.0 if k % 2 else -1.0) for k in range(views)]
    distance = float(rng.uniform(*_DISTANCES))
    poses = []
    for side in sides:
        away = distance
        while True:
            pose = camera_pose(first + side * _SPREAD, away, plan.elevation)
            pose[:3, 3] += middle
            seen = (places - pose[:3, 3]) @ pose[:3, :3]
            pixels = (seen @ intrinsics.T)[:, :2] / seen[:, 2:]
            border = np.asarray(_SIZE) - 1.0 - _MARGIN
            if seen[:, 2].min() > 0.1 and ((pixels >= _MARGIN) & (pixels <= border)).all():
                break
            away *= _FARTHER
        poses.append(pose)
    return np.stack(poses)


def _draw_cover(
    rng: np.random.Generator,
    kind: str,
    seed: int,
    plan: Plan,
    times: Array,
    nodes: list[tuple[Array, ...]],
    poses: Array,
) -> Cover | None:
    if kind not in ("bar", "barwave", "blackout"):
        return None
    highest = max(float(path.places[:, 2].max()) for path in plan.grippers) + 0.11
    if kind == "blackout":
        return draw_blackout(rng, highest, seed % 2 == 1)
    return draw_bar(rng, times, [ropes[0] for ropes in nodes], highest, poses[0, :3, 3])


# a camera at rest sees the same table in all frames
@lru_cache(maxsize=16)
def _render_table(intrinsics: bytes, pose: bytes) -> Array:
    return render_depth(
        [],
        [],
        np.frombuffer(intrinsics).reshape(3, 3),
        np.frombuffer(pose).reshape(4, 4),
        _SIZE,
        _TABLE,
    )


def _draw_frame(made: SyntheticSequence, number: int) -> SequenceFrame:
    time, nodes = float(made.times[number]), made.nodes[number]
    objects: list[Object] = []
    for path in made._plan.grippers:
        objects += path.make_objects(time, made.radius)
    empty = False
    if made._cover is not None:
        objects += made._cover.make_objects(time)
        empty = made._cover.is_empty(time)
    depths, masks, labels, occluders, unseen = [], [], [], [], []
    for view, pose in enumerate(made.poses):
        rng = np.random.default_rng([made._seed, SEQUENCES.index(made.kind), 5, number, view])
        exact, label, occluder = _render(nodes, made.radius, objects, made.intrinsics, pose)
        if empty:
            exact, label, occluder = np.zeros_like(exact), np.zeros_like(label), np.zeros_like(occluder)
        unseen.append([_find_unseen(rope, made.radius, exact, made.intrinsics, pose) for rope in nodes])
        depths.append(_sense(exact, made, rng))
        masks.append(_MASK.make_mask(label > 0, rng))
        labels.append(label)
        occluders.append(occluder)
    return SequenceFrame(
        number=number,
        time=time,
        depth=np.stack(depths),
        depth_scale=_DEPTH_SCALE,
        intrinsics=made.intrinsics,
        poses=made.poses,
        mask=np.stack(masks),
        labels=np.stack(labels),
        occluders=np.stack(occluders),
        color=None,
        nodes=nodes,
        hidden=tuple(np.all(own, axis=0) for own in zip(*unseen, strict=True)),
        grippers=tuple(path.find_state(time) for path in made._plan.grippers),
        crossings=_find_crossings(nodes, made.spacings, made.radius),
    )


def _sense(exact: Array, made: SyntheticSequence, rng: np.random.Generator) -> NDArray[np.uint16]:
    if made._device is not None:
        return made._device.sense(exact, made.intrinsics, depth_scale=_DEPTH_SCALE, rng=rng)
    return sense(
        exact,
        noise=_DEPTH_SD,
        flying=DEFAULT_FLYING,
        step=made.radius,
        depth_scale=_DEPTH_SCALE,
        rng=rng,
    )


def _render(
    nodes: tuple[Array, ...], radius: float, objects: list[Object], intrinsics: Array, pose: Array
) -> tuple[Array, NDArray[np.int32], NDArray[np.bool_]]:
    """Return exact depths, the number of the rope of each pixel or 0, and the pixels of objects."""
    nearest = _render_table(intrinsics.tobytes(), pose.tobytes()).copy()
    labels = np.zeros(nearest.shape, dtype=np.int32)
    for number, rope in enumerate(nodes, 1):
        depth = render_depth([rope], radius, intrinsics, pose, _SIZE, 0.0)
        nearer = (depth > 0) & ((depth < nearest) | (nearest == 0))
        nearest[nearer], labels[nearer] = depth[nearer], number
    before = nearest.copy()
    for item in objects:
        _add_object(nearest, item, intrinsics, pose)
    occluders = nearest != before
    labels[occluders] = 0
    return nearest, labels, occluders


def _add_object(depth: Array, item: Object, intrinsics: Array, pose: Array) -> None:
    """Lower depths to an object's, in the part of the image that its corners span."""
    height, width = depth.shape
    rows, columns = slice(0, height), slice(0, width)
    if isinstance(item, Box):
        corners = np.stack(np.meshgrid(*[(-0.5, 0.5)] * 3), axis=-1).reshape(-1, 3) * item.size
        cosine, sine = math.cos(item.turn), math.sin(item.turn)
        turned = corners @ np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        seen = (turned + item.center - pose[:3, 3]) @ pose[:3, :3]
        if seen[:, 2].max() <= 0:
            return
        if seen[:, 2].min() > 0.01:
            pixels = (seen @ intrinsics.T)[:, :2] / seen[:, 2:]
            low, high = np.floor(pixels.min(axis=0)), np.ceil(pixels.max(axis=0)) + 1.0
            low = np.clip(low, 0.0, (width, height)).astype(int)
            high = np.clip(high, 0.0, (width, height)).astype(int)
            rows, columns = slice(low[1], high[1]), slice(low[0], high[0])
    part = depth[rows, columns]
    if part.size:
        moved = intrinsics.copy()
        moved[:2, 2] -= columns.start, rows.start
        depth[rows, columns] = add_objects(part, [item], moved, pose)


def _find_unseen(
    rope: Array, radius: float, depth: Array, intrinsics: Array, pose: Array
) -> NDArray[np.bool_]:
    """Return (N,) whether the pixel of a node shows something else than the rope around this node."""
    seen = (rope - pose[:3, 3]) @ pose[:3, :3]
    pixels = np.rint((seen @ intrinsics.T)[:, :2] / seen[:, 2:]).astype(np.int64)
    inside = ((pixels >= 0) & (pixels < _SIZE)).all(axis=1) & (seen[:, 2] > 0)
    columns, rows = np.clip(pixels, 0, np.asarray(_SIZE) - 1).T
    rays = np.column_stack([columns, rows, np.ones(len(rope))]) @ np.linalg.inv(intrinsics).T
    shown = rays * depth[rows, columns][:, None]
    # the axis between a few nodes before and after
    reach = 3
    least = np.full(len(rope), np.inf)
    for shift in range(-reach, reach):
        a = np.clip(np.arange(len(rope)) + shift, 0, len(rope) - 1)
        b = np.minimum(a + 1, len(rope) - 1)
        along = seen[b] - seen[a]
        share = ((shown - seen[a]) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-18)
        nearest = seen[a] + np.clip(share, 0.0, 1.0)[:, None] * along
        least = np.minimum(least, np.linalg.norm(shown - nearest, axis=1))
    return ~inside | (least > (1.0 + _NEAR) * radius)


def _find_crossings(
    nodes: tuple[Array, ...], spacings: tuple[float, ...], radius: float
) -> tuple[TrueCrossing, ...]:
    """Return where strands cross as seen from above."""
    counts = [len(rope) for rope in nodes]
    first = np.concatenate([np.arange(count - 1) for count in counts])
    number = np.repeat(np.arange(len(nodes)), np.array(counts) - 1)
    start = first + np.cumsum([0, *counts[:-1]])[number]
    pairs, shares, _ = find_crossed_segments(
        np.ascontiguousarray(np.concatenate(nodes)[:, :2]), np.stack([start, start + 1], axis=1)
    )
    found = []
    for pair, share in zip(pairs, shares, strict=True):
        strands = [(int(number[i]), (first[i] + part) * spacings[number[i]]) for i, part in zip(pair, share)]
        if strands[0][0] == strands[1][0] and abs(strands[0][1] - strands[1][1]) < _MIN_BETWEEN * radius:
            continue
        heights = [
            float((1.0 - part) * nodes[number[i]][first[i], 2] + part * nodes[number[i]][first[i] + 1, 2])
            for i, part in zip(pair, share)
        ]
        upper = 0 if heights[0] >= heights[1] else 1
        over, under = strands[upper], strands[1 - upper]
        found.append(TrueCrossing((over[0], float(over[1])), (under[0], float(under[1]))))
    return tuple(found)
