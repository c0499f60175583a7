"""Pictures of the documentation against those that programs draw today."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

SIZE = (200, 200)  # pixels at which pictures are compared: fonts and smoothed edges hardly count
MAX_RESIZED = 0.02  # of width and height, which depend on fonts
MAX_DIFFERENCE = 3.0  # grey levels of 255, root mean square


def compare_pictures(one: Path, other: Path) -> float:
    """Return the root mean square of the differences of two pictures, in grey levels; inf if sizes differ."""
    first, second = (Image.open(path).convert("RGB") for path in (one, other))
    if np.abs(np.divide(first.size, second.size) - 1.0).max() > MAX_RESIZED:
        return float("inf")
    small = [np.asarray(made.resize(SIZE, Image.Resampling.BOX), dtype=float) for made in (first, second)]
    return float(np.sqrt(np.mean((small[0] - small[1]) ** 2)))
