"""Ends on another rope's side."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from shared.ropes import R, draw_line, find_warnings
from strand.reconstruction.evidence.branches import find_branches

UP = np.array([0.0, 0.0, 5.0 * R])


def test_branches_are_ends_that_point_into_another_side():
    trunk = strand.Chain(draw_line([-0.1, 0, 0], [0.1, 0, 0]), R)
    branch = strand.Chain(draw_line([0.0, 2.5 * R, 0], [0.0, 0.1, 0]), R)
    ((number, other, place),) = find_branches([trunk, branch])
    assert (number, other) == (1, 0)
    np.testing.assert_allclose(place, [0, 0, 0], atol=R)
    over = strand.Chain(draw_line([0.0, 2.5 * R, 2 * R], [0.0, 0.1, 2 * R]), R)
    assert find_branches([trunk, over]) == []


def test_a_branched_object_comes_as_chains_that_meet_and_says_so(data):
    points = np.loadtxt(data / "harness" / "wireHarness.txt")
    model = strand.reconstruct([strand.View.from_world(points, points.mean(axis=0) + 40.0 * UP)], 0.006)
    assert len(model.chains) > 2
    found = find_warnings(model, "branch")
    assert found
    for warning in found:
        end, trunk = (model.chains[number] for number in warning.chains)
        reach = np.linalg.norm(end.points[[0, -1]] - warning.place, axis=1).min()
        assert warning.amount == pytest.approx(reach)
        assert warning.amount < trunk.radius + 1.75 * end.radius
        assert trunk.nearest(warning.place[None]).distance[0] < 1e-9
    assert model.confidence < 0.2


def test_a_t_is_named_a_branch_and_a_gap_is_none():
    trunk = np.stack([np.linspace(-0.1, 0.1, 201), np.zeros(201), np.full(201, R)], axis=1)
    for start, branched in ((0.0, True), (4.5 * R, False)):
        arm = np.stack([np.zeros(101), start + np.linspace(0.0, 0.1, 101), np.full(101, R)], axis=1)
        scene = strand.synthetic.scene(chains=[trunk, arm], seed=1)
        model = strand.reconstruct(scene.views, scene.radius, scene.bounds)
        assert len(find_warnings(model, "branch")) == branched


@pytest.mark.parametrize(("gap", "said"), [(0.0, True), (1.0, False), (2.0, False)])
def test_a_rope_that_ends_short_of_another_is_no_branch(gap, said):
    trunk = draw_line([-0.12, 0, R], [0.12, 0, R])
    other = draw_line([0.01, (1.0 + gap) * R, R], [0.01, 0.12, R])
    scene = strand.synthetic.scene(chains=[trunk, other], radius=R, seed=1)
    model = strand.reconstruct(scene.views, R, scene.bounds)
    assert len(model.chains) == 2
    assert len(find_warnings(model, "branch")) == said


def test_ropes_that_cross_near_an_end_are_no_branches(collected):
    scene = collected("two_ropes")
    model = strand.reconstruct(scene.views, scene.radius, scene.bounds)
    assert len(model.chains) == 2
    assert find_warnings(model, "branch") == []
