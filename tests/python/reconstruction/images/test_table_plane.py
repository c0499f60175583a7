"""The table: the plane that most points lie on, and the one that ropes lie on."""

from __future__ import annotations

import dataclasses

import numpy as np
import open3d as o3d
import pytest

from strand.geometry.plane import Plane
from strand.reconstruction.images.table_plane import find_largest_plane, find_table_beside_ropes
from strand.synthetic import Camera, Segmentation, scene
from strand.views.rope_images import make_rope_images


def tilted(seed, count=6000, things=2000, noise=0.001):
    """Points of a tilted table before a camera at the origin, with things on it; its normal and n.x."""
    rng = np.random.default_rng(seed)
    normal = np.array([0.3, -0.6, -1.0]) + 0.3 * rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    middle = np.array([0.0, 0.0, 0.8])
    plan = rng.uniform(-0.4, 0.4, (count, 2)) @ Plane(normal, 0.0).axes.T
    table = middle + plan + rng.normal(scale=noise, size=(count, 1)) * normal
    above = middle + rng.uniform(-0.1, 0.1, (things, 3)) + 0.15 * normal
    return np.vstack([table, above]), normal, float(normal @ middle)


@pytest.mark.parametrize("seed", range(8))
def test_the_plane_is_the_table_as_open3d_finds_it_too(seed):
    points, normal, offset = tilted(seed)
    (found, height), share = find_largest_plane(points)
    assert np.degrees(np.arccos(min(found @ normal, 1.0))) < 0.1
    assert height == pytest.approx(offset, abs=2e-4)
    assert 0.7 < share < 0.8
    o3d.utility.random.seed(0)
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    (*other, minus), inliers = cloud.segment_plane(0.005, 3, 1000)
    sign = np.sign(np.dot(other, found))
    # least squares over all inliers is nearer to the truth than a plane through three points
    assert np.degrees(np.arccos(min(sign * np.dot(other, found), 1.0))) < 1.0
    assert -sign * minus == pytest.approx(height, abs=5e-3)
    assert len(inliers) / len(points) == pytest.approx(share, abs=0.02)


def test_the_same_bits_again_and_the_same_plane_in_any_unit():
    points, _, _ = tilted(3)
    (normal, offset), share = find_largest_plane(points)
    again, same_share = find_largest_plane(points)
    assert np.array_equal(again.normal, normal)
    assert (again.offset, same_share) == (offset, share)
    scaled, _ = find_largest_plane(1000.0 * points)
    np.testing.assert_allclose(scaled.normal, normal, atol=1e-9)
    assert scaled.offset == pytest.approx(1000.0 * offset)


def test_points_that_fix_no_plane_have_none():
    line = np.linspace(1.0, 2.0, 50)[:, None] * [0.1, 0.2, 1.0]
    for points in (np.empty((0, 3)), line[:2], line, np.tile(line[:1], (40, 1))):
        assert find_largest_plane(points) is None


def test_the_table_is_found_where_it_is_and_nowhere_else():
    made = scene("loop", seed=2, views=3, camera=Camera("zed"), mask=Segmentation())
    images = make_rope_images(made.views, made.views, None)
    normal, offset = find_table_beside_ropes(images[1], made.radius)
    assert np.linalg.norm(normal) == pytest.approx(1.0)
    assert normal[2] > np.cos(0.03)
    center = made.truth[0].mean(axis=0)
    assert abs(normal @ [center[0], center[1], 0.0] - offset) < 0.5 * made.radius
    bare = [dataclasses.replace(image, depth=np.where(image.mask, image.depth, 0.0)) for image in images]
    assert find_table_beside_ropes(bare[1], made.radius) is None
    rng = np.random.default_rng(0)
    rough = [
        dataclasses.replace(
            image, depth=np.where(image.mask, image.depth, rng.uniform(0.2, 2.0, image.depth.shape))
        )
        for image in images
    ]
    assert find_table_beside_ropes(rough[1], made.radius) is None


def test_a_table_is_found_where_depths_scatter_by_several_radii():
    made = scene("s", seed=1, views=1, camera=Camera("d435", size=(320, 240)), mask=Segmentation())
    (image,) = make_rope_images(made.views, made.views, None)
    rng = np.random.default_rng(0)
    # neighbours err alike, as in stereo
    coarse = rng.normal(scale=4.0 * made.radius, size=(60, 80))
    noisy = np.where(image.depth > 0, image.depth + coarse.repeat(4, axis=0).repeat(4, axis=1), 0.0)
    table = find_table_beside_ropes(dataclasses.replace(image, depth=noisy), made.radius)
    assert table is not None
    assert table.normal @ [0.0, 0.0, 1.0] > np.cos(np.radians(3.0))
    assert abs(table.offset) < 1.5 * made.radius
