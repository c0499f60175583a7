"""Ctrl-C leaves a reconstruction at once in every stage, and breaks nothing."""

from __future__ import annotations

import signal
import time

import numpy as np
import pytest

import strand

MAX_DELAY = 0.6  # seconds; the promise is 0.2 s on an idle machine


class Interrupted(BaseException):
    """Raised by a signal's handler, as `KeyboardInterrupt` by Ctrl-C."""


def raise_interrupted(*_):
    raise Interrupted


def collect_bits(model):
    return [chain.points.tobytes() for chain in model.chains]


def measure_time(call):
    begin = time.perf_counter()
    call()
    return time.perf_counter() - begin


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("camera", [None, "d405"])
def test_every_stage_is_left_at_once(camera, count, threads):
    threads(count)
    scene = strand.synthetic.scene("overhand", seed=3, views=3, camera=strand.synthetic.Camera(camera))
    stages: list[str] = []

    def reconstruct():
        return strand.reconstruct(scene.views, scene.radius, scene.bounds, progress=stages.append)

    expected = collect_bits(reconstruct())
    # the least of three, as a busy machine slows single runs
    takes = min(measure_time(reconstruct) for _ in range(3))
    before = signal.signal(signal.SIGALRM, raise_interrupted)
    late, left = [], set()
    try:
        for share in np.linspace(0.02, 0.95, 20):
            begin = time.perf_counter()
            signal.setitimer(signal.ITIMER_REAL, share * takes)
            try:
                reconstruct()
                signal.setitimer(signal.ITIMER_REAL, 0.0)
            except Interrupted:
                late.append(time.perf_counter() - begin - share * takes)
                left.update(stages[-1:])
            stages.clear()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert len(late) > 10
    assert len(left) > 2
    assert max(late) < MAX_DELAY
    assert collect_bits(reconstruct()) == expected
