"""The sensor's noise along the viewing rays, and how far it reaches from pixel to pixel, from residuals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from strand._core import TubeFit
from strand.reconstruction.evidence.depth_errors import MIN_CORRELATION, correlate_on_planes, find_depth_step
from strand.reconstruction.tubes.pixels import Cameras, Grid
from strand.support.checks import Array
from strand.support.robust import robust_deviation
from strand.views.sensor import Sensor

# residuals whose rays meet the surface more flatly tell more of the edge than of the noise
_LEAST_FACING = 0.4
# lags along rows and columns, pixels
_LAGS = 8
# of residuals where no surroundings are seen
_NEAR_LAGS = 3
_MIN_DEVIATIONS = 3.0  # standard deviations of neighbours' correlation: with less they count as independent
_FULL_CORRELATION = 0.2  # of neighbours, from which on it counts in full
# fewest pairs of neighbours that say something
_FEWEST = 50
# differences of neighbours are cut off at this many standard deviations of the residuals
_OUTLIER = 4.0
# curves follow noise that reaches far: it is at most so many times as large as the residuals
_MOST_HIDDEN = 5.0
# of long noise so much of neighbours' squared differences moves the curve
_FOLLOWED = 0.4
# neighbours differ by this share of their variance at least
_LEAST_UNLIKE = 1e-3
# most of the errors' variance that a fit can have followed
_MOST_TAKEN = 0.75
# candidates of the correlation length, pixels
_LENGTHS = np.geomspace(0.2, 20.0, 200)
# half the width of what of a rope counts, in radii: there rays meet it less flatly than `_LEAST_FACING`
_HALF_WIDTH = math.sqrt(1.0 - _LEAST_FACING**2)


@dataclass(frozen=True)
class Noise:
    """The sensor's noise on the ropes.

    Attributes
    ----------
    sd : float
        Standard deviation along the viewing rays, metres.
    correlation : float
        As `Sensor.correlation`, pixels; 0 where the pixels' errors are independent.
    shared : (float, float)
        How many points count as one: for what moves a rope along the rays, and across them.
    step : float
        Distance of the depths that the sensor tells apart, metres; 0 where that is not seen.
    """

    sd: float
    correlation: float = 0.0
    shared: tuple[float, float] = (1.0, 1.0)
    step: float = 0.0

    @property
    def sensor(self) -> Sensor:
        """The same of a sensor."""
        return Sensor(sd=self.sd, correlation=self.correlation, step=self.step)


@dataclass(frozen=True, eq=False)
class _Raster:
    """Errors along the rays where the pixels are, all views in one, NaN between.

    Attributes
    ----------
    values : (P,) ndarray of float32
        Metres, rows of pixels one after the other, each row with a margin.
    places : (N,) ndarray of int64
        Where the errors are.
    width : int
        Of the rows.
    """

    values: NDArray[np.float32]
    places: NDArray[np.int64]
    width: int

    @classmethod
    def of(cls, grids: Sequence[Grid], error: Array, chosen: NDArray[np.bool_]) -> _Raster:
        width = max(grid.size[0] for grid in grids) + _LAGS
        ends = np.cumsum([grid.size[1] + _LAGS for grid in grids]) * width
        starts = [0, *ends[:-1].tolist()]
        places = np.concatenate(
            [start + grid.row * width + grid.column for start, grid in zip(starts, grids, strict=True)]
        )[chosen]
        values = np.full(int(ends[-1]) + width, np.nan, dtype=np.float32)
        values[places] = error[chosen]
        return cls(values, places, width)

    def correlations(self, lags: int, most: float) -> tuple[list[float], int, float]:
        """Correlate errors 1, 2, ... pixels apart; count neighbours, and say by how much they differ.

        The differences, cut off at `most`, are over the square root of 2: the errors' standard deviation, if
        neighbours are independent.
        """
        here = self.values[self.places]
        power = float(np.square(here).mean(dtype=np.float64))
        found, count, apart = [], 0, 0.0
        for lag in range(1, lags + 1):
            product, pairs = 0.0, 0
            for step in (lag, lag * self.width):
                there = self.values[self.places + step]
                both = ~np.isnan(there)
                one, other = here[both], there[both]
                product += float((one * other).sum(dtype=np.float64))
                pairs += len(one)
                if lag == 1:
                    difference = (one - other).clip(-most, most)
                    apart += float(np.square(difference).sum(dtype=np.float64))
            found.append(product / (pairs * power) if pairs and power else 0.0)
            count = count or pairs
        return found, count, math.sqrt(0.5 * apart / count) if count else 0.0


def expected_noise(sensor: Sensor | str, cameras: Cameras, radius: float, spacing: float) -> Noise:
    """Return the noise of a known sensor on ropes.

    Parameters
    ----------
    sensor : Sensor
    cameras : Cameras
    radius : float
        The ropes', metres.
    spacing : float
        Length of the splines' spans, in radii.

    Returns
    -------
    Noise

    Raises
    ------
    ValueError
        If the points are no image's.
    """
    assert isinstance(sensor, Sensor)
    seen = [(float(np.median(grid.depth)), grid.focal) for grid in cameras.grids.values()]
    if not seen:
        raise ValueError(
            "Config.sensor: expected views whose points lie before a camera, got points all around"
        )
    errors = [sensor.at(depth, focal) for depth, focal in seen]
    pixels = float(np.median([radius * focal / depth for depth, focal in seen]))
    return Noise(
        sd=float(np.median([error.sd for error in errors])),
        correlation=sensor.correlation,
        shared=shared_points(sensor.correlation, pixels, spacing),
        step=float(np.median([error.step for error in errors])),
    )


def measured_noise(fit: TubeFit, cameras: Cameras, spacing: float) -> Noise:
    """Measure the noise on fitted ropes.

    Neighbouring residuals say whether the pixels' errors are alike. A curve follows errors that reach as far
    as the rope is wide, and leaves little of them in the residuals. So how far they reach is taken from flat
    surroundings, where some were seen, and how large they are from differences of neighbours, which the curve
    does not change much.

    Parameters
    ----------
    fit : TubeFit
        Along the rays.
    cameras : Cameras
    spacing : float
        Length of the splines' spans, in radii.

    Returns
    -------
    Noise
        Of correlation 0 where neighbours are hardly alike.
    """
    good = fit.inlier & (fit.facing > _LEAST_FACING)
    if not good.any():
        return Noise(fit.sigma)
    error = fit.residual / fit.facing.clip(_LEAST_FACING)
    sd = robust_deviation(error[good])
    grids = cameras.grids
    if not grids:
        return Noise(sd)
    step = find_depth_step(next(iter(grids.values())).depth)
    seen = np.flatnonzero(np.isin(fit.view, list(grids)))
    raster = _Raster.of(list(grids.values()), error[seen], good[seen])
    (alike,), count, apart = raster.correlations(1, _OUTLIER * sd)
    plain = max(MIN_CORRELATION, _MIN_DEVIATIONS / math.sqrt(max(count, 1)))
    if count < _FEWEST or alike <= plain:
        return Noise(sd, step=step)
    share = min((alike - plain) / (_FULL_CORRELATION - MIN_CORRELATION), 1.0)
    around, followed = correlate_on_planes(cameras.images(), _LAGS)
    if not followed:
        # farther apart, what the curves followed is missing
        around = raster.correlations(_NEAR_LAGS, _OUTLIER * sd)[0]
    length, alike = correlation_length(around, followed)
    radius = pixel_radius(fit, cameras)
    left = max(1.0 - alike, _LEAST_UNLIKE) * (
        1.0 - followed_differences(length, radius, spacing) / len(cameras.views)
    )
    whole = min(max(apart / math.sqrt(left), sd), _MOST_HIDDEN * sd)
    along, across = shared_points(length, radius, spacing)
    return Noise(
        sd + share * (whole - sd),
        share * length,
        (1.0 + share * (along - 1.0), 1.0 + share * (across - 1.0)),
        step,
    )


def pixel_radius(fit: TubeFit, cameras: Cameras) -> float:
    """Return how long the ropes' radius is in the images, pixels, in the median of a fit's points."""
    seen = np.isin(fit.view, list(cameras.grids))
    scale = np.concatenate([grid.focal / grid.depth for grid in cameras.grids.values()])
    return float(np.median(fit.radii[fit.radius_classes[fit.curve[seen]]] * scale))


def correlation_length(correlations: Sequence[float], followed: float) -> tuple[float, float]:
    """Return how far errors reach whose residuals have some correlations.

    Parameters
    ----------
    correlations : sequence of float
        Of residuals 1, 2, ... pixels apart.
    followed : float
        Unknowns that were fitted, for each point: what is fitted follows errors, the farther they reach the
        more, and takes what residuals have in common.

    Returns
    -------
    length, alike : float
        `Sensor.correlation`, pixels, and the correlation of neighbours' errors.
    """
    lags = np.arange(1, len(correlations) + 1)
    taken = np.minimum(followed * 4.0 * math.pi * _LENGTHS**2, _MOST_TAKEN)[:, None]
    expected = (np.exp(-((lags / (2.0 * _LENGTHS[:, None])) ** 2)) - taken) / (1.0 - taken)
    best = int(((expected - correlations) ** 2).sum(axis=1).argmin())
    length, share = float(_LENGTHS[best]), float(taken[best, 0])
    return length, share + (1.0 - share) * float(correlations[0])


def followed_differences(length: float, radius: float, spacing: float) -> float:
    """Return the share of neighbours' squared differences that a curve fitted to one view follows.

    Of smoothed noise, what is longer than two spans along the rope has erf(x) - 2 x exp(-x^2) / sqrt(pi) of
    them, x being pi times the smoothing's standard deviation over the span; a part of it moves the curve.

    Parameters
    ----------
    length, radius, spacing : float
        As those of `shared_points`.

    Returns
    -------
    float
    """
    x = math.pi * length / (spacing * radius)
    return _FOLLOWED * (math.erf(x) - 2.0 * x * math.exp(-x * x) / math.sqrt(math.pi))


def shared_points(length: float, radius: float, spacing: float) -> tuple[float, float]:
    """Return how many points of a rope count as one.

    A span of the curve counts as one place at least, however far errors reach: nothing finer is fitted. What
    moves the curve across the rays has opposite signs on the rope's two sides, which errors that reach from
    one to the other do not have.

    Parameters
    ----------
    length : float
        `Sensor.correlation`, pixels.
    radius : float
        The rope's, pixels.
    spacing : float
        Length of the spline's spans, in radii.

    Returns
    -------
    along, across : float
        For what moves the rope along the rays, and across them; 1 for independent errors.
    """
    if length <= 0.0:
        return 1.0, 1.0
    reach = math.ceil(6.0 * length)
    in_row = float(np.exp(-((np.arange(-reach, reach + 1) / (2.0 * length)) ** 2)).sum())
    # of this, the part that is not finer than a span
    finest = math.pi * length / (spacing * radius)
    in_row = max(in_row * math.sqrt(math.pi) / 2.0 * math.erf(finest) / finest, 1.0)
    count = max(round(2.0 * _HALF_WIDTH * radius), 2)
    x = (np.arange(count) - 0.5 * (count - 1)) / (0.5 * count) * _HALF_WIDTH
    alike = np.exp(-(((x[:, None] - x) * radius / (2.0 * length)) ** 2))
    slope = x / np.sqrt(1.0 - x**2)
    along = in_row * float(alike.sum()) / count
    across = in_row * float(slope @ alike @ slope) / float(slope @ slope)
    return max(along, 1.0), max(across, 1.0)
