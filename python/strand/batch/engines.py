"""Parts that the engines share: the number of attempts, the environment of processes, and their error."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from strand._core import StrandError

MAX_ATTEMPTS = 3
"""Number of processes that may die on a unit before the batch gives it up."""


class EngineError(StrandError, RuntimeError):
    """Processes do not start, Ray fails, or a machine has another version of strand."""


@contextmanager
def set_environment(variables: Mapping[str, str]) -> Iterator[None]:
    """Set environment variables while processes start, and restore them at the end."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
