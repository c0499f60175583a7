"""Times in seconds, and in whole nanoseconds as recordings and messages have them."""

from __future__ import annotations

import math

SECOND = 10**9
"""Nanoseconds."""


def count_nanoseconds(seconds: float) -> int:
    """Return the whole number of nanoseconds nearest to a time."""
    whole = math.floor(seconds)
    # the difference is exact: a product of the whole time would lose digits
    return whole * SECOND + round((seconds - whole) * SECOND)
