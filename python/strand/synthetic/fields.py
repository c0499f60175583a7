"""Smooth random images and dilated masks, the building blocks of imitated cameras and masks."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import Array, check_nonnegative

_MAX_PIXELS = 64.0  # pixels: largest smoothness or window; more is a mistake, and slow
_GAUSSIAN_REACH = 2.5  # standard deviations: a Gaussian is zero beyond this


def check_pixels(name: str, value: float) -> float:
    """Return a length in an image, checked: from 0 to 64 pixels."""
    length = check_nonnegative(name, value)
    if length > _MAX_PIXELS:
        raise ValueError(f"{name}: expected at most {_MAX_PIXELS:g} pixels, got {length:g}")
    return length


def draw_field(shape: tuple[int, int], smoothness: float, rng: np.random.Generator) -> Array:
    """Return (H, W) normal numbers with mean 0 and variance 1, smoothed with a Gaussian.

    Parameters
    ----------
    shape : (int, int)
        Height and width, pixels.
    smoothness : float
        Standard deviation of the Gaussian, pixels; 0 for independent numbers.
    rng : numpy.random.Generator
        The random number generator.
    """
    height, width = shape
    reach = math.ceil(_GAUSSIAN_REACH * smoothness)
    noise = rng.normal(size=(height + 2 * reach, width + 2 * reach))
    if reach == 0:
        return noise
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / smoothness) ** 2)
    kernel /= np.sqrt((kernel**2).sum())  # keeps the variance at 1
    rows, result = np.zeros((height, width + 2 * reach)), np.zeros(shape)
    for i, weight in enumerate(kernel):
        rows += weight * noise[i : i + height]
    for i, weight in enumerate(kernel):
        result += weight * rows[:, i : i + width]
    return result


def dilate(mask: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """Return an (H, W) mask of the pixels with a masked one within `reach` rows and columns."""
    height, width = mask.shape
    around = np.pad(mask, reach)
    rows, result = np.zeros((height, width + 2 * reach), dtype=bool), np.zeros(mask.shape, dtype=bool)
    for i in range(2 * reach + 1):
        rows |= around[i : i + height]
    for i in range(2 * reach + 1):
        result |= rows[:, i : i + width]
    return result
