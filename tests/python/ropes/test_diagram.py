"""Diagrams: codes against each other, against tables, and against knot Floer homology."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from knot_floer_homology import pd_to_hfk

import strand
from lib.braids import BRAIDS, make_closed_braid, make_knots
from lib.measure import find_crossings
from strand.synthetic import shape

OVERHAND = strand.knot_diagram(shape("overhand"))


def find_even_passages(gauss):
    """Return the Dowker-Thistlethwaite code of a Gauss code."""
    where = {number: place for place, number in enumerate(gauss, 1)}
    odd = gauss[::2]
    return tuple(where[-number] * (1 if number > 0 else -1) for number in odd)


def test_a_trefoil_has_the_codes_of_the_books():
    # alternating: each strand is above what it passed below (KnotInfo: DT 4 6 2)
    assert OVERHAND.gauss_code() == (-1, 2, -3, 1, -2, 3)
    assert tuple(map(abs, OVERHAND.dt_code())) == (4, 6, 2)
    assert OVERHAND.signs in ((1, 1, 1), (-1, -1, -1))
    assert OVERHAND.writhe() == sum(OVERHAND.signs)
    mirrored = strand.knot_diagram(shape("overhand") * [1, -1, 1])
    assert mirrored.gauss_code() == OVERHAND.gauss_code()
    assert mirrored.writhe() == -OVERHAND.writhe()
    # KnotTheory: PD[X[1, 4, 2, 5], X[3, 6, 4, 1], X[5, 2, 6, 3]] is the left one
    left = OVERHAND if OVERHAND.writhe() < 0 else mirrored
    assert sorted(left.pd_code()) == [(1, 4, 2, 5), (3, 6, 4, 1), (5, 2, 6, 3)]
    assert strand.knot(shape("overhand")).chirality == ("left" if left is OVERHAND else "right")


def test_the_figure_eight_knot_has_the_codes_of_the_books():
    diagram = strand.knot(shape("figure8_knot")).diagram
    assert tuple(map(abs, diagram.gauss_code())) == (1, 2, 3, 1, 4, 3, 2, 4)
    assert tuple(map(abs, diagram.dt_code())) == (4, 6, 8, 2)  # KnotInfo: 4 6 8 2
    assert diagram.writhe() == 0


def test_codes_of_random_views_say_the_same():
    rng = np.random.default_rng(0)
    for _, _, nodes in make_knots(18, 150, seed=7):
        for closed in (False, True):
            diagram = strand.knot_diagram(nodes, closed, direction=rng.normal(size=3))
            count = len(diagram.signs)
            assert sorted(diagram.gauss_code()) == [*range(-count, 0), *range(1, count + 1)]
            assert diagram.dt_code() == find_even_passages(diagram.gauss_code())
            assert sorted(np.ravel(diagram.pd_code())) == sorted(2 * [*range(1, 2 * count + 1)])
            where = {number: place for place, number in enumerate(diagram.gauss_code(), 1)}
            for number, (edges, sign) in enumerate(zip(diagram.pd_code(), diagram.signs, strict=True), 1):
                # edge k leads to passage k: the lower strand comes in first, the upper one from its right
                # to its left or the other way
                after = [place % (2 * count) + 1 for place in (where[-number], where[number])]
                assert (edges[0], edges[2]) == (where[-number], after[0])
                above = (where[number], after[1])
                assert (edges[3], edges[1]) == (above if sign > 0 else above[::-1])


def test_a_diagram_shows_the_knot_that_is_tied():
    for word, _ in BRAIDS.values():
        nodes = make_closed_braid(word)
        small = strand.knot(nodes, closed=True)
        if small.name == "0_1":
            continue
        above, below = (strand.knot_diagram(nodes, True, direction=(0, 0, side)) for side in (1, -1))
        assert len(above.signs) == len(below.signs) == len(word)
        homologies = [
            pd_to_hfk([list(edges) for edges in found.pd_code()]) for found in (above, below, small)
        ]
        for key in ("ranks", "tau", "seifert_genus"):
            assert homologies[0][key] == homologies[1][key] == homologies[2][key]


def test_crossings_are_those_that_are_seen():
    nodes = shape("paper")
    diagram = strand.knot_diagram(nodes)
    seen = find_crossings(nodes)
    assert len(diagram.signs) == len(seen)
    passages = sorted((s, high) for low, top, _ in seen for s, high in ((low, False), (top, True)))
    heights = np.interp([s for s, _ in passages], np.linspace(0, 0.4, len(nodes)), nodes[:, 2])
    assert [number > 0 for number in diagram.gauss_code()] == list(heights > heights.mean())
    # from below all are exchanged, and each keeps its sign
    below = strand.knot_diagram(nodes, direction=(0, 0, -2))
    assert below.gauss_code() == tuple(-number for number in diagram.gauss_code())
    assert below.signs == diagram.signs


def test_the_arc_that_closes_an_open_rope_lies_above_everything():
    # the straight way from end to end crosses the middle strand, which is above both ends, or below them
    nodes = np.array([[-1, 0], [-3, 0], [-3, 2], [0, 2], [0, -2], [3, -2], [3, 0], [1, 0]])
    for height in (3.0, -3.0):
        z = np.where(np.abs(nodes[:, 1]) > 0, height, 0.0)
        assert strand.knot_diagram(np.column_stack([nodes, z])).gauss_code() == (-1, 1)


def test_a_direction_along_a_strand_over_a_node_is_turned():
    # seen from above the first segment lies exactly under the last node but one
    nodes = [[0, 0, 0], [2, 0, 0], [2, 2, 1], [1, 1, 1], [1, 0, 1], [1, -1, 1.0]]
    assert strand.knot_diagram(nodes).gauss_code() == (-1, 1)


@pytest.mark.parametrize(
    ("direction", "message"),
    [
        ((0, 0, 0), "direction: expected a vector that is not zero"),
        ((0, 0, np.nan), "direction"),
        ((0, 1), "direction"),
    ],
)
def test_directions_that_are_none(direction, message):
    with pytest.raises(ValueError, match=message):
        strand.knot_diagram(shape("loop"), direction=direction)


def test_a_plan_that_meets_itself_has_no_diagram():
    with pytest.raises(strand.NotEnoughDataError, match="points: the curve meets itself"):
        strand.knot_diagram(shape("loop") * [1, 1, 0])
    with pytest.raises(TypeError, match="closed"):
        strand.knot_diagram(shape("loop"), 1.5)


def test_small_diagrams_alternate():
    # of alternating knots those without a crossing to spare
    for name in ("3_1", "4_1", "5_1", "7_1"):
        found = strand.knot(make_closed_braid(BRAIDS[name][0]), closed=True)
        signs = np.sign(found.gauss_code())
        assert len(signs) == 2 * int(name[0])
        assert all(a != b for a, b in pairwise(signs))
