"""A second look: what no curve explains, and decisions that are made again."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

import strand
from shared.ropes import R, render_crossing
from strand.reconstruction.tubes import decision, method
from strand.reconstruction.tubes.clouds import Clouds
from strand.reconstruction.tubes.second_look import trace_unexplained


def test_arcs_are_found_on_a_rope_without_a_curve(paper, paper_model, collected):
    fit = paper_model.stages["fit"]
    assert trace_unexplained(fit, [0]).nodes == []
    two = collected("two_ropes")
    model = strand.reconstruct(two.views, two.radius, two.bounds, keep_stages=True)
    fit = model.stages["fit"]
    clouds = Clouds.from_views([view.crop(two.bounds) for view in two.views], strand.Box(*two.bounds))
    one = strand.fit_tubes(
        clouds.points,
        clouds.viewpoints,
        fit.curves[:1],
        fit.motions,
        two.radius,
        pose_sd=(0.01, 0.001),
        reference=3,
        fit_curves=False,
        iterations=1,
    )
    found = trace_unexplained(one, [0]).nodes
    other = model.chains[1 if model.chains[0].nearest(found[0][:1]).distance[0] > 2.0 * R else 0]
    assert sum(np.linalg.norm(np.diff(nodes, axis=0), axis=1).sum() for nodes in found) > 0.5 * other.length
    for nodes in found:
        assert other.nearest(nodes).distance.max() < two.radius


@pytest.mark.parametrize("radius", [(0.003, 0.006), None])
def test_joins_are_reconsidered_where_points_stay_unexplained(monkeypatch, radius):
    views, bounds, truth = render_crossing(0.003, 0.006)
    decide_joins = decision.decide_joins
    decisions = []

    def cut_short_at_first(*arguments):
        by_class = decide_joins(*arguments)
        if not decisions:
            for number, (best, *_) in enumerate(by_class):
                chains = [(nodes[: len(nodes) // 2], ring) for nodes, ring in best.hypothesis.chains]
                by_class[number] = [replace(best, hypothesis=replace(best.hypothesis, chains=chains))]
        decisions.append(by_class)
        return by_class

    for room in (method, decision):
        monkeypatch.setattr(room, "decide_joins", cut_short_at_first)
    model = strand.reconstruct(views, radius, bounds)
    assert len(decisions) == 2
    assert [chain.radius for chain in model.chains] == pytest.approx([0.003, 0.006], rel=0.03)
    lengths = [strand.Chain(axis, 1.0).length for axis in truth]
    assert [chain.length for chain in model.chains] == pytest.approx(lengths, rel=0.02)


def draw_lanes(length: float, views: int = 11) -> tuple[list[np.ndarray], np.ndarray]:
    """Return points of each view on straight ropes side by side, each 1 m long, and the axis of the first."""
    rng = np.random.default_rng(0)
    count = round(length)
    points = []
    for _ in range(views):
        x, lane = rng.random((2, 600 * count)) * [[1.0], [count]]
        turn = np.pi * rng.random(len(x))
        across, up = np.floor(lane) * 8.0 * R + R * np.cos(turn), R * np.sin(turn)
        points.append(np.column_stack([x, across, up]))
    axis = np.column_stack([np.linspace(0.0, 1.0, 101), np.zeros(101), np.zeros(101)])
    return points, axis


def test_memory_grows_with_the_points_and_not_with_points_times_nodes():
    """One curve explains 1 of 20 m of rope in 11 views."""
    points, axis = draw_lanes(20.0)
    cameras = np.tile([0.5, 1.0, 3.0], (len(points), 1))
    fit = strand.fit_tubes(
        points,
        cameras,
        [axis],
        [np.eye(4)] * len(points),
        R,
        pose_sd=(0.01, 0.001),
        reference=0,
        fit_curves=False,
        iterations=1,
        uncertainty=False,
    )
    tracemalloc.start()
    arcs = trace_unexplained(fit, [0]).nodes
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    nodes = sum(len(arc) for arc in arcs)
    assert nodes * 0.5 * R > 17.0
    assert peak < 300 * len(fit.points)
