"""The sensor's errors in an image fit's own units: known beforehand, or measured by residuals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from strand._core import ImageFit, RopeImages
from strand.reconstruction.evidence.depth_errors import correlate_on_planes, find_depth_step
from strand.views.depth_image import DepthImage
from strand.views.sensor import Sensor

# depth is taken from discs of this part of the rope's radius
_DISC = 0.6
# the median of independent errors has a standard deviation this much larger than their mean's
_MEDIAN = 1.25
# curves follow depth: its errors are so many times as wide as residuals, and reach so many times as far
_FOLLOWED, _FARTHER = 1.4, 2.0
# a correlation that is as good as none, pixels
_ALONE = 0.01
# of neighbouring pixels that are alike their correlation is found
_MOST_ALIKE = 0.99
# least and most noise, and lengths over which errors are alike, radii; and edges' errors, pixels
_NOISE, _LENGTH, _LATERAL = (0.08, 2.0), (1.0, 8.0), (0.1, 1.0)


@dataclass(frozen=True)
class Errors:
    """Errors of ropes' depth and of masks' edges.

    Attributes
    ----------
    noise : float or None
        Standard deviation of the depth that a disc of the rope's middle shows, radii; None if it is not
        known.
    correlation : float
        A stretch of rope over which these count as one, radii.
    lateral : float
        Standard deviation of the place of a mask's edge, pixels.
    bias : float
        How much too far away ropes are seen, radii.
    """

    noise: float | None = None
    correlation: float = 3.0
    lateral: float = 0.3
    bias: float = 0.0

    @property
    def values(self) -> tuple[float | None, float, float, float]:
        """As the kernels take them."""
        return self.noise, self.correlation, self.lateral, self.bias


def neighbours_alike(taken: Sequence[DepthImage]) -> float:
    """Return how alike errors of neighbouring pixels are in flat surroundings; 0 if none are seen."""
    surroundings = [(image.depth, image.distance) for image in taken if np.isfinite(image.distance)]
    correlations, followed = correlate_on_planes(surroundings, 1)
    return min(correlations[0] + followed, _MOST_ALIKE) if correlations else 0.0


def expected_errors(sensor: Sensor, taken: Sequence[DepthImage], images: RopeImages, radius: float) -> Errors:
    """Return the errors of a known sensor's images of ropes of one radius, metres."""
    found = []
    for image, pixels in zip(taken, images.radii, strict=True):
        error = sensor.at(image.distance, image.camera.focal[0])
        share, length = _of_discs(error.correlation, float(pixels))
        found.append((error.sd * share / radius, length))
    noise, length = np.median(found, axis=0).tolist()
    usual = Errors()
    return Errors(
        float(np.clip(noise, *_NOISE)),
        float(np.clip(length, *_LENGTH)),
        sensor.lateral or usual.lateral,
        sensor.bias / radius,
    )


def measured_errors(fit: ImageFit, usual: Errors) -> Errors:
    """Return the errors that a fit's residuals show, the usual where they show nothing.

    A curve follows depth, and leaves less of its errors in the residuals; the mask's edges, which are many to
    a span of the curve, it follows hardly.
    """
    noise, length = usual.noise, usual.correlation
    if fit.scatter is not None:
        sd, stretch = fit.scatter
        noise = float(np.clip(_FOLLOWED * sd, *_NOISE))
        length = float(np.clip(_FARTHER * stretch, *_LENGTH))
    lateral = usual.lateral if fit.lateral is None else float(np.clip(fit.lateral, *_LATERAL))
    return Errors(noise, length, lateral, usual.bias)


def sensor_of(
    errors: Errors,
    fit: ImageFit,
    correlation: float | None,
    taken: Sequence[DepthImage],
    images: RopeImages,
    radius: float,
) -> Sensor:
    """Return the sensor that makes errors, with biases of a fit and a correlation in pixels.

    Without that, which takes flat surroundings, the discs' errors stand for the pixels', which are wider.
    """
    first = taken[0].depth[taken[0].mask]
    share = 1.0 if correlation is None else _of_discs(correlation, float(np.median(images.radii)))[0]
    noise = fit.noise if errors.noise is None else errors.noise
    return Sensor(
        sd=noise / share * radius,
        correlation=correlation or 0.0,
        step=find_depth_step(first[first > 0]),
        bias=float(np.median(fit.biases)) * radius,
        lateral=errors.lateral,
    )


def _of_discs(correlation: float, pixels: float) -> tuple[float, float]:
    """Return how wide errors of discs' medians are beside those of pixels, and how far they are alike, radii.

    Errors of pixels are alike as `Sensor.correlation` says, on a rope whose radius is so many pixels.
    """
    reach = max(_DISC * pixels, 1.0)
    whole = math.floor(reach)
    y, x = np.ogrid[-whole : whole + 1, -whole : whole + 1]
    disc = np.hypot(x, y) <= reach
    # how many pairs of a disc's pixels are so many rows and columns apart
    size = 4 * whole + 1
    pairs = np.rint(np.fft.irfft2(np.abs(np.fft.rfft2(disc, (size, size))) ** 2, (size, size)))
    apart = (np.arange(size) + 2 * whole) % size - 2 * whole

    def alike(away: np.ndarray) -> np.ndarray:
        return np.exp(-(away**2) / (4.0 * max(correlation, _ALONE) ** 2))

    shares = alike(apart) @ pairs / np.count_nonzero(disc) ** 2
    # longer stretches than the longest are not told apart
    far = math.ceil(min(2.0 * reach + 6.0 * correlation, 2.0 * _LENGTH[1] * pixels))
    power, *along = alike(apart + np.arange(far + 1)[:, None]) @ shares
    share = min(_MEDIAN * math.sqrt(power), 1.0)
    return share, (1.0 + 2.0 * float(sum(along)) / power) / pixels
