"""Prices of hypotheses."""

from __future__ import annotations

import pytest

from shared.ropes import R, draw_line
from strand.config import Linking
from strand.reconstruction.evidence.join_evidence import JoinEvidence
from strand.reconstruction.evidence.prior import Prior
from strand.reconstruction.evidence.visibility import sort_rays
from strand.reconstruction.tubes.scores import price_contradictions, price_explanation

CHAINS = [(draw_line([0, 0, 0], [0.3, 0, 0]), False), (draw_line([0, 0.1, 0], [0.2, 0.1, 0]), False)]


@pytest.mark.parametrize(
    ("prior", "rings", "cost"),
    [
        (Prior(), "maybe", 0.0),
        (Prior.from_caller(2, None), "maybe", 0.0),
        (Prior.from_caller(4, None), "maybe", 60.0),
        (Prior.from_caller(1, None), "maybe", 30.0),
        (Prior(), "always", 60.0),
        (Prior.from_caller(None, [0.2, 0.3]), "never", 0.0),
        # 2 for each radius beyond 2 % and one radius
        (Prior.from_caller(None, [0.2, 0.33]), "maybe", 2.0 * ((0.03 - 0.02 * 0.33) / R - 1.0)),
        # at most as much as a rope
        (Prior.from_caller(None, [0.2, 0.6]), "maybe", 30.0),
    ],
)
def test_contradictions_to_the_prior_cost(prior, rings, cost):
    evidence = JoinEvidence(R, Linking(rings=rings), prior=prior)
    assert price_contradictions(CHAINS, evidence) == pytest.approx(cost, abs=1e-6)


def test_unexplained_points_cost(paper, paper_model):
    fit = paper_model.stages["fit"]
    visibility = sort_rays(paper.views, paper_model.poses, paper.views)
    whole = price_explanation(fit, visibility)
    lost = fit.explained.copy()
    lost[::2] = False
    assert price_explanation(fit.replace(explained=lost), visibility) > whole + 20.0
    # no camera saw through the true rope
    assert price_explanation(fit, None) == pytest.approx(whole, abs=2.0)
