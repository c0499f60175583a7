"""Joins and alternatives."""

from __future__ import annotations

from functools import partial

import numpy as np

import strand
from strand.reconstruction.tubes import hypotheses
from strand.reconstruction.tubes.hypotheses import Hypothesis, ScoredHypothesis
from strand.reconstruction.tubes.join_costs import JoinCosts
from strand.reconstruction.tubes.joins import list_alternatives


def test_joins_refer_to_the_chains_that_run_there():
    scene = strand.synthetic.scene(chains=strand.synthetic.random_ropes(4, 2, seed=2), seed=2)
    model = strand.reconstruct(scene.views, scene.radius, scene.bounds)
    assert len(model.chains) == 2
    assert model.joins
    for join in model.joins:
        assert join.chains
        for number in join.chains:
            distance = np.linalg.norm(model.chains[number].points - join.place, axis=1).min()
            assert distance < 4.0 * scene.radius


def test_alternatives_come_with_their_additional_cost(collected, tmp_path):
    scene = collected("paper_mid")
    model = strand.reconstruct(scene.views, scene.radius, scene.bounds)
    assert model.alternatives
    costs = [other.cost for other in model.alternatives]
    assert costs == sorted(costs)
    assert costs[0] >= 0.0
    model.save(tmp_path / "model.json")
    loaded = strand.load_model(tmp_path / "model.json").alternatives
    assert [other.cost for other in loaded] == costs
    for a, b in zip(loaded, model.alternatives, strict=True):
        for some, others in zip(a.chains, b.chains, strict=True):
            np.testing.assert_array_equal(some, others)


def test_a_hypothesis_that_explains_nothing_is_no_alternative(paper_model):
    chains = [(chain.points, chain.closed) for chain in paper_model.chains]
    one = Hypothesis(JoinCosts((), {}), (), chains, 0.0, (), 0.01, 2.5)
    scored = [ScoredHypothesis(one, partial(float, cost), 0.0) for cost in (2.0, 3.5, np.inf)]
    assert [other.cost for other in list_alternatives([scored, scored[2:], []])] == [1.5]


def test_a_hypothesis_without_a_rival_is_not_fitted(collected, monkeypatch):
    scene = strand.synthetic.scene("overhand", seed=1)
    sizes: list[int] = []
    add = hypotheses._Contest._add

    def count_hypotheses(contest, one):
        add(contest, one)
        sizes.append(len(contest.scored))
        fitted = ["cost" in other.__dict__ for other in contest.scored]
        assert fitted == [len(contest.scored) > 1] * len(fitted)

    monkeypatch.setattr(hypotheses._Contest, "_add", count_hypotheses)
    strand.reconstruct(scene.views, scene.radius, scene.bounds)
    assert sizes
    assert sizes[0] == 1
    scene = collected("paper_mid")
    strand.reconstruct(scene.views, scene.radius, scene.bounds)
    assert max(sizes) > 1
