"""Where a string ends: data that stop, found by counting."""

from __future__ import annotations

import math

import numpy as np

from strand.curve import Curve
from strand.tubefit import TubeFit
from strand.view import Array

# all in radii: width of the counting bins; the stretch near an end whose points are looked at twice; how far
# inside the end the density is taken, from and to; how far the end may lie from the first full bin
_BIN, _NEAR_END, _INSIDE, _REACH = 0.5, 7.0, (1.0, 5.0), 1.5


def string_parts(fit: TubeFit, exclusive: bool) -> list[Curve | None]:
    """Cut each fitted curve to the stretch that its points support.

    With n points for each metre of string and m points past L0 - r, where L0 is about where they give out,
    the end is at L0 - r + m / n: unbiased, where a threshold on the density is not.

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
    counted = fit.inlier.copy()
    curves = [Curve.whole(control) for control in fit.curves]
    if exclusive:
        counted &= ~_ambiguous(fit, curves, counted)
    parts: list[Curve | None] = []
    for number, curve in enumerate(curves):
        s = np.sort(curve.arc_length(fit.parameter[counted & (fit.curve == number)]))
        if len(s) < 8:
            parts.append(None)
            continue
        radius = fit.radius(number)
        start = _end(s, curve.length, radius)
        stop = curve.length - _end(curve.length - s[::-1], curve.length, radius)
        parts.append(curve.part(start, stop) if stop - start > radius else None)
    return parts


def seen_excess(cosine: float, band: float) -> tuple[float, float]:
    """How much longer than from the side a string seems from a camera, in radii, and half the range of it.

    A flat cut that faces the camera shows points which are near enough to the surface of the string carried
    on to count as string. A round cap's outline reaches farther along the axis the more slanting the view. An
    end is something between the two.

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
    half_width = np.sqrt(1.0 - np.linspace(-1.0, 1.0, 402)[1:-1] ** 2)
    # a point of the cut h under the rim, on a chord of the half width w, is h w from the surface
    area = 2.0 * float(np.minimum(2.0 * half_width, band / half_width).mean())
    flat = area * max(cosine, 0.0) / (2.0 * sine)
    round_cap = math.pi / 4.0 * (1.0 / sine - 1.0)
    return 0.5 * (flat + round_cap), 0.5 * abs(flat - round_cap)


def pixel_width(count: int, length: float, sine: float, radius: float) -> float:
    """Width of a pixel along a string, metres, if `count` of them see a stretch of `length` metres.

    `sine` is that of the angle between the string and the way to the camera, across which pixels are squares.
    """
    return math.sqrt(2.0 * radius * length / count / sine)


def end_deviation(fit: TubeFit, number: int, part: Curve, late: bool) -> float:
    """Return the standard deviation of where a string ends along itself.

    In each view the end is uncertain by a pixel's width over the square root of 12, as rows of pixels may end
    together, and by its shape, see `seen_excess`: the former independently, the latter not. Views count by
    their points near the end.

    Parameters
    ----------
    fit : TubeFit
    number : int
        Of the curve.
    part : Curve
        The stretch of it that is string.
    late : bool
        Whether the end in question is that of greater arc length.

    Returns
    -------
    float
        Metres; a radius if no point is near.
    """
    radius = fit.radius(number)
    length = min(_INSIDE[1] * radius, part.length)
    place = part.arc_length(fit.parameter)
    inwards = part.length - place if late else place
    counted = fit.inlier & (fit.curve == number) & (inwards < length)
    tangent = part.at([part.length if late else 0.0])[1][0]
    outward = tangent if late else -tangent
    total, variance, doubts = 0, 0.0, 0.0
    for view in np.unique(fit.view[counted]):
        mine = counted & (fit.view == view)
        count = int(np.count_nonzero(mine))
        cosine = float(np.clip(fit.to_camera[mine].mean(axis=0) @ outward, -0.99, 0.99))
        width = pixel_width(count, length, math.sqrt(1.0 - cosine**2), radius)
        total += count
        variance += count**2 * width**2 / 12.0
        doubts += count * seen_excess(cosine, fit.band(number) / radius)[1] * radius
    return math.hypot(math.sqrt(variance), doubts) / total if total else radius


def _end(s: Array, length: float, radius: float) -> float:
    """Arc length at which ascending places of points begin."""
    width = _BIN * radius
    bins = int(length / width) + 1
    counts = np.bincount(np.minimum((s / width).astype(np.int64), bins - 1), minlength=bins)
    usual = float(np.median(counts[counts > 0]))
    first = 0
    for i in range(bins - 1):
        density = max(float(np.median(counts[i + 1 : i + 9])), 0.3 * usual)
        if counts[i] >= 0.4 * density and counts[i] + counts[i + 1] >= 0.8 * density:
            first = i
            break
    about = (first + 0.5) * width
    near, far = about + _INSIDE[0] * radius, min(about + _INSIDE[1] * radius, length - about)
    far = max(far, near + radius)
    inside = np.count_nonzero((s >= near) & (s < far))
    beyond = np.count_nonzero((s < near) & (s > about - _REACH * radius))
    if not inside:
        return about
    density = inside / (far - near)
    # where another strand hides part of the inside, the density is too low: no end lies beyond all points
    end = max(near - beyond / density, s[1] - 1.0 / density)
    return float(np.clip(end, max(about - _REACH * radius, 0.0), about + _REACH * radius))


def _ambiguous(fit: TubeFit, curves: list[Curve], counted: np.ndarray) -> np.ndarray:
    """Points near the end of their curve that lie on the surface of another strand as well."""
    places = [curve.nodes(0.25 * fit.radius(number)) for number, curve in enumerate(curves)]
    samples = [curve.at(s)[:2] for curve, s in zip(curves, places, strict=True)]
    centres = np.concatenate([sample[0] for sample in samples])
    tangents = np.concatenate([sample[1] for sample in samples])
    number = np.repeat(np.arange(len(curves)), [len(s) for s in places])
    along = np.concatenate(places)
    radii = fit.radii[fit.ropes[number]]
    ambiguous = np.zeros(len(fit.curve), dtype=bool)
    for k, curve in enumerate(curves):
        r = fit.radius(k)
        slack = max(2.5 * fit.sigma, 0.15 * r)
        reach = 1.3 * float(fit.radii.max()) + slack
        own = np.flatnonzero(counted & (fit.curve == k))
        s = curve.arc_length(fit.parameter[own])
        for at_end in (s < _NEAR_END * r, s > curve.length - _NEAR_END * r):
            points, here = own[at_end], s[at_end]
            if not len(points):
                continue
            position = fit.points[points]
            low, high = position.min(axis=0) - reach, position.max(axis=0) + reach
            near = np.flatnonzero(((centres > low) & (centres < high)).all(axis=1))
            offset = position[:, None] - centres[near]
            lengthwise = (offset * tangents[near]).sum(axis=2)
            across = offset - lengthwise[..., None] * tangents[near]
            distance = np.linalg.norm(across, axis=2)
            facing = (across * fit.to_camera[points][:, None]).sum(axis=2) > -0.1 * distance
            elsewhere = (number[near] != k) | (np.abs(along[near] - here[:, None]) > 5.0 * r)
            on_surface = (np.abs(lengthwise) < 0.3 * r) & (np.abs(distance - radii[near]) < slack) & facing
            ambiguous[points] |= (on_surface & elsewhere).any(axis=1)
    return ambiguous
