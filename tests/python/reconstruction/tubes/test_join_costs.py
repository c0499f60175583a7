"""Prices of joins."""

from __future__ import annotations

import numpy as np

from shared.ropes import R, draw_line
from strand.config import Linking
from strand.reconstruction.evidence.join_evidence import JoinEvidence
from strand.reconstruction.evidence.visibility import sort_rays
from strand.reconstruction.tubes.chaining import chain_arcs
from strand.reconstruction.tubes.join_costs import price_joins
from strand.reconstruction.tubes.matching import match_ends


def link_arcs(arcs, visibility=None):
    """Make chains of arcs by the matching of least cost."""
    evidence = JoinEvidence(R, Linking(), visibility)
    return chain_arcs(arcs, match_ends(price_joins(arcs, evidence), evidence.config.free_end)[0], evidence)


def test_joins_keep_out_of_free_space(paper):
    visibility = sort_rays(paper.views, paper.poses_true, paper.views)
    z = 8.0 * R
    arcs = [draw_line([-0.06, 0.0, z], [-0.01, 0.0, z]), draw_line([0.01, 0.0, z], [0.06, 0.0, z])]
    assert len(link_arcs(arcs)) == 1
    assert len(link_arcs(arcs, visibility)) == 2


def test_the_margin_between_equally_good_ways_is_zero():
    def draw_ends(slope):
        """Draw four arcs that lead into a gap, with two likely ways to join them."""
        arcs = []
        for x in (-1.0, 1.0):
            for y in (-1.0, 1.0):
                inner = np.array([x * 3 * R, y * 1.5 * R, 0.0])
                out = np.array([x, y * slope, 0.0]) / np.hypot(1.0, slope)
                arcs.append(draw_line(inner + 10 * R * out, inner))
        return arcs

    def find_margin(slope):
        costs = price_joins(draw_ends(slope), JoinEvidence(R, Linking()))
        joins, cost = match_ends(costs, 5.0)
        return min(match_ends(costs, 5.0, [pair])[1] - cost for pair in joins), joins

    low, across = find_margin(0.0)[1], find_margin(0.5)[1]
    assert low != across
    a, b = 0.0, 0.5
    for _ in range(40):
        middle = 0.5 * (a + b)
        a, b = (middle, b) if find_margin(middle)[1] == low else (a, middle)
    assert find_margin(a)[0] < 0.01
    assert find_margin(0.0)[0] > 1.0
    assert find_margin(0.5)[0] > 0.3


def test_linking_prefers_the_straight_way_on():
    up = np.array([0.0, 0.0, 2 * R])
    line = np.linspace(-0.06, 0.06, 60)
    lower = np.stack([line, 0 * line, 0 * line], axis=1)
    upper = np.stack([0 * line, line, 0 * line], axis=1) + up
    arcs = [lower[:25], lower[36:], upper]
    chains = link_arcs(arcs)
    assert sorted(round(float(np.ptp(nodes[:, 0])), 3) for nodes, _ in chains) == [0.0, 0.12]
    assert not any(closed for _, closed in chains)
    far = [lower[:10], lower[50:]]
    assert len(link_arcs(far)) == 2
