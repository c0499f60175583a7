"""Arcs traced in points."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from shared.ropes import R, sample_tube
from strand.reconstruction.outliers import drop_outliers


def test_an_arc_follows_the_axis_of_a_bend_without_cutting_the_corner():
    angle = np.linspace(0, 1.5 * np.pi, 200)
    axis = 4 * R * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    camera = np.array([0.0, 0.0, 0.5])
    points = sample_tube(axis, camera, 1e-4)
    ((nodes, support),) = strand.trace_tubes(points, camera, R)
    inner = nodes[4:-4]
    off = np.abs(np.linalg.norm(inner[:, :2], axis=1) - 4 * R)
    assert np.quantile(off, 0.9) < 0.03 * R
    assert off.max() < 0.15 * R
    assert np.abs(inner[:, 2]).max() < 0.05 * R
    assert len(nodes) == len(support)
    assert strand.Chain(nodes, R).length > 0.9 * strand.Chain(axis, R).length


def test_two_strands_in_contact_stay_two():
    y = R
    axes = [np.array([[-0.1, side * y, 0.0], [0.1, side * y, 0.0]]) for side in (-1.0, 1.0)]
    camera = np.array([0.0, 0.0, 0.5])
    points = np.concatenate([sample_tube(axis, camera, 1e-4, seed) for seed, axis in enumerate(axes)])
    arcs = sorted((nodes for nodes, _ in strand.trace_tubes(points, camera, R)), key=lambda n: n[0, 1])
    assert len(arcs) == 2
    for nodes, side in zip(arcs, (-1.0, 1.0), strict=True):
        assert np.abs(nodes[:, 1] - side * y).max() < 0.1 * R
        assert np.ptp(nodes[:, 0]) > 0.18


def test_tracing_is_the_same_for_any_number_of_threads(paper, threads):
    (view,) = drop_outliers([paper.views[3].crop(paper.bounds)], R, strand.Config().filter, published=False)
    answers = []
    for count in (1, 2, 3):
        threads(count)
        arcs = strand.trace_tubes(view.points, [0.0, 0.0, 0.0], R)
        answers.append([nodes.tobytes() for nodes, _ in arcs])
    assert answers[0]
    assert answers[0] == answers[1] == answers[2]


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"points": np.zeros((3, 2))}, ValueError, "points"),
        ({"points": np.zeros((3, 3), dtype=int)}, TypeError, "points"),
        ({"points": np.full((3, 3), np.nan)}, ValueError, "points"),
        ({"viewpoint": np.zeros((2, 3))}, ValueError, "viewpoint"),
        ({"viewpoint": np.zeros(2)}, ValueError, "viewpoint"),
        ({"radius": 0.0}, ValueError, "radius"),
        ({"radius": -1.0}, ValueError, "radius"),
        ({"min_nodes": -1}, ValueError, "min_nodes"),
    ],
)
def test_tracing_refuses_wrong_input_by_name(change, error, message):
    arguments = {"points": np.zeros((3, 3)), "viewpoint": np.ones(3), "radius": 0.01} | change
    with pytest.raises(error, match=message):
        strand.trace_tubes(**arguments)


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.zeros((500, 3)), np.full((20, 3), 0.1)])
def test_nothing_like_a_tube_gives_no_arc(points):
    assert strand.trace_tubes(points, [0.0, 0.0, 1.0], 0.01) == []
