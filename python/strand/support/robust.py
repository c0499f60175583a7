"""Estimate standard deviations from medians, which outliers hardly change."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

import strand._core as _core

DEVIATION_OF_MEDIAN = 1.4826  # standard deviation of normal errors, over the median of their sizes


def estimate_deviation(errors: NDArray[np.floating[Any]]) -> float:
    """Return a robust standard deviation of errors about zero; 0 without errors."""
    return DEVIATION_OF_MEDIAN * _core.find_median(np.abs(errors)) if len(errors) else 0.0
