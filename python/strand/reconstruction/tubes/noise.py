"""Measure the sensor's noise along the viewing rays, and how far it reaches from pixel to pixel."""

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
from strand.support.robust import estimate_deviation
from strand.views.sensor import Sensor

_MIN_FACING = 0.4  # cosine between ray and surface normal: flatter residuals show the edge, not the noise
_LAGS = 8  # pixels: largest lag along rows and columns
_NEAR_LAGS = 3  # pixels: the same for residuals, where no flat surroundings are seen
_MIN_DEVIATIONS = 3.0  # standard deviations of neighbours' correlation: with less they count as independent
_FULL_CORRELATION = 0.2  # of neighbours, from which on it counts in full
_MIN_PAIRS = 50  # pairs of neighbours: fewer give no correlation
_MAX_DIFFERENCE = 4.0  # standard deviations of the residuals: neighbours' differences are cut off here
_MAX_HIDDEN = 5.0  # times the residuals: noise that a curve follows is not larger
_FOLLOWED = 0.4  # share of neighbours' squared differences in long noise that moves the curve
_MIN_DIFFERENCE = 1e-3  # share of their variance by which neighbours differ at least
_MAX_TAKEN = 0.75  # share of the errors' variance that a fit can have followed
_LENGTHS = np.geomspace(0.2, 20.0, 200)  # pixels: candidates of the correlation length
_HALF_WIDTH = math.sqrt(1.0 - _MIN_FACING**2)  # radii: of the strip of a rope with less flat rays


@dataclass(frozen=True)
class Noise:
    """The sensor's noise on the ropes.

    Attributes
    ----------
    sd : float
        Standard deviation along the viewing rays, metres.
    correlation : float
        As `Sensor.correlation`, pixels; 0 if the pixels' errors are independent.
    shared : (float, float)
        Number of points that count as one, for motions of a rope along the rays and across them.
    step : float
        Distance between the sensor's depth values, metres; 0 if it is not known.
    """

    sd: float
    correlation: float = 0.0
    shared: tuple[float, float] = (1.0, 1.0)
    step: float = 0.0

    @property
    def sensor(self) -> Sensor:
        """A sensor with this noise."""
        return Sensor(sd=self.sd, correlation=self.correlation, step=self.step)


@dataclass(frozen=True, eq=False)
class _Raster:
    """Errors along the rays in one image of all views, NaN between the pixels.

    Attributes
    ----------
    values : (P,) ndarray of float32
        Metres, rows of pixels one after the other, each row with a margin.
    places : (N,) ndarray of int64
        Indices of the errors.
    width : int
        Pixels of a row.
    """

    values: NDArray[np.float32]
    places: NDArray[np.int64]
    width: int

    @classmethod
    def from_grids(cls, grids: Sequence[Grid], error: Array, chosen: NDArray[np.bool_]) -> _Raster:
        width = max(grid.size[0] for grid in grids) + _LAGS
        ends = np.cumsum([grid.size[1] + _LAGS for grid in grids]) * width
        starts = [0, *ends[:-1].tolist()]
        places = np.concatenate(
            [start + grid.row * width + grid.column for start, grid in zip(starts, grids, strict=True)]
        )[chosen]
        values = np.full(int(ends[-1]) + width, np.nan, dtype=np.float32)
        values[places] = error[chosen]
        return cls(values, places, width)

    def correlate(self, lags: int, most: float) -> tuple[list[float], int, float]:
        """Correlate errors 1, 2, ... pixels from each other; also count and compare direct neighbours.

        The last value is the root mean square of their differences, cut off at `most`, over the square root
        of 2: the errors' standard deviation, if neighbours are independent.
        """
        here = self.values[self.places]
        power = float(np.square(here).mean(dtype=np.float64))
        found, count, squares = [], 0, 0.0
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
                    squares += float(np.square(difference).sum(dtype=np.float64))
            found.append(product / (pairs * power) if pairs and power else 0.0)
            count = count or pairs
        return found, count, math.sqrt(0.5 * squares / count) if count else 0.0


def expect_noise(sensor: Sensor | str, cameras: Cameras, radius: float, spacing: float) -> Noise:
    """Return the noise of a known sensor on ropes of a radius, metres; splines have spans of `spacing` radii.

    Raises ValueError if the points do not come from images.
    """
    assert isinstance(sensor, Sensor)
    seen = [(float(np.median(grid.depth)), grid.focal) for grid in cameras.grids.values()]
    if not seen:
        raise ValueError(
            "Config.sensor: expected views whose points lie in front of a camera, got points all around it"
        )
    errors = [sensor.at(depth, focal) for depth, focal in seen]
    pixels = float(np.median([radius * focal / depth for depth, focal in seen]))
    return Noise(
        sd=float(np.median([error.sd for error in errors])),
        correlation=sensor.correlation,
        shared=count_shared_points(sensor.correlation, pixels, spacing),
        step=float(np.median([error.step for error in errors])),
    )


