"""Whole strings."""

from __future__ import annotations

import numpy as np
import pytest

from shared.ropes import CROSSED, draw_cross, draw_straight
from strand._core import straighten
from strand.config import Reconnection, Splitting
from strand.reconstruction.published.assembly import assemble, extend_to_end
from strand.reconstruction.published.reconnection import reconnect
from strand.reconstruction.published.splitting import split

RADIUS = CROSSED


def test_a_crossing_cuts_both_strands_once_and_the_right_ends_are_joined():
    parts = split(draw_cross(), RADIUS, Splitting())
    assert len(parts.segments) == 4
    assert [len(nodes) for nodes in parts.cuts] == [1, 1]
    joined = reconnect(parts, RADIUS, None, Reconnection())
    assert sorted(map(sorted, joined.joins)) == [[1, 2], [5, 6]]
    axis = np.concatenate([draw_straight(tuple(c[0]), tuple(c[-1]), 0.0002) for c in draw_cross()])
    found = assemble(parts.segments, joined, axis, RADIUS, Reconnection())
    assert [closed for _, closed in found] == [False, False]
    for (nodes, _), chain in zip(sorted(found, key=lambda s: s[0][:, 2].mean()), draw_cross(), strict=True):
        first, last = sorted([nodes[0].tolist(), nodes[-1].tolist()])
        np.testing.assert_allclose(
            [first, last], sorted([chain[0].tolist(), chain[-1].tolist()]), atol=RADIUS / 4
        )
        # every node lies on the straight line through its strand
        offset = np.cross(nodes - chain[0], (chain[-1] - chain[0]) / np.linalg.norm(chain[-1] - chain[0]))
        assert np.abs(offset).max() < 1e-9


def test_a_ring_stays_a_ring():
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    ring = 0.04 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    parts = split([ring], RADIUS, Splitting())
    assert parts.rings == (0,)
    joined = reconnect(parts, RADIUS, None, Reconnection())
    ((nodes, closed),) = assemble(parts.segments, joined, ring, RADIUS, Reconnection())
    assert closed
    assert len(nodes) >= 60


def test_bends_that_the_average_shortens_are_moved_back():
    angle = np.linspace(0, 1.5 * np.pi, 60)
    bend = 0.03
    nodes = (bend - 4 / 9 * RADIUS**2 / bend) * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    moved = straighten(nodes, RADIUS, 3 * RADIUS)
    off = np.linalg.norm(moved, axis=1)[5:-5] - bend
    assert np.abs(off).max() < 0.1 * 4 / 9 * RADIUS**2 / bend
    line = draw_straight((0, 0, 0), (0.1, 0.02, 0))
    np.testing.assert_allclose(straighten(line, RADIUS, 3 * RADIUS), line, atol=1e-12)


@pytest.mark.parametrize("missing", [0.0, 0.5, 1.3, 2.8])
def test_the_end_is_found_by_counting(missing):
    rng = np.random.default_rng(1)
    length = 0.1
    axis = np.stack([rng.uniform(0, length, 4000), *rng.normal(scale=2e-4, size=(2, 4000))], axis=1)
    nodes = draw_straight((0, 0, 0), (length - missing * RADIUS, 0, 0))
    reached = extend_to_end(nodes, axis, 4000 / length, RADIUS, 3 * RADIUS)
    assert reached[-1, 0] == pytest.approx(length, abs=0.1 * RADIUS)
    assert np.abs(reached[-1, 1:]).max() < 1e-9
