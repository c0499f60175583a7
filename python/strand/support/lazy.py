"""A property that is worked out once, when it is first asked for."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar, overload

import numpy as np

T = TypeVar("T")


class lazy_property(Generic[T]):
    """A method as a property that is worked out when it is first asked for; an array is then read-only.

    Before Python 3.12 `functools.cached_property` holds a lock of its class meanwhile. A process that another
    thread forks at that moment waits for it for ever.
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
        # two threads may both work it out: both get the same
        value = self._work(instance)
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
        instance.__dict__[self._name] = value
        return value
