"""Crossings, contacts and grasps of a harness: edges that share a node neither cross nor touch there."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest

import strand
from strand.ropes.harness import Harness, HarnessEdge, HarnessNode
from strand.synthetic import Camera, harness


@cache
def make_model(kind, seed, joined=True):
    """Return the model of a simulated harness as it is."""
    made = harness(kind, seed=seed, views=1, camera=Camera(size=(32, 24)))
    chains = [strand.Chain(line, radius) for line, radius in zip(made.truth, made.radii, strict=True)]
    graph = None
    if joined:
        degrees = np.bincount(np.reshape(made.edges, -1))
        nodes = [
            HarnessNode(k, place, None, int(degree))
            for k, (place, degree) in enumerate(zip(made.nodes, degrees, strict=True))
        ]
        edges = [
            HarnessEdge(k, *ends, chain)
            for k, (ends, chain) in enumerate(zip(made.edges, chains, strict=True))
        ]
        graph = Harness(nodes, edges)
    return made, strand.Model(chains, made.poses, confidence=0.95, harness=graph)


@pytest.mark.parametrize("kind", ["tree", "tang", "four", "cycle", "cross", "near"])
@pytest.mark.parametrize("seed", range(4))
def test_crossings_are_those_of_the_truth_and_none_at_junctions(kind, seed):
    made, model = make_model(kind, seed)
    found = np.array([one.place for one in model.crossings()]).reshape(-1, 3)
    assert len(found) == len(made.crossings)
    for place in made.crossings:
        assert np.linalg.norm(found - place, axis=1).min() < 0.002


def test_edges_that_bend_over_each_other_near_their_node_do_not_cross():
    """Noise of the fit makes branches that part slowly cross in plan."""
    s = np.linspace(0.0, 0.1, 101)
    wave = 0.0004 * np.sin(s * 600.0)
    one = np.column_stack([s, wave, np.full(101, 0.004)])
    other = np.column_stack([s, np.maximum(0.4 * (s - 0.02), 0.0), np.full(101, 0.004)])
    trunk = np.column_stack([-s[::-1], 0.0 * s, np.full(101, 0.004)])
    chains = [strand.Chain(line, 0.003) for line in (trunk, one, other)]
    places = [trunk[0], trunk[-1], one[-1], other[-1]]
    nodes = [HarnessNode(k, place, None, (1, 3, 1, 1)[k]) for k, place in enumerate(places)]
    edges = [HarnessEdge(k, *((0, 1), (1, 2), (1, 3))[k], chain) for k, chain in enumerate(chains)]
    apart = strand.Model(chains, np.eye(4)[None])
    joined = dataclasses.replace(apart, harness=Harness(nodes, edges))
    assert len(apart.crossings()) > 0
    assert joined.crossings() == ()
    assert len(apart.contacts(0.002)) > 0
    assert joined.contacts(0.002) == ()
    assert [pair for pair in joined.summary().splitlines() if "passes over" in pair] == []


@pytest.mark.parametrize("seed", range(3))
def test_contacts_at_shared_nodes_are_left_out_and_others_stay(seed):
    made, model = make_model("near", seed)
    _, loose = make_model("near", seed, joined=False)
    kept = {(one.first, one.second) for one in model.contacts(0.004)}
    every = {(one.first, one.second): one for one in loose.contacts(0.004)}
    assert kept <= set(every)
    for key, one in every.items():
        ends = [set(made.edges[chain]) for chain, _ in key]
        if not ends[0] & ends[1]:
            assert key in kept, one


@pytest.mark.parametrize("seed", range(3))
def test_no_grasp_is_on_a_junction_or_under_another_branch(seed):
    made, model = make_model("cross", seed)
    gripper = strand.Gripper(opening=0.03, width=0.01, thickness=0.006, depth=0.04)
    grasps = model.grasps(gripper, table=([0, 0, 1], 0.0))
    assert len(grasps) > 0
    degrees = np.bincount(np.reshape(made.edges, -1))
    for grasp in grasps:
        away = np.linalg.norm(made.nodes[degrees > 1] - model.chains[grasp.chain].at(grasp.s), axis=1)
        assert away.min() > 0.5 * gripper.width
        for crossing in model.crossings():
            if grasp.chain == crossing.under[0]:
                assert abs(grasp.s - crossing.under[1]) > 0.5 * gripper.width


@pytest.mark.parametrize("seed", range(4))
def test_no_pull_moves_a_junction(seed):
    made, model = make_model("cross", seed)
    _, loose = make_model("cross", seed, joined=False)
    degrees = np.bincount(np.reshape(made.edges, -1))
    plan = model.pull_plan()
    undone = {id(one) for pull in plan.pulls for one in pull.undoes}
    assert len(undone) + len(plan.left) == len(model.crossings())
    for pull in plan.pulls:
        if pull.move == "end":
            start, stop = made.edges[pull.chain]
            # an end that is pulled out is held beyond the crossing
            from_start = pull.s == 0.0 if pull.lift else pull.s > pull.undoes[0].under[1]
            assert degrees[start if from_start else stop] == 1
    assert loose.pull_plan().left == ()


def test_a_crossing_between_junctions_is_left():
    """A bridge over another edge has a junction at both sides: nothing takes it off."""
    low = np.array([[0.0, -0.1, 0.004], [0.0, 0.1, 0.004]])
    high = np.array([[-0.1, 0.0, 0.012], [0.1, 0.0, 0.012]])
    forks = [
        np.array([high[side], high[side] + [out, up, 0.0]])
        for side, out in ((0, -0.1), (1, 0.1))
        for up in (-0.1, 0.1)
    ]
    tips = [
        np.array([low[side], low[side] + [out, 0.1 * (2 * side - 1), 0.0]])
        for side in (0, 1)
        for out in (-0.05, 0.05)
    ]
    pairs = [(0, 1), (2, 3), (2, 4), (2, 5), (3, 6), (3, 7), (0, 8), (0, 9), (1, 10), (1, 11)]
    lines = [low, high, *forks, *tips]
    chains = [strand.Chain(line, 0.004) for line in lines]
    places = {}
    for ends, line in zip(pairs, lines, strict=True):
        for node, place in zip(ends, line, strict=True):
            places.setdefault(node, place)
    degrees = np.bincount(np.reshape(pairs, -1))
    nodes = [HarnessNode(k, places[k], None, int(degrees[k])) for k in range(len(places))]
    edges = [HarnessEdge(k, *ends, chains[k]) for k, ends in enumerate(pairs)]
    model = strand.Model(chains, np.empty((0, 4, 4)), harness=Harness(nodes, edges))
    assert len(model.crossings()) == 1
    plan = model.pull_plan()
    assert (len(plan.pulls), len(plan.left)) == (0, 1)
    assert len(dataclasses.replace(model, harness=None).pull_plan().pulls) > 0
