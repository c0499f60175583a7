"""Strands whose points go on where the map's mask ends: at a low view, and beyond the table's edge."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from strand.reconstruction.harness.ground import Ground
from strand.reconstruction.harness.onward import follow_ends
from strand.reconstruction.harness.strands import Strand
from strand.synthetic import Camera, Noise, camera_pose, harness
from strand.synthetic.rendering import render_depth

RADIUS = 0.004  # metres
ABOVE = np.array([0.0, 0.0, 1.0])


def draw_arc(stop, radius=0.06):
    """Return an axis: straight along x to the origin, then an arc of some length in the plane."""
    angle = np.linspace(0.0, stop / radius, 60)[1:]
    bent = np.column_stack([radius * np.sin(angle), radius * (1.0 - np.cos(angle)), np.zeros(59)])
    straight = np.column_stack([np.linspace(-0.08, 0.0, 60), np.zeros((60, 2))])
    return np.concatenate([straight, bent])


def see_tube(line, rng, count=8000):
    """Return points of the upper half of a tube that ends flat, metres."""
    at = rng.uniform(0.0, len(line) - 1.0, count)
    places = np.column_stack([np.interp(at, np.arange(len(line)), line[:, axis]) for axis in range(3)])
    ways = np.gradient(line, axis=0)[at.astype(int)]
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    across = np.cross(ABOVE, ways)
    angle = rng.uniform(0.0, np.pi, (count, 1))
    return places + RADIUS * (np.cos(angle) * across + np.sin(angle) * ABOVE)


def follow(points, strands, spare=None):
    camera, none = np.array([[0.0, 0.0, 5.0]]), points[:0]
    spare = none if spare is None else spare
    ground = Ground(np.eye(4)[None], [points], [points], [spare], camera, none, ABOVE, None, [None], False)
    return follow_ends(strands, np.zeros(len(strands), dtype=bool), ground)


def make_strand(nodes):
    return Strand(np.asarray(nodes), (None, None), RADIUS, False)


def test_an_end_goes_on_along_a_bend_as_far_as_its_points():
    line = draw_arc(0.07)
    (found,), _ = follow(see_tube(line, np.random.default_rng(1)), [make_strand(line[:70])])
    np.testing.assert_allclose(found.nodes[-1], line[-1], atol=RADIUS)
    np.testing.assert_allclose(found.nodes[0], line[0], atol=1e-12)
    gaps = np.linalg.norm(found.nodes[:, None] - line, axis=2).min(axis=1)
    assert gaps[:-1].max() < 0.3 * RADIUS


def test_points_that_were_dropped_as_outliers_lead_on_and_count_then():
    rng, line = np.random.default_rng(5), draw_arc(0.07)
    points = see_tube(line, rng)
    dropped = points[:, 0] > 0.02
    aside = np.array([[0.03, 0.2, 0.0]]) + 0.001 * rng.normal(size=(50, 3))
    spare = np.concatenate([points[dropped], aside])
    (found,), ground = follow(points[~dropped], [make_strand(line[:70])], spare)
    np.testing.assert_allclose(found.nodes[-1], line[-1], atol=RADIUS)
    assert len(ground.clouds[0]) > 0.99 * len(points)
    assert np.linalg.norm(ground.clouds[0][:, None] - aside[:1], axis=2).min() > 0.1
    np.testing.assert_allclose(ground.given[0], ground.clouds[0], atol=1e-12)


def test_an_end_where_points_end_stays_as_it_is():
    line = draw_arc(0.03)
    (found,), _ = follow(see_tube(line, np.random.default_rng(2)), [make_strand(line)])
    np.testing.assert_array_equal(found.nodes, line)


def test_an_end_does_not_go_on_along_another_strand_or_a_surface():
    rng = np.random.default_rng(3)
    line = draw_arc(0.07)
    other = make_strand(line[72:] + np.array([0.001, 0.0, 0.0]))
    (found, _), _ = follow(see_tube(line, rng), [make_strand(line[:70]), other])
    assert np.linalg.norm(found.nodes[-1] - line[69]) < 2.0 * RADIUS
    flat = np.column_stack([rng.uniform(0.0, 0.1, 9000), rng.uniform(-0.05, 0.05, 9000), np.zeros(9000)])
    points = np.concatenate([see_tube(line[:60], rng), flat])
    (found,), _ = follow(points, [make_strand(line[:60])])
    np.testing.assert_array_equal(found.nodes, line[:60])


def test_a_thin_branch_along_the_rays_of_a_low_view_is_whole():
    made = harness("tree", seed=1021021, views=1, noise=Noise(depth=0.0009))
    model = strand.reconstruct(made.views, sorted(set(made.radii)), made.bounds, branches=True)
    truth = sorted(np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in made.truth)
    assert sorted(edge.length for edge in model.harness.edges) == pytest.approx(truth, rel=0.05)


def test_a_rope_that_runs_away_from_a_low_camera_is_whole():
    share = np.linspace(0.0, 1.0, 60)[:, None]
    lines = []
    for x, y, bend in ((-0.13, 0.01, 0.08), (0.13, -0.01, -0.08), (-0.004, 0.024, 0.05)):
        plan = share * [x, y] + bend * np.sin(np.pi * share) * [y, -x]
        lines.append(np.column_stack([plan, np.full(60, RADIUS)]))
    camera, rng = Camera(size=(640, 480)), np.random.default_rng(0)
    pose = camera_pose(0.0, 0.3, 0.5)
    depth = render_depth(lines, [RADIUS] * 3, camera.intrinsics, pose, camera.size, 3.0)
    depth[depth > 0.0] += 0.0008 * rng.normal(size=np.count_nonzero(depth > 0.0))
    view = strand.View.from_depth(depth, camera.intrinsics, pose)
    model = strand.reconstruct([view], RADIUS, ([-0.3, -0.3, 0.0024], [0.3, 0.3, 0.03]), branches=True)
    # far along the rays, points are as sparse as outliers
    lengths = sorted(edge.length for edge in model.harness.edges)
    assert lengths == pytest.approx([0.0245, 0.1325, 0.1325], abs=0.008)


def see_over_edge(drop, low):
    """Return the model of a trunk that hangs over a table's edge and parts on the table, and true lengths."""
    trunk, branch, bend = 0.005, 0.0035, 0.017
    down = np.linspace(0.0, np.pi / 2.0, 20)
    over = np.column_stack([0.1 + bend * np.sin(down), np.zeros(20), trunk - bend * (1.0 - np.cos(down))])
    lines = [
        np.concatenate([[[0.0, 0.0, trunk]], over, over[-1:] - [[0.0, 0.0, drop]]]),
        np.array([[0.0, 0.0, trunk], [-0.02, 0.01, branch], [-0.09, 0.04, branch]]),
        np.array([[0.0, 0.0, trunk], [-0.02, -0.012, branch], [-0.07, -0.06, branch]]),
    ]
    camera, views = Camera(size=(640, 480)), []
    rng = np.random.default_rng(4)
    for turn in (-0.6, 0.0, 0.6):
        pose = camera_pose(turn, 0.45, 0.8)
        rendered = (camera.intrinsics, pose, camera.size, 0.2)
        depth = render_depth(lines, [trunk, branch, branch], *rendered)
        table = render_depth([], [], *rendered)
        mask = (depth > 0.0) & ((depth < table - 1e-9) | (table == 0.0))
        noisy = np.where(depth > 0.0, depth + 0.0005 * rng.normal(size=depth.shape), 0.0)
        views.append(strand.View.from_depth(noisy, camera.intrinsics, pose, mask=mask if low < 0.0 else None))
    bounds = ([-0.2, -0.2, low], [0.2, 0.2, 0.05])
    model = strand.reconstruct(views, [branch, trunk], bounds, branches=True)
    return model, [float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()) for line in lines]


@pytest.mark.parametrize("drop", [0.015, 0.05, 0.1])
def test_a_trunk_that_hangs_over_the_edge_of_the_table_is_whole(drop):
    model, lengths = see_over_edge(drop, low=-0.2)
    assert sorted(edge.length for edge in model.harness.edges) == pytest.approx(sorted(lengths), abs=0.006)
    assert model.confidence > 0.8


def test_an_end_that_bounds_cut_at_the_edge_of_the_table_is_doubted():
    model, _ = see_over_edge(0.05, low=0.002)
    (doubt,) = (doubt for doubt in model.doubts if doubt.kind == "cut end")
    assert np.linalg.norm(doubt.place - [0.115, 0.0, 0.0]) < 0.015
    assert model.confidence < 0.3
