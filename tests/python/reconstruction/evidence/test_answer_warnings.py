"""Warnings about an answer."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from shared.ropes import R, draw_line, find_warnings
from strand.config import Linking
from strand.reconstruction.evidence.answer_warnings import warn_about_answer
from strand.reconstruction.evidence.confidence import doubt_margin
from strand.reconstruction.evidence.visibility import sort_rays
from strand.ropes.doubt import DOUBTS, Doubt


def test_ends_that_leave_the_extraction_range_are_warned_about():
    t = np.linspace(-0.2, 0.2, 400)
    scene = strand.synthetic.scene(chains=[np.stack([t, 0 * t, 0 * t + 0.0042], axis=1)], seed=1)
    low, high = (np.array(corner) for corner in scene.bounds)
    low[0], high[0] = -0.1, 0.1
    model = strand.reconstruct(scene.views, scene.radius, (low, high))
    ends = find_warnings(model, "cut end")
    assert sorted(np.sign(warning.place[0]) for warning in ends) == [-1.0, 1.0]
    for warning in ends:
        assert warning.chains == (0,)
        assert abs(warning.place[0]) == pytest.approx(0.1, abs=R)
    whole = strand.reconstruct(scene.views, scene.radius, scene.bounds)
    assert find_warnings(whole, "cut end") == []


@pytest.mark.parametrize("kind", DOUBTS)
def test_great_doubts_become_warnings(kind, paper, paper_model):
    visibility = sort_rays(paper.views, paper_model.poses, paper.views)
    place = np.array([0.1, 0.2, 0.3])
    least = doubt_margin(Linking().margin)
    great = Doubt(kind, 1.01 * least, "how the rope runs", "it may end there", place)
    small = Doubt(kind, 0.99 * least, "how the rope runs", "it may end there")
    (warning,) = warn_about_answer(
        paper_model.chains, (great, small), visibility, strand.Box(*paper.bounds), Linking()
    )
    assert (warning.kind, warning.amount, str(warning)) == (kind, great.amount, str(great))
    np.testing.assert_array_equal(warning.place, place)


def test_doubtful_joins_are_warned_about_at_their_place():
    chains = strand.synthetic.random_ropes(5, 2, seed=2)
    scene = strand.synthetic.scene(chains=chains, seed=2, views=2, noise=strand.synthetic.Noise(depth=0.0015))
    model = strand.reconstruct(scene.views, scene.radius, scene.bounds)
    nodes = np.concatenate(chains)
    found = find_warnings(model, "join")
    assert found
    for warning in found:
        assert np.linalg.norm(nodes - warning.place, axis=1).min() < 2.0 * scene.radius
        assert warning.amount in [doubt.amount for doubt in model.doubts if doubt.kind == "join"]


def test_a_segment_of_no_rope_is_warned_about_at_its_place():
    rope = draw_line([-0.1, 0.0, R], [0.1, 0.0, R])
    stub = draw_line([0.0, 0.03, R], [4.0 * R, 0.03, R])
    scene = strand.synthetic.scene(chains=[rope, stub], seed=1)
    model = strand.reconstruct(scene.views, scene.radius, scene.bounds)
    assert len(model.chains) == 1
    (warning,) = find_warnings(model, "left out")
    assert np.linalg.norm(warning.place - stub.mean(axis=0)) < R
    # 0.15 for each radius of it, and for one more
    assert warning.amount == pytest.approx(0.15 * 5.0, abs=0.15)


def test_a_wrong_number_of_ropes_is_warned_about(paper):
    model = strand.reconstruct(paper.views, paper.radius, paper.bounds, ropes=2)
    (prior,) = find_warnings(model, "prior")
    (rival,) = find_warnings(model, "rival")
    assert prior.place is None
    assert prior.amount > 2.0
    assert strand.Chain(paper.truth[0], R).nearest(rival.place[None]).distance[0] < 2.0 * R
