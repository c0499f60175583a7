"""Tests of matching messages in time, against a search through all of them."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from strand.io.recordings.synchronization import match_messages

TIMES = st.lists(st.integers(0, 60), min_size=1, max_size=12)


def search(times, tolerance):
    rows = []
    for i, time in enumerate(times[0]):
        row = [i]
        for other in times[1:]:
            best = min(range(len(other)), key=lambda n: (abs(other[n] - time), other[n], n))
            if abs(other[best] - time) <= tolerance:
                row.append(best)
        if len(row) == len(times):
            rows.append(row)
    return rows


@given(st.lists(TIMES, min_size=1, max_size=3), st.integers(0, 20))
def test_the_nearest_messages_match(times, tolerance):
    found = match_messages([np.array(one) for one in times], tolerance)
    assert found.shape == (len(found), len(times))
    want = search(times, tolerance)
    assert [row[0] for row in found.tolist()] == [row[0] for row in want]
    for row, other in zip(found.tolist(), want, strict=True):
        assert [times[k][n] for k, n in enumerate(row)] == [times[k][n] for k, n in enumerate(other)]


def test_the_earlier_of_two_equally_near_messages_matches():
    assert match_messages([np.array([10]), np.array([15, 5])], 5).tolist() == [[0, 1]]


def test_a_topic_without_messages_makes_no_frame():
    assert match_messages([np.array([1, 2]), np.empty(0, np.int64)], 100).shape == (0, 2)
    assert match_messages([np.empty(0, np.int64)], 100).shape == (0, 1)
