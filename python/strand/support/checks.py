"""Check the arguments of public functions.

Each check returns the value in the form that strand uses. It raises TypeError for a value of the wrong kind
and ValueError for a value out of range. Messages name the argument, what was wrong and what is accepted.
"""

from __future__ import annotations

import math
import operator
import os
import reprlib
from collections.abc import Iterable
from itertools import chain
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
_Kind = TypeVar("_Kind")

_MAX_ROTATION_ERROR = 1e-6  # how far R R^T may be from the identity, in any entry
_MAX_LAST_ROW_ERROR = 1e-9  # how far the last row of a pose may be from (0, 0, 0, 1)
_MAX_ROTATION_ENTRY = 2.0  # larger entries could overflow in R R^T
_MAX_NESTING = 4  # lists in lists, deeper than any argument's
_FLAGS = frozenset((bool, np.bool_))
_SCALARS = _FLAGS | {int, float, np.float64, np.int64}  # entries of lists that hold no array
_NANOSECONDS = 1e11  # larger times are no seconds, even those that bags can hold
_MOST = 2**63 - 1  # whole numbers of 64 bits, as kernels and tables hold them


def check_number(name: str, value: Any) -> float:
    """Return `value` as a finite float; arrays without a dimension count as numbers."""
    if type(value) is float and math.isfinite(value):
        return value
    refuse_masks_and_units(name, value)
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


def check_stamp(name: str, value: Any) -> float | None:
    """Return `value` as a time in seconds, None if it is None; nanoseconds since 1970 are refused."""
    if value is None:
        return None
    found = check_number(name, value)
    if abs(found) >= _NANOSECONDS:
        raise ValueError(f"{name}: expected seconds, got {_show(value)}, as large as nanoseconds")
    return found


def check_positive(name: str, value: Any, most: float = math.inf) -> float:
    """Return `value` as a float above zero and not above `most`."""
    try:
        found = check_number(name, value)
    except ValueError:
        found = math.nan
    if not found > 0:
        raise ValueError(f"{name}: expected a positive number, got {_show(value)}")
    if found > most:
        raise ValueError(f"{name}: expected at most {most:g}, got {value}")
    return found


def check_lengths(name: str, value: Any) -> tuple[float, ...]:
    """Return one length or several, metres, as positive floats."""
    refuse_masks_and_units(name, value)
    each = np.asarray(value, dtype=object)
    lengths = tuple(check_positive(name, one) for one in each.ravel().tolist())
    if each.ndim > 1:
        raise ValueError(f"{name}: expected one number or a flat list of them, got shape {each.shape}")
    if not lengths:
        raise ValueError(f"{name}: expected one number or several, got none")
    return lengths


def check_nonnegative(name: str, value: Any) -> float:
    """Return `value` as a float of zero or above."""
    try:
        found = check_number(name, value)
    except ValueError:
        found = math.nan
    if not found >= 0:
        raise ValueError(f"{name}: expected a number >= 0, got {_show(value)}")
    return found


def check_integer(name: str, value: Any, least: int = 0, most: int = _MOST) -> int:
    """Return `value` as an int from `least` to `most`."""
    try:
        if isinstance(value, (bool, np.bool_)) or is_masked(value):
            raise TypeError
        found = operator.index(value)
    except TypeError:
        raise TypeError(f"{name}: expected an integer, got {type(value).__name__}") from None
    if found < least:
        raise ValueError(f"{name}: expected at least {least}, got {_show(found)}")
    if found > most:
        raise ValueError(f"{name}: expected at most {most}, got {_show(found)}")
    return found


def _show(number: Any) -> str:
    """Return a number as text; Python refuses to write whole numbers of thousands of digits."""
    try:
        return str(number)
    except ValueError:
        return describe_value(number)


def describe_value(value: Any) -> str:
    """Return a short text that shows a value of any size or depth in a message."""
    try:
        return reprlib.repr(value)
    except ValueError:  # a whole number of thousands of digits
        return f"a long {type(value).__name__}"


def check_bool(name: str, value: Any) -> bool:
    """Return `value` as a bool."""
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{name}: expected True or False, got {type(value).__name__}")
    return bool(value)


def check_text(name: str, value: Any) -> str:
    """Return `value` as a str."""
    if not isinstance(value, str):
        raise TypeError(f"{name}: expected text, got {type(value).__name__}")
    return str(value)


