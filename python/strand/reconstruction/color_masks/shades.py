"""Differences of colours in Lab from others in more or less light."""

from __future__ import annotations

import numpy as np

from strand.support.checks import Array

BLACK = -16.0  # Lab: light of black on lines of one hue
TABLE_SHADE = (0.72, 1.05)  # the table's light in shadows, third root


def measure_from_line(pixels: Array, colors: Array, shade: tuple[float, float]) -> Array:
    """Return (N,) differences of (N, 3) colours from others in more or less light."""
    black = np.array([BLACK, 0.0, 0.0])
    full, own = colors - black, pixels - black
    part = (own * full).sum(axis=1) / np.maximum((full * full).sum(axis=1), 1e-9)
    return np.asarray(np.linalg.norm(own - np.clip(part, *shade)[:, None] * full, axis=1))
