"""Simulated sequences: a camera sees ropes that grippers move, with the truth at every time."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import Array, check_bool, check_choice, check_integer
from strand.synthetic.camera import camera_pose, find_device
from strand.synthetic.depth_camera import DepthCamera
from strand.synthetic.grippers import GRIPPER_HEIGHT
from strand.synthetic.recorded import save_recording
from strand.synthetic.rope_motion import simulate
from strand.synthetic.sequence_covers import Cover, draw_bar, draw_blackout, draw_post
from strand.synthetic.sequence_frames import SIZE, SequenceFrame, Stage, draw_frame
from strand.synthetic.sequence_plans import DURATION, Plan, plan_sequence

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

_FOCAL_LENGTH = 600.0  # pixels
_RATE = 30.0  # images per second
_JITTER = 0.002  # seconds: standard deviation of the times of images
_LEAST_GAP = 0.02  # seconds between two images
_DISTANCES = (0.7, 0.9)  # metres: range of the cameras' distance; farther if ropes would leave the image
_FARTHER = 1.03  # factor of the distance until all ropes are in view
_MARGIN = 12.0  # pixels between ropes and the image's border
_MAX_SLOWER = 4  # simulations of a rope that is too fast
_SLOWER = 0.8  # power of the ratio of the greatest speed to that of a rope, by which grippers are slower
_SPREAD = math.radians(35.0)  # radians between two cameras
_MAX_VIEWS = 8
_MAX_FRAMES = 3000


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
    _stage: Stage = field(repr=False)

    def __len__(self) -> int:
        return len(self.times)

    def __iter__(self) -> Iterator[SequenceFrame]:
        return (self[number] for number in range(len(self)))

    def __getitem__(self, number: int) -> SequenceFrame:
        """Draw a frame; a negative number counts from the last one."""
        at = check_integer("number", number, -len(self))
        if at >= len(self):
            raise IndexError(f"number: expected at most {len(self) - 1}, got {at}")
        number = at % len(self)
        return draw_frame(self._stage, number, float(self.times[number]), self.nodes[number])

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write an MCAP file of ROS 2 that `strand.Recording` reads, such as a camera's driver records.

        Topics are `/camera/depth/image_raw` (16UC1, whole millimetres), `/camera/color/image_raw` of the same
        pixels if the sequence has colour, their CameraInfo, and the camera's pose in the frame `table`, which
        is the world, in `/tf_static`. Several cameras are `camera_0`, `camera_1` and so on. A frame takes
        0.6 MB, and 1.5 MB with colour.

        Parameters
        ----------
        path : str or path-like
            The .mcap file to write or replace.

        Raises
        ------
        ValueError
            If the name does not end with .mcap.
        OSError
            If the file cannot be written.
        """
        save_recording(self, path)


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
    - `bar`, `barwave`: as `carry` and `wave`, and a bar hides a part of the rope from the first camera for a
      while.
    - `blackout`: as `carry`; for 0.5 to 1 s nothing is seen, behind a plate or in empty images.
    - `two`: the end of a rope is carried over another rope.
    - `slide`: a rope is pulled along its own axis.
    - `still`: a rope lies on the table.

    Ropes have a radius of 3.5 to 5 mm, and are at rest for the first 0.2 s. They bend by their weight, keep
    their length, and slide on the table and on each other with friction. All movements end within 3 s.
    The images have 640 x 480 pixels, and masks with ragged edges.

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
    plan, nodes = _move(plan, times)
    whole = math.ceil(DURATION * _RATE)
    for array in (times, *(rope for ropes in nodes for rope in ropes)):
        array.setflags(write=False)
    intrinsics = np.array(
        [
            [_FOCAL_LENGTH, 0.0, 0.5 * (SIZE[0] - 1)],
            [0.0, _FOCAL_LENGTH, 0.5 * (SIZE[1] - 1)],
            [0.0, 0.0, 1.0],
        ]
    )
    poses = _place_cameras(placing, plan, nodes[:whole], intrinsics, views)
    cover = _draw_cover(covering, kind, seed, plan, times[:whole], nodes[:whole], poses[0, :3, 3])
    return SyntheticSequence(
        name=f"{kind}{seed:02d}",
        kind=kind,
        times=times[:frames],
        intrinsics=intrinsics,
        poses=poses,
        radius=plan.radius,
        nodes=tuple(nodes[:frames]),
        spacings=plan.spacings,
        _stage=Stage((seed, SEQUENCES.index(kind), 5), plan, cover, device, intrinsics, poses, color),
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


def _move(plan: Plan, times: Array) -> tuple[Plan, list[tuple[Array, ...]]]:
    """Return the nodes at each time, and the plan, whose waving gets smaller while nodes are too fast."""
    nodes = _simulate(plan, times)
    for _ in range(_MAX_SLOWER):
        moved = [np.diff(np.stack(rope), axis=0) for rope in zip(*nodes, strict=True)]
        speed = max(float((np.linalg.norm(way, axis=2) / np.diff(times)[:, None]).max()) for way in moved)
        if speed <= plan.fastest:
            break
        # the ropes have come to rest already, and get slower by more than their grippers
        smaller = plan.make_smaller((plan.fastest / speed) ** _SLOWER)
        plan = replace(smaller, ropes=nodes[0], settle=0.0)
        nodes = _simulate(plan, times)
    return plan, nodes


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
            border = np.asarray(SIZE) - 1.0 - _MARGIN
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
    camera: Array,
) -> Cover | None:
    """Return what hides a rope for a while from a camera with this centre, if the kind has something."""
    highest = max((float(path.places[:, 2].max()) for path in plan.grippers), default=0.0) + GRIPPER_HEIGHT
    ropes = [first for first, *_ in nodes]
    match kind:
        case "bar":
            return draw_bar(rng, times, ropes, highest, camera)
        case "barwave":
            return draw_post(rng, times, ropes, camera)
        case "blackout":
            return draw_blackout(rng, highest, seed % 2 == 1)
    return None
