"""The ropes' radii: what is known of them beforehand, and an estimate from how wide ropes look."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

import strand._core as _core
from strand._core import NotEnoughDataError
from strand.config import Known
from strand.support.checks import Array, check_radius
from strand.views.box import Bounds
from strand.views.view import View, checked_views

# the largest radius that is looked for, metres
LARGEST = 20e-3
# places of each view that are asked for an estimate, and how many estimates a radius needs
_SEEDS, _FEWEST = 400, 10
# on a logarithmic scale: width of the kernel of their density, spacing of its places, least distance of modes
_KERNEL, _STEP, _APART = 0.08, 0.01, 0.3
# modes lower than this share of the highest are no ropes
_LEAST_MODE = 0.1
# radii that differ by less than this share, or this many standard deviations, are taken for one
_SAME, _SAME_SD = 0.05, 3.0
# how far noise pulls a fitted radius, in squares of its standard deviation over the radius: silhouettes lose
# points to the outlier filter and gain pixels that fly, and neither shows in the residuals
_PULL = 0.2
# what is not known of a strip's width, in radii: ropes lie beside each other, patches are round
_WIDTH_SD = 0.05


@dataclass(frozen=True, eq=False)
class Radii:
    """What is known of the ropes' radii before the fit.

    Attributes
    ----------
    values, sd : (K,) ndarray
        The radius of each class of ropes and its standard deviation, metres.
    free : bool
        Whether they were not given and the data are to fix them.
    held : bool
        Whether the data cannot.
    """

    values: Array
    sd: Array
    free: bool
    held: bool = False

    @property
    def prior(self) -> Array | None:
        """(K, 2) Means and standard deviations for the fit; None if the radii are held."""
        return None if self.held else np.column_stack([self.values, self.sd])

    def only(self, numbers: Sequence[int]) -> Radii:
        """Return some of them."""
        chosen = list(numbers)
        return replace(self, values=self.values[chosen], sd=self.sd[chosen])

    def with_parts(self) -> Radii:
        """Return them with their halves and thirds."""
        values = np.concatenate([self.values, self.values / 2.0, self.values / 3.0])
        order = np.argsort(values)
        return replace(self, values=values[order], sd=np.concatenate([self.sd, self.sd, self.sd])[order])

    def unsure(self) -> Radii:
        """Return them with standard deviations so wide that each could be any other of them."""
        return replace(self, sd=np.full(len(self.values), float(np.ptp(self.values))))

    def nearest(self, fitted: Array) -> list[int]:
        """Return for each fitted radius the number of the one that it is nearest to."""
        return [int(np.abs(np.log(self.values / value)).argmin()) for value in fitted]

    def capped(self, sd: Array) -> Array:
        """Return deviations of fitted radii, metres: of given ones at most those that they came with."""
        return sd if self.free else np.minimum(sd, self.sd)

    @classmethod
    def given(cls, radius: float | Sequence[float], known: Known | None = None) -> Radii:
        """Return given radii after checking them.

        Raises
        ------
        TypeError
            If one is not a number.
        ValueError
            If one is not finite and positive, or there is none.
        """
        each = np.atleast_1d(np.asarray(radius, dtype=object)).tolist()
        values = np.unique([check_radius(one) for one in each])
        if not len(values):
            raise ValueError("radius: expected a number of metres or several, got none")
        known = Known() if known is None else known
        return cls(values, known.radius_sd * values, free=False)


def estimate_radius(views: Sequence[View], bounds: Bounds | None = None) -> tuple[Array, Array]:
    """Estimate the ropes' radii from how wide they look.

    To its camera a stretch of rope is a strip, across which the points' variance is r^2 / 3 whatever the
    noise in depth. Every view gives such estimates at several hundred places; their modes are the radii.
    Ropes that lie side by side look like a wide one and make modes of their own, so there may be more modes
    than radii.

    Parameters
    ----------
    views : sequence of View
        Views of ropes alone.
    bounds : pair of (3,) array_like, or Box, optional
        The extraction range, metres: low and high corner of a box along the axes of the world frame, or a
        `strand.Box`, which may be turned; views are
        cropped to it.

    Returns
    -------
    radii, sd : (K,) ndarray
        Ascending, and their standard deviations, metres: 5 % and half of what a pixel covers, as the
        outermost pixels may be missing or mixed with what is behind.

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If there are no views, or `bounds` is out of range.
    strand.NotEnoughDataError
        If the views show no strips.
    """
    views = checked_views(views)
    if bounds is not None:
        views = tuple(view.crop(bounds) for view in views)
    found = [
        _core.apparent_radii(view.world_points, view.viewpoint, LARGEST, _SEEDS)
        for view in views
        if len(view.points)
    ]
    strips = np.concatenate([np.empty((0, 2)), *found])
    if len(strips) < _FEWEST:
        raise NotEnoughDataError("views: no stretch of rope is clear enough to give a radius")
    size = np.log(strips[:, 0])
    places = np.arange(size.min() - _STEP, size.max() + 2.0 * _STEP, _STEP)
    density = np.exp(-0.5 * ((places[:, None] - size) / _KERNEL) ** 2).sum(axis=1)
    modes: list[float] = []
    for i in np.argsort(-density, kind="stable"):
        if density[i] < _LEAST_MODE * density.max():
            break
        peak = density[i] >= density[max(i - 1, 0)] and density[i] >= density[min(i + 1, len(places) - 1)]
        if peak and all(abs(places[i] - mode) > _APART for mode in modes):
            modes.append(float(places[i]))
    near = np.abs(size[:, None] - np.sort(modes)) < _APART / 2.0
    radii, footprint = np.array([np.median(strips[close], axis=0) for close in near.T]).T
    return radii, np.hypot(_WIDTH_SD * radii, 0.5 * footprint)


def apparent_radius(views: Sequence[View]) -> float | None:
    """Return the least radius that ropes look like, metres; None if no stretch of rope is clear enough.

    Parameters
    ----------
    views : sequence of View
        Views of ropes alone.
    """
    try:
        return float(estimate_radius(views)[0][0])
    except NotEnoughDataError:
        return None


def fitted_deviation(fitted: Array, sd: Array, sigma: float) -> Array:
    """Return the standard deviations of fitted radii, with what noise does to them beside its scatter.

    Points that scatter independently would give a radius better than the tube's outline is seen.

    Parameters
    ----------
    fitted, sd : (K,) ndarray
        Radii and what the fit says of their standard deviations, metres.
    sigma : float
        Standard deviation of the fit's residuals, metres.

    Returns
    -------
    (K,) ndarray
        Metres.
    """
    return np.hypot(sd, _PULL * sigma**2 / fitted)


def agreeing(radii: Array, sd: Array) -> list[int]:
    """Give radii that may be one and the same the same number.

    Parameters
    ----------
    radii, sd : (K,) ndarray
        Radii and their standard deviations, metres.

    Returns
    -------
    list of int
        Ascending with the radii, from 0.
    """
    order = np.argsort(radii, kind="stable")
    classes = np.zeros(len(radii), dtype=np.int64)
    for before, after in pairwise(order):
        limit = max(_SAME_SD * float(np.hypot(sd[before], sd[after])), _SAME * radii[after])
        classes[after] = classes[before] + int(radii[after] - radii[before] > limit)
    return [int(one) for one in classes]
