"""Exact depth images, and plain noise."""

from __future__ import annotations

import math

import numpy as np
import open3d as o3d
import pytest
from scipy.spatial.distance import cdist

from strand.synthetic import camera_pose, render_depth, scene, sense, shapes
from strand.synthetic.shapes import shape

RADIUS = 0.0042
PINHOLE = np.array([[212.0, 0.0, 159.5], [0.0, 212.0, 119.5], [0.0, 0.0, 1.0]])
OVERHEAD = camera_pose(0.0, 0.35, elevation=0.5 * math.pi)  # image x is world y, image y is world x


def finer(nodes, times=3):
    s = shapes.compute_arc_lengths(nodes)
    at = np.linspace(0.0, s[-1], times * (len(nodes) - 1) + 1)
    return np.stack([np.interp(at, s, nodes[:, k]) for k in range(3)], axis=1)


def unproject(depth, intrinsics, pose):
    v, u = np.nonzero(depth)
    z = depth[v, u]
    camera = np.stack(
        [(u - intrinsics[0, 2]) / intrinsics[0, 0] * z, (v - intrinsics[1, 2]) / intrinsics[1, 1] * z, z], 1
    )
    return camera @ pose[:3, :3].T + pose[:3, 3]


def test_straight_tube_from_above():
    half = 0.1
    nodes = np.array([[0.0, -half, RADIUS], [0.0, 0.01, RADIUS], [0.0, half, RADIUS]])
    distance = 0.35
    K = PINHOLE.copy()
    K[:2, 2] = 160, 120  # a pixel's centre on the axis
    depth = render_depth([nodes], RADIUS, K, OVERHEAD, (321, 241), table=False)
    assert depth[depth > 0].min() == pytest.approx(distance - 2 * RADIUS, abs=1e-12)
    assert depth[120, 160] == pytest.approx(distance - 2 * RADIUS, abs=1e-12)
    # silhouette: rays that touch the tube, whose axis is at the depth `distance - RADIUS`
    wide = 212 * math.tan(math.asin(RADIUS / (distance - RADIUS)))
    assert np.ptp(np.nonzero(depth[:, 160])[0]) == 2 * math.floor(wide)
    # flat ends, turned away from the camera: the tube ends at the rim's top
    long = 212 * half / (distance - 2 * RADIUS)
    assert np.ptp(np.nonzero(depth[120])[0]) == 2 * math.floor(long)
    points = unproject(depth, K, OVERHEAD)
    assert np.hypot(points[:, 0], points[:, 2] - RADIUS) == pytest.approx(RADIUS, abs=1e-12)
    assert (points[:, 2] > RADIUS).all()
    assert np.abs(points[:, 1]).max() <= half + 1e-12


def test_the_end_is_a_flat_disc():
    nodes = np.stack([np.linspace(-0.1, 0.0, 101), np.zeros(101), np.full(101, 0.05)], axis=1)
    pose = camera_pose(0.0, 0.3, elevation=0.0)  # looks along the rope's axis, from 0.05 below it
    depth = render_depth([nodes], 0.01, PINHOLE, pose, table=0)
    points = unproject(depth, PINHOLE, pose)
    assert points[:, 0].max() <= 1e-12
    disc = points[points[:, 0] > -1e-9]
    assert len(disc) == pytest.approx(np.pi * (0.01 * 212 / 0.3) ** 2, rel=0.1)
    assert np.hypot(disc[:, 1], disc[:, 2] - 0.05).max() <= 0.01


def test_every_hit_is_on_the_table_or_on_the_tube():
    nodes = shape("overhand")
    pose = camera_pose(0.7, 0.32)
    points = unproject(render_depth([nodes], RADIUS, PINHOLE, pose), PINHOLE, pose)
    table = np.abs(points[:, 2]) < 1e-12
    assert np.abs(points[table, :2]).max() <= 0.5
    tube = points[~table]
    assert len(tube) > 1000
    assert cdist(tube, finer(nodes, 10)).min(axis=1) == pytest.approx(RADIUS, rel=0.01)