def check_path(name: str, value: Any) -> Path:
    """Return a str or path-like `value` as a Path; refuse empty text."""
    words = value.__fspath__() if isinstance(value, os.PathLike) else value
    if not isinstance(words, str):
        raise TypeError(f"{name}: expected a path, got {type(words).__name__}")
    if not words:
        raise ValueError(f"{name}: expected a path, got an empty text")
    return Path(words)


def check_choice(name: str, value: Any, accepted: tuple[str, ...]) -> str:
    """Return `value`, which must be one of the accepted words."""
    if not isinstance(value, str):
        raise TypeError(f"{name}: expected one of {', '.join(accepted)}, got {describe_value(value)}")
    if value not in accepted:
        raise ValueError(f"{name}: expected one of {', '.join(accepted)}, got {describe_value(value)}")
    return value


def check_fraction_or_nan(name: str, value: float) -> float:
    """Return a number from 0 to 1, or NaN for unknown."""
    if isinstance(value, (float, np.floating)) and np.isnan(value):
        return float("nan")
    share = check_number(name, value)
    if not 0.0 <= share <= 1.0:
        raise ValueError(f"{name}: expected a number from 0 to 1, or NaN, got {_show(value)}")
    return share


def check_instance(name: str, value: Any, kind: type[_Kind]) -> _Kind:
    """Return `value`, which must be an instance of a type."""
    if not isinstance(value, kind):
        raise TypeError(f"{name}: expected type {kind.__name__}, got {type(value).__name__}")
    return value


def check_instances(name: str, values: Iterable[Any], kind: type[_Kind]) -> tuple[_Kind, ...]:
    """Return a sequence of instances of one type as a tuple."""
    held = check_sequence(name, values, kind.__name__)
    return tuple(check_instance(f"{name}[{i}]", one, kind) for i, one in enumerate(held))


def check_sequence(name: str, value: Iterable[Any], content: str) -> tuple[Any, ...]:
    """Return the entries of an iterable as a tuple; refuse text and dictionaries.

    `content` says in the error message what the entries should be.
    """
    refuse_masks_and_units(name, value)
    try:
        if isinstance(value, (str, bytes, dict)):
            raise TypeError
        return tuple(value)
    except TypeError:
        raise TypeError(f"{name}: expected a sequence of {content}, got {type(value).__name__}") from None


def check_radius(radius: float) -> float:
    """Return a rope's radius, metres, as a positive float."""
    if isinstance(radius, str):
        raise TypeError(
            f"radius: expected a number of metres, got {radius!r}; "
            "only the command line and scene files take text with a unit"
        )
    try:
        found = check_number("radius", radius)
    except TypeError:
        raise TypeError(f"radius: expected a number of metres, got {describe_value(radius)}") from None
    except ValueError:
        found = 0.0
    if found <= 0:
        raise ValueError(f"radius: expected a positive number of metres, got {_show(radius)}")
    return found


def to_array(name: str, value: ArrayLike) -> NDArray[Any]:
    """Return `value` as an array of any type; refuse ragged rows, masks and units.

    Other subclasses, such as matrices and memory maps, count as the plain numbers that they hold.
    """
    has_flag = _inspect(name, value, _MAX_NESTING)
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None
    if has_flag and array.dtype.kind in "iuf":
        raise TypeError(f"{name}: expected numbers, got True or False among them")
    return array


def is_masked(value: object) -> bool:
    """Return whether a value is a masked array; plain arrays do not make NumPy import its module for them."""
    return (
        isinstance(value, np.ndarray)
        and type(value) is not np.ndarray
        and isinstance(value, np.ma.MaskedArray)
    )


def refuse_masks_and_units(name: str, value: Any) -> None:
    """Raise TypeError if a value, or an entry of a list, is a masked array or has a unit.

    NumPy would take the numbers under the mask, and drop the unit.
    """
    _inspect(name, value, _MAX_NESTING)


