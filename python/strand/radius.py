"""The strings' radius from the data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand._core import NotEnoughDataError
from strand.config import Config
from strand.outliers import without_outliers
from strand.tubefit import TubeFit
from strand.tubes import Bounds, Clouds, fit_arcs
from strand.view import View

# the radii that the search starts from, metres, and the largest it accepts
_STARTS = (2e-3, 4e-3, 8e-3)
LARGEST = 20e-3
# least scatter of the cosine between normal and viewing direction over the visible half of a tube
_HALF_TUBE = 0.12


def estimate_radius(views: Sequence[View], bounds: Bounds, config: Config) -> float:
    """Find the radius to start from: the one that explains most of the middle view.

    From several starts, arcs are traced in the view with the middle number and fitted with the radius free;
    what is kept explains most points with the least scatter.

    Parameters
    ----------
    views : sequence of View
        Cropped to the extraction range.
    bounds : pair of (3,) ndarray or None
        The extraction range, metres.
    config : Config

    Returns
    -------
    float
        Metres.

    Raises
    ------
    strand.NotEnoughDataError
        If no start leads to tubes.
    """
    seen = [view for view in views if len(view.points)]
    best: tuple[float, float] | None = None
    if seen:
        view = seen[len(seen) // 2]
        for start in _STARTS:
            try:
                value, radius = _refined(view, bounds, start, config)
            except NotEnoughDataError:
                continue
            if radius < LARGEST and (best is None or value > best[0]):
                best = (value, radius)
    if best is None:
        raise NotEnoughDataError("views: the middle one shows no tube that would give a radius")
    return best[1]


def _refined(view: View, bounds: Bounds, radius: float, config: Config) -> tuple[float, float]:
    """Share of points explained less their scatter in radii, and the radius, after a few fits."""
    value = 0.0
    for _ in range(3):
        kept = without_outliers(view, radius, config.filter)
        if len(kept.points) < 50:
            raise NotEnoughDataError("views: too few points for a radius")
        clouds = Clouds.of([kept], bounds)
        fit = fit_arcs(clouds, np.eye(4)[None], radius, config, fit_radius=True)
        value = _coverage(fit) * (_explained(fit) - fit.sigma / fit.radius)
        radius = float(np.clip(fit.radius, 0.6 * radius, 1.6 * radius))
    return value, radius


def _explained(fit: TubeFit) -> float:
    """Share of the points that lie on a tube."""
    return float((fit.explained & (np.abs(fit.residual) < 0.35 * fit.radius)).mean())


def _coverage(fit: TubeFit) -> float:
    """How much of a tube's visible half the points cover: a tube too wide has them on a narrow strip."""
    on_tube = fit.explained & (np.abs(fit.residual) < fit.band)
    return min(float(np.std(fit.facing[on_tube])) / _HALF_TUBE, 1.0) if on_tube.any() else 0.0
