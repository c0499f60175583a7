"""Standard deviations that outliers hardly change."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

DEVIATION_OF_MEDIAN = 1.4826  # standard deviation of normal errors over the median of their absolute values


def robust_deviation(errors: NDArray[np.floating[Any]]) -> float:
    """Return the standard deviation of normal errors with this median absolute value; 0 if there are none."""
    return DEVIATION_OF_MEDIAN * float(np.median(np.abs(errors))) if len(errors) else 0.0