def _inspect(name: str, value: Any, depth: int) -> bool:
    """Refuse masks and units; tell whether a value is or holds a bool, which NumPy would take for 0 or 1."""
    if type(value) is np.ndarray:
        return bool(value.dtype.kind == "b")
    if isinstance(value, np.ndarray):
        if is_masked(value):
            raise TypeError(
                f"{name}: expected an array without a mask; fill or drop masked values: .filled(0) suits "
                "depths without a return, and masks"
            )
        if hasattr(value, "unit") or hasattr(value, "units"):
            raise TypeError(f"{name}: expected plain numbers in SI units, got {type(value).__name__}")
        return bool(value.dtype == np.bool_)
    if not isinstance(value, (list, tuple)) or depth == 0:
        return False
    kinds = set(map(type, value))
    has_flag = not _FLAGS.isdisjoint(kinds)
    if not _SCALARS.issuperset(kinds):
        for entry in value:
            has_flag |= _inspect(name, entry, depth - 1)
    return has_flag


def freeze_array(array: NDArray[Any], given: Any = None) -> NDArray[Any]:
    """Return a read-only array that nobody else can change, copied only if needed.

    `array` is the result of a check, and `given` is the caller's value. Without `given`, the function assumes
    that someone else holds the array.
    """
    fresh = isinstance(given, (list, tuple)) or (
        type(given) is np.ndarray and not np.may_share_memory(array, given)
    )
    kept = array if fresh and array.flags.owndata else array.copy()
    kept.setflags(write=False)
    return kept


def round_to_millimeters(place: Array) -> list[float]:
    """Return the coordinates of a place, metres, rounded to millimetres for messages."""
    return [round(x, 3) for x in place.tolist()]


def check_float_array(name: str, value: ArrayLike, shape: tuple[int | str, ...]) -> Array:
    """Return measured numbers, such as points or depths, as a C-ordered float64 array.

    A letter in `shape` accepts any length, as in ("N", 3). Whole numbers raise TypeError, as they do not say
    their unit.
    """
    array = to_array(name, value)
    if array.dtype.kind != "f":
        hint = " (whole numbers do not say their unit: give metres)" if array.dtype.kind in "iu" else ""
        raise TypeError(f"{name}: expected floating point numbers, got dtype {array.dtype}{hint}")
    if array.shape != shape and (
        array.ndim != len(shape)
        or any(isinstance(want, int) and want != got for want, got in zip(shape, array.shape, strict=True))
    ):
        wanted = ", ".join(map(str, shape)) + ("," if len(shape) == 1 else "")
        raise ValueError(f"{name}: expected shape ({wanted}), got {array.shape}")
    return _convert(array)


def _convert(array: NDArray[Any]) -> Array:
    if array.dtype == np.float64 and array.flags.c_contiguous:
        return array
    # NumPy may warn when it converts NaN, or long doubles that are too large or too small
    with np.errstate(all="ignore"):
        return np.asarray(array, dtype=np.float64, order="C")


def check_numbers(name: str, value: ArrayLike) -> Array:
    """Return finite numbers of any shape as float64; whole numbers are accepted."""
    array = to_array(name, value)
    if array.dtype.kind not in "fiu":
        raise TypeError(f"{name}: expected numbers, got dtype {array.dtype}")
    return _check_finite(name, _convert(array))


def check_finite_array(name: str, value: ArrayLike, shape: tuple[int | str, ...]) -> Array:
    """Return `value` as `check_float_array` does; refuse NaN and infinity."""
    return _check_finite(name, check_float_array(name, value, shape))


def check_clouds(name: str, values: Iterable[ArrayLike]) -> tuple[Array, ...]:
    """Return a sequence of (N, 3) arrays, such as clouds or centrelines, as finite float64 arrays."""
    given = check_sequence(name, values, "(N, 3) arrays")
    return tuple(check_finite_array(f"{name}[{i}]", one, ("N", 3)) for i, one in enumerate(given))


def check_vectors(name: str, value: ArrayLike) -> Array:
    """Return (..., 3) points or directions as float64; whole numbers, NaN and infinity are accepted."""
    array = convert_integers(name, value)
    if array.dtype.kind != "f":
        raise TypeError(f"{name}: expected numbers, got dtype {array.dtype}")
    if array.shape[-1:] != (3,):
        raise ValueError(f"{name}: expected shape (..., 3), got {array.shape}")
    return array.astype(np.float64, copy=False)


def check_small_array(name: str, value: ArrayLike, shape: tuple[int | str, ...]) -> Array:
    """Return a finite vector or matrix, such as an origin or a pose; whole numbers are accepted."""
    return _check_finite(name, check_float_array(name, convert_integers(name, value), shape))


def convert_integers(name: str, value: ArrayLike) -> NDArray[Any]:
    """Return `value` as an array, with whole numbers converted to floats."""
    array = to_array(name, value)
    return array.astype(np.float64) if array.dtype.kind in "iu" else array


