"""Simulated harnesses: graphs, radii, angles, heights, and images that show them."""

from __future__ import annotations

import math
from collections import Counter
from functools import cache

import numpy as np
import pytest
from scipy.spatial import cKDTree

from strand.synthetic import HARNESSES, Camera, Noise, Segmentation, harness

SMALL = Camera(size=(64, 48))
SEEDS = range(6)


@cache
def draw(kind, seed):
    return harness(kind, seed=seed, views=1, camera=SMALL)


def find_degrees(made):
    return Counter(end for edge in made.edges for end in edge)


@pytest.mark.parametrize("kind", HARNESSES)
@pytest.mark.parametrize("seed", SEEDS)
def test_edges_share_the_places_of_their_nodes(kind, seed):
    made = draw(kind, seed)
    assert len(made.edges) == len(made.truth) == len(made.radii) == len(made.wires)
    for (start, stop), line in zip(made.edges, made.truth, strict=True):
        np.testing.assert_allclose(line[[0, -1]], made.nodes[[start, stop]], atol=1e-9)
    assert set(find_degrees(made)) == set(range(len(made.nodes)))


@pytest.mark.parametrize("kind", HARNESSES)
@pytest.mark.parametrize("seed", SEEDS)
def test_strands_do_not_cut_through_each_other_or_the_table(kind, seed):
    made = draw(kind, seed)
    if kind in ("tied", "loop"):
        return  # their edges stand for wires side by side
    for i, (edge, line, radius) in enumerate(zip(made.edges, made.truth, made.radii, strict=True)):
        if kind != "air":
            assert line[:, 2].min() > 0.99 * radius
        for other_edge, other, other_radius in list(zip(made.edges, made.truth, made.radii, strict=True))[
            i + 1 :
        ]:
            both = radius + other_radius
            places = line
            for node in set(edge) & set(other_edge):
                places = places[np.linalg.norm(places - made.nodes[node], axis=1) > 8.0 * both]
            if len(places):
                assert cKDTree(other).query(places)[0].min() > 0.97 * both


@pytest.mark.parametrize("kind", ["tree", "four", "tang", "cycle", "tied", "air"])
@pytest.mark.parametrize("seed", SEEDS)
def test_wires_are_conserved_at_junctions(kind, seed):
    made = draw(kind, seed)
    wire = made.radii[0] / math.sqrt(made.wires[0])
    np.testing.assert_allclose(made.radii, wire * np.sqrt(made.wires))
    for node, degree in find_degrees(made).items():
        if degree > 1:
            arriving = sum(
                count for count, edge in zip(made.wires, made.edges, strict=True) if edge[1] == node
            )
            leaving = sum(
                count for count, edge in zip(made.wires, made.edges, strict=True) if edge[0] == node
            )
            assert arriving == leaving


@pytest.mark.parametrize(("kind", "low", "high"), [("tree", 40, 80), ("tang", 22, 34)])
@pytest.mark.parametrize("seed", SEEDS)
def test_the_trunk_goes_straight_on_and_branches_leave_at_an_angle(kind, low, high, seed):
    made = draw(kind, seed)

    def find_heading(line):
        step = np.diff(line[:, :2], axis=0)[1:4].mean(axis=0)
        return step / np.linalg.norm(step)

    for node in set(node for node, degree in find_degrees(made).items() if degree > 1):
        (trunk,) = [line for line, edge in zip(made.truth, made.edges, strict=True) if edge[1] == node]
        onward = -find_heading(trunk[::-1])
        turns = sorted(
            math.degrees(math.acos(min(find_heading(line) @ onward, 1.0)))
            for line, edge in zip(made.truth, made.edges, strict=True)
            if edge[0] == node
        )
        assert turns[0] < 8
        assert low - 8 < turns[1] < high + 8


def test_kinds_have_the_nodes_that_they_say():
    assert all(max(find_degrees(draw("four", seed)).values()) == 4 for seed in SEEDS)
    for seed in SEEDS:
        cycle, ropes = draw("cycle", seed), draw("rope", seed)
        assert len(cycle.edges) == len(cycle.nodes)
        assert cycle.edges.count((1, 2)) == 2
        assert set(find_degrees(ropes).values()) == {1}
        assert (1, 1) in draw("loop", seed).edges
        assert len(draw("tree", seed).crossings) == 0
        assert len(draw("cross", seed).crossings) > 0
        assert len(draw("near", seed).crossings) > 0


@pytest.mark.parametrize("seed", SEEDS)
def test_an_end_that_is_laid_on_a_strand_lies_on_top_of_it(seed):
    made = draw("laid", seed)
    tip, (place,) = made.truth[-1][-1], made.crossings
    below = min(np.linalg.norm(line - place, axis=1).min() for line in made.truth[:-1])
    assert below < 1.1 * made.radii[-1]
    assert np.linalg.norm(tip[:2] - place[:2]) < 2.5 * made.radii[-1]
    assert tip[2] > place[2] + 0.5 * made.radii[-1]


@pytest.mark.parametrize("kind", HARNESSES)
def test_the_image_shows_each_edge_where_nothing_lies_on_it(kind):
    made = harness(kind, seed=1, views=1, noise=Noise(depth=0.0, flying=0.0))
    (pose,), k = made.poses_true, made.intrinsics
    shown, count = 0, 0
    for line, radius in zip(made.truth, made.radii, strict=True):
        # wires side by side have a gap between them near a tie
        reach = 10.0 * radius if kind in ("tied", "loop") else 0.005
        away = np.linalg.norm(line[:, None] - made.nodes, axis=2).min(axis=1) > reach
        count += away.sum()
        x, y, z = ((line[away] - pose[:3, 3]) @ pose[:3, :3]).T
        columns, rows = np.rint(x / z * k[0, 0] + k[0, 2]), np.rint(y / z * k[1, 1] + k[1, 2])
        depth = made.depth[0, rows.astype(int), columns.astype(int)] * made.depth_scale
        assert ((depth > 0) & (depth < z + 0.5 * radius)).all()
        shown += (depth > z - 2.0 * radius).sum()
    assert shown > 0.8 * count > 0


def test_a_device_gives_masks_and_a_seed_the_same_bits():
    options = {"seed": 4, "views": 2, "camera": Camera("sgbm", size=(320, 240)), "mask": Segmentation(grow=1)}
    one, other = harness("tree", **options), harness("tree", **options)
    np.testing.assert_array_equal(one.depth, other.depth)
    np.testing.assert_array_equal(one.poses, other.poses)
    assert one.mask.shape == one.depth.shape
    assert 0.005 < one.mask.mean() < 0.3
    assert (harness("tree", **options | {"seed": 5}).depth != one.depth).any()
    with pytest.raises(ValueError, match="kind: expected one of tree, "):
        harness("star")
