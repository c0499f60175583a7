"""Observe in each view where ropes end: this fixes the view's pose along a straight rope."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import strand._core as _core
from strand._core import EndObservation, TubeFit
from strand.geometry.curve import Curve
from strand.reconstruction.tubes.tube_ends import estimate_excess, estimate_pixel_width
from strand.support.checks import Array
from strand.views.box import Box
from strand.views.pose import moved, moved_by_each

_INSIDE = (1.0, 4.0)  # radii: stretch inside an end over which the density of its points is taken
_HIDING = 2.5  # radii: a strand this near to a line of sight hides what is behind it
# Cosine between an end's outward direction and the way to the camera. Below, so few pixels see the end that
# the outlier filter drops them. Above, only its shape is seen.
_COSINES = (-0.5, 0.6)
_MAX_OFFSET = 1.8  # radii: ends farther from the expected place are not found, as curves extend little more
_MIN_POINTS = 12  # on the stretch inside
_MAX_DISAGREEMENT = 4.0  # standard deviations of an observation from the views' median
_AHEAD = 2.0  # radii: place beyond an end that must be in the extraction range too
_STEPS = 0.5 * np.arange(9)  # radii: places before an end that other strands may hide
_OWN = 6  # nodes beyond those places that are no other strand


@dataclass(frozen=True, eq=False)
class _Scene:
    """The data that all observations share."""

    fit: TubeFit
    axes: list[Array | None]
    cameras: Array
    backwards: Array
    bounds: Box | None
    translation_sd: float


def observe_ends(
    fit: TubeFit,
    parts: Sequence[Curve | None],
    closed: Sequence[bool],
    viewpoints: Array,
    bounds: Box | None,
    translation_sd: float,
) -> list[EndObservation]:
    """Find the ends in each view by itself, and return those that two views or more see.

    With n points per metre of rope inside and m points past a place a radius inside, the end is m / n from
    there. Points are weighted by the surface that their pixel sees, so that a rope that leads away from the
    camera does not seem to end early.

    An end's place is uncertain by a pixel's width along the rope over the square root of 12, as rows of
    pixels may end together, and by its shape (`estimate_excess`).

    Parameters
    ----------
    fit : TubeFit
    parts : sequence of (Curve or None)
        The stretch of each fitted curve that is rope.
    closed : sequence of bool
        Whether each is a ring.
    viewpoints : (V, 3) ndarray
        The cameras' centres as reported, metres.
    bounds : Box or None
        The extraction range: ropes that leave it do not end there.
    translation_sd : float
        Standard deviation of the reported poses, metres.
    """
    axes = [
        None if part is None else part.place_at(part.spaced(0.5 * fit.radius(number)))
        for number, part in enumerate(parts)
    ]
    cameras = moved_by_each(viewpoints[:, None], fit.motions)[:, 0]
    backwards = np.asarray(np.linalg.inv(fit.motions), dtype=np.float64)
    scene = _Scene(fit, axes, cameras, backwards, bounds, translation_sd)
    found: list[EndObservation] = []
    for number, (part, ring) in enumerate(zip(parts, closed, strict=True)):
        if part is None or ring:
            continue
        whole = Curve.whole(part.control)
        first, last = whole.arc_length_at([part.start, part.stop])
        mine = np.flatnonzero(fit.inlier & (fit.curve == number))
        place = whole.arc_length_at(fit.parameter[mine])
        for late in (False, True):
            inwards = last - place if late else place - first
            at_end = np.abs(inwards) < (_INSIDE[1] + 1.0) * fit.radius(number)
            found += _observe_end(scene, number, part, late, mine[at_end], inwards[at_end])
    return found


def _observe_end(
    scene: _Scene, number: int, part: Curve, late: bool, near: np.ndarray, inwards: Array
) -> list[EndObservation]:
    """Observe one end in all views; return the observations that agree, if they are several.

    `near` has the numbers of the points near the end, `inwards` how far inside it they are, metres.
    """
    fit = scene.fit
    r = fit.radius(number)
    views = fit.view[near]
    # the points come view by view
    starts = np.searchsorted(views, np.arange(len(scene.cameras) + 1)).tolist()
    stretch = part.length - r * _STEPS if late else r * _STEPS
    inside, tangents, _ = part.at(np.clip(stretch, 0.0, part.length))
    outward = tangents[0] if late else -tangents[0]
    weight = _weigh_pixels(scene.cameras[views] - fit.points[near], tangents[0])
    near_and_far = (_INSIDE[0] * r, _INSIDE[1] * r)
    found = _core.find_seen_ends(inwards, weight, starts, near_and_far, _MAX_OFFSET * r, _MIN_POINTS)
    others = _find_other_axes(scene.axes, number, inside)
    outside: list[int] = []
    if scene.bounds is not None:
        ahead = moved_by_each(inside[:1] + _AHEAD * r * np.outer([0, 1], outward), scene.backwards)
        outside = np.flatnonzero(~scene.bounds.holds(ahead).all(axis=1)).tolist()
    seen = []
    for view, (camera, end) in enumerate(zip(scene.cameras, found, strict=True)):
        if end is None or view in outside:
            continue
        to_camera = camera - inside[0]
        cosine = float(to_camera @ outward) / math.sqrt(to_camera @ to_camera)
        if not _COSINES[0] < cosine < _COSINES[1] or _core.occludes(others, inside, camera, _HIDING * r):
            continue
        offset, count, length = end
        width = estimate_pixel_width(count, length, math.sqrt(1.0 - cosine**2), r)
        excess, doubt = estimate_excess(cosine, fit.band(number) / r)
        offset -= excess * r
        sd = math.hypot(width / math.sqrt(12.0), doubt * r)
        seen.append((view, inside[0] + offset * outward, offset, sd))
    middle = _core.find_median([offset for _, _, offset, _ in seen]) if seen else 0.0
    agreeing = [
        EndObservation(view, 2 * number + late, moved(spot[None], scene.backwards[view])[0], outward, sd)
        for view, spot, offset, sd in seen
        if abs(offset - middle) < _MAX_DISAGREEMENT * math.hypot(sd, scene.translation_sd)
    ]
    return agreeing if len(agreeing) > 1 else []


def _find_other_axes(axes: Sequence[Array | None], number: int, inside: Array) -> Array:
    """Return places of all axes but those near the stretch `inside` of curve `number`."""
    places = []
    for other, nodes in enumerate(axes):
        if nodes is None:
            continue
        if other == number:
            # the stretch is at one end of the nodes, which are as far from each other as its places
            late = np.linalg.norm(nodes[-1] - inside[0]) < np.linalg.norm(nodes[0] - inside[0])
            nodes = nodes[: -len(inside) - _OWN] if late else nodes[len(inside) + _OWN :]
        places.append(nodes)
    return np.concatenate(places)


def _weigh_pixels(ray: Array, tangent: Array) -> Array:
    """Return the length of rope that the pixel at the end of each ray sees, up to a common factor."""
    square = (ray * ray).sum(axis=1)
    along = (ray @ tangent) ** 2
    return np.asarray(square / np.sqrt(np.maximum(1.0 - along / square, 0.01)))
