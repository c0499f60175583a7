"""What engines have in common: how often a unit is tried, and the error of those that cannot work."""

from __future__ import annotations

from strand._core import StrandError

TRIES = 3
"""So many processes may die of a unit before it is given up."""


class EngineError(StrandError, RuntimeError):
    """Processes do not start, Ray cannot go on, or a machine has another version of strand."""
