"""Rings, ropes beside each other, and radii that no rope has."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from strand.reconstruction.harness.rises import list_rises
from strand.synthetic import Camera, Noise, camera_pose, harness, render_depth

CAMERA = Camera(size=(640, 480))
ROOM = ([-0.3, -0.3, 0.001], [0.3, 0.3, 0.05])


def look(lines, radius, given=None):
    rng = np.random.default_rng(0)
    views = []
    for turn in (0.3, 2.4, 4.5):
        pose = camera_pose(turn, 0.5, 1.0)
        depth = render_depth(lines, [radius] * len(lines), CAMERA.intrinsics, pose, CAMERA.size, 3.0)
        depth[depth > 0.0] += 0.0003 * rng.normal(size=np.count_nonzero(depth > 0.0))
        views.append(strand.View.from_depth(depth, CAMERA.intrinsics, pose))
    return strand.reconstruct(views, radius if given is None else given, ROOM, branches=True)


def test_a_ring_has_the_length_of_one_turn():
    angles = np.linspace(0.0, 2.0 * np.pi, 201)
    line = np.column_stack([0.07 * np.cos(angles), 0.07 * np.sin(angles), np.full(201, 0.003)])
    model = look([line], 0.003)
    (edge,) = model.harness.edges
    assert edge.chain.closed
    assert edge.length == pytest.approx(2.0 * np.pi * 0.07, rel=0.02)


def test_ropes_that_run_beside_each_other_for_a_while_are_two():
    along = np.linspace(-0.12, 0.12, 121)
    aside = 0.00405 + 0.8 * np.maximum(np.abs(along) - 0.03, 0.0) ** 2 / 0.09
    lines = [np.column_stack([along, side * aside, np.full(121, 0.004)]) for side in (-1.0, 1.0)]
    model = look(lines, 0.004)
    assert [node.degree for node in model.harness.nodes] == [1, 1, 1, 1]


def test_an_end_that_touches_a_side_is_no_sure_junction():
    host = np.column_stack([np.linspace(-0.11, 0.11, 111), np.zeros(111), np.full(111, 0.004)])
    other = np.column_stack([np.zeros(46), np.linspace(0.0082, 0.0982, 46), np.full(46, 0.004)])
    assert look([host, other], 0.004).confidence < 0.9


def test_two_ends_that_lie_on_each_other_are_two_ropes():
    s = np.linspace(0.0, 0.14, 90)
    below = np.column_stack([s, np.zeros(90), np.full(90, 0.004)])
    # the other rope comes down to the table within nine radii
    share = np.clip((s - 0.006) / 0.036, 0.0, 1.0)
    above = np.column_stack([np.full(90, 0.002), s, 0.004 + 0.0082 * (1.0 - share**2 * (3.0 - 2.0 * share))])
    model = look([below, above], 0.004)
    assert [node.degree for node in model.harness.nodes] == [1, 1, 1, 1]
    assert sorted(chain.length for chain in model.chains) == pytest.approx([0.14, 0.14], abs=0.008)


@pytest.mark.parametrize(("height", "below", "found"), [(0.008, 1.0, 1), (0.002, 1.0, 0), (0.008, 0.0, 0)])
def test_a_strand_that_rises_over_nothing_is_found(height, below, found):
    along = np.linspace(-0.15, 0.15, 151)
    bump = height * np.exp(-((along / 0.015) ** 2))
    rising = np.column_stack([along, np.zeros(151), 0.004 + bump])
    other = np.column_stack([np.full(151, 0.001), along + 0.3 * below, np.full(151, 0.004)])
    places = list_rises([(rising, 0.004, False), (other, 0.004, False)], np.array([0.0, 0.0, 1.0]))
    assert len(places) == found
    if found:
        np.testing.assert_allclose(places[0], [0.0, 0.0, 0.012], atol=0.01)


def test_a_radius_as_high_as_the_ropes_is_refused():
    line = np.column_stack([np.linspace(-0.1, 0.1, 101), np.zeros(101), np.full(101, 0.002)])
    with pytest.raises(strand.NotEnoughDataError, match="over the table"):
        look([line], 0.002, given=0.012)


@pytest.mark.parametrize(("seed", "noise"), [(830009, 0.00078), (921035, 0.00098), (950014, 0.00036)])
def test_tangles_of_ropes_in_one_low_view_have_no_junction(seed, noise):
    made = harness("rope", seed=seed, views=1, noise=Noise(depth=noise))
    graph = strand.reconstruct(made.views, made.radii[0], made.bounds, branches=True).harness
    assert [node.degree for node in graph.nodes] == [1, 1, 1, 1]
    true = [np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in made.truth]
    assert sorted(edge.length for edge in graph.edges) == pytest.approx(sorted(true), rel=0.05)


def test_an_end_that_lies_on_a_strand_in_a_bend_keeps_its_length():
    made = harness("near", seed=1051017, views=7, noise=Noise(depth=0.00041))
    graph = strand.reconstruct(made.views, sorted(set(made.radii)), made.bounds, branches=True).harness
    true = sorted(np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in made.truth)
    assert sorted(edge.length for edge in graph.edges) == pytest.approx(true, rel=0.04)


def test_a_strand_that_bends_sharply_between_junctions_keeps_its_length():
    made = harness("cross", seed=1054045, views=7, noise=Noise(depth=0.00071))
    graph = strand.reconstruct(made.views, sorted(set(made.radii)), made.bounds, branches=True).harness
    degrees = [node.degree for node in graph.nodes]
    (inner,) = [edge for edge in graph.edges if degrees[edge.start] > 1 and degrees[edge.stop] > 1]
    ((number, _),) = [
        (k, pair)
        for k, pair in enumerate(made.edges)
        if all(sum(node in other for other in made.edges) > 1 for node in pair)
    ]
    true = np.linalg.norm(np.diff(made.truth[number], axis=0), axis=1).sum()
    assert inner.length == pytest.approx(true, rel=0.15)


def test_a_branch_that_no_camera_saw_leaves_a_doubt_of_the_gap():
    made = harness("air", seed=1041011, views=1, noise=Noise(depth=0.0005))
    model = strand.reconstruct(made.views, sorted(set(made.radii)), made.bounds, branches=True)
    assert len(model.harness.edges) < len(made.edges)
    (doubt,) = [doubt for doubt in model.doubts if "point at each other" in doubt.reason]
    missed = made.nodes[2]
    assert np.linalg.norm(doubt.place - missed) < 3.0 * max(made.radii)
    assert model.confidence < 0.8


def test_branches_side_by_side_all_the_way_are_no_sure_rope():
    made = harness("air", seed=1097002, views=7, noise=Noise(depth=0.00039))
    model = strand.reconstruct(made.views, None, made.bounds, branches=True)
    assert len(model.harness.edges) < len(made.edges)
    assert any("farther off the strand's surface" in doubt.reason for doubt in model.doubts)
    assert model.confidence < 0.8