def measure_noise(fit: TubeFit, cameras: Cameras, spacing: float) -> Noise:
    """Measure the noise of a fit along the rays; splines have spans of `spacing` radii.

    Correlated residuals of neighbours show that the pixels' errors are correlated. A curve follows errors
    that reach as far as the rope is wide, so that residuals hide them. How far they reach is measured on flat
    surroundings, if there are any. How large they are follows from differences of neighbours, which the curve
    hardly changes.
    """
    good = fit.inlier & (fit.facing > _MIN_FACING)
    if not good.any():
        return Noise(fit.sigma)
    error = fit.residual / fit.facing.clip(_MIN_FACING)
    sd = estimate_deviation(error[good])
    grids = cameras.grids
    if not grids:
        return Noise(sd)
    step = find_depth_step(next(iter(grids.values())).depth)
    seen = np.flatnonzero(cameras.have_grids(fit.view))
    raster = _Raster.from_grids(list(grids.values()), error[seen], good[seen])
    (correlation,), count, difference = raster.correlate(1, _MAX_DIFFERENCE * sd)
    least = max(MIN_CORRELATION, _MIN_DEVIATIONS / math.sqrt(max(count, 1)))
    if count < _MIN_PAIRS or correlation <= least:
        return Noise(sd, step=step)
    share = min((correlation - least) / (_FULL_CORRELATION - MIN_CORRELATION), 1.0)
    around, followed = correlate_on_planes(cameras.make_images(), _LAGS)
    if not followed:
        # at larger lags, the errors that the curves followed are missing
        around = raster.correlate(_NEAR_LAGS, _MAX_DIFFERENCE * sd)[0]
    length, correlation = find_correlation_length(around, followed)
    radius = measure_pixel_radius(fit, cameras)
    left = max(1.0 - correlation, _MIN_DIFFERENCE) * (
        1.0 - estimate_followed_share(length, radius, spacing) / len(cameras.views)
    )
    whole = min(max(difference / math.sqrt(left), sd), _MAX_HIDDEN * sd)
    along, across = count_shared_points(length, radius, spacing)
    return Noise(
        sd + share * (whole - sd),
        share * length,
        (1.0 + share * (along - 1.0), 1.0 + share * (across - 1.0)),
        step,
    )


def measure_pixel_radius(fit: TubeFit, cameras: Cameras) -> float:
    """Return the median radius of the ropes in the images at a fit's points, pixels."""
    seen = cameras.have_grids(fit.view)
    scale = np.concatenate([grid.focal / grid.depth for grid in cameras.grids.values()])
    return float(np.median(fit.radii[fit.radius_classes[fit.curve[seen]]] * scale))


def find_correlation_length(correlations: Sequence[float], followed: float) -> tuple[float, float]:
    """Return `Sensor.correlation`, pixels, and the correlation of neighbours' errors.

    Parameters
    ----------
    correlations : sequence of float
        Correlations of residuals 1, 2, ... pixels from each other.
    followed : float
        Fitted unknowns per point. A fit follows errors, the more the farther they reach, and so lowers the
        correlations of its residuals.
    """
    lags = np.arange(1, len(correlations) + 1)
    taken = np.minimum(followed * 4.0 * math.pi * _LENGTHS**2, _MAX_TAKEN)[:, None]
    expected = (np.exp(-((lags / (2.0 * _LENGTHS[:, None])) ** 2)) - taken) / (1.0 - taken)
    best = int(((expected - correlations) ** 2).sum(axis=1).argmin())
    length, share = float(_LENGTHS[best]), float(taken[best, 0])
    return length, share + (1.0 - share) * float(correlations[0])


def estimate_followed_share(length: float, radius: float, spacing: float) -> float:
    """Return the share of neighbours' squared differences that a curve fitted to one view follows.

    Let x be pi times the smoothing's standard deviation over the span. In smoothed noise, waves longer than
    two spans along the rope hold the share erf(x) - 2 x exp(-x^2) / sqrt(pi) of the squared differences. A
    part of these waves moves the curve. The arguments are those of `count_shared_points`.
    """
    x = math.pi * length / (spacing * radius)
    return _FOLLOWED * (math.erf(x) - 2.0 * x * math.exp(-x * x) / math.sqrt(math.pi))


def count_shared_points(length: float, radius: float, spacing: float) -> tuple[float, float]:
    """Return how many points of a rope count as one, for its motion along the rays and across them.

    The points of a span count as one place at least, however far errors reach, as nothing finer is fitted.
    Errors that move the curve across the rays have opposite signs on the rope's two sides, unlike errors that
    reach from one side to the other. Independent errors give 1.

    Parameters
    ----------
    length : float
        `Sensor.correlation`, pixels.
    radius : float
        The rope's radius, pixels.
    spacing : float
        Length of the spline's spans, radii.
    """
    if length <= 0.0:
        return 1.0, 1.0
    reach = math.ceil(6.0 * length)
    in_row = float(np.exp(-((np.arange(-reach, reach + 1) / (2.0 * length)) ** 2)).sum())
    # the part of it that is not finer than a span
    finest = math.pi * length / (spacing * radius)
    in_row = max(in_row * math.sqrt(math.pi) / 2.0 * math.erf(finest) / finest, 1.0)
    count = max(round(2.0 * _HALF_WIDTH * radius), 2)
    x = (np.arange(count) - 0.5 * (count - 1)) / (0.5 * count) * _HALF_WIDTH
    correlation = np.exp(-(((x[:, None] - x) * radius / (2.0 * length)) ** 2))
    slope = x / np.sqrt(1.0 - x**2)
    along = in_row * float(correlation.sum()) / count
    across = in_row * float(slope @ correlation @ slope) / float(slope @ slope)
    return max(along, 1.0), max(across, 1.0)
