"""Values that no argument of a kind takes, and what answers hold."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

HUGE = 10**5000  # more digits than Python writes
_SPECIAL = (float("nan"), float("inf"), float("-inf"), HUGE, -HUGE)
_NO_NUMBERS = (
    True,
    np.True_,
    np.array(True),
    "1",
    b"1",
    1j,
    np.ma.masked,
    np.ma.masked_array(1.0),
    np.datetime64("2020"),
    object(),
)


def list_wrong(value: Any) -> Iterator[Any]:
    """Yield values that an argument does not take that takes a valid one; None too."""
    yield None
    if isinstance(value, (bool, np.bool_)):
        yield from (2, "yes", 0.5, float("nan"), np.ma.masked, [])
    elif isinstance(value, int):
        yield from (*_SPECIAL, *_NO_NUMBERS, 1.5, [[1]])
    elif isinstance(value, float):
        yield from (*_SPECIAL, *_NO_NUMBERS, [[1.0]], np.ones((2, 2)))
    elif isinstance(value, (str, Path)):
        yield from (5, b"x", True, 1.5, ["x"], *([""] if isinstance(value, Path) else []))
    elif isinstance(value, np.ndarray):
        yield from _list_wrong_arrays(value)
    elif isinstance(value, (list, tuple)) and value:
        yield from (5, HUGE, float("nan"), "x", True)
        for i, entry in enumerate(value):
            for wrong in list_wrong(entry):
                yield type(value)((*value[:i], wrong, *value[i + 1 :]))
    else:
        yield from (5, True, HUGE, float("nan"), "x")


def _list_wrong_arrays(array: np.ndarray) -> Iterator[Any]:
    mask = np.zeros(array.shape, bool)
    mask.flat[-1:] = True
    yield np.ma.masked_array(array, mask)
    yield np.ma.masked_array(array)
    if array.ndim > 1:
        yield list(np.ma.masked_array(array, mask))
    yield from (
        "x",
        b"x",
        True,
        object(),
        HUGE,
        [HUGE] * len(array),
        array.astype(str),
        array.astype(complex),
    )
    if array.size:
        yield array[None, ..., None]
    if array.dtype.kind != "b":
        yield np.ones(array.shape, bool)


def describe(value: Any) -> Iterator[Any]:
    """Yield the parts of an answer in a form that can be compared; times that work took are left out."""
    if isinstance(value, np.ndarray):
        yield (str(value.dtype), value.shape, value.tobytes())
    elif dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            if field.name not in ("timings", "_stage"):
                yield field.name
                yield from describe(getattr(value, field.name))
    elif isinstance(value, dict):
        for key, entry in value.items():
            yield key
            yield from describe(entry)
    elif isinstance(value, (list, tuple, Iterator)):
        for entry in value:
            yield from describe(entry)
    elif isinstance(value, (str, bytes, int, float, Path, type(None))):
        yield repr(value)
    else:
        yield type(value)
        shown = [name for name in dir(type(value)) if name[0] != "_"]
        for name in shown if type(value).__module__.startswith("strand") else ():
            if not callable(entry := getattr(value, name)):
                yield from describe(entry)


def is_optional(parameter: inspect.Parameter) -> bool:
    """Tell whether an argument may be None."""
    return parameter.default is None or "None" in str(parameter.annotation)
