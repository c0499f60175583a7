"""Give ropes of known length their bows back where no camera saw them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand._core import TubeFit
from strand.geometry.curve import Curve
from strand.reconstruction.evidence.prior import Prior
from strand.support.checks import Array

_MAX_HEIGHT = 2.0  # times a bow's height: no bow becomes higher
_BISECTIONS = 40  # steps that find a bow's height


def restore_bows(fit: TubeFit, starts: Sequence[Array]) -> list[Array]:
    """Return the fitted curves' control points, with their starting shape where no point lies on them.

    A fit bends least where nothing was seen, which removes bows. The starting shape is put back with a change
    of least third differences, which joins it smoothly to the rest. `starts` are the points before
    the fit.
    """
    curves = []
    for number, (control, start) in enumerate(zip(fit.curves, starts, strict=True)):
        count = len(control)
        spans = np.unique(fit.parameter[fit.inlier & (fit.curve == number)].astype(np.int64))
        bare = np.ones(count, dtype=bool)
        # control points that hardly move the edge of the seen stretch follow the bow
        for k in (1, 2):
            bare[np.minimum(spans, count - 4) + k] = False
        seen = np.flatnonzero(~bare)
        # there is no rope beyond the first and the last point
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


def lengthen(
    fit: TubeFit, starts: Sequence[Array], parts: Sequence[Curve | None], prior: Prior
) -> list[Curve | None]:
    """Raise the bows of ropes that are shorter than their known lengths.

    `starts` are the control points before the fit, `parts` the stretches of the curves that are rope.
    """
    found = [(number, part) for number, part in enumerate(parts) if part is not None]
    shapes = restore_bows(fit, starts)
    longer = list(parts)
    for (number, part), true in zip(
        found, prior.match_lengths([part.length for _, part in found]), strict=True
    ):
        bow = shapes[number] - part.control
        if true is None or part.length >= true or not bow.any():
            continue

        def raise_bow(height: float, part: Curve = part, bow: Array = bow) -> Curve:
            return Curve(part.control + height * bow, part.start, part.stop)

        low, high = 0.0, _MAX_HEIGHT
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if raise_bow(middle).length < true else (low, middle)
        # a rope that no bow of this shape makes long enough may keep its own
        ways = [raise_bow(high)] if high < _MAX_HEIGHT else [part, raise_bow(1.0)]
        longer[number] = max(ways, key=lambda way: way.length)
    return longer
