"""Lines of a mask's skeleton."""

from __future__ import annotations

import numpy as np

from strand import _core


def test_a_cross_has_four_lines_that_meet():
    mask = np.zeros((61, 81), dtype=bool)
    mask[28:33, 5:76] = True
    mask[5:56, 38:43] = True
    groups, lines = _core.trace_skeleton(mask)
    assert np.abs(groups - [30.0, 40.0]).max() < 3.0
    free = [pixels for pixels, ends in lines if min(ends) == -1]
    assert len(free) == 4
    for pixels in free:
        assert (np.abs(np.diff(pixels, axis=0)).max(axis=1) == 1).all()
        assert mask[tuple(pixels.T)].all()


def test_a_bar_is_one_line_and_nothing_has_none():
    mask = np.zeros((20, 60), dtype=bool)
    assert _core.trace_skeleton(mask)[1] == []
    mask[8:13, 5:55] = True
    groups, ((pixels, ends),) = _core.trace_skeleton(mask)
    assert len(groups) == 0
    assert ends == (-1, -1)
    assert len(pixels) > 40
