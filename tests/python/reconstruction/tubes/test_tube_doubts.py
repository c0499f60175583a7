"""Doubts about answers of tubes."""

from __future__ import annotations

import numpy as np

import strand
from shared.ropes import R, find_warnings
from strand.ropes.doubt import DOUBTS


def test_an_answer_about_a_clear_scene_is_confident(paper_model, tmp_path):
    assert paper_model.confidence > 0.85
    assert not {warning.kind for warning in paper_model.warnings} & set(DOUBTS)
    assert all(join.margin > 1.5 for join in paper_model.joins)
    assert [join.margin for join in paper_model.joins] == sorted(join.margin for join in paper_model.joins)
    paper_model.save(tmp_path / "model.json")
    loaded = strand.load_model(tmp_path / "model.json")
    assert loaded.confidence == paper_model.confidence
    assert len(loaded.joins) == len(paper_model.joins)
    for a, b in zip(loaded.joins, paper_model.joins, strict=True):
        np.testing.assert_array_equal(a.place, b.place)
        assert (a.chains, a.margin) == (b.chains, b.margin)
    assert [str(doubt) for doubt in loaded.doubts] == [str(doubt) for doubt in paper_model.doubts]
    assert [doubt.amount for doubt in loaded.doubts] == [doubt.amount for doubt in paper_model.doubts]


def test_a_hidden_end_is_put_in_the_middle_of_its_range_and_doubted(tucked_under):
    scene = tucked_under
    model = strand.reconstruct(scene.views, scene.radius, scene.bounds)
    assert len(model.chains) == 2
    end = scene.truth[1][-1]
    off = min(np.linalg.norm(chain.points[k] - end) for chain in model.chains for k in (0, -1))
    assert off < 1.5 * R
    hidden = [doubt for doubt in model.doubts if doubt.kind == "end"]
    assert len(hidden) == 1
    assert np.linalg.norm(hidden[0].place - end) < 4.0 * R
    assert model.confidence < 0.95
    assert [(warning.place.tolist(), warning.amount) for warning in find_warnings(model, "end")] == [
        (doubt.place.tolist(), doubt.amount) for doubt in model.doubts if doubt.kind == "end"
    ]


def test_points_on_no_rope_lower_the_confidence(paper):
    rng = np.random.default_rng(0)
    _, high = paper.bounds
    ball = rng.normal(size=(1500, 3))
    ball = np.array([0.0, 0.0, high[2] - 3.0 * R]) + 3.0 * R * ball / np.linalg.norm(ball, axis=1)[:, None]
    views = []
    for view in paper.views:
        facing = (ball - ball.mean(axis=0)) @ (view.viewpoint - ball.mean(axis=0)) > 0
        back = (ball[facing] - view.viewpoint) @ view.pose[:3, :3]
        views.append(strand.View(np.concatenate([view.points, back]), view.pose))
    model = strand.reconstruct(views, paper.radius, paper.bounds)
    assert model.confidence < 0.8
    assert "points" in [doubt.kind for doubt in model.doubts]


def test_noise_as_wide_as_the_rope_lowers_the_confidence():
    scene = strand.synthetic.scene(
        "paper", seed=0, radius=0.0025, noise=strand.synthetic.Noise(depth=0.0015), views=2
    )
    assert strand.reconstruct(scene.views, scene.radius, scene.bounds).confidence < 0.7


def test_a_wrong_number_of_ropes_lowers_the_confidence(paper):
    for ropes in (2, 3):
        model = strand.reconstruct(paper.views, paper.radius, paper.bounds, ropes=ropes)
        assert model.confidence < 0.5


def test_a_wrong_radius_is_warned_about(paper, paper_model):
    half = strand.reconstruct(paper.views, 0.5 * paper.radius, paper.bounds)
    assert len(find_warnings(half, "points")) == 1
    assert find_warnings(paper_model, "points") == []
