"""Copies of frozen dataclasses that check nothing."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar, cast

T = TypeVar("T")


def copy_with(value: T, **fields: Any) -> T:
    """Return a copy of a frozen dataclass with some fields changed; nothing is checked.

    Lazy properties keep their values, so none may depend on these fields.
    """
    return _make(value, {**value.__dict__, **fields})


def copy_fields_with(value: T, **fields: Any) -> T:
    """Return such a copy, whose lazy properties are found anew."""
    names = [entry.name for entry in dataclasses.fields(cast(Any, value))]
    return _make(value, {name: getattr(value, name) for name in names} | fields)


def _make(like: T, values: dict[str, Any]) -> T:
    made = object.__new__(type(like))
    made.__dict__.update(values)
    return made
