"""Places where arcs meet: which reading of heights, bends and widths is the cheapest."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from strand import _core
from strand.reconstruction.harness.lines import trace_lines
from strand.reconstruction.harness.places import decide_places
from strand.reconstruction.harness.strands import follow_strands
from strand.reconstruction.harness.surface_map import SurfaceMap

CELL = 0.001
RADIUS = 0.005


def draw(strands, shape=(240, 240)):
    """Return a map of strands: their ends in cells, and the height of their axes at both ends, metres."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    heights = np.full(shape, -np.inf)
    for (r0, c0), (r1, c1), z0, z1 in strands:
        way = np.array([r1 - r0, c1 - c0], dtype=float)
        along = np.clip(((rows - r0) * way[0] + (columns - c0) * way[1]) / (way @ way), 0.0, 1.0)
        away = CELL * np.hypot(rows - r0 - along * way[0], columns - c0 - along * way[1])
        on = away < RADIUS
        axis = z0 + along * (z1 - z0)
        surface = np.where(on, axis + np.sqrt(np.maximum(RADIUS**2 - away**2, 0.0)), -np.inf)
        heights = np.maximum(heights, surface)
    mask = np.isfinite(heights)
    widths = _core.measure_edge_distances(mask, sum(shape)).astype(np.float64)
    return SurfaceMap(np.eye(3), np.zeros(2), CELL, mask, np.where(mask, heights, 0.0), widths, mask)


def decide(strands):
    drawn = draw(strands)
    return decide_places(trace_lines(drawn, RADIUS), drawn, floor=0.0)


LOW = RADIUS
HIGH = 3.0 * RADIUS


def raise_over(middle, start, stop):
    """Return a strand from the table over a place, in two pieces, and back to the table."""
    return [(start, middle, LOW, HIGH), (middle, stop, HIGH, LOW)]


@pytest.mark.parametrize("turn", [0.0, 0.4, 1.1])
def test_arms_of_one_height_make_a_junction(turn):
    ends = [(120 + 90 * np.cos(angle + turn), 120 + 90 * np.sin(angle + turn)) for angle in (0.0, 2.1, 4.2)]
    decided = decide([((120, 120), end, LOW, LOW) for end in ends])
    assert [len(junction.ends) for junction in decided.junctions] == [3]
    assert not decided.passings
    assert np.linalg.norm(decided.junctions[0].place - 120) < 5


@pytest.mark.parametrize("slope", [0.0, 40.0])
def test_a_strand_that_rises_over_another_crosses_it(slope):
    over = raise_over((120, 120), (20, 120 - slope), (220, 120 + slope))
    decided = decide([((120, 20), (120, 220), LOW, LOW), *over])
    assert not decided.junctions
    assert len({passing.place for passing in decided.passings}) == 1
    heights = sorted(passing.height for passing in decided.passings)
    assert heights[1] - heights[0] > RADIUS


def test_four_arms_of_one_height_make_one_junction():
    decided = decide([((120, 20), (120, 220), LOW, LOW), ((20, 120), (220, 120), LOW, LOW)])
    assert [len(junction.ends) for junction in decided.junctions] == [4]


def test_an_end_on_a_strand_is_an_end():
    decided = decide([((120, 20), (120, 220), LOW, LOW), ((20, 120), (122, 120), LOW, HIGH)])
    assert not decided.junctions
    assert [laid.under for laid in decided.laid] == [False]
    assert np.linalg.norm(decided.laid[0].place - 120) < 8


def test_an_end_under_a_strand_is_an_end():
    over = raise_over((120, 120), (120, 20), (120, 220))
    decided = decide([((20, 120), (120, 120), LOW, LOW), *over])
    assert not decided.junctions
    assert [laid.under for laid in decided.laid] == [True]


def test_an_end_under_a_strand_that_lies_high_for_long_is_an_end():
    # no part of the upper strand lies on the table
    over = [((120, 60), (120, 180), HIGH, HIGH)]
    decided = decide([((20, 120), (120, 120), LOW, LOW), *over])
    assert not decided.junctions
    assert [laid.under for laid in decided.laid] == [True]


@pytest.mark.parametrize("bend", [12.0, 20.0])
def test_strands_that_touch_side_by_side_stay_apart(bend):
    strands = [
        (start, (120, column), LOW, LOW)
        for column, outer in ((115.5, 115.5 - bend), (124.5, 124.5 + bend))
        for start in ((20, outer), (220, outer))
    ]
    decided = decide(strands)
    assert not decided.junctions
    assert len({passing.place for passing in decided.passings}) == 1
    # neither hides the other
    assert all(passing.height == passing.other for passing in decided.passings)


@pytest.mark.parametrize("side", [-1, 1])
def test_a_loop_from_a_junction_keeps_its_length(side):
    angles = np.linspace(0.0, 2.0 * np.pi, 41)
    ring = np.column_stack([120.0 - 40.0 * np.cos(angles), 120.0 + side * 40.0 * np.sin(angles)])
    loop = [(*map(tuple, pair), LOW, LOW) for pair in pairwise(ring)]
    drawn = draw([((20, 118), (80, 120), LOW, LOW), *loop])
    lines = trace_lines(drawn, RADIUS)
    strands = follow_strands(lines, decide_places(lines, drawn, floor=0.0), drawn, None)
    lengths = [np.linalg.norm(np.diff(strand.nodes, axis=0), axis=1).sum() for strand in strands]
    assert max(lengths) == pytest.approx(CELL * 80.0 * np.pi, rel=0.1)


@pytest.mark.parametrize(("bend", "kept"), [(30.0, 2), (7.0, 1)])
def test_a_ring_that_no_rope_can_make_is_dropped(bend, kept):
    angles = np.linspace(0.0, 2.0 * np.pi, 41)
    ring = np.column_stack([120.0 - bend * np.cos(angles), 170.0 + bend * np.sin(angles)])
    drawn = draw(
        [((20, 20), (220, 60), LOW, LOW), *((*map(tuple, pair), LOW, LOW) for pair in pairwise(ring))]
    )
    lines = trace_lines(drawn, RADIUS)
    assert len(lines.arcs) == 2
    strands = follow_strands(lines, decide_places(lines, drawn, floor=0.0), drawn, None)
    assert len(strands) == kept


def test_a_strand_as_wide_as_two_in_one_half_has_the_width_of_the_other():
    beside = [((120, 20), (120, 200), LOW, LOW), ((129, 20), (129, 130), LOW, LOW)]
    drawn = draw(beside)
    lines = trace_lines(drawn, RADIUS)
    strands = follow_strands(lines, decide_places(lines, drawn, floor=0.0), drawn, None)
    longest = max(strands, key=lambda strand: len(strand.nodes))
    assert longest.half_width == pytest.approx(RADIUS, rel=0.15)


def test_a_diagonal_strand_keeps_its_length():
    drawn = draw([((30, 30.5), (190, 190.5), LOW, LOW)])
    lines = trace_lines(drawn, RADIUS)
    (strand,) = follow_strands(lines, decide_places(lines, drawn, floor=0.0), drawn, None)
    length = np.linalg.norm(strand.nodes[-1] - strand.nodes[0])
    assert length > CELL * np.hypot(160, 160)


def test_a_strand_over_a_junction_leaves_it_one():
    # the strand crosses a branch close to where three meet
    arms = [((120, 120), end, LOW, LOW) for end in ((120, 20), (40, 200), (210, 200))]
    over = raise_over((97, 143), (20, 70), (170, 215))
    decided = decide([*arms, *over])
    assert [len(junction.ends) for junction in decided.junctions] == [3]
    assert len({passing.place for passing in decided.passings}) == 1
