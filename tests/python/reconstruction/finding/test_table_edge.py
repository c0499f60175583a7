"""Ends near which something is seen below the table are doubted."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from strand.geometry.plane import Plane
from strand.reconstruction.finding.table_edge import doubt_ends_at_edge

R = 0.004
NORMAL, EDGE = np.array([0.0, 0.0, 1.0]), 0.1
POSE = strand.synthetic.camera_pose(0.0, 0.4, 0.6)
K = np.array([[400.0, 0.0, 159.5], [0.0, 400.0, 119.5], [0.0, 0.0, 1.0]])


def hanging():
    """A rope that lies on the table and hangs over its edge."""
    turn = np.linspace(0.0, np.pi / 2, 30)
    bend = np.column_stack([EDGE + 3 * R * np.sin(turn), 0.0 * turn, 3 * R * np.cos(turn) - 2 * R])
    down = np.column_stack([np.full(60, EDGE + 3 * R), np.zeros(60), np.linspace(-2 * R, -0.12, 60)])
    flat = np.column_stack([np.linspace(-0.12, EDGE, 100), np.zeros(100), np.full(100, R)])
    return np.concatenate([flat, bend[1:], down[1:]])


def view_of(rope, edge):
    """A view of a rope on a table that ends at x = edge, with the floor far below."""
    depth = strand.synthetic.render_depth([rope], R, K, POSE, size=(320, 240), table=False)
    depth = np.where((depth > 0) & np.isfinite(depth), depth, np.inf)
    rows, columns = np.mgrid[:240, :320]
    rays = np.stack([(columns - 159.5) / 400.0, (rows - 119.5) / 400.0, np.ones((240, 320))], axis=-1)
    rays = rays @ POSE[:3, :3].T
    table, floor = ((height - POSE[2, 3]) / rays[..., 2] for height in (0.0, -0.7))
    beyond = POSE[0, 3] + table * rays[..., 0] > edge
    depth = np.minimum(depth, np.where(beyond, floor, table))
    noise = np.random.default_rng(0).normal(0.0, 0.0004, depth.shape)
    return strand.View.from_depth(depth + noise, K, POSE)


@pytest.mark.parametrize("points_only", [False, True])
def test_an_end_at_the_edge_is_doubted_where_the_rope_goes_on_below(points_only):
    rope = hanging()
    chain = strand.Chain(rope[rope[:, 2] >= 0.0], R)
    view = view_of(rope, EDGE)
    if points_only:
        view = strand.View(view.points, view.pose)
    ((doubt, about),) = doubt_ends_at_edge([chain], [view], [Plane(NORMAL, 0.0)])
    assert doubt.kind == "cut end"
    assert about == (0,)
    np.testing.assert_array_equal(doubt.place, chain.points[-1])
    assert doubt_ends_at_edge([chain], [view], [None]) == []


@pytest.mark.parametrize("edge", [10.0, EDGE])
def test_a_rope_that_ends_on_the_table_is_not_doubted(edge):
    rope = hanging()
    lying = rope[rope[:, 0] < EDGE - 2 * R]
    chain = strand.Chain(lying, R)
    assert doubt_ends_at_edge([chain], [view_of(lying, edge)], [Plane(NORMAL, 0.0)]) == []


def test_the_answer_is_unsure():
    view = view_of(hanging(), EDGE)
    whole = float(np.linalg.norm(np.diff(hanging(), axis=0), axis=1).sum())
    model = strand.reconstruct([view], R)
    assert model.chains[0].length < 0.8 * whole
    assert model.chains[0].confidence < 0.5
    assert model.confidence < 0.5
    assert any("below the table's edge" in warning.message for warning in model.warnings)
