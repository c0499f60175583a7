"""Tests of lazy properties."""

from __future__ import annotations

import threading

from strand.support.lazy import lazy_property


class Slow:
    def __init__(self, wait):
        self.wait = wait
        self.asked = threading.Event()
        self.times = 0

    @lazy_property
    def value(self):
        """Return how often the value was computed."""
        self.asked.set()
        assert self.wait.wait(timeout=60)
        self.times += 1
        return self.times


def test_one_instance_does_not_wait_for_another():
    never, now = threading.Event(), threading.Event()
    now.set()
    slow, quick = Slow(never), Slow(now)
    waiting = threading.Thread(target=lambda: slow.value)
    waiting.start()
    try:
        assert slow.asked.wait(timeout=60)
        got = []
        other = threading.Thread(target=lambda: got.append(quick.value), daemon=True)
        other.start()
        other.join(timeout=30)
        assert got == [1]
    finally:
        never.set()
        waiting.join()


def test_the_value_is_computed_once_and_documented():
    now = threading.Event()
    now.set()
    one = Slow(now)
    assert [one.value, one.value, one.times] == [1, 1, 1]
    assert Slow.value.__doc__ == "Return how often the value was computed."
