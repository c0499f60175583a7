"""Plans that take ropes apart: followed move by move, they leave no crossing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from shared.ropes import R, draw_circle
from strand import Chain, Model
from strand.ropes.pulls import plan_pulls
from strand.synthetic import random_ropes, shape

UP = np.array([0.0, 0.0, 1.0])


def make_model(*chains):
    return Model(chains, np.eye(4)[None])


def move_end(chains, pull):
    """Return the ropes after the move of an end: the tail lies straight where the plan puts it."""
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
    count = len(make_model(*chains).crossings())
    plan = make_model(*chains).pull_plan()
    assert (sum(len(pull.undoes) for pull in plan.pulls), plan.left) == (count, ())
    while count:
        first = make_model(*chains).pull_plan().pulls[0]
        chains = move_end(chains, first)
        assert len(make_model(*chains).crossings()) < count
        count = len(make_model(*chains).crossings())


def test_a_plan_is_printed_as_its_moves():
    plan = make_model(Chain(shape("loop"), R)).pull_plan()
    assert str(plan).splitlines() == [
        *(f"{k}. {pull}" for k, pull in enumerate(plan.pulls, 1)),
        "0 crossings left",
    ]


def test_several_ropes_come_apart():
    ropes = make_model(*(Chain(nodes, R) for nodes in random_ropes(6, 3, R, 6)))
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
        (pull,) = make_model(line, end).pull_plan().pulls
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
    first = make_model(bight, end, *walls).pull_plan().pulls[0]
    assert (first.move, first.lift, first.chain, len(first.undoes)) == ("loop", True, 0, 1)
    np.testing.assert_allclose(first.place[:2], [0.0, 0.02], atol=1e-4)
    np.testing.assert_allclose(first.direction, [0, 1, 0], atol=1e-6)
    # clear of the end
    assert first.distance == pytest.approx(0.02 + 4 * R, abs=1e-4)
    # not through a rope that lies in the way
    beyond = Chain([[-0.05, 0.055, 0.0], [0.05, 0.055, 0.0]], R)
    assert make_model(bight, end, *walls, beyond).pull_plan().pulls[0].move == "end"


def test_a_loop_that_lies_on_a_rope_is_lifted_off():
    s = np.linspace(-0.1, 0.1, 101)
    line = Chain(np.stack([s, 0 * s, 0 * s], axis=1), R)
    t = np.linspace(-1, 1, 201)
    bight = Chain(np.stack([0.04 * t, 0.02 - 0.4 * t**2, 0 * t + 2 * R], axis=1), R)
    (pull,) = make_model(line, bight).pull_plan().pulls
    assert (pull.move, pull.lift, pull.chain, len(pull.undoes)) == ("loop", True, 1, 2)
    np.testing.assert_allclose(pull.direction, [0, -1, 0], atol=1e-6)
    assert pull.distance == pytest.approx(0.02 + 4 * R, abs=1e-4)
    np.testing.assert_allclose(pull.place[:2], [0, 0.02], atol=1e-4)
    # the loop beneath is not lifted through the rope
    assert all(one.chain == 0 for one in make_model(line, bight).pull_plan((0, 0, -1)).pulls)


def test_what_lies_free_needs_no_pull_and_linked_rings_are_left():
    assert make_model(draw_circle(0.05, 100, False)).pull_plan().pulls == ()
    assert make_model().pull_plan().left == ()
    one = draw_circle(0.05, 200, True)
    tilted = Chain(
        np.stack([one.points[:, 0] + 0.05, 0.9 * one.points[:, 1], 0.3 * one.points[:, 1]], axis=1),
        R,
        closed=True,
    )
    plan = make_model(one, tilted).pull_plan()
    assert (plan.pulls, len(plan.left)) == ((), 2)
    with pytest.raises(ValueError, match="direction"):
        make_model(one).pull_plan((0, 0, 0))


def move_loop(chains, pull):
    """Return the ropes after the move of a loop, which runs straight to the goal and back."""
    chain = chains[pull.chain]
    passes = [s for one in pull.undoes for i, s in (one.over, one.under) if i == pull.chain]
    goal = pull.place + pull.distance * pull.direction + 10 * R * UP
    before = chain.arc_length < min(passes) - 4 * R
    after = chain.arc_length > max(passes) + 4 * R
    nodes = np.vstack([chain.points[before], goal, chain.points[after]])
    return [Chain(nodes, R) if i == pull.chain else one for i, one in enumerate(chains)]


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("depth", [-0.08, -0.04, -0.02, 0.02, 0.04, 0.08])
def test_a_straight_loop_is_lifted_over_all_that_bulges_beneath_it(depth, turned):
    x = np.linspace(-0.25, 0.25, 601)
    lower = Chain(np.stack([x, depth * (1 - (x / 0.05) ** 2), 0 * x], axis=1), R)
    upper = np.stack([x, 0 * x, 0 * x + 2 * R], axis=1)
    chains = [lower, Chain(upper[::-1] if turned else upper, R)]
    (pull,) = make_model(*chains).pull_plan().pulls
    assert (pull.move, len(pull.undoes)) == ("loop", 2)
    np.testing.assert_allclose(pull.direction, [0, np.sign(depth), 0], atol=1e-6)
    assert pull.distance == pytest.approx(abs(depth) + 4 * R, abs=1e-3)
    assert make_model(*move_loop(chains, pull)).crossings() == ()


@pytest.mark.parametrize("past", [0.5, 0.9, 3.0])
@pytest.mark.parametrize("turned", [False, True])
def test_a_loop_goes_back_to_its_own_ends(past, turned):
    x = np.linspace(-0.2, 0.2, 401)
    lower = Chain(np.stack([x, 0 * x, 0 * x], axis=1), R)
    bight = np.stack([0.3 * x, past * R - 20 * x**2, 0 * x + 2 * R], axis=1)
    chains = [lower, Chain(bight[::-1] if turned else bight, R)]
    (pull,) = make_model(*chains).pull_plan().pulls
    np.testing.assert_allclose(pull.direction, [0, -1, 0], atol=1e-3)
    assert make_model(*move_loop(chains, pull)).crossings() == ()


def test_a_rope_right_above_another_one_is_moved_to_a_side():
    x = np.linspace(-0.1, 0.1, 101)
    upper, lower = (Chain(np.stack([x, 0 * x, 0 * x + z], axis=1), R) for z in (2 * R, 0.0))
    (one,) = make_model(upper, Chain(lower.points[:, [1, 0, 2]], R)).crossings()
    # two at the same place, as of strands that lie too close together to tell
    twice = [replace(one, over=(0, s), under=(1, s)) for s in (0.09, 0.11)]
    (pull,) = plan_pulls((upper, lower), twice, UP).pulls
    np.testing.assert_allclose(np.abs(pull.direction), [0, 1, 0], atol=1e-9)
    assert pull.distance == pytest.approx(4 * R)


@pytest.mark.parametrize("start", [0.0, 1.0, 2.5, 4.0])
def test_rings_come_apart_the_short_way_wherever_they_begin(start):
    t = start + np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
    ring = np.stack([0.1 * np.cos(t), 0.1 * np.sin(t), 0 * t], axis=1)
    moved = ring + np.array([0.18, 0.0, 2 * R])
    rings = [Chain(ring, R, closed=True), Chain(moved, R, closed=True)]
    (pull,) = make_model(*rings).pull_plan().pulls
    np.testing.assert_allclose(pull.direction, [1, 0, 0], atol=0.05)
    assert pull.distance == pytest.approx(0.02 + 4 * R, abs=2e-3)


def test_what_a_short_pull_leaves_is_said():
    s = np.linspace(-0.1, 0.1, 101)
    line = Chain(np.stack([s, 0 * s, 0 * s + 2 * R], axis=1), R)
    (free,) = make_model(line, Chain([[0.0, -0.2, 0.0], [0.0, 0.06, 0.0]], R)).pull_plan().pulls
    assert free.slack == pytest.approx(0.0, abs=1e-9)
    # an end within a spiral has no room
    (hemmed,) = make_model(Chain(random_ropes(1, 1, R, 0)[0], R)).pull_plan().pulls
    assert hemmed.slack > 0.05
