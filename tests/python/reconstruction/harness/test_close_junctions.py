"""Junctions of many branches, junctions that are close, and views too flat to tell strands apart."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest

import strand
from strand.synthetic import Camera, Noise, camera_pose, harness
from strand.synthetic.rendering import render_depth

CAMERA = Camera(size=(640, 480))
R = 0.004
TRUNK = 0.14


def look(lines, azimuths=(0.0,), elevation=1.0, radii=None):
    """Reconstruct strands that lie on a table."""
    rng = np.random.default_rng(0)
    radii = [R] * len(lines) if radii is None else radii
    views = []
    for azimuth in azimuths:
        pose = camera_pose(azimuth, 0.55, elevation)
        depth = render_depth(lines, radii, CAMERA.intrinsics, pose, CAMERA.size, 3.0)
        depth[depth > 0.0] += 0.0005 * rng.normal(size=np.count_nonzero(depth > 0.0))
        views.append(strand.View.from_depth(depth, CAMERA.intrinsics, pose))
    bounds = ([-0.3, -0.3, 0.0025], [0.3, 0.3, 0.03])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return strand.reconstruct(views, sorted(set(radii)), bounds, branches=True)


def draw(start, angle, length):
    s = np.linspace(0.0, length, 100)
    angle = math.radians(angle)
    return np.column_stack([start + s * math.cos(angle), s * math.sin(angle), np.full(100, R)])


@pytest.mark.parametrize("angles", [(0, 60, 130, 200, 280), (0, 60, 120, 180, 240, 300)], ids=len)
@pytest.mark.parametrize("azimuths", [(0.0,), (-0.8, 0.8)], ids=len)
def test_many_branches_meet_at_one_junction(angles, azimuths):
    found = look([draw(0.0, angle, 0.12) for angle in angles], azimuths).harness
    assert sorted(node.degree for node in found.nodes) == [1] * len(angles) + [len(angles)]
    junction = next(node for node in found.nodes if node.degree > 1)
    np.testing.assert_allclose(junction.position, [0.0, 0.0, R], atol=R)


@pytest.mark.parametrize("gap", [0.01, 0.012, 0.03])
def test_two_junctions_are_no_sure_junction_of_four(gap):
    half = 0.5 * gap
    lines = [
        draw(-TRUNK, 0, 2 * TRUNK),
        draw(-half, 80, 0.1),
        draw(half, -70, 0.1),
    ]
    model = look(lines)
    if gap > 6.0 * R:
        assert sorted(node.degree for node in model.harness.nodes) == [1, 1, 1, 1, 3, 3]
    else:
        assert model.confidence < 0.9


@pytest.mark.parametrize(("gap", "azimuth", "angle"), [(0.008, 0.0, -70), (0.01, 0.5, -70), (0.01, 0.0, -80)])
def test_branches_on_both_sides_of_a_trunk_are_no_two_ropes_that_turn(gap, azimuth, angle):
    half = 0.5 * gap
    model = look([draw(-TRUNK, 0, 2 * TRUNK), draw(-half, 80, 0.1), draw(half, angle, 0.1)], (azimuth,))
    assert len(model.chains) > 2
    assert model.confidence < 0.9


@pytest.mark.parametrize("elevation", [0.15, 0.2, 0.3])
def test_views_along_a_table_make_no_edges_without_length(elevation):
    made = harness("tree", seed=2, views=1)
    model = look([*made.truth], (-1.5, 0.0, 1.5), elevation, list(made.radii))
    assert model.confidence < 0.9
    for edge in model.harness.edges:
        assert edge.length > 0.5 * edge.radius


def test_a_loop_that_closes_at_its_junction_has_one_junction_of_four():
    made = harness("loop", seed=1051007, views=7, noise=Noise(depth=0.00066))
    graph = strand.reconstruct(made.views, sorted(set(made.radii)), made.bounds, branches=True).harness
    assert sorted(node.degree for node in graph.nodes) == [1, 1, 4]


@pytest.mark.parametrize("gap", [4.0, 6.0, 10.0])
def test_a_bridge_between_two_ropes_is_no_sure_pair_of_ropes(gap):
    along, half = np.linspace(-0.12, 0.12, 161), 0.5 * gap * R
    aside = half + 0.0024 * np.sin(np.pi * np.abs(along) / 0.12)
    lines = [np.column_stack([along, side * aside, np.full(161, R)]) for side in (-1.0, 1.0)]
    bridge = np.column_stack([np.zeros(60), np.linspace(-half, half, 60), np.full(60, R)])
    model = look([*lines, bridge], (0.0, 2.1, 4.2), 0.45)
    joined = sorted(node.degree for node in model.harness.nodes) == [1, 1, 1, 1, 3, 3]
    assert joined or model.confidence < 0.6
    apart = look(lines, (0.0, 2.1, 4.2), 0.45)
    assert [node.degree for node in apart.harness.nodes] == [1, 1, 1, 1]
