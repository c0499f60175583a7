"""Netlists: what they refuse, and matches beside brute force and known truth."""

from __future__ import annotations

import itertools
import time
from collections import Counter

import numpy as np
import pytest

import strand
from lib.netlists import RADIUS, draw_netlist, measure
from shared.harnesses import make_harness
from strand import Netlist
from strand.ropes.net_matching import match_netlist

STAR = [("plug", "J", 0.3), ("J", "ecu", 0.1), ("J", "lamp", 0.2)]


@pytest.mark.parametrize(
    ("edges", "wires", "said"),
    [
        ([], None, "expected at least one branch, got none"),
        ([*STAR, ("J", "J", 0.1)], None, r"edges\[3\]: expected two different nodes, got J twice"),
        ([*STAR, ("lamp", "J", 0.2)], None, r"edges\[3\]: expected each branch once, got lamp to J twice"),
        ([*STAR, ("a", "b", 0.1)], None, "got a without a way to plug"),
        ([("a", "b", 0.0)], None, r"edges\[0\]: expected a positive number"),
        ([("a", "", 0.1)], None, r"edges\[0\]: expected names of nodes, got an empty one"),
        ([("a", "b")], None, r"edges\[0\]: expected two names and a length, got 2 values"),
        (STAR, [1, 2], r"wires: expected one for each edge \(3\), got 2"),
        (STAR, [1, 2, 0], r"wires\[2\]: expected at least 1"),
    ],
)
def test_a_netlist_that_cannot_be_is_refused(edges, wires, said):
    with pytest.raises(ValueError, match=said):
        Netlist(edges, wires)


def find_by_brute_force(net, found, tolerance):
    """Return the costs of all isomorphisms by their namings, of graphs without twins."""
    nodes = sorted({end for edge in found for end in edge[:2]})
    lengths = {frozenset(edge[:2]): edge[2] for edge in found}
    costs = {}
    for chosen in itertools.permutations(nodes):
        naming = dict(zip(net.nodes, chosen, strict=True))
        total = 0.0
        for edge in net.edges:
            length = lengths.get(frozenset((naming[edge.start], naming[edge.stop])))
            if length is None:
                break
            error = abs(length - edge.length) / np.sqrt((tolerance * edge.length) ** 2 + 2 * RADIUS**2)
            total += 0.5 * error**2 if error < 3 else 3 * error - 4.5
        else:
            costs[chosen] = total
    return costs


@pytest.mark.parametrize("seed", range(12))
def test_the_best_match_and_its_margin_are_those_of_brute_force(seed):
    rng = np.random.default_rng(seed)
    net = draw_netlist(rng, 2 if seed % 2 else 1)
    if len(net.nodes) > 7:
        net = Netlist(net.edges[:6])
    found, _, _ = measure(rng, net, "none")
    costs = sorted(find_by_brute_force(net, found, 0.03).items(), key=lambda item: item[1])
    match = match_netlist(net, found, 0.03)
    assert match.complete
    assert match.nodes == dict(zip(net.nodes, costs[0][0], strict=True))
    assert match.cost == pytest.approx(costs[0][1])
    # a branch that is missing, with another one that is too many, costs 24
    margin = costs[1][1] - costs[0][1]
    assert (
        match.margin == pytest.approx(margin) if margin < 20 else 20 < match.margin < min(margin, 24) + 1e-9
    )
    as_good = [chosen for chosen, cost in costs if cost < costs[0][1] + 3.0]
    assert set(match.open) == {
        name for k, name in enumerate(net.nodes) if len({chosen[k] for chosen in as_good}) > 1
    }


@pytest.mark.parametrize("change", ["none", "missing", "too many", "longer"])
def test_changes_are_named_where_the_margin_is_wide(change):
    sure, right = 0, 0
    for seed in range(30):
        rng = np.random.default_rng([7, seed])
        net = draw_netlist(rng, int(rng.integers(2, 6)))
        found, nodes, changed = measure(rng, net, change)
        match = match_netlist(net, found, 0.03)
        if match.margin < 6.0:
            continue
        sure += 1
        named = match.missing == ((changed,) if change == "missing" else ())
        named &= match.extra == ((changed,) if change == "too many" else ())
        right += match.nodes == nodes and named
    assert sure > 8
    assert right == sure


