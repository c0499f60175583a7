"""Plans that take ropes apart: done move by move, they leave nothing that crosses."""

from __future__ import annotations

import numpy as np
import pytest
from drawn import R, circle

from strand import Chain, Model
from strand.synthetic import random_ropes, shape

UP = np.array([0.0, 0.0, 1.0])


def model(*chains):
    return Model(chains, np.eye(4)[None])


def done(chains, pull):
    """The ropes after the move of an end: the tail lies straight where the plan has put it."""
    chain = chains[pull.chain]
    (crossing,) = pull.undoes
    start = pull.s < 0.5 * chain.length
    passes = [s for i, s in (crossing.over, crossing.under) if i == pull.chain]
    held = min(passes) + 4 * R if start else max(passes) - 4 * R
    turn = chain.at(held)
    goal = pull.place + pull.distance * pull.direction
    assert abs(pull.direction @ UP) < 1e-12
    tail = np.linspace(turn, goal, 30)[1:] * [1, 1, 0] + [0, 0, 10 * R]
    kept = chain.arc_length > held if start else chain.arc_length < held
    nodes = np.vstack([tail[::-1], chain.points[kept]] if start else [chain.points[kept], tail])
    return [Chain(nodes, R) if i == pull.chain else one for i, one in enumerate(chains)]


@pytest.mark.parametrize("name", ["loop", "figure8", "overhand", "paper"])
def test_each_move_undoes_what_it_says_and_after_the_last_nothing_crosses(name):
    chains = [Chain(shape(name), R)]
    count = len(model(*chains).crossings())
    plan = model(*chains).pull_plan()
    assert (sum(len(pull.undoes) for pull in plan.pulls), plan.left) == (count, ())
    while count:
        first = model(*chains).pull_plan().pulls[0]
        chains = done(chains, first)
        assert len(model(*chains).crossings()) < count
        count = len(model(*chains).crossings())


def test_several_ropes_come_apart():
    ropes = model(*(Chain(nodes, R) for nodes in random_ropes(6, 3, R, 6)))
    plan = ropes.pull_plan()
    undone = [one.place for pull in plan.pulls for one in pull.undoes]
    np.testing.assert_allclose(
        sorted(map(tuple, undone)), sorted(tuple(one.place) for one in ropes.crossings())
    )
    assert plan.left == ()
    assert ropes.pull_plan(-UP).left == ()


def test_an_end_on_top_is_lifted_and_one_beneath_is_pulled_out():
    s = np.linspace(-0.1, 0.1, 101)
    line = Chain(np.stack([s, 0 * s, 0 * s], axis=1), R)
    for height in (2 * R, -2 * R):
        end = Chain([[0.05, -0.3, height], [0.05, 0.03, height]], R)
        (pull,) = model(line, end).pull_plan().pulls
        assert (pull.move, pull.chain, pull.lift) == ("end", 1, height > 0)
        # back, and not onto itself
        assert -0.99 < pull.direction[1] < -0.5
        assert pull.s == pytest.approx(end.length if height > 0 else 0.3 - 4 * R)
        assert (pull.place + pull.distance * pull.direction)[1] < -2 * R
        assert str(pull).startswith("lift the end" if height > 0 else "pull out the end")


def test_a_strand_is_lifted_over_the_end_of_one_that_is_hemmed_in():
    s = np.linspace(-1.0, 1.0, 201)
    # the end of a rope comes out from under a bight by 2 cm, between two other ropes
    bight = Chain(np.stack([0.2 * s, 0.02 - 0.1 * s**2, 0 * s + 2 * R], axis=1), R)
    end = Chain([[0.0, -0.2, 0.0], [0.0, 0.04, 0.0]], R)
    walls = [Chain([[x, -0.2, 0.0], [x, 0.0, 0.0]], R) for x in (-0.015, 0.015)]
    first = model(bight, end, *walls).pull_plan().pulls[0]
    assert (first.move, first.lift, first.chain, len(first.undoes)) == ("loop", True, 0, 1)
    np.testing.assert_allclose(first.place[:2], [0.0, 0.02], atol=1e-4)
    np.testing.assert_allclose(first.direction, [0, 1, 0], atol=1e-6)
    # clear of the end
    assert first.distance == pytest.approx(0.02 + 4 * R, abs=1e-4)
    # not through a rope that lies in the way
    beyond = Chain([[-0.05, 0.055, 0.0], [0.05, 0.055, 0.0]], R)
    assert model(bight, end, *walls, beyond).pull_plan().pulls[0].move == "end"


def test_a_loop_that_lies_on_a_rope_is_lifted_off():
    s = np.linspace(-0.1, 0.1, 101)
    line = Chain(np.stack([s, 0 * s, 0 * s], axis=1), R)
    t = np.linspace(-1, 1, 201)
    bight = Chain(np.stack([0.04 * t, 0.02 - 0.4 * t**2, 0 * t + 2 * R], axis=1), R)
    (pull,) = model(line, bight).pull_plan().pulls
    assert (pull.move, pull.lift, pull.chain, len(pull.undoes)) == ("loop", True, 1, 2)
    np.testing.assert_allclose(pull.direction, [0, -1, 0], atol=1e-6)
    assert pull.distance == pytest.approx(0.02 + 4 * R, abs=1e-4)
    np.testing.assert_allclose(pull.place[:2], [0, 0.02], atol=1e-4)
    # the loop beneath is not lifted through the rope
    assert all(one.chain == 0 for one in model(line, bight).pull_plan((0, 0, -1)).pulls)


def test_what_lies_free_needs_no_pull_and_linked_rings_are_left():
    assert model(circle(0.05, 100, False)).pull_plan().pulls == ()
    assert model().pull_plan().left == ()
    one = circle(0.05, 200, True)
    tilted = Chain(
        np.stack([one.points[:, 0] + 0.05, 0.9 * one.points[:, 1], 0.3 * one.points[:, 1]], axis=1),
        R,
        closed=True,
    )
    plan = model(one, tilted).pull_plan()
    assert (plan.pulls, len(plan.left)) == ((), 2)
    with pytest.raises(ValueError, match="direction"):
        model(one).pull_plan((0, 0, 0))
