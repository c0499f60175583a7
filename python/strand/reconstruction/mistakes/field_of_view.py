"""Points and images that no camera sees: too far away, all around it, or off its principal point."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

import strand._core as _core
from strand.geometry.lengths import measure_lengths
from strand.ropes.doubt import Doubt
from strand.views.depth_image import DepthImage
from strand.views.view import View

_DEPTH_STEP = 97  # depths from one checked depth to the next
_MAX_DISTANCE = 10_000.0  # radii: farther ropes are a fraction of a pixel wide in any camera
_MAX_FOCAL_LENGTHS = 4.0  # focal lengths in pixels times radii: farther ropes are half a pixel wide
_MAX_METERS = 20.0  # metres that depth cameras see: nearer depths may be those of walls behind the ropes
_NO_METERS = 30.0  # metres that no depth camera sees, whatever radius was estimated from such depths
_TOO_FAR_DOUBT = 5.0  # doubt of depths beyond `_MAX_DISTANCE`

_SAMPLE = 1000  # points of a view whose directions are looked at
_MIN_POINTS = 100  # points that a view must show
_MAX_ANGLE = np.radians(100.0)  # radians from the middle of the points: no depth camera sees farther aside
_MAX_ASIDE_SHARE = 0.05  # share of the points that may lie farther aside
_ALL_AROUND_DOUBT = 5.0  # doubt of viewpoints inside the points

_CELLS = 16.0  # cells of directions to a unit vector's length
_MIN_IN_CELL = 3  # points of a view in a cell that it sees
_SAMPLE_OF_CELLS = 20_000  # points of a view that are put into cells
_MIN_CELLS = 100  # cells that a view sees: with fewer it shows ropes alone
_MIN_COMMON = 0.8  # share of the cells of two views that both see, if their camera did not move
_MOVED_DOUBT = 1.5  # doubt of a common pose for views that differ

_USUAL_SIZES = (
    (424, 240),
    (480, 270),
    (640, 360),
    (640, 400),
    (640, 480),
    (640, 576),
    (848, 480),
    (960, 540),
    (1024, 768),
    (1280, 720),
    (1280, 800),
    (1920, 1080),
    (2208, 1242),
)  # pixels: widths and heights of images of depth cameras
_MAX_OFFSET_OF_OTHER = 0.04  # share of an image: this near its middle, a principal point is its own
_MIN_OFFSET = 0.15  # share of an image: this far from its middle, a principal point is another image's
_OFF_CENTER_DOUBT = 1.2  # doubt: images that were cropped look the same


def doubt_far_depths(views: Sequence[View], radius: float, focal: float | None = None) -> Doubt | None:
    """Doubt depths at which no camera would see a rope of a radius, metres: they may be millimetres.

    The longest focal length of the cameras, pixels, makes the limit closer, if it is known.
    """
    # points of the world frame have no depth, only a distance
    depths = [
        measure_lengths(view.points[::_DEPTH_STEP])
        if view.image is None
        else view.image.depth.ravel()[::_DEPTH_STEP]
        for view in views
    ]
    some = np.concatenate(depths)
    some = some[some > 0]
    farthest = _MAX_DISTANCE * radius
    if focal is not None:
        farthest = min(farthest, max(_MAX_FOCAL_LENGTHS * focal * radius, _MAX_METERS), _NO_METERS)
    median = _core.find_median(some)
    if not median > farthest:
        return None
    cameras = [float(np.linalg.norm(view.viewpoint)) for view in views if view.image is None]
    # with points of the world frame the cameras are far away too
    looks = "depths look like millimetres: give depth_scale=0.001, or points * 0.001"
    if len(cameras) == len(views) and min(cameras) > _MAX_DISTANCE * radius:
        looks = "points and poses look like millimetres: give both in metres"
    reason = f"{looks}; half of them are more than {median:.0f} m away"
    return Doubt("depth", _TOO_FAR_DOUBT, "where the ropes are", reason)


def doubt_points_all_around(views: Sequence[View]) -> Doubt | None:
    """Doubt viewpoints of points that lie farther aside than a camera sees."""
    for number, view in enumerate(views):
        if view.image is not None or len(view.points) < _MIN_POINTS:
            continue
        points = view.points[:: max(len(view.points) // _SAMPLE, 1)]
        towards = points / measure_lengths(points)[:, None]
        middle = towards.mean(axis=0)
        middle /= max(float(np.linalg.norm(middle)), np.finfo(float).tiny)
        angles = np.arccos(np.clip(towards @ middle, -1.0, 1.0))
        if np.mean(angles > _MAX_ANGLE) > _MAX_ASIDE_SHARE:
            reason = (
                "points look like world-frame ones: use View.from_world, with the camera's place; those of "
                f"view {number} lie all around their camera, up to "
                f"{np.degrees(np.quantile(angles, 1.0 - _MAX_ASIDE_SHARE)):.0f} degrees from where most are"
            )
            return Doubt("viewpoint", _ALL_AROUND_DOUBT, "where the ropes are", reason)
    return None


def doubt_shared_viewpoint(views: Sequence[View]) -> Doubt | None:
    """Doubt the common pose of views of points that show different directions of a scene.

    A camera that does not move sees the same directions in all views. World points that were given without
    viewpoints look as if it had turned.
    """
    groups: dict[bytes, list[int]] = {}
    for number, view in enumerate(views):
        if view.image is None:
            groups.setdefault(view.pose.tobytes(), []).append(number)
    for group in groups.values():
        if len(group) < 2:
            continue
        seen = [cells for number in group if len(cells := _find_cells(views[number])) >= _MIN_CELLS]
        for one, other in itertools.pairwise(seen):
            common = len(one & other) / len(one | other)
            if common < _MIN_COMMON:
                reason = (
                    "points look like world-frame ones: use View.from_world, with the camera's place; views "
                    f"{_join_numbers(group)} have one pose, but two of them have only {common:.0%} of the "
                    "directions in which they show something in common"
                )
                return Doubt("viewpoint", _MOVED_DOUBT, "where the ropes are", reason)
    return None


def doubt_principal_point(views: Sequence[View]) -> Doubt | None:
    """Doubt intrinsics, the same for all views, that belong to a transposed image or one of another size."""
    images = {
        (view.image.camera.center, view.image.depth.shape): view.image
        for view in views
        if view.image is not None and view.image.depth.size
    }
    if len(images) != 1:
        return None
    reason = _explain_offset(*images.values())
    return None if reason is None else Doubt("intrinsics", _OFF_CENTER_DOUBT, "where the ropes are", reason)


def _explain_offset(image: DepthImage) -> str | None:
    """Say of which image a principal point is the middle; None if it is near that of its own."""
    height, width = image.depth.shape
    cx, cy = image.camera.center
    across, down = (2.0 * cx + 1.0) / width, (2.0 * cy + 1.0) / height
    if min(across, down) <= 0.0 or max(abs(across - 1.0), abs(down - 1.0)) < _MIN_OFFSET:
        return None
    where = (
        f"the principal point ({cx:.0f}, {cy:.0f}) is the middle of an image of "
        f"{across * width:.0f} x {down * height:.0f} pixels, depth has {width} x {height}"
    )
    shape = width / height
    if abs(across * shape - 1.0) < _MAX_OFFSET_OF_OTHER and abs(down / shape - 1.0) < _MAX_OFFSET_OF_OTHER:
        return f"depth looks transposed, rows for columns: {where}"
    if abs(across / down - 1.0) < _MAX_OFFSET_OF_OTHER:
        return f"intrinsics look like those of an image {across:.2g} times as large: {where}"
    # an image that was cut out of another has a size of its own
    if (width, height) in _USUAL_SIZES:
        for usual_width, usual_height in _USUAL_SIZES:
            shares = (across * width / usual_width, down * height / usual_height)
            if max(abs(share - 1.0) for share in shares) < _MAX_OFFSET_OF_OTHER:
                return f"intrinsics look like those of an image of {usual_width} x {usual_height}: {where}"
    return None


def _find_cells(view: View) -> set[int]:
    """Return the cells of directions in which a view of points shows something."""
    points = view.points[:: max(len(view.points) // _SAMPLE_OF_CELLS, 1)]
    away = measure_lengths(points)
    towards = points[away > 0.0] / away[away > 0.0, None]
    cells = np.floor(_CELLS * (towards + 1.0)).astype(np.int64) @ (1, 1000, 1_000_000)
    found, counts = np.unique(cells, return_counts=True)
    return set(found[counts >= _MIN_IN_CELL].tolist())


def _join_numbers(numbers: Sequence[int]) -> str:
    return f"{', '.join(map(str, numbers[:-1]))} and {numbers[-1]}"
