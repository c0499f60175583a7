"""Tests of chains drawn over depth images."""

from __future__ import annotations

import base64
import io
import re

import numpy as np
import pytest
from PIL import Image

import strand
from strand.report.cameras import make_cameras
from strand.report.overlay import draw_overlay
from strand.ropes.doubt import Doubt

K = np.array([[200.0, 0, 79.5], [0, 200.0, 59.5], [0, 0, 1]])
POSE = np.diag([1.0, -1.0, -1.0, 1.0])
POSE[2, 3] = 0.5
LINE = np.linspace([-0.1, 0.01, 0.004], [0.1, 0.01, 0.004], 81)


def make_table(tilt=0.0):
    """Return a view of a table with a block, 20 mm high, over the middle of LINE."""
    depth = np.full((120, 160), 0.5) + tilt * np.arange(160)
    depth[:, 70:90] -= 0.02
    return strand.View.from_depth(depth, K, POSE)


def draw(view, chain, max_bytes=100_000, **more):
    model = strand.Model((chain,), view.pose[None], **more)
    (camera,) = make_cameras(model, [view])
    return camera, draw_overlay(camera, model, max_bytes)


def find_paths(svg, kind):
    found = re.findall(rf'<path class="{kind}" d="([^"]+)"', svg)
    pieces = [piece for path in found for piece in path[1:].split("M")]
    parts = [np.array([pair.split(",") for pair in piece.split("L")], dtype=float) for piece in pieces]
    # colours change along a line
    lines = []
    for part in parts:
        if lines and (lines[-1][-1] == part[0]).all():
            lines[-1] = np.vstack([lines[-1], part[1:]])
        else:
            lines.append(part)
    return lines


def test_lines_lie_where_the_camera_sees_the_rope():
    _, svg = draw(make_table(), strand.Chain(LINE, 0.004))
    first, second = find_paths(svg, "seen")
    (covered,) = find_paths(svg, "hidden")
    v = 59.5 - 200 * 0.01 / 0.496
    for points in (first, second, covered):
        np.testing.assert_allclose(points[:, 1], v, atol=0.06)
    assert covered[0, 0] == pytest.approx(70, abs=1.5)
    assert covered[-1, 0] == pytest.approx(90, abs=1.5)
    assert first[0, 0] == pytest.approx(79.5 - 200 * 0.1 / 0.496, abs=0.06)
    # the pieces join
    assert (first[-1] == covered[0]).all()
    assert (covered[-1] == second[0]).all()


def test_stretches_without_points_are_dashed():
    seen = np.full(81, 3)
    seen[10:20] = 0
    _, svg = draw(make_table(), strand.Chain(LINE, 0.004, points_seen=seen))
    (dashed,) = find_paths(svg, "bridged")
    u = 79.5 + 200 * LINE[[10, 20], 0] / 0.496
    np.testing.assert_allclose(dashed[[0, -1], 0], u, atol=0.06)


@pytest.mark.parametrize("tilt", [0.0, 0.0005])
def test_grey_shows_the_distance_before_the_plane(tilt):
    _, svg = draw(make_table(tilt), strand.Chain(LINE, 0.004))
    data = re.search(r'href="data:image/jpeg;base64,([^"]+)"', svg).group(1)
    grey = np.asarray(Image.open(io.BytesIO(base64.b64decode(data)))).astype(float)
    left = int(re.search(r'viewBox="(\d+)', svg).group(1))
    assert grey[:, 75 - left : 85 - left].min() > 180
    assert grey[:, : 60 - left].max() < 140


def test_images_keep_within_their_limit():
    depth = np.random.default_rng(0).uniform(0.4, 0.6, (700, 900))
    view = strand.View.from_depth(depth, [[900, 0, 450], [0, 900, 350], [0, 0, 1]], POSE)
    _, svg = draw(view, strand.Chain(LINE, 0.004), max_bytes=30_000)
    assert len(svg) < 40_000


def test_doubts_are_marked_with_their_reason():
    doubts = (
        Doubt("end", 0.2, "where it ends", "a < b", LINE[0]),
        Doubt("noise", 0.1, "a", "b"),
    )
    _, svg = draw(make_table(), strand.Chain(LINE, 0.004), doubts=doubts)
    assert svg.count('class="doubt"') == 1
    assert "a &lt; b" in svg


def test_ropes_behind_the_camera_and_outside_are_not_drawn():
    for offset in ([0, 0, 1.0], [5.0, 0, 0]):
        _, svg = draw(make_table(), strand.Chain(LINE + offset, 0.004))
        assert "nan" not in svg
        assert "<text" not in svg


@pytest.mark.parametrize("turn", [np.eye(4), POSE])
def test_views_of_points_are_seen_from_their_viewpoint(turn):
    rng = np.random.default_rng(0)
    cloud = LINE[rng.integers(0, 81, 2000)] + rng.normal(scale=0.002, size=(2000, 3))
    viewpoint = np.array([0.1, -0.05, 0.4])
    world = strand.View.from_world(cloud, viewpoint)
    pose = turn.copy()
    pose[:3, 3] = viewpoint
    view = strand.View((cloud - viewpoint) @ pose[:3, :3], pose)
    for one in (world, view):
        camera, svg = draw(one, strand.Chain(LINE, 0.002))
        assert camera.imagined
        np.testing.assert_allclose(camera.viewpoint, viewpoint)
        pixels, _ = camera.project(LINE)
        rows, columns = np.rint(pixels[:, 1]).astype(int), np.rint(pixels[:, 0]).astype(int)
        near = [
            camera.depth[r - 3 : r + 4, c - 3 : c + 4].max() > 0 for r, c in zip(rows, columns, strict=True)
        ]
        assert np.mean(near) > 0.9
        assert find_paths(svg, "seen")
