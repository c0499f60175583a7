"""Why nothing lies in the extraction range: the likely mistake is the one without which points would."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

import strand._core as _core
from strand.box import Box, metres
from strand.checks import Array
from strand.pose import moved
from strand.view import View

# so many points of each view are looked at; a cause is likely if it explains this share of them
_ENOUGH, _SHARE = 20_000, 1e-3
# camera frames of other conventions, as rotations into x right, y down, z forward
_AXES = {
    "x right, y up, z backward": np.diag([1.0, -1.0, -1.0]),
    "x forward, y left, z up": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
}


def why_empty(views: Sequence[View], bounds: Box | None) -> str:
    """Say where the points are, where the extraction range is, and what mistake would explain it.

    Parameters
    ----------
    views : sequence of View
        None of which has a point in the range.
    bounds : Box or None
        The extraction range, metres.
    """
    clouds = [view.points[:: max(len(view.points) // _ENOUGH, 1)] for view in views]
    masked = [f"view {i} has {why}" for i, view in enumerate(views) if (why := mask_without_points(view))]
    if masked and not any(map(len, clouds)):
        return f"no view has a point: {', '.join(masked)}; 0 in a mask is no rope, every other number is rope"
    if bounds is None or not any(map(len, clouds)):
        return "no view has a point; are all depths 0 or not finite?"
    placed = np.concatenate([view.world_points for view in views])
    inside = {
        cause: _count_inside([mend(cloud, view) for cloud, view in zip(clouds, views, strict=True)], bounds)
        for cause, mend in _CAUSES.items()
    }
    likely = max(inside, key=inside.__getitem__)
    found = inside[likely] > _SHARE * sum(map(len, clouds))
    hint = likely if found else "are bounds, poses and units those of one world frame, in metres?"
    return (
        "no view has a point in the extraction range: "
        f"the points lie between {metres(placed.min(axis=0))} and {metres(placed.max(axis=0))} m, "
        f"the range is {bounds}; {hint}"
    )


def mask_without_points(view: View) -> str | None:
    """Say what is wrong with a mask in which no point lies; None if one does, or there is no mask."""
    mask = view.mask
    if mask is None or len(view.points):
        return None
    return "no depth inside its mask" if mask.any() else "an empty mask"


def _count_inside(clouds: Sequence[Array], bounds: Box) -> int:
    return int(np.count_nonzero(bounds.holds(np.concatenate(clouds))))


def _depth_in_millimetres(cloud: Array, view: View) -> Array:
    return moved(1e-3 * cloud, view.pose)


def _all_in_millimetres(cloud: Array, view: View) -> Array:
    return 1e-3 * moved(cloud, view.pose)


def _bounds_in_millimetres(cloud: Array, view: View) -> Array:
    return 1e3 * moved(cloud, view.pose)


def _in_world_frame(cloud: Array, _: View) -> Array:
    return cloud


def _inverse_pose(cloud: Array, view: View) -> Array:
    return moved(cloud, np.asarray(np.linalg.inv(view.pose), dtype=np.float64))


def _other_axes(turn: Array) -> Callable[[Array, View], Array]:
    def turned(cloud: Array, view: View) -> Array:
        # points that came in the world frame have a camera's place, but no camera frame
        from_world = (
            view.image is None and np.array_equal(view.pose[:3, :3], np.eye(3)) and view.viewpoint.any()
        )
        return np.empty((0, 3)) if from_world else moved(cloud @ turn.T, view.pose)

    return turned


def _centred(_: Array, view: View) -> Array:
    """Points of a depth image if its intrinsics are scaled so that their centre is the image's."""
    image = view.image
    if image is None or min(image.centre) <= 0:
        return np.empty((0, 3))
    height, width = image.depth.shape
    across, down = width / (2.0 * image.centre[0]), height / (2.0 * image.centre[1])
    focal = image.focal[0] * across, image.focal[1] * down
    points = _core.unproject(image.rope_depth, focal, (0.5 * (width - 1), 0.5 * (height - 1)))
    return moved(points[:: max(len(points) // _ENOUGH, 1)], view.pose)


def _outside_mask(cloud: Array, view: View) -> Array:
    """As many points of the whole image as lie in its mask."""
    image = view.image
    if image is None or image.mask is None or not len(cloud):
        return np.empty((0, 3))
    points = _core.unproject(image.depth, image.focal, image.centre)
    return moved(points[:: max(len(points) // len(cloud), 1)], view.pose)


_CAUSES: dict[str, Callable[[Array, View], Array]] = {
    "depths look like millimetres: give depth_scale=0.001, or points * 0.001": _depth_in_millimetres,
    "points and poses look like millimetres: give both in metres": _all_in_millimetres,
    "bounds look like millimetres: give them in metres": _bounds_in_millimetres,
    "points look like world-frame ones: use View.from_world": _in_world_frame,
    "poses look like world-to-camera ones: give their inverses, camera-to-world": _inverse_pose,
    **{
        f"the camera frame looks like {name}: turn it to x right, y down, z forward": _other_axes(turn)
        for name, turn in _AXES.items()
    },
    "intrinsics look like those of an image of another size: scale fx, fy, cx, cy with it": _centred,
    "points outside of the masks do lie there: are the masks those of these frames?": _outside_mask,
}
"""What may be wrong, and the points in the world frame if it is."""
