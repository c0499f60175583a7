"""Smooth random images, and pixels near others: what imitated cameras and masks are made of."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import Array, check_nonnegative

_LARGEST = 64.0  # pixels, the greatest smoothness and the widest window: more is a mistake, and slow

_CUT = 2.5  # standard deviations at which a Gaussian is cut off


def pixels(name: str, value: float) -> float:
    """Return a length in an image, not negative and at most 64 pixels."""
    length = check_nonnegative(name, value)
    if length > _LARGEST:
        raise ValueError(f"{name}: expected at most {_LARGEST:g} pixels, got {length:g}")
    return length


def field(shape: tuple[int, int], smoothness: float, rng: np.random.Generator) -> Array:
    """(H, W) Normal numbers with mean 0 and variance 1, smoothed with a Gaussian.

    Parameters
    ----------
    shape : (int, int)
        Height and width, pixels.
    smoothness : float
        Standard deviation of the Gaussian, pixels; 0 for numbers that do not depend on each other.
    rng : numpy.random.Generator
        The source of chance.
    """
    height, width = shape
    reach = math.ceil(_CUT * smoothness)
    chance = rng.normal(size=(height + 2 * reach, width + 2 * reach))
    if reach == 0:
        return chance
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / smoothness) ** 2)
    kernel /= np.sqrt((kernel**2).sum())  # keeps the variance
    rows, result = np.zeros((height, width + 2 * reach)), np.zeros(shape)
    for i, weight in enumerate(kernel):
        rows += weight * chance[i : i + height]
    for i, weight in enumerate(kernel):
        result += weight * rows[:, i : i + width]
    return result


def spread(chosen: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """(H, W) Pixels with a chosen one within so many rows and columns."""
    height, width = chosen.shape
    around = np.pad(chosen, reach)
    rows, result = np.zeros((height, width + 2 * reach), dtype=bool), np.zeros(chosen.shape, dtype=bool)
    for i in range(2 * reach + 1):
        rows |= around[i : i + height]
    for i in range(2 * reach + 1):
        result |= rows[:, i : i + width]
    return result
