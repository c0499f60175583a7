"""Where each view sees ropes end: what fixes its pose along a straight rope."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

import strand._core as _core
from strand._core import EndObservation, TubeFit
from strand.geometry.curve import Curve
from strand.reconstruction.tubes.tube_ends import pixel_width, seen_excess
from strand.support.checks import Array
from strand.views.box import Box
from strand.views.pose import moved

# all in radii: how far inside an end its density is taken, from and to; how near a line of sight another
# strand hides what is there
_INSIDE = (1.0, 4.0)
_OCCLUDED = 2.5
# least and greatest cosine between the way out of an end and the way to the camera: below the least so few
# pixels see the end that the outlier filter takes them; above the greatest its shape is all that one sees
_COSINES = (-0.5, 0.6)
# farthest from where it is expected that an end is found, in radii: curves are carried on by little more
_FARTHEST = 1.8
# fewer points on the stretch inside say little
_LEAST_POINTS = 12


def observed_ends(
    fit: TubeFit,
    parts: Sequence[Curve | None],
    closed: Sequence[bool],
    viewpoints: Array,
    bounds: Box | None,
    translation_sd: float,
) -> list[EndObservation]:
    """Find the ends in each view by itself.

    With n points for each metre of rope inside and m points past a place a radius inside, the end is m / n
    from there, as in `extents`. Points count by the surface that a pixel sees, so that a rope that
    goes away from the camera does not seem to end early.

    An end's place is uncertain by a pixel's width along the rope over the square root of 12, as rows of
    pixels may end together, and by its shape, see `seen_excess`.

    Parameters
    ----------
    fit : TubeFit
    parts : sequence of (Curve or None)
        The stretch of each fitted curve that is rope.
    closed : sequence of bool
        Whether each has no ends.
    viewpoints : (V, 3) ndarray
        The cameras' centres as reported, metres.
    bounds : Box or None
        The extraction range: what runs out of it does not end there.
    translation_sd : float
        Of the reported poses, metres: views that disagree by more than four of it see something else.

    Returns
    -------
    list of EndObservation
        Only of ends that two views or more see.
    """
    axis = [
        None if part is None else part.at(part.spaced(0.5 * fit.radius(number)))[0]
        for number, part in enumerate(parts)
    ]
    cameras = [moved(centre[None], motion)[0] for centre, motion in zip(viewpoints, fit.motions, strict=True)]
    backwards = np.linalg.inv(fit.motions)
    found: list[EndObservation] = []
    for number, (part, ring) in enumerate(zip(parts, closed, strict=True)):
        if part is None or ring:
            continue
        r = fit.radius(number)
        whole = Curve.whole(part.control)
        first, last = whole.arc_length_at([part.start, part.stop])
        mine = np.flatnonzero(fit.inlier & (fit.curve == number))
        place = whole.arc_length_at(fit.parameter[mine])
        for late in (False, True):
            end = 2 * number + late
            # from the end inwards
            inwards = last - place if late else place - first
            at_end = np.abs(inwards) < (_INSIDE[1] + 1.0) * r
            near, inwards = mine[at_end], inwards[at_end]
            views = fit.view[near]
            stretch = part.length - 0.5 * r * np.arange(9) if late else 0.5 * r * np.arange(9)
            inside, tangents, _ = part.at(np.clip(stretch, 0.0, part.length))
            outward = tangents[0] if late else -tangents[0]
            others = _elsewhere(axis, number, inside, r)
            seen = []
            for view, camera in enumerate(cameras):
                to_camera = camera - inside[0]
                cosine = float(to_camera @ outward / np.linalg.norm(to_camera))
                if not _COSINES[0] < cosine < _COSINES[1] or _core.occludes(
                    others, inside, camera, _OCCLUDED * r
                ):
                    continue
                back = backwards[view]
                ahead = moved(inside[:1] + 2.0 * r * np.outer([0, 1], outward), back)
                if bounds is not None and not bounds.holds(ahead).all():
                    continue
                seen_here = views == view
                surface = _surface(camera - fit.points[near[seen_here]], tangents[0])
                measured = _end(inwards[seen_here], surface, r, math.sqrt(1.0 - cosine**2))
                if measured is None:
                    continue
                offset, width = measured
                excess, doubt = seen_excess(cosine, fit.band(number) / r)
                offset -= excess * r
                sd = math.hypot(width / math.sqrt(12.0), doubt * r)
                seen.append((view, inside[0] + offset * outward, offset, sd, back))
            middle = float(np.median([offset for _, _, offset, _, _ in seen])) if seen else 0.0
            agreeing = [
                EndObservation(view, end, moved(spot[None], back)[0], outward, sd)
                for view, spot, offset, sd, back in seen
                if abs(offset - middle) < 4.0 * math.hypot(sd, translation_sd)
            ]
            if len(agreeing) > 1:
                found.extend(agreeing)
    return found


def _elsewhere(axis: Sequence[Array | None], number: int, inside: Array, r: float) -> Array:
    """Places of all axes that are not of the stretch `inside` of curve `number`."""
    places = []
    for other, nodes in enumerate(axis):
        if nodes is None:
            continue
        if other == number:
            # the stretch is at one of the two ends of the nodes, which are half a radius apart
            late = np.linalg.norm(nodes[-1] - inside[0]) < np.linalg.norm(nodes[0] - inside[0])
            nodes = nodes[: -len(inside) - 6] if late else nodes[len(inside) + 6 :]
        places.append(nodes)
    return np.concatenate(places)


def _surface(ray: Array, tangent: Array) -> Array:
    """Length of rope, but for a factor, that the pixel at the end of each ray stands for."""
    square = (ray * ray).sum(axis=1)
    along = (ray @ tangent) ** 2
    return np.asarray(square / np.sqrt(np.maximum(1.0 - along / square, 0.01)))


def _end(inwards: Array, weight: Array, r: float, sine: float) -> tuple[float, float] | None:
    """How far outside the expected place points give out, and a pixel's width along the rope, metres."""
    offset, count = 0.0, 0
    for _ in range(3):
        near, far = _INSIDE[0] * r - offset, _INSIDE[1] * r - offset
        body = (inwards >= near) & (inwards < far)
        count = int(np.count_nonzero(body))
        if count < _LEAST_POINTS:
            return None
        density = weight[body].sum() / (far - near)
        beyond = weight[inwards < near].sum()
        offset = float(beyond / density - near)
        if abs(offset) > _FARTHEST * r:
            return None
    return offset, pixel_width(count, far - near, sine, r)
