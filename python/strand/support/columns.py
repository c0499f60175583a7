"""Columns of tables whose cells are arrays, for pyarrow."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.support.extras import import_extra


def make_lists(arrays: Sequence[NDArray[Any] | None], kind: Any = np.float64) -> Any:
    """Return a list for each array; null for a missing array."""
    pa = import_extra("pyarrow")
    return pa.ListArray.from_arrays(_make_offsets(arrays), pa.array(_flatten(arrays, kind)))


def make_nested_lists(arrays: Sequence[NDArray[Any] | None], width: int) -> Any:
    """Return a list of lists for each (N, width) array; null for a missing array."""
    pa = import_extra("pyarrow")
    flat = _flatten(arrays, np.float64)
    inner = np.arange(0, len(flat) + 1, width, dtype=np.int32)
    return pa.ListArray.from_arrays(_make_offsets(arrays), pa.ListArray.from_arrays(inner, pa.array(flat)))


def _flatten(arrays: Sequence[NDArray[Any] | None], kind: Any) -> NDArray[Any]:
    known = [np.ravel(array).astype(kind, copy=False) for array in arrays if array is not None]
    return np.concatenate(known) if known else np.empty(0, dtype=kind)


def _make_offsets(arrays: Sequence[NDArray[Any] | None]) -> Any:
    """Return where each array's rows begin and where the last one's end; null for a missing array."""
    pa = import_extra("pyarrow")
    sizes = [0 if array is None else len(array) for array in arrays]
    offsets: NDArray[np.int32] = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32)
    return pa.array(offsets, mask=np.array([*(array is None for array in arrays), False]))
