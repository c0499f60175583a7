"""Gaps in masks: filled where depth shows the rope in them, doubted where ropes' ends point at each other."""

from __future__ import annotations

import numpy as np
import pytest

from strand.geometry.plane import Plane
from strand.reconstruction.images.facing_ends import doubt_facing_ends
from strand.reconstruction.images.lost_pieces import add_lost_pieces
from strand.views.depth_image import DepthImage
from strand.views.pinhole import Pinhole

RADIUS = 0.004
TABLE = Plane(np.array([0.0, 0.0, -1.0]), -0.5)
CAMERA = Pinhole((1000.0, 1000.0), (100.0, 60.0))
ROWS, COLUMNS = np.mgrid[:120, :200]


def draw_rope(away, lifted=0.0):
    """Return the depth of a rope above the table, by distances from its axis, pixels: two to a millimetre."""
    away = away / 2000.0
    top = 0.5 - lifted - RADIUS - np.sqrt(np.maximum(RADIUS**2 - away**2, 0.0))
    return np.where(away < RADIUS, top, 0.5)


def mend(depth, mask, occluders=None):
    image = DepthImage(depth, CAMERA, np.eye(4), mask, None, occluders)
    (found,) = add_lost_pieces([image], TABLE, None, RADIUS)
    return found.mask


ALONG = np.abs(ROWS - 60)
ROPE = (ALONG < 8) & (np.abs(COLUMNS - 100) < 90)
GAP = np.abs(COLUMNS - 100) < 30


def test_a_gap_in_which_depth_shows_the_rope_is_filled():
    mended = mend(draw_rope(ALONG), ROPE & ~GAP)
    lost = ROPE & GAP & (ALONG < 6)
    assert mended[lost].all()
    assert not mended[ALONG > 11].any()


@pytest.mark.parametrize("shown", ["the table", "something higher", "something wide"])
def test_a_gap_in_which_depth_shows_something_else_stays(shown):
    other = {
        "the table": np.full(ROWS.shape, 0.5),
        "something higher": draw_rope(ALONG, lifted=3.0 * RADIUS),
        "something wide": np.where(ALONG < 20, 0.5 - 2.0 * RADIUS, 0.5),
    }[shown]
    mask = ROPE & ~GAP
    assert np.array_equal(mend(np.where(GAP, other, draw_rope(ALONG)), mask), mask)


def test_a_strand_that_leads_from_side_to_side_of_masked_strands_is_not_added():
    sides = np.minimum(np.abs(ROWS - 30), np.abs(ROWS - 90))
    depth = np.minimum(draw_rope(sides), draw_rope(np.abs(COLUMNS - 100)))
    assert np.array_equal(mend(depth, sides < 8), sides < 8)
    # a strand between two ends of a mask is
    ends = (np.abs(COLUMNS - 100) < 8) & (ALONG > 20)
    assert mend(draw_rope(np.abs(COLUMNS - 100)), ends)[60, 100]


def test_occluders_are_never_added():
    mask = ROPE & ~GAP
    assert np.array_equal(mend(draw_rope(ALONG), mask, GAP), mask)


def ropes(*pairs):
    """Return straight ropes between two points each, radii."""
    return [RADIUS * np.linspace([*start, 0.0], [*stop, 0.0], 40) for start, stop in pairs]


def test_ends_that_point_at_each_other_are_doubted_by_how_well_they_do():
    def worst(*pairs):
        return max((doubt.amount for doubt in doubt_facing_ends(ropes(*pairs), RADIUS)), default=0.0)

    left = ((-30, 0), (-5, 0))
    assert worst(left, ((5, 0), (30, 0))) == pytest.approx(0.35)
    # a rope may bend over a gap, by a right angle or more
    assert 0.05 < worst(left, ((0, 5), (0, 30))) <= 0.35
    assert 0.05 < worst(left, ((-5, 10), (-30, 10))) < 0.35
    # far away, past each other, away from each other
    assert worst(left, ((15, 0), (40, 0))) == 0.0
    assert worst(left, ((-10, 10), (20, 10))) == 0.0
    assert worst(((-5, 30), (-5, 5)), ((5, 5), (5, 30))) < 0.12
    # one rope's own ends
    ring = RADIUS * 10 * np.array([[np.cos(a), np.sin(a), 0.0] for a in np.linspace(0.3, 6.0, 80)])
    assert not list(doubt_facing_ends([ring], RADIUS))