def test_a_longer_branch_shows_its_difference():
    net = Netlist([("plug", "J1", 0.32), ("J1", "ecu", 0.11), ("J1", "lamp", 0.2)])
    found = [(0, 1, 0.22, RADIUS, None), (2, 1, 0.111, RADIUS, None), (1, 3, 0.32, RADIUS, None)]
    match = match_netlist(net, found, 0.03)
    assert match.nodes == {"plug": 3, "J1": 1, "ecu": 2, "lamp": 0}
    (lamp,) = [edge for edge in match.edges if "lamp" in edge.names]
    assert lamp.difference == pytest.approx(0.02)
    assert str(lamp) == "J1 to lamp: 220 mm, expected 200 mm (+10.0 %)"
    assert match.open == ()


def test_names_that_lengths_do_not_tell_apart_are_open_unless_wires_do():
    net = Netlist([("plug", "J", 0.3), ("J", "a", 0.1), ("J", "b", 0.101)], wires=[3, 1, 2])
    found = [(0, 1, 0.3, RADIUS, None), (1, 2, 0.1, RADIUS, None), (1, 3, 0.1, RADIUS, None)]
    match = match_netlist(net, found, 0.03)
    assert match.open == ("a", "b")
    assert match.margin < 0.1
    counted = [(*edge[:4], count) for edge, count in zip(found, (3, 2, 1), strict=True)]
    match = match_netlist(net, counted, 0.03)
    assert (match.nodes["a"], match.nodes["b"], match.open) == (3, 2, ())


def test_branches_side_by_side_and_a_harness_are_matched():
    harness = make_harness([(0, 1), (1, 2), (1, 2), (2, 3)], seed=2)
    lengths = [edge.length for edge in harness.edges]
    names = [("a", "p"), ("p", "q"), ("q", "p"), ("q", "b")]
    net = Netlist([(*pair, length) for pair, length in zip(names, lengths, strict=True)])
    match = harness.match(net, tolerance=0.01)
    assert match.nodes == {"a": 0, "p": 1, "q": 2, "b": 3}
    assert [edge.found for edge in match.edges] == pytest.approx(lengths)
    assert [edge.edges for edge in match.edges] == [(0,), (1,), (2,), (3,)]
    assert match.cost == pytest.approx(0.0)


def test_a_netlist_of_something_else_has_no_names():
    net = Netlist([("a", "J", 0.1), *(("J", f"leaf{k}", 0.1) for k in range(8))])
    match = make_harness([(0, 1)]).match(net)
    assert set(match.nodes.values()) == {None}
    assert len(match.missing) == 9
    assert match.extra == (0,)
    assert not match.complete


def draw_mesh(side):
    edges = [((x, y), (x + 1, y)) for x in range(side - 1) for y in range(side)]
    return edges + [((x, y), (x, y + 1)) for x in range(side) for y in range(side - 1)]


@pytest.mark.parametrize("taken", [0, 1, 5])
def test_nets_of_200_junctions_end_soon(taken):
    """Work is bounded, whatever comes out: all lengths are alike, and the mesh has eight symmetries."""
    edges = draw_mesh(15)
    net = Netlist([(str(a), str(b), 0.1) for a, b in edges])
    rng = np.random.default_rng(0)
    number = {name: k for k, name in enumerate(net.nodes)}
    found = [(number[str(a)], number[str(b)], 0.1 + 0.001 * rng.normal(), RADIUS, None) for a, b in edges]
    begun = time.process_time()
    match = match_netlist(net, found[taken:], 0.03)
    assert time.process_time() - begun < 20.0
    if match.complete:
        assert match.open
    assert Counter(match.nodes.values())[None] < len(net.nodes) or not match.complete


def test_the_public_name_and_the_method_agree():
    harness = make_harness([(0, 1), (1, 2), (1, 3)], seed=1)
    net = strand.Netlist([(f"n{edge.start}", f"n{edge.stop}", edge.length) for edge in harness.edges])
    match = harness.match(net)
    assert match.nodes == {f"n{k}": k for k in range(4)}
    assert "J1" not in str(match)
