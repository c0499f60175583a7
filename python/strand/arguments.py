"""Single arguments of public functions, checked: errors name the argument and what is accepted."""

from __future__ import annotations

import math
import operator
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def number(name: str, value: Any) -> float:
    """Return `value` as a finite float; arrays without a dimension count as numbers.

    Raises
    ------
    TypeError
        If it is not a real number.
    ValueError
        If it is not finite.
    """
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise TypeError(f"{name}: expected a number, got {type(value).__name__}")
    try:
        found = float(value)
    except OverflowError:
        found = math.inf
    if not math.isfinite(found):
        raise ValueError(f"{name}: expected a finite number, got {found}")
    return found


def positive(name: str, value: Any, most: float = math.inf) -> float:
    """Return `value` as a float above zero, and not above `most`.

    Raises
    ------
    TypeError
        If it is not a real number.
    ValueError
        If it is zero, negative, too large or not finite.
    """
    try:
        found = number(name, value)
    except ValueError:
        found = math.nan
    if not found > 0:
        raise ValueError(f"{name}: expected a positive number, got {value}")
    if found > most:
        raise ValueError(f"{name}: expected at most {most:g}, got {value}")
    return found


def not_negative(name: str, value: Any) -> float:
    """Return `value` as a float of zero or above.

    Raises
    ------
    TypeError
        If it is not a real number.
    ValueError
        If it is negative or not finite.
    """
    try:
        found = number(name, value)
    except ValueError:
        found = math.nan
    if not found >= 0:
        raise ValueError(f"{name}: expected a number >= 0, got {value}")
    return found


def whole(name: str, value: Any, least: int = 0, most: float = math.inf) -> int:
    """Return `value` as an int in a range.

    Raises
    ------
    TypeError
        If it is not a whole number.
    ValueError
        If it is out of range.
    """
    try:
        found = operator.index(value)
    except TypeError:
        raise TypeError(f"{name}: expected an integer, got {type(value).__name__}") from None
    if found < least:
        raise ValueError(f"{name}: expected at least {least}, got {found}")
    if found > most:
        raise ValueError(f"{name}: expected at most {most}, got {found}")
    return found


def flag(name: str, value: Any) -> bool:
    """Return `value` as a bool.

    Raises
    ------
    TypeError
        If it is neither True nor False.
    """
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{name}: expected True or False, got {type(value).__name__}")
    return bool(value)


def text(name: str, value: Any) -> str:
    """Return `value` as a str.

    Raises
    ------
    TypeError
        If it is no text.
    """
    if not isinstance(value, str):
        raise TypeError(f"{name}: expected text, got {type(value).__name__}")
    return str(value)


def several(name: str, value: Iterable[Any], what: str) -> tuple[Any, ...]:
    """Return what a sequence holds.

    Raises
    ------
    TypeError
        If it is text, or nothing that can be gone through.
    """
    try:
        if isinstance(value, (str, bytes, dict)):
            raise TypeError
        return tuple(value)
    except TypeError:
        raise TypeError(f"{name}: expected a sequence of {what}, got {type(value).__name__}") from None


def as_array(name: str, value: ArrayLike) -> NDArray[Any]:
    """Return `value` as an array of any kind.

    Raises
    ------
    ValueError
        If its rows are of different lengths.
    """
    try:
        return np.asarray(value)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None


def positive_array(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """Return `value` as a float64 array of finite numbers above zero, of any shape.

    Raises
    ------
    TypeError
        If it holds something else than real numbers.
    ValueError
        If one is not finite and positive.
    """
    array = as_array(name, value)
    if array.dtype.kind not in "fiu":
        raise TypeError(f"{name}: expected numbers, got {value!r}")
    found = array.astype(np.float64)
    if not (np.isfinite(found) & (found > 0)).all():
        raise ValueError(f"{name}: expected positive numbers, got {value!r}")
    return found
