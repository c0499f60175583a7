"""What engines have in common: how often a unit is tried, the environment of processes, an error."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from strand._core import StrandError

TRIES = 3
"""So many processes may die of a unit before it is given up."""


class EngineError(StrandError, RuntimeError):
    """Processes do not start, Ray cannot go on, or a machine has another version of strand."""


@contextmanager
def environment(values: Mapping[str, str]) -> Iterator[None]:
    """Have variables of the environment as given while processes start, and as before at the end."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
