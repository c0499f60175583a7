"""Ropes of known length."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from shared.ropes import R, find_warnings, hide_behind_plate, measure_length, measure_max_distance
from strand.config import Config


@pytest.fixture(scope="module")
def hidden_bow():
    """A straight rope with a bow of 3 cm in its middle, which a plate hides from one camera."""
    y = np.linspace(-0.15, 0.15, 601)
    x = np.where(np.abs(y) < 0.05, 0.03 * np.cos(np.pi * y / 0.1) ** 2, 0.0)
    truth = np.stack([x, y, np.full(len(y), R)], axis=1)
    scene = strand.synthetic.scene(chains=[truth], seed=2, views=1)
    return truth, hide_behind_plate(scene, (-0.04, -0.05), (0.08, 0.05), 0.022), scene.bounds


def test_a_bow_over_a_hidden_gap_makes_up_the_known_length(hidden_bow):
    truth, views, bounds = hidden_bow
    (straight,) = strand.reconstruct(views, R, bounds, ropes=1).chains
    model = strand.reconstruct(views, R, bounds, ropes=1, length=measure_length(truth))
    (chain,) = model.chains
    assert straight.length < 0.95 * measure_length(truth)
    assert chain.length == pytest.approx(measure_length(truth), rel=1e-3)
    assert measure_max_distance(straight, truth) > 6.0
    assert measure_max_distance(chain, truth) < 1.5
    assert find_warnings(model, "length") == []
    assert chain.bridged[np.abs(chain.points[:, 1]) < 0.03].all()
    low, high = bounds
    assert ((chain.points > low) & (chain.points < high)).all()


def test_a_known_length_leaves_visible_stretches_as_they_are(hidden_bow):
    truth, views, bounds = hidden_bow
    (straight,) = strand.reconstruct(views, R, bounds, ropes=1).chains
    (chain,) = strand.reconstruct(views, R, bounds, ropes=1, length=measure_length(truth)).chains
    seen = chain.points[np.abs(chain.points[:, 1]) > 0.065]
    assert straight.nearest(seen).distance.max() < 0.1 * R


def test_a_lost_end_is_doubted_by_the_missing_length():
    y = np.linspace(-0.15, 0.15, 601)
    truth = np.stack([0 * y, y, np.full(len(y), R)], axis=1)
    scene = strand.synthetic.scene(chains=[truth], seed=2, views=1)
    views = hide_behind_plate(scene, (-0.04, 0.1), (0.08, 0.2), 0.022)
    before = strand.reconstruct(views, R, scene.bounds, ropes=1)
    model = strand.reconstruct(views, R, scene.bounds, ropes=1, length=0.3)
    (chain,) = model.chains
    np.testing.assert_array_equal(chain.points, before.chains[0].points)
    assert model.confidence < before.confidence < 0.5
    short = round((0.3 - chain.length) * 1e3)
    assert short > 40
    (warning,) = find_warnings(model, "length")
    said = f"chain 0 is {chain.length * 1e3:.0f} mm long, {short} mm shorter than it is known to be"
    assert (str(warning), warning.chains) == (said, (0,))
    # 0.4 for each radius beyond 2 % of the length and one radius
    assert warning.amount == pytest.approx(0.4 * ((0.3 - chain.length - 0.02 * 0.3) / chain.radius - 1.0))


def test_no_bow_leads_through_free_space():
    y = np.linspace(-0.15, 0.15, 601)
    truth = np.stack([0 * y, y, np.full(len(y), R)], axis=1)
    scene = strand.synthetic.scene(chains=[truth], seed=2, views=1)
    views = hide_behind_plate(scene, (0.0, -0.05), (0.02, 0.05), 0.022)
    model = strand.reconstruct(views, R, scene.bounds, ropes=1, length=0.4)
    assert model.chains[0].length < 0.32
    assert len(find_warnings(model, "length")) == 1


@pytest.mark.parametrize("published", [False, True])
def test_a_right_length_changes_nothing_and_a_wrong_one_is_warned_about(published):
    scene = strand.synthetic.scene("arc", seed=3)
    config = Config.published() if published else Config()
    plain = strand.reconstruct(scene.views, R, scene.bounds, ropes=1, config=config)
    true = measure_length(scene.truth[0])
    for length in (true, [true]):
        model = strand.reconstruct(scene.views, R, scene.bounds, ropes=1, config=config, length=length)
        np.testing.assert_array_equal(model.chains[0].points, plain.chains[0].points)
        np.testing.assert_allclose(model.confidence, plain.confidence, atol=0.02)
        assert list(map(str, model.warnings)) == list(map(str, plain.warnings))
    model = strand.reconstruct(scene.views, R, scene.bounds, ropes=1, config=config, length=0.9 * true)
    (warning,) = find_warnings(model, "length")
    assert "longer than it is known to be" in str(warning)
    assert not model.confidence > 0.7


@pytest.mark.parametrize("times", [1.0, 40.0, 1000.0])
def test_lengths_in_millimetres_are_asked_about(times):
    scene = strand.synthetic.scene("arc", seed=3, views=1)
    true = times * round(measure_length(scene.truth[0]), 3)
    model = strand.reconstruct(scene.views, R, scene.bounds, length=true)
    said = [str(warning) for warning in find_warnings(model, "length")]
    assert len(said) == (times > 1)
    assert [f"; is length={true:g} in metres?" in text for text in said] == [times > 100] * len(said)


@pytest.mark.parametrize("half", [0.03, 0.045])
def test_lengths_decide_which_segments_belong_together(half):
    """Two ropes that cross under a plate: straight on, one would be much longer than the other."""

    def rope(side, before, after, lift):
        y = np.linspace(-half - before, half + after, 500)
        t = np.clip(0.5 + 0.5 * y / half, 0.0, 1.0)
        x = 0.012 * side * (1.0 - 2.0 * t**3 * (10.0 - 15.0 * t + 6.0 * t * t))
        return np.stack([x, y, R + lift * np.sin(np.pi * t) ** 2], axis=1)

    truth = [rope(1.0, 0.12, 0.05, 0.0), rope(-1.0, 0.05, 0.12, 2.2 * R)]
    scene = strand.synthetic.scene(chains=truth, seed=2, views=1)
    views = hide_behind_plate(scene, (-0.01, -half - 0.004), (0.08, half + 0.004), 0.045)
    for length in (None, [measure_length(nodes) for nodes in truth]):
        model = strand.reconstruct(views, R, scene.bounds, ropes=2, length=length)
        crossed = [chain.points[0, 0] * chain.points[-1, 0] < 0 for chain in model.chains]
        assert crossed == [length is not None] * 2