def test_a_fine_rope_has_no_gaps():
    angle = np.linspace(0.0, 1.9 * np.pi, 2000)
    ring = np.stack([0.08 * np.cos(angle), 0.08 * np.sin(angle), np.full(2000, RADIUS)], axis=1)
    depth = render_depth([ring], RADIUS, PINHOLE, OVERHEAD)
    towards = unproject(depth, PINHOLE, OVERHEAD)
    off = np.hypot(np.hypot(towards[:, 0], towards[:, 1]) - 0.08, towards[:, 2] - RADIUS)
    reach = np.hypot(towards[:, 0], towards[:, 1])
    turn = np.mod(np.arctan2(towards[:, 1], towards[:, 0]), 2 * np.pi)
    within = (np.abs(reach - 0.08) < 0.8 * RADIUS) & (turn > 0.05) & (turn < 1.89 * np.pi)
    assert within.sum() > 500
    assert off[within] == pytest.approx(RADIUS, rel=1e-3)


def test_chains_of_different_radii_hide_each_other():
    low = np.array([[-0.1, 0.0, 0.004], [0.1, 0.0, 0.004]])
    high = np.array([[0.0, -0.1, 0.018], [0.0, 0.1, 0.018]])
    both = render_depth([low, high], [0.004, 0.01], PINHOLE, OVERHEAD)
    alone = [render_depth([nodes], r, PINHOLE, OVERHEAD) for nodes, r in ((low, 0.004), (high, 0.01))]
    assert np.array_equal(both, np.minimum(*alone))
    assert both.min() == pytest.approx(0.35 - 0.028, abs=1e-4)


def test_ropes_beside_and_behind_the_camera():
    pose = np.eye(4)
    behind = np.array([[-0.1, 0.0, -0.3], [0.1, 0.0, -0.3]])
    assert not render_depth([behind], RADIUS, PINHOLE, pose, table=0).any()
    past = np.array([[0.02, 0.0, -0.5], [0.02, 0.0, 0.5]])  # from behind the camera to in front of it
    fine = np.linspace(past[0], past[1], 1001)
    depth = render_depth([past], RADIUS, PINHOLE, pose, table=0)
    assert (depth > 0).sum() > 500
    assert np.abs(depth - render_depth([fine], RADIUS, PINHOLE, pose, table=0)).max() < 1e-9


def test_table_is_finite_and_optional():
    nodes = shape("straight", length=0.05)
    assert (render_depth([nodes], RADIUS, PINHOLE, OVERHEAD) > 0).all()
    cut = unproject(render_depth([nodes], RADIUS, PINHOLE, OVERHEAD, table=0.2), PINHOLE, OVERHEAD)
    assert 0.099 < np.abs(cut[:, :2]).max() <= 0.1
    assert (render_depth([nodes], RADIUS, PINHOLE, OVERHEAD, table=False) > 0).sum() < 300
    assert render_depth([], RADIUS, PINHOLE, OVERHEAD) == pytest.approx(0.35, abs=1e-12)


def make_tube_mesh(nodes, radius, sides=128):
    tangents = np.gradient(nodes, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    across = np.cross(tangents, (0.0, 0.0, 1.0))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    up = np.cross(across, tangents)
    angle = np.arange(sides) * 2 * np.pi / sides
    rings = nodes[:, None] + radius * (
        np.cos(angle)[:, None] * across[:, None] + np.sin(angle)[:, None] * up[:, None]
    )
    i = np.arange(len(nodes) - 1)[:, None] * sides
    a, b = i + np.arange(sides), i + (np.arange(sides) + 1) % sides
    faces = [
        np.stack([a, b, b + sides], -1).reshape(-1, 3),
        np.stack([a, b + sides, a + sides], -1).reshape(-1, 3),
    ]
    vertices = np.vstack([rings.reshape(-1, 3), nodes[[0, -1]]])
    for ring, middle in ((0, len(vertices) - 2), ((len(nodes) - 1) * sides, len(vertices) - 1)):
        rim = ring + np.arange(sides)
        faces.append(np.stack([rim, np.roll(rim, 1), np.full(sides, middle)], 1))
    return vertices.astype(np.float32), np.vstack(faces).astype(np.uint32)


def test_parity_with_open3d():
    made = scene("paper", seed=3, views=3)
    vertices, faces = make_tube_mesh(finer(made.truth[0], 2), RADIUS)
    square = np.float32([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]])
    cast = o3d.t.geometry.RaycastingScene()
    cast.add_triangles(o3d.core.Tensor(vertices), o3d.core.Tensor(faces))
    cast.add_triangles(o3d.core.Tensor(square), o3d.core.Tensor(np.uint32([[0, 1, 2], [0, 2, 3]])))
    x, y = (np.arange(320) - 159.5) / 212, (np.arange(240) - 119.5) / 212
    for pose in made.poses_true:
        directions = np.stack([*np.meshgrid(x, y), np.ones((240, 320))], axis=-1) @ pose[:3, :3].T
        rays = np.concatenate([np.broadcast_to(pose[:3, 3], directions.shape), directions], axis=-1)
        theirs = cast.cast_rays(o3d.core.Tensor(rays.astype(np.float32)))["t_hit"].numpy()
        ours = render_depth(made.truth, RADIUS, PINHOLE, pose)
        agree = np.isfinite(theirs) == (ours > 0)
        assert agree.mean() > 0.9999
        rope = np.isfinite(theirs) & (unproject_all(theirs, rays)[..., 2] > 1e-4)
        error = np.abs(ours - theirs)
        assert rope.sum() > 1000
        # the mesh's facets are up to 1.3 micrometres inside the tube; at its outline they miss it
        assert np.median(error[rope]) < 2e-6
        assert (error[rope] < 5e-5).mean() > 0.99
        assert (error[agree & ~rope & (ours > 0)] < 1e-5).mean() > 0.999


