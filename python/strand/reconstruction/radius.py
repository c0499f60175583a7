"""The ropes' radii: given by the caller, or estimated from the ropes' apparent width."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

import strand._core as _core
from strand._core import NotEnoughDataError
from strand.config import Known
from strand.support.checks import Array, check_radius, refuse_masks_and_units
from strand.views.box import Bounds
from strand.views.view import View, check_views

_MAX_RADIUS = 20e-3  # metres: the largest radius that is estimated
_USUAL_RADIUS = 0.005  # metres: assumed where no radius is known

_PLACES = 400  # places of each view at which the width of a strip is measured
_MIN_STRIPS = 10  # measured widths that a radius needs
_KERNEL = 0.08  # standard deviation of the kernel of their density, of the logarithm of the radius
_STEP = 0.01  # spacing at which the density is evaluated, of the logarithm of the radius
_MIN_SPACING = 0.3  # between modes of the density, of the logarithm of the radius
_MIN_MODE = 0.1  # share of the highest mode: lower modes are no ropes
_WIDTH_SD = 0.05  # radii: standard deviation of a strip's width, as ropes lie beside each other
_PULL = 0.2  # of the noise's variance over the radius: how far noise pulls a fitted radius
_SAME_SHARE = 0.05  # share of a radius: closer radii are one
_SAME_SD = 3.0  # standard deviations: closer radii are one


@dataclass(frozen=True, eq=False)
class Radii:
    """The radii of the ropes before the fit, and how well they are known.

    Attributes
    ----------
    values, sd : (K,) ndarray
        The radius of each class of ropes and its standard deviation, metres.
    free : bool
        Whether the caller did not give them, and the data determine them.
    held : bool
        Whether the data cannot determine them.
    """

    values: Array
    sd: Array
    free: bool
    held: bool = False

    @property
    def prior(self) -> Array | None:
        """(K, 2) Means and standard deviations for the fit, metres; None if the radii are held."""
        return None if self.held else np.column_stack([self.values, self.sd])

    def select(self, numbers: Sequence[int]) -> Radii:
        """Return some of the classes."""
        chosen = list(numbers)
        return replace(self, values=self.values[chosen], sd=self.sd[chosen])

    def add_parts(self) -> Radii:
        """Return the radii with their halves and thirds."""
        values = np.concatenate([self.values, self.values / 2.0, self.values / 3.0])
        order = np.argsort(values)
        return replace(self, values=values[order], sd=np.concatenate([self.sd, self.sd, self.sd])[order])

    def widen(self) -> Radii:
        """Return the radii with standard deviations so wide that each may be any other of them."""
        return replace(self, sd=np.full(len(self.values), float(np.ptp(self.values))))

    def find_nearest(self, fitted: Array) -> list[int]:
        """Return the number of the nearest class for each fitted radius, metres."""
        return [int(np.abs(np.log(self.values / value)).argmin()) for value in fitted]

    def cap(self, sd: Array) -> Array:
        """Return standard deviations of fitted radii, metres, at most those that the caller gave."""
        return sd if self.free else np.minimum(sd, self.sd)

    @classmethod
    def from_caller(cls, radius: float | Sequence[float], known: Known | None = None) -> Radii:
        """Check radii that the caller gives, metres.

        Raises
        ------
        TypeError
            If one is not a number.
        ValueError
            If one is not finite and positive, or there is none.
        """
        refuse_masks_and_units("radius", radius)
        each = np.atleast_1d(np.asarray(radius, dtype=object)).tolist()
        values = np.array(sorted({check_radius(one) for one in each}))
        if not len(values):
            raise ValueError("radius: expected a number of metres or several, got none")
        known = Known() if known is None else known
        return cls(values, known.radius_sd * values, free=False)


def estimate_radius(views: Sequence[View], bounds: Bounds | None = None) -> tuple[Array, Array]:
    """Estimate the ropes' radii from how wide they look.

    A camera sees a stretch of rope as a strip. Across the strip, the variance of the points is r^2 / 3,
    whatever the noise in depth. Each view gives several hundred such estimates; their modes are the radii.
    Ropes that lie side by side look like one wide rope and make modes of their own. So there may be more
    modes than radii.

    Parameters
    ----------
    views : sequence of View
        Views of ropes alone.
    bounds : pair of (3,) array_like, or Box, optional
        The extraction range, metres: low and high corner of a box along the axes of the world frame, or a
        `strand.Box`, which may be turned. Views are cropped to it.

    Returns
    -------
    radii, sd : (K,) ndarray
        Ascending radii and their standard deviations, metres: 5 % and half the width of a pixel, as the
        outermost pixels may be missing or mixed with the background.

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If there are no views, or `bounds` is out of range.
    strand.NotEnoughDataError
        If the views show no strips.

    Examples
    --------
    >>> import strand
    >>> scene = strand.synthetic.scene("s", views=3)
    >>> radii, sd = strand.estimate_radius(scene.views, scene.bounds)
    >>> bool(abs(radii[0] - scene.radius) < 3 * sd[0])
    True
    """
    views = check_views(views)
    if bounds is not None:
        views = tuple(view.crop(bounds) for view in views)
    return measure_radii(views)


def measure_radii(views: Sequence[View]) -> tuple[Array, Array]:
    """Estimate radii as `estimate_radius` does, in views of ropes alone."""
    found = [
        _core.estimate_radii(view.world_points, view.viewpoint, _MAX_RADIUS, _PLACES)
        for view in views
        if len(view.points)
    ]
    strips = np.concatenate([np.empty((0, 2)), *found])
    if len(strips) < _MIN_STRIPS:
        raise NotEnoughDataError("views: no stretch of rope is clear enough to measure its radius")
    size = np.log(strips[:, 0])
    places = np.arange(size.min() - _STEP, size.max() + 2.0 * _STEP, _STEP)
    density = np.exp(-0.5 * ((places[:, None] - size) / _KERNEL) ** 2).sum(axis=1)
    modes: list[float] = []
    for i in np.argsort(-density, kind="stable"):
        if density[i] < _MIN_MODE * density.max():
            break
        peak = density[i] >= density[max(i - 1, 0)] and density[i] >= density[min(i + 1, len(places) - 1)]
        if peak and all(abs(places[i] - mode) > _MIN_SPACING for mode in modes):
            modes.append(float(places[i]))
    near = np.abs(size[:, None] - np.sort(modes)) < _MIN_SPACING / 2.0
    radii, footprint = np.array([np.median(strips[close], axis=0) for close in near.T]).T
    return radii, np.hypot(_WIDTH_SD * radii, 0.5 * footprint)


def guess_radius(views: Sequence[View]) -> float | None:
    """Return the least radius that ropes in views of ropes alone seem to have, metres; None if unclear."""
    try:
        return float(measure_radii(views)[0][0])
    except NotEnoughDataError:
        return None


def find_thinnest(radii: Radii | None) -> float:
    """Return the least radius that the caller gave, or a usual one, metres."""
    return _USUAL_RADIUS if radii is None else float(radii.values.min())


def add_noise_deviation(fitted: Array, sd: Array, sigma: float) -> Array:
    """Return standard deviations of fitted radii that include how far noise pulls them, metres.

    The outlier filter takes points from the silhouette and mixed pixels add some. Neither shows in the
    residuals.

    Parameters
    ----------
    fitted, sd : (K,) ndarray
        Radii, and their standard deviations by the fit, metres.
    sigma : float
        Standard deviation of the fit's residuals, metres.
    """
    return np.hypot(sd, _PULL * sigma**2 / fitted)


def group_radii(radii: Array, sd: Array) -> list[int]:
    """Return the class of each radius, from 0 and ascending with the radii: those that may be one share it.

    Parameters
    ----------
    radii, sd : (K,) ndarray
        Radii and their standard deviations, metres.
    """
    order = np.argsort(radii, kind="stable")
    classes = np.zeros(len(radii), dtype=np.int64)
    for before, after in pairwise(order):
        limit = max(_SAME_SD * float(np.hypot(sd[before], sd[after])), _SAME_SHARE * radii[after])
        classes[after] = classes[before] + int(radii[after] - radii[before] > limit)
    return [int(one) for one in classes]
