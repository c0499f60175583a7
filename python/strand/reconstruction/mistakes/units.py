"""Numbers that no depth camera or robot gives: grey values as depths, and poses in another unit."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from strand.ropes.doubt import Doubt
from strand.support.checks import Array
from strand.views.extract import Extract
from strand.views.view import View

_STEP = 61  # pixels from one pixel whose depth is looked at to the next
_FEW = 16  # steps from one pixel to the next in a first look
_MAX_LEVEL = 255.5  # greatest 8-bit number, in steps of depth
_MIN_LEVELS = 32  # different depths: with fewer, a simulated scene may be flat
_MAX_NEAREST = 0.6  # of the greatest depth: grey values start lower; shares are 1 % and 99 % quantiles
_ROUNDING = 0.02  # steps that a depth may lie beside a whole number of steps
_GRAY_DOUBT = 5.0  # doubt of depths that are grey values

_MIN_AWAY = 50.0  # metres from the origin: nearer cameras may stand anywhere in a robot's cell
_MIN_DEPTHS_AWAY = 100.0  # median depths from the origin: the same
_SAME_PLACE = 1e-9  # metres: cameras this near each other did not move


def doubt_gray_levels(views: Sequence[View]) -> Doubt | None:
    """Doubt depths that are at most 255 whole steps: they look like an image of grey values."""
    for number, view in enumerate(views):
        if view.image is None:
            continue
        depths = view.image.depth.ravel()
        # most images are clear from a few pixels
        if _differ_finely(_find_levels(depths[:: _FEW * _STEP])):
            continue
        step = _find_gray_step(depths[::_STEP])
        step = None if step is None else _find_gray_step(depths)
        if step is not None:
            reason = (
                f"depth looks like an 8-bit image, such as grey values or colours: depths of view {number} "
                f"are whole multiples of {step * 1e3:.3g} mm up to 255; give the camera's depth image"
            )
            return Doubt("depth", _GRAY_DOUBT, "where the ropes are", reason)
    return None


def _find_levels(depths: Array) -> Array:
    """Return the different depths in order, without 0."""
    return np.unique(depths[depths > 0])


def _differ_finely(levels: Array) -> bool:
    """Tell whether depths in order have more steps than 8-bit numbers: so have all depths that hold them."""
    return len(levels) > 1 and bool(levels[-1] > _MAX_LEVEL * np.diff(levels).min())


def _find_gray_step(depths: Array) -> float | None:
    """Return the step between depths that look like 8-bit numbers, metres; None if they do not."""
    levels = _find_levels(depths)
    if len(levels) < 2:
        return None
    step = float(np.diff(levels).min())
    if _differ_finely(levels) or len(levels) < min(_MIN_LEVELS, len(depths) // 4):
        return None
    if np.abs(levels / step - np.rint(levels / step)).max() > _ROUNDING:
        return None
    near, far = np.quantile(depths[depths > 0], (0.01, 0.99))
    return step if near < _MAX_NEAREST * far else None


def refuse_poses_in_other_units(extract: Extract) -> None:
    """Refuse poses that place cameras much farther away than they see, where nothing confirms them.

    Millimetres are a thousand times too far. Cameras far from the origin are right if bounds hold what they
    show, or if two of them stand apart, but near enough to each other to see the same ropes.

    Raises
    ------
    ValueError
        If all poses look like those of another unit.
    """
    # points of the world frame and their viewpoints have one unit
    views = [view for view in extract.whole if not _may_be_world_frame(view)]
    if extract.bounds is not None or len(views) < len(extract.whole):
        return
    away = np.array([float(np.linalg.norm(view.viewpoint)) for view in views])
    if not away.min() > _MIN_AWAY:
        return
    depths = np.array([_measure_depth(view) for view in views])
    if not (away > _MIN_DEPTHS_AWAY * depths).all():
        return
    for (one, near), (other, far) in itertools.combinations(zip(views, depths, strict=True), 2):
        apart = float(np.linalg.norm(one.viewpoint - other.viewpoint))
        if _SAME_PLACE < apart < near + far:
            return
    raise ValueError(
        f"views: cameras stand up to {away.max():.0f} m from the world's origin, but see only "
        f"{np.median(depths):.2g} m far; are the translations in metres? If so, give bounds, or poses in "
        "a frame near the ropes"
    )


def _may_be_world_frame(view: View) -> bool:
    """Tell whether a view may come from `View.from_world`."""
    return view.image is None and np.array_equal(view.pose[:3, :3], np.eye(3))


def _measure_depth(view: View) -> float:
    """Return the median distance of some points from their camera, metres; 0 without points."""
    points = view.points[::_STEP] if len(view.points) > _STEP else view.points
    return float(np.median(np.linalg.norm(points, axis=1))) if len(points) else 0.0
