"""Copies of frozen dataclasses."""

from __future__ import annotations

from typing import Any, TypeVar

T = TypeVar("T")


def copy_with(value: T, **fields: Any) -> T:
    """Return a copy of a frozen dataclass with some fields changed; nothing is checked.

    Lazy properties keep their values, so none may depend on these fields.
    """
    made = object.__new__(type(value))
    made.__dict__.update(value.__dict__, **fields)
    return made
