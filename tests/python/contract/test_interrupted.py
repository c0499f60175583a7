"""Ctrl-C in the middle of a reconstruction: it is answered at once in every stage, and nothing is broken."""

from __future__ import annotations

import signal
import time

import numpy as np
import pytest

import strand

# how late an answer may be, seconds; what is asked for is 0.2 s, on a machine that does nothing else
LATE = 0.6


class Interrupted(BaseException):
    """What a signal's handler raises, as Ctrl-C does `KeyboardInterrupt`."""


def interrupt(*_):
    raise Interrupted


def nodes(model):
    return [chain.points.tobytes() for chain in model.chains]


@pytest.mark.parametrize("camera", [None, "d405"])
def test_every_stage_is_left_at_once(camera):
    scene = strand.synthetic.scene("overhand", seed=3, views=3, camera=strand.synthetic.Camera(camera))
    stages: list[str] = []

    def reconstruct():
        return strand.reconstruct(scene.views, scene.radius, scene.bounds, progress=stages.append)

    expected = nodes(reconstruct())
    begin = time.perf_counter()
    reconstruct()
    takes = time.perf_counter() - begin
    before = signal.signal(signal.SIGALRM, interrupt)
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
                left.add(stages[-1])
            stages.clear()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert len(late) > 10
    assert len(left) > 2
    assert max(late) < LATE
    assert nodes(reconstruct()) == expected
