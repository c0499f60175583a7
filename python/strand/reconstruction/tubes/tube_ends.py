"""Where a rope ends: where its points give out, found by counting."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

import strand._core as _core
from strand._core import TubeFit
from strand.geometry.curve import Curve
from strand.reconstruction.evidence.visibility import Visibility
from strand.support.checks import Array

# how far inside an end the density of its points is taken, in radii
_INSIDE = 5.0
# places beyond an end that cameras may have seen through, in radii
_AHEAD = np.arange(0.5, 4.01, 0.25)
# stretches beyond an end that no camera saw, in radii: the end lies in the middle of them
_UNSEEN = (2.0, 3.5)
# of chords evenly across a circle of radius 1
_HALF_WIDTHS = np.sqrt(1.0 - np.linspace(-1.0, 1.0, 402)[1:-1] ** 2)


def extents(fit: TubeFit, exclusive: bool) -> list[Curve | None]:
    """Cut each fitted curve to the stretch that its points support (see `_core.rope_extents`).

    Parameters
    ----------
    fit : TubeFit
    exclusive : bool
        Leave out points near an end that another strand explains too: they say nothing about that end.

    Returns
    -------
    list of (Curve or None)
        None for a curve that fewer than eight points support.
    """
    tolerance = None
    if exclusive:
        tolerance = [max(2.5 * fit.sigma, 0.15 * fit.radius(number)) for number in range(len(fit.curves))]
    return [
        None if extent is None else Curve(control, *extent)
        for control, extent in zip(fit.curves, _core.rope_extents(fit, tolerance), strict=True)
    ]


def unseen_beyond(part: Curve, late: bool, visibility: Visibility, radius: float) -> float:
    """Return how far straight beyond an end cameras first saw that nothing is there.

    Parameters
    ----------
    part : Curve
        The stretch of a curve that is rope.
    late : bool
        Whether the end in question is that of greater arc length.
    visibility : Visibility
        What the views saw.
    radius : float
        The rope's, metres.

    Returns
    -------
    float
        Metres; infinite if it is farther than four radii.
    """
    end, inner = part.at([part.length, part.length - radius] if late else [0.0, radius])[0]
    outward = (end - inner) / max(float(np.linalg.norm(end - inner)), np.finfo(float).tiny)
    through = visibility.seen_through(end + radius * _AHEAD[:, None] * outward, outward, radius)
    return float(_AHEAD[through.argmax()] * radius) if through.any() else float("inf")


def with_hidden_ends(
    fit: TubeFit, parts: Sequence[Curve | None], closed: Sequence[bool], visibility: Visibility
) -> list[Curve | None]:
    """Carry ropes that end where no camera saw on to the middle of the stretch where they may end.

    Parameters
    ----------
    fit : TubeFit
    parts : sequence of (Curve or None)
        The stretch of each fitted curve that was seen.
    closed : sequence of bool
        Whether each has no ends.
    visibility : Visibility
        What the views saw.

    Returns
    -------
    list of (Curve or None)
    """
    longer = list(parts)
    for number, (part, ring) in enumerate(zip(parts, closed, strict=True)):
        if part is None or ring:
            continue
        r = fit.radius(number)
        whole = Curve.whole(part.control)
        start, stop = whole.arc_length_at([part.start, part.stop])
        early, late = (unseen_beyond(part, end, visibility, r) for end in (False, True))
        if _UNSEEN[0] * r <= early <= _UNSEEN[1] * r:
            start = max(start - 0.5 * early, 0.0)
        if _UNSEEN[0] * r <= late <= _UNSEEN[1] * r:
            stop = min(stop + 0.5 * late, whole.length)
        longer[number] = whole.trimmed(start, stop)
    return longer


def seen_excess(cosine: float, band: float) -> tuple[float, float]:
    """How much longer a rope seems from a camera than from the side, in radii, and half the range of it.

    A flat cut that faces the camera shows points that count as rope: they are near the surface of the rope
    carried on. A round cap's outline reaches farther along the axis the more slanting the view. An end is
    something between the two.

    Parameters
    ----------
    cosine : float
        Between the way out of the end and the way to the camera.
    band : float
        How far inside the surface a point may be, in radii.

    Returns
    -------
    excess, doubt : float
        Radii.
    """
    sine = math.sqrt(1.0 - cosine**2)
    # a point of the cut h under the rim, on a chord of the half width w, is h w from the surface
    area = 2.0 * float(np.minimum(2.0 * _HALF_WIDTHS, band / _HALF_WIDTHS).mean())
    flat = area * max(cosine, 0.0) / (2.0 * sine)
    round_cap = math.pi / 4.0 * (1.0 / sine - 1.0)
    return 0.5 * (flat + round_cap), 0.5 * abs(flat - round_cap)


def pixel_width(count: int, length: float, sine: float, radius: float) -> float:
    """Width of a pixel along a rope, metres, if `count` of them see a stretch of `length` metres.

    `sine` is that of the angle between the rope and the way to the camera, across which pixels are squares.
    """
    return math.sqrt(2.0 * radius * length / count / sine)


def end_deviations(
    fit: TubeFit, number: int, part: Curve, mine: np.ndarray, place: Array
) -> tuple[float, float]:
    """Return the standard deviations of where a rope begins and ends along itself.

    In each view an end is uncertain by a pixel's width over the square root of 12, as rows of pixels may end
    together, and by its shape, see `seen_excess`. The former is independent from view to view, the latter is
    not. Views count by their points near the end.

    Parameters
    ----------
    fit : TubeFit
    number : int
        Of the curve.
    part : Curve
        The stretch of it that is rope.
    mine : (M,) ndarray of int
        Numbers of the points that lie on it.
    place : (M,) ndarray
        Arc length of each along the stretch, metres.

    Returns
    -------
    start, stop : float
        Metres; a radius if no point is near.
    """
    radius = fit.radius(number)
    length = min(_INSIDE * radius, part.length)
    first, last = part.at([0.0, part.length])[1]

    def deviation(near: np.ndarray, outward: Array) -> float:
        views, to_camera = fit.view[near], fit.to_camera[near]
        total, variance, doubts = 0, 0.0, 0.0
        for view, count in enumerate(np.bincount(views).tolist()):
            if not count:
                continue
            cosine = float(to_camera[views == view].sum(axis=0) @ outward) / count
            cosine = min(max(cosine, -0.99), 0.99)
            width = pixel_width(count, length, math.sqrt(1.0 - cosine**2), radius)
            total += count
            variance += count**2 * width**2 / 12.0
            doubts += count * seen_excess(cosine, fit.band(number) / radius)[1] * radius
        return math.hypot(math.sqrt(variance), doubts) / total if total else radius

    return (
        deviation(mine[place < length], -first),
        deviation(mine[part.length - place < length], last),
    )