def _check_finite(name: str, array: Array) -> Array:
    if np.count_nonzero(np.isfinite(array)) < array.size:
        raise ValueError(f"{name}: expected finite numbers, got NaN or infinity")
    return array


def check_colors(name: str, value: ArrayLike, shape: tuple[int | str, ...]) -> Array:
    """Return colours from 0 to 1 as float64; uint8 colours are divided by 255."""
    array = to_array(name, value)
    if array.dtype.kind in "iu" and array.dtype != np.uint8:
        raise TypeError(f"{name}: expected uint8, or floats from 0 to 1, got dtype {array.dtype}")
    colors = check_finite_array(name, array / 255.0 if array.dtype == np.uint8 else array, shape)
    if colors.size and not (colors.min() >= 0 and colors.max() <= 1):
        raise ValueError(
            f"{name}: expected colours from 0 to 1, or uint8, got {colors.min()} to {colors.max()}"
        )
    return colors


def check_mask(name: str, value: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.int32] | NDArray[np.bool_]:
    """Return a new array in the image's shape: bools, or labels as int32; 0 means no rope."""
    array = to_array(name, value)
    if array.dtype.kind not in "biu":
        raise TypeError(
            f"{name}: expected bools, or whole numbers as labels (0: no rope), got dtype {array.dtype}"
        )
    if array.shape != shape:
        raise ValueError(f"{name}: expected the depth image's shape {shape}, got {array.shape}")
    if array.dtype == np.bool_:
        return np.array(array, order="C")
    least, most = 0, int(np.iinfo(np.int32).max)
    if array.size and not (array.min() >= least and array.max() <= most):
        raise ValueError(
            f"{name}: expected labels from {least} to {most}, got {array.min()} to {array.max()}"
        )
    return np.array(array, dtype=np.int32, order="C")


def check_occluders(name: str, value: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Return a new array of bools in the image's shape: pixels of the robot or a hand, not 0."""
    array = to_array(name, value)
    if array.dtype.kind not in "biu":
        raise TypeError(
            f"{name}: expected bools, or whole numbers (0: neither robot nor hand), got dtype {array.dtype}"
        )
    if array.shape != shape:
        raise ValueError(f"{name}: expected the depth image's shape {shape}, got {array.shape}")
    return np.array(array != 0, order="C")


def check_rigid_motion(name: str, value: ArrayLike) -> Array:
    """Return `value` as a (4, 4) rigid motion; refuse rotations that scale, shear or mirror."""
    pose = check_small_array(name, value, (4, 4))
    *rows, last = pose.tolist()
    if max(map(abs, (*last[:3], last[3] - 1.0))) > _MAX_LAST_ROW_ERROR:
        raise ValueError(f"{name}: expected the last row (0, 0, 0, 1), got {pose[3]}")
    if not _is_rotation([row[:3] for row in rows]):
        raise ValueError(f"{name}: expected a rigid motion, but its (3, 3) part is not a rotation")
    return pose


def _is_rotation(rows: list[list[float]]) -> bool:
    """Tell whether the rows of a (3, 3) matrix are orthogonal unit vectors, right-handed."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = rows
    if max(map(abs, chain.from_iterable(rows))) > _MAX_ROTATION_ENTRY:
        return False
    errors = (
        ax * ax + ay * ay + az * az - 1.0,
        bx * bx + by * by + bz * bz - 1.0,
        cx * cx + cy * cy + cz * cz - 1.0,
        ax * bx + ay * by + az * bz,
        ax * cx + ay * cy + az * cz,
        bx * cx + by * cy + bz * cz,
    )
    volume = cx * (ay * bz - az * by) + cy * (az * bx - ax * bz) + cz * (ax * by - ay * bx)
    return max(map(abs, errors)) <= _MAX_ROTATION_ERROR and volume > 0.0


def check_intrinsics(name: str, value: ArrayLike) -> Array:
    """Return `value` as a pinhole matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], pixels."""
    camera = check_small_array(name, value, (3, 3))
    fx, fy, cx, cy = camera[0, 0], camera[1, 1], camera[0, 2], camera[1, 2]
    if fx <= 0 or fy <= 0 or not np.array_equal(camera, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]):
        raise ValueError(
            f"{name}: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with fx, fy > 0, got {camera.tolist()}"
        )
    return camera
