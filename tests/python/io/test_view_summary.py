"""Tests of summaries of views."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from strand.io.view_summary import summarize_view

K = np.array([[10.0, 0.0, 1.5], [0.0, 11.0, 1.0], [0.0, 0.0, 1.0]])
DEPTH = np.array([[0.0, np.nan, 0.4, 0.5], [0.6, np.inf, 0.0, 0.3], [0.3, 0.3, 0.0, 0.3]])


def test_pixels_are_counted_by_kind():
    seen = summarize_view(strand.View.from_depth(DEPTH, K))
    assert (seen.kind, seen.size, seen.corners, seen.colors) == ("depth image", (4, 3), None, False)
    assert (seen.points, seen.no_return, seen.not_finite) == (7, 3, 2)
    assert seen.distance == (0.3, 0.6)
    assert seen.intrinsics == (10.0, 11.0, 1.5, 1.0)
    assert (seen.labels, seen.points_in_mask) == (None, None)


def test_a_mask_is_counted_by_its_labels():
    labels = np.array([[0, 7, 7, 0], [3, 3, 3, 0], [0, 0, 0, 0]])
    colors = np.zeros((3, 4, 3))
    seen = summarize_view(strand.View.from_depth(DEPTH, K, None, colors, mask=labels))
    assert (seen.points, seen.labels, seen.points_in_mask, seen.colors) == (7, 2, 2, True)


def test_points_have_corners():
    points = np.array([[0.0, 0.0, 2.0], [-1.0, 0.5, 0.0], [0.0, 0.0, 0.0], [0.0, 3.0, 4.0]])
    seen = summarize_view(strand.View(points, dropped=4), no_return=1)
    assert (seen.kind, seen.size, seen.intrinsics) == ("points", None, None)
    assert (seen.points, seen.no_return, seen.not_finite) == (3, 1, 4)
    assert seen.distance == pytest.approx((np.sqrt(1.25), 5.0))
    np.testing.assert_array_equal(seen.corners, [[-1.0, 0.0, 0.0], [0.0, 3.0, 4.0]])


@pytest.mark.parametrize("view", [strand.View.from_depth(np.zeros((2, 3)), K), strand.View(np.empty((0, 3)))])
def test_empty_views_have_no_distance(view):
    seen = summarize_view(view)
    assert (seen.points, seen.distance, seen.corners) == (0, None, None)
