"""Bows that ropes of known length have where nothing of them was seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand._core import TubeFit
from strand.geometry.curve import Curve
from strand.reconstruction.evidence.prior import Prior
from strand.support.checks import Array

# a bow may become this many times as high; its height is found by so many bisections
_HIGHEST, _BISECTIONS = 2.0, 40


def bowed(fit: TubeFit, starts: Sequence[Array]) -> list[Array]:
    """Give fitted curves their starting shape back where no point lies on them.

    Where nothing was seen a fit bends least, which takes bows away. There the starting shape is put back,
    with a change of least third differences that joins it smoothly to what was seen.

    Parameters
    ----------
    fit : TubeFit
    starts : sequence of (n, 3) ndarray
        Control points of the same curves before the fit, metres.

    Returns
    -------
    list of (n, 3) ndarray
        Metres.
    """
    curves = []
    for number, (control, start) in enumerate(zip(fit.curves, starts, strict=True)):
        count = len(control)
        spans = np.unique(fit.parameter[fit.inlier & (fit.curve == number)].astype(np.int64))
        bare = np.ones(count, dtype=bool)
        # at the edge of what was seen, control points that hardly move it follow the bow
        for k in (1, 2):
            bare[np.minimum(spans, count - 4) + k] = False
        seen = np.flatnonzero(~bare)
        # beyond the first and the last points is no rope
        if len(seen):
            bare[: seen[0]] = bare[seen[-1] :] = False
        if not len(seen) or not bare.any():
            curves.append(control)
            continue
        third = np.diff(np.eye(count), 3, axis=0)
        change = control - start
        change[bare] = np.linalg.lstsq(third[:, bare], -third[:, ~bare] @ change[~bare], rcond=None)[0]
        curves.append(np.where(bare[:, None], start + change, control))
    return curves


def as_long(
    fit: TubeFit, starts: Sequence[Array], parts: Sequence[Curve | None], prior: Prior
) -> list[Curve | None]:
    """Give ropes that are shorter than they are known to be the bows that they started with.

    Parameters
    ----------
    fit : TubeFit
    starts : sequence of (n, 3) ndarray
        Control points of its curves before the fit, metres.
    parts : sequence of (Curve or None)
        The stretch of each curve that is rope.
    prior : Prior
        How long the ropes are.

    Returns
    -------
    list of (Curve or None)
        The same stretches, as long as they are known to be where bows can make them so.
    """
    found = [(number, part) for number, part in enumerate(parts) if part is not None]
    shapes = bowed(fit, starts)
    longer = list(parts)
    for (number, part), true in zip(found, prior.expected([part.length for _, part in found]), strict=True):
        bow = shapes[number] - part.control
        if true is None or part.length >= true or not bow.any():
            continue

        def higher(height: float, part: Curve = part, bow: Array = bow) -> Curve:
            return Curve(part.control + height * bow, part.start, part.stop)

        low, high = 0.0, _HIGHEST
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if higher(middle).length < true else (low, middle)
        # what no bow of this shape makes long enough may keep the one that it has
        ways = [higher(high)] if high < _HIGHEST else [part, higher(1.0)]
        longer[number] = max(ways, key=lambda way: way.length)
    return longer
