"""A property whose value is computed on first access and then kept."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar, overload

import numpy as np

T = TypeVar("T")


class lazy_property(Generic[T]):
    """Turn a method into a property that is computed on first access; an array becomes read-only.

    `functools.cached_property` is not used: before Python 3.12, it holds a lock while it computes. A
    process that another thread forks at that moment waits for that lock for ever.
    """

    def __init__(self, work: Callable[[Any], T]) -> None:
        self._work = work
        self.__doc__ = work.__doc__

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, instance: None, owner: type) -> lazy_property[T]: ...

    @overload
    def __get__(self, instance: object, owner: type) -> T: ...

    def __get__(self, instance: object | None, owner: type) -> lazy_property[T] | T:
        if instance is None:
            return self
        # two threads may both compute the value: it is the same
        value = self._work(instance)
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
        instance.__dict__[self._name] = value
        return value