def unproject_all(depth, rays):
    return rays[..., :3] + np.where(np.isfinite(depth), depth, 0.0)[..., None] * rays[..., 3:]


def test_quantisation():
    exact = render_depth([shape("loop")], RADIUS, PINHOLE, camera_pose(0.3, 0.32))
    settings = dict(noise=0.0, flying=0.0, step=RADIUS, rng=np.random.default_rng(0))
    for depth_scale in (1e-4, 1e-3):
        seen = sense(exact, depth_scale=depth_scale, **settings)
        assert seen.dtype == np.uint16
        assert np.abs(seen * depth_scale - exact).max() <= 0.5001 * depth_scale
    # 16 bits of 1e-6 m reach 66 mm only; farther points have no return
    assert not sense(exact, depth_scale=1e-6, **settings).any()


def test_flying_pixels_are_between_two_surfaces():
    exact = render_depth([shape("loop")], RADIUS, PINHOLE, camera_pose(0.3, 0.32), table=3.0)
    assert (exact > 0).all()
    rng = np.random.default_rng(7)
    around = np.pad(exact, 1, mode="edge")
    gaps = np.stack([around[1:-1, :-2], around[1:-1, 2:], around[:-2, 1:-1], around[2:, 1:-1]]) - exact
    step = np.abs(gaps).max(axis=0) > RADIUS
    seen = sense(exact, noise=0.0, flying=0.25, step=RADIUS, depth_scale=2e-5, rng=rng) * 2e-5
    moved = np.abs(seen - exact) > 2e-5
    assert not (moved & ~step).any()
    assert moved.sum() == pytest.approx(0.25 * step.sum(), rel=0.1)
    low, high = exact + np.minimum(gaps.min(axis=0), 0), exact + np.maximum(gaps.max(axis=0), 0)
    assert ((seen >= low - 2e-5) & (seen <= high + 2e-5)).all()


def test_wrong_cameras():
    nodes = shape("straight")
    with pytest.raises(ValueError, match="intrinsics: expected"):
        render_depth([nodes], RADIUS, -PINHOLE, OVERHEAD)
    with pytest.raises(ValueError, match="pose: expected a rigid motion"):
        render_depth([nodes], RADIUS, PINHOLE, np.diag([2.0, 1.0, 1.0, 1.0]))
    with pytest.raises(ValueError, match="table: expected a number >= 0"):
        render_depth([nodes], RADIUS, PINHOLE, OVERHEAD, table=-1.0)
    with pytest.raises(ValueError, match="radius: expected one number, or one for each of 1 chains, got 2"):
        render_depth([nodes], [0.004, 0.005], PINHOLE, OVERHEAD)
    with pytest.raises(
        ValueError, match=r"chains\[0\]: expected turns below 90 degrees, got a sharper one at node 1"
    ):
        render_depth([nodes[[0, 1, 0]]], RADIUS, PINHOLE, OVERHEAD)
    with pytest.raises(ValueError, match="distance: expected a positive"):
        camera_pose(0.0, 0.0)
    with pytest.raises(ValueError, match="azimuth: expected a finite"):
        camera_pose(math.nan, 0.3)
