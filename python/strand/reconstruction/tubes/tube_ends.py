"""Find where ropes end, by counting their points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

import strand._core as _core
from strand._core import TubeFit
from strand.geometry.curve import Curve
from strand.reconstruction.evidence.visibility import Visibility
from strand.reconstruction.tubes.fitting import EXPLAINED_RADII, EXPLAINED_SIGMAS
from strand.support.checks import Array

_INSIDE = 5.0  # radii: stretch inside an end over which the density of its points is taken
_AHEAD = np.arange(0.5, 4.01, 0.25)  # radii: places beyond an end that cameras may have seen through
_UNSEEN = (2.0, 3.5)  # radii: an unseen stretch this long has the end in its middle
_MAX_COSINE = 0.99  # between an end's direction and the way to the camera: larger ones are cut off here
_HALF_WIDTHS = np.sqrt(1.0 - np.linspace(-1.0, 1.0, 402)[1:-1] ** 2)  # of chords of a circle of radius 1


def find_extents(fit: TubeFit, exclusive: bool) -> list[Curve | None]:
    """Cut each fitted curve to the stretch that its points support; None for fewer than eight points.

    If `exclusive`, points near an end do not count if another strand explains them too.
    """
    tolerance = None
    if exclusive:
        tolerance = [
            max(EXPLAINED_SIGMAS * fit.sigma, EXPLAINED_RADII * fit.radius(number))
            for number in range(len(fit.curves))
        ]
    return [
        None if extent is None else Curve(control, *extent)
        for control, extent in zip(fit.curves, _core.find_extents(fit, tolerance), strict=True)
    ]


def measure_unseen(
    fit: TubeFit, parts: Sequence[Curve | None], closed: Sequence[bool], visibility: Visibility
) -> list[tuple[float, float] | None]:
    """Return how far straight on from the two ends of each open rope cameras saw free space first, metres.

    A distance is infinite if it is over four radii. Rings and lost curves have none.
    """

    def measure(part: Curve, late: bool, radius: float) -> float:
        end, inner = part.place_at([part.length, part.length - radius] if late else [0.0, radius])
        outward = (end - inner) / max(float(np.linalg.norm(end - inner)), np.finfo(float).tiny)
        through = visibility.seen_through(end + radius * _AHEAD[:, None] * outward, outward, radius)
        return float(_AHEAD[through.argmax()] * radius) if through.any() else float("inf")

    return [
        None if part is None or ring else (measure(part, False, radius), measure(part, True, radius))
        for part, ring, radius in zip(parts, closed, map(fit.radius, range(len(parts))), strict=True)
    ]


def extend_hidden_ends(
    fit: TubeFit, parts: Sequence[Curve | None], unseen: Sequence[tuple[float, float] | None]
) -> list[Curve | None]:
    """Extend ropes that end where no camera saw to the middle of the stretch where they may end.

    `unseen` is from `measure_unseen`.
    """
    longer = list(parts)
    for number, (part, hidden) in enumerate(zip(parts, unseen, strict=True)):
        if part is None or hidden is None:
            continue
        r, (early, late) = fit.radius(number), hidden
        whole = Curve.whole(part.control)
        start, stop = whole.arc_length_at([part.start, part.stop])
        if _UNSEEN[0] * r <= early <= _UNSEEN[1] * r:
            start = max(start - 0.5 * early, 0.0)
        if _UNSEEN[0] * r <= late <= _UNSEEN[1] * r:
            stop = min(stop + 0.5 * late, whole.length)
        longer[number] = whole.trimmed(start, stop)
    return longer


def estimate_excess(cosine: float, band: float) -> tuple[float, float]:
    """Return how much longer a rope looks from a camera than from the side, and half its range, radii.

    A flat cut that faces the camera shows points near the surface of the extended rope. A round cap looks
    the longer, the more slanting the view. An end is between the two.

    Parameters
    ----------
    cosine : float
        Between the end's outward direction and the way to the camera.
    band : float
        How far inside the surface a point may be, radii.
    """
    sine = math.sqrt(1.0 - cosine**2)
    flat = _measure_cut(band) * max(cosine, 0.0) / (2.0 * sine)
    round_cap = math.pi / 4.0 * (1.0 / sine - 1.0)
    return 0.5 * (flat + round_cap), 0.5 * abs(flat - round_cap)


@lru_cache(maxsize=16)
def _measure_cut(band: float) -> float:
    """Return the area of a flat cut, square radii, whose points are up to `band` radii inside the surface."""
    # a point of the cut, h under the rim on a chord of half width w, is h w from the surface
    return 2.0 * float(np.minimum(2.0 * _HALF_WIDTHS, band / _HALF_WIDTHS).mean())


def estimate_pixel_width(count: int, length: float, sine: float, radius: float) -> float:
    """Return a pixel's width along a rope, metres, if `count` of them see a stretch of `length` metres.

    `sine` belongs to the angle between the rope and the way to the camera, across which pixels are square.
    """
    return math.sqrt(2.0 * radius * length / count / sine)


def estimate_end_deviations(
    fit: TubeFit, number: int, part: Curve, mine: np.ndarray, place: Array
) -> tuple[float, float]:
    """Return the standard deviations of a rope's start and stop along itself, metres; a radius if unseen.

    In each view an end is uncertain for two reasons. Rows of pixels may end together: a pixel's width over
    the square root of 12. The end's shape is unknown (`estimate_excess`). Only the first is independent from
    view to view. Each view counts by its points near the end.

    Parameters
    ----------
    fit : TubeFit
    number : int
        The curve's number.
    part : Curve
        The stretch of the curve that is rope.
    mine : (M,) ndarray of int
        Numbers of the points on it.
    place : (M,) ndarray
        Arc length of each point along the stretch, metres.
    """
    radius = fit.radius(number)
    length = min(_INSIDE * radius, part.length)
    first, last = part.at([0.0, part.length])[1]

    def estimate(near: np.ndarray, outward: Array) -> float:
        views, to_camera = fit.view[near], fit.to_camera[near]
        total, variance, doubts = 0, 0.0, 0.0
        # the points come view by view
        for count in filter(None, np.bincount(views).tolist()):
            cosine = float(to_camera[total : total + count].sum(axis=0) @ outward) / count
            cosine = min(max(cosine, -_MAX_COSINE), _MAX_COSINE)
            width = estimate_pixel_width(count, length, math.sqrt(1.0 - cosine**2), radius)
            total += count
            variance += count**2 * width**2 / 12.0
            doubts += count * estimate_excess(cosine, fit.band(number) / radius)[1] * radius
        return math.hypot(math.sqrt(variance), doubts) / total if total else radius

    return (
        estimate(mine[place < length], -first),
        estimate(mine[part.length - place < length], last),
    )
