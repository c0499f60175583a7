"""Doubts of a look at a harness: by another look, by views along the table, and by points on no strand."""

from __future__ import annotations

import math

import numpy as np
import pytest

import strand
from strand.reconstruction.harness.graph import Graph
from strand.reconstruction.harness.look_doubts import doubt_by_rival, doubt_hidden_ends, is_same_graph
from strand.synthetic import Camera, Noise, camera_pose, harness
from strand.synthetic.rendering import render_depth

CAMERA = Camera(size=(640, 480))
RADIUS = 0.004  # metres
PLACES = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [-0.1, 0.0, 0.0]])
PAIRS = [(0, 1), (0, 2), (0, 3)]


def look(lines, radii, elevation=1.1):
    rng = np.random.default_rng(0)
    pose = camera_pose(0.3, 0.5, elevation)
    depth = render_depth(lines, radii, CAMERA.intrinsics, pose, CAMERA.size, 3.0)
    depth[depth > 0.0] += 0.0003 * rng.normal(size=np.count_nonzero(depth > 0.0))
    view = strand.View.from_depth(depth, CAMERA.intrinsics, pose)
    bounds = ([-0.3, -0.3, 0.0025], [0.3, 0.3, 0.03])
    return strand.reconstruct([view], sorted(set(radii)), bounds, branches=True)


def draw(start, stop):
    return np.linspace([*start, RADIUS], [*stop, RADIUS], 80)


def make_graph(places, pairs):
    return Graph(np.asarray(places), np.zeros((len(places), 3, 3)), pairs)


def test_graphs_are_the_same_in_any_order_and_near_enough():
    graph = make_graph(PLACES, PAIRS)
    order = [2, 0, 3, 1]
    numbers = {old: new for new, old in enumerate(order)}
    renamed = make_graph(PLACES[order] + 0.004, [(numbers[b], numbers[a]) for a, b in PAIRS[::-1]])
    assert is_same_graph(graph, renamed, 0.01)
    assert not is_same_graph(graph, renamed, 0.005)
    assert not is_same_graph(graph, make_graph(PLACES, [(0, 1), (0, 2), (1, 3)]), 0.01)
    assert not is_same_graph(graph, make_graph(PLACES[:3], PAIRS[:2]), 0.01)


@pytest.mark.parametrize(("height", "hidden"), [(2.0, 2), (0.0, 0), (-2.0, 0)])
def test_ends_under_another_strand_are_doubted(height, hidden):
    # two strands end where a third passes, over the ends, beside or under these
    lines = [draw((-0.1, 0.0), (-0.002, 0.0)), draw((0.002, 0.0), (0.1, 0.0)), draw((0.0, -0.1), (0.0, 0.1))]
    lines[2][:, 2] += height * RADIUS
    chains = [strand.Chain(line, RADIUS) for line in lines]
    graph = make_graph([line[late] for line in lines for late in (0, -1)], [(0, 1), (2, 3), (4, 5)])
    doubts = list(doubt_hidden_ends(graph, chains, np.array([0.0, 0.0, 1.0])))
    assert [abs(float(doubt.place[0])) for doubt in doubts] == [0.002] * hidden


def test_the_node_of_a_ring_has_no_place_of_its_own():
    # the ring's node is 4
    graph = make_graph([*PLACES, [0.5, 0.0, 0.0]], [*PAIRS, (4, 4)])
    assert is_same_graph(graph, make_graph([*PLACES, [0.5, 0.3, 0.0]], [*PAIRS, (4, 4)]), 0.01)
    assert not is_same_graph(graph, make_graph([*PLACES, [0.5, 0.0, 0.0]], [*PAIRS, (0, 4)]), 0.01)
    alone = [make_graph([[x, 0.0, 0.0]], [(0, 0)]) for x in (0.0, 0.3)]
    assert is_same_graph(*alone, 0.01)
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    ring = np.column_stack([0.08 * np.cos(angle), 0.06 * np.sin(angle), np.full(200, RADIUS)])
    model = look([ring], [RADIUS])
    assert [chain.closed for chain in model.chains] == [True]
    assert model.confidence > 0.9


@pytest.mark.parametrize(("sure", "rival"), [(0.97, 0.6), (0.86, 0.6), (0.5, 0.5), (0.9, 0.0)])
def test_a_rival_leaves_the_share_that_bayes_says(sure, rival):
    left = sure * math.exp(-doubt_by_rival(sure, rival).amount)
    only, other, none = sure * (1 - rival), rival * (1 - sure), (1 - sure) * (1 - rival)
    assert left == pytest.approx(only / (only + other + none))


@pytest.mark.parametrize("length", [2.75, 3.25, 3.75])
def test_a_short_branch_that_is_left_out_is_doubted(length):
    rope = draw((-0.14, 0.0), (0.14, 0.0))
    whole = look([rope], [RADIUS])
    tip = (0.3 * length * RADIUS, 0.95 * length * RADIUS)
    short = look([rope, draw((0.0, 0.0), tip)], [RADIUS, RADIUS])
    assert len(whole.chains) == 1
    assert whole.confidence > 0.9
    if len(short.chains) == 1:
        (doubt,) = (doubt for doubt in short.doubts if doubt.kind == "left out")
        np.testing.assert_allclose(doubt.place[:2], tip, atol=2.0 * RADIUS)
    assert short.confidence < 0.8


def test_views_along_a_table_are_doubted():
    made = harness("tree", seed=2, views=1)
    flat, steep = (look([*made.truth], list(made.radii), elevation) for elevation in (0.15, 1.1))
    (doubt,) = (doubt for doubt in flat.doubts if doubt.kind == "view")
    assert "look along the table" in str(doubt)
    assert flat.confidence < 0.9
    assert "view" not in {doubt.kind for doubt in steep.doubts}


def test_strands_along_the_rays_in_the_air_are_doubted():
    # both branches go on, but so aslant that their points are as sparse as outliers
    made = harness("air", seed=924050, views=1, noise=Noise(depth=0.0006))
    model = strand.reconstruct(made.views, sorted(set(made.radii)), made.bounds, branches=True)
    dropped = [doubt for doubt in model.doubts if "dropped" in doubt.reason]
    assert [doubt.kind for doubt in dropped] == ["left out"]
    assert model.confidence < 0.9
    whole = harness("air", seed=940017, views=3, noise=Noise(depth=0.0006))
    model = strand.reconstruct(whole.views, sorted(set(whole.radii)), whole.bounds, branches=True)
    assert not any("dropped" in doubt.reason for doubt in model.doubts)


def test_a_strand_along_the_rays_in_the_air_is_not_cut_off():
    made = harness("air", seed=940009, views=1, noise=Noise(depth=0.0006))
    model = strand.reconstruct(made.views, sorted(set(made.radii)), made.bounds, branches=True)
    truth = sorted(np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in made.truth)
    assert sorted(edge.length for edge in model.harness.edges) == pytest.approx(truth, rel=0.25)


@pytest.mark.parametrize("step", [20, 150])
def test_sparse_views_of_a_harness_in_the_air_keep_their_points(step):
    made = harness("air", seed=940017, views=3, noise=Noise(depth=0.0003))
    views = [strand.View(view.points[::step], view.pose) for view in made.views]
    model = strand.reconstruct(views, sorted(set(made.radii)), made.bounds, branches=True)
    assert len(model.harness.edges) == len(made.edges)
