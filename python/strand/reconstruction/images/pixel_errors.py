"""The sensor's errors in the units of an image fit: given by the caller, or measured by residuals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import strand._core as _core
from strand._core import ImageFit, RopeImages
from strand.reconstruction.evidence.depth_errors import correlate_on_planes, find_depth_step
from strand.views.depth_image import DepthImage
from strand.views.sensor import Sensor

CONFUSING_CORRELATION = 0.5  # of neighbouring pixels: errors that are more correlated look like ropes
_DISC = 0.6  # radii: radius of the discs whose median depth is taken
_MEDIAN_SD = 1.25  # standard deviation of the median of independent errors over that of their mean
_FOLLOWED = 1.4  # width of depth's errors over that of their residuals: curves follow errors
_FOLLOWED_LENGTH = 2.0  # length of depth's correlated errors over that of residuals
_MIN_CORRELATION = 0.01  # pixels: a shorter correlation is none
_MAX_NEIGHBOR_CORRELATION = 0.99  # of neighbouring pixels
_NOISE_RANGE = (0.08, 2.0)  # radii
_LENGTH_RANGE = (1.0, 8.0)  # radii over which errors are correlated
_LATERAL_RANGE = (0.1, 1.0)  # pixels: errors of masks' edges


@dataclass(frozen=True)
class Errors:
    """Errors of ropes' depth and of masks' edges, as kernels take them.

    Attributes
    ----------
    noise : float or None
        Standard deviation of the median depth of a disc on a rope's middle, radii; None if unknown.
    correlation : float
        Length of rope over which depths count as one, radii.
    lateral : float
        Standard deviation of the place of a mask's edge, pixels.
    bias : float
        Depth minus its true value, radii.
    """

    noise: float | None = None
    correlation: float = 3.0
    lateral: float = 0.3
    bias: float = 0.0

    @property
    def values(self) -> tuple[float | None, float, float, float]:
        """The errors as kernels take them."""
        return self.noise, self.correlation, self.lateral, self.bias


def correlate_neighbors(taken: Sequence[DepthImage]) -> float:
    """Return the correlation of neighbouring pixels' errors in flat surroundings; 0 without any."""
    surroundings = [(image.depth, image.distance) for image in taken if np.isfinite(image.distance)]
    correlations, followed = correlate_on_planes(surroundings, 1)
    return min(correlations[0] + followed, _MAX_NEIGHBOR_CORRELATION) if correlations else 0.0


def convert_sensor(
    sensor: Sensor, given: Sequence[DepthImage], images: RopeImages, radius: float, factor: int
) -> Errors:
    """Return the errors of a sensor's images of ropes of one radius, metres.

    The kernels' images are magnified by `factor`.
    """
    found = []
    for image, pixels in zip(given, images.radii, strict=True):
        error = sensor.at(image.distance, image.camera.focal[0])
        share, length = _average_over_discs(error.correlation, float(pixels) / factor)
        found.append((error.sd * share / radius, length))
    noise, length = np.median(found, axis=0).tolist()
    usual = Errors()
    return Errors(
        float(np.clip(noise, *_NOISE_RANGE)),
        float(np.clip(length, *_LENGTH_RANGE)),
        factor * (sensor.lateral or usual.lateral),
        sensor.bias / radius,
    )


def measure_errors(fit: ImageFit, usual: Errors, factor: int) -> Errors:
    """Return the errors that a fit's residuals show, and the usual ones where they show none.

    The kernels' images are magnified by `factor`.

    A curve follows errors of depth, and leaves less of them in the residuals. It hardly follows those of the
    mask's edges, of which a span of the curve has many.
    """
    noise, length = usual.noise, usual.correlation
    if fit.scatter is not None:
        sd, stretch = fit.scatter
        noise = float(np.clip(_FOLLOWED * sd, *_NOISE_RANGE))
        length = float(np.clip(_FOLLOWED_LENGTH * stretch, *_LENGTH_RANGE))
    lateral = usual.lateral
    if fit.lateral is not None:
        lateral = factor * float(np.clip(fit.lateral / factor, *_LATERAL_RANGE))
    return Errors(noise, length, lateral, usual.bias)


def describe_sensor(
    errors: Errors,
    fit: ImageFit,
    correlation: float | None,
    given: Sequence[DepthImage],
    images: RopeImages,
    radius: float,
    factor: int,
) -> Sensor:
    """Return the sensor whose images have some errors, a fit's biases and a correlation in pixels.

    Without a correlation, the errors of discs stand for those of pixels, which are wider. The kernels' images
    are magnified by `factor`.
    """
    first = given[0].mask_depths
    share = 1.0
    if correlation is not None:
        share, _ = _average_over_discs(correlation, _core.find_median(images.radii) / factor)
    noise = fit.noise if errors.noise is None else errors.noise
    return Sensor(
        sd=noise / share * radius,
        correlation=correlation or 0.0,
        step=find_depth_step(first[first > 0]),
        bias=_core.find_median(fit.biases) * radius,
        lateral=errors.lateral / factor,
    )


def _average_over_discs(correlation: float, pixels: float) -> tuple[float, float]:
    """Return the width of errors of discs' medians over that of pixels, and their correlation length, radii.

    Parameters
    ----------
    correlation : float
        Of pixels' errors, as `Sensor.correlation`.
    pixels : float
        The ropes' radius.
    """
    reach = max(_DISC * pixels, 1.0)
    pairs = _core.count_disc_pairs(reach)
    half = len(pairs) // 2
    distances = np.concatenate([np.arange(half + 1), np.arange(-half, 0)])

    def correlate(away: np.ndarray) -> np.ndarray:
        return np.exp(-(away**2) / (4.0 * max(correlation, _MIN_CORRELATION) ** 2))

    shares = correlate(distances) @ pairs / pairs[0, 0] ** 2
    # lengths beyond the longest that counts make no difference
    far = math.ceil(min(2.0 * reach + 6.0 * correlation, 2.0 * _LENGTH_RANGE[1] * pixels))
    power, *along = correlate(distances + np.arange(far + 1)[:, None]) @ shares
    share = min(_MEDIAN_SD * math.sqrt(power), 1.0)
    return share, (1.0 + 2.0 * float(sum(along)) / power) / pixels
