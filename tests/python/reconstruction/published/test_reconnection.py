"""Pairing ends by direction, and bridging gaps."""

from __future__ import annotations

import numpy as np
import pytest

from shared.ropes import CROSSED, draw_cross, draw_straight
from strand.config import Reconnection, Splitting
from strand.reconstruction.published.reconnection import reconnect
from strand.reconstruction.published.splitting import split

RADIUS = CROSSED


@pytest.mark.parametrize("degrees", [45, 70, 90, 110, 135])
def test_ends_are_paired_by_direction_at_any_steep_angle(degrees):
    parts = split(draw_cross(np.radians(degrees)), RADIUS, Splitting())
    joined = reconnect(parts, RADIUS, None, Reconnection())
    assert sorted(map(sorted, joined.joins)) == [[1, 2], [5, 6]]


def test_a_gap_is_bridged_only_if_the_number_of_ropes_is_known():
    pieces = [draw_straight((0, 0, 0), (0.1, 0, 0)), draw_straight((0.13, 0, 0), (0.2, 0, 0))]
    parts = split(pieces, RADIUS, Splitting())
    assert reconnect(parts, RADIUS, None, Reconnection()).joins == ()
    assert reconnect(parts, RADIUS, 2, Reconnection()).joins == ()
    assert reconnect(parts, RADIUS, 1, Reconnection()).joins == ((1, 2),)
    assert reconnect(parts, RADIUS, 1, Reconnection(gap=5.0)).joins == ()
