"""Parity with Open3D on the same clouds."""

import numpy as np
import open3d as o3d
import pytest
from scipy.spatial import cKDTree

import strand
from strand import synthetic

registration = o3d.pipelines.registration


def open3d_cloud(points, normals=None):
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    if normals is not None:
        cloud.normals = o3d.utility.Vector3dVector(normals)
    return cloud


@pytest.fixture(scope="module")
def views():
    """What the cameras saw of the paper's string, in the world frame, flying pixels included."""
    scene = synthetic.scene("paper", seed=3)
    low, high = scene.bounds
    clouds = [view.world_points for view in scene.views]
    return [cloud[((low <= cloud) & (cloud <= high)).all(axis=1)] for cloud in clouds]


@pytest.fixture(scope="module")
def clouds(views):
    rng = np.random.default_rng(4)
    ball = rng.normal(size=(4000, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    duplicates = rng.random((1500, 3))
    return {
        "one view": views[3],
        "all views": np.concatenate(views),
        "cube": rng.random((5000, 3)),
        "sphere": ball + rng.normal(0.0, 0.01, ball.shape),
        "duplicates": np.concatenate([duplicates, duplicates[:700], duplicates[:300]]),
    }


SPACING = {"one view": 0.0015, "all views": 0.0006, "cube": 0.05, "sphere": 0.05, "duplicates": 0.08}


# outliers


def open3d_mask(points, radius, min_neighbors):
    _, kept = open3d_cloud(points).remove_radius_outlier(min_neighbors, radius)
    mask = np.zeros(len(points), bool)
    mask[list(kept)] = True
    return mask


@pytest.mark.parametrize("name", SPACING)
@pytest.mark.parametrize("min_neighbors", [1, 4, 16])
def test_the_same_outliers(clouds, name, min_neighbors):
    # Open3D keeps points with more than the asked number within the radius and counts the point itself,
    # which is as many others
    points = clouds[name]
    shares = []
    for radius in SPACING[name] * np.array([0.7, 1.3, 2.5, 5.0]):
        mask = strand.radius_outlier_mask(points, radius, min_neighbors)
        np.testing.assert_array_equal(mask, open3d_mask(points, radius, min_neighbors))
        shares.append(mask.mean())
    assert shares[0] < 0.99
    assert shares[-1] > 0.5


def test_only_a_neighbour_exactly_on_the_boundary_is_told_apart():
    # strand counts it, Open3D does not
    points = np.stack(np.meshgrid(*[np.arange(10) * 0.125] * 3), axis=-1).reshape(-1, 3)
    inner = ((points > 0) & (points < 1.125)).all(axis=1)
    np.testing.assert_array_equal(strand.radius_outlier_mask(points, 0.125, 6), inner)
    assert not open3d_mask(points, 0.125, 6).any()
    for radius in 0.125 * np.array([1.0 - 1e-12, 1.0 + 1e-12]):
        for min_neighbors in (1, 3, 6):
            np.testing.assert_array_equal(
                strand.radius_outlier_mask(points, radius, min_neighbors),
                open3d_mask(points, radius, min_neighbors),
            )


# normals


def gaps(points, neighbors):
    """(l1 - l0) / l2 of each neighbourhood's covariance: how well its normal is determined."""
    result = np.zeros(len(points))
    for i, near in enumerate(neighbors):
        if len(near) >= 3:
            low, middle, high = np.linalg.eigvalsh(np.cov(points[near].T, bias=True))
            result[i] = (middle - low) / high
    return result


def degrees_between(a, b):
    sines = np.linalg.norm(np.cross(a, b), axis=1)
    return np.degrees(np.arcsin(np.minimum(sines, 1.0)))


@pytest.mark.parametrize("name", ["one view", "all views", "cube", "sphere"])
@pytest.mark.parametrize("search", [{"k": 12}, {"k": 30}, {"radius": 5.0}])
def test_the_same_normals_up_to_sign(clouds, name, search):
    points = clouds[name]
    tree = cKDTree(points)
    if "k" in search:
        neighbors = tree.query(points, search["k"])[1]
        parameters = o3d.geometry.KDTreeSearchParamKNN(search["k"])
    else:
        # outliers have no plane
        points = points[strand.radius_outlier_mask(points, 2.0 * SPACING[name], 4)]
        search = {"radius": search["radius"] * SPACING[name]}
        neighbors = cKDTree(points).query_ball_point(points, search["radius"])
        parameters = o3d.geometry.KDTreeSearchParamRadius(search["radius"])
    found = strand.estimate_normals(points, **search)
    theirs = open3d_cloud(points)
    theirs.estimate_normals(parameters)
    determined = gaps(points, neighbors) > 1e-6
    assert determined.mean() >= 0.99
    assert degrees_between(found, np.asarray(theirs.normals))[determined].max() < 0.01


# registration


def pair_of_views(views):
    source, target = (cloud[strand.radius_outlier_mask(cloud, 0.0042, 4)] for cloud in views[2:4])
    return source, target, 0.0042


def hills(views):
    rng = np.random.default_rng(6)
    x, y = rng.uniform(-0.5, 0.5, (2, 4000))
    target = np.stack([x, y, 0.1 * np.sin(6 * x) + 0.1 * np.cos(5 * y)], axis=1)
    motion = strand.pose_from_angles(0.01, -0.02, 0.03, [0.01, -0.01, 0.005])
    source = target[::2] + rng.normal(0.0, 5e-4, (2000, 3))
    return (source - motion[:3, 3]) @ motion[:3, :3], target, 0.05


@pytest.mark.parametrize("clouds_of", [pair_of_views, hills])
@pytest.mark.parametrize("by_planes", [False, True])
@pytest.mark.parametrize("share_of_reach", [1.0, 0.4])
def test_the_same_registration(views, clouds_of, by_planes, share_of_reach):
    source, target, reach = clouds_of(views)
    normals = strand.estimate_normals(target, radius=reach, viewpoint=[0.0, 0.0, 9.0])
    target, normals = (array[normals.any(axis=1)] for array in (target, normals))
    if by_planes:
        estimation = registration.TransformationEstimationPointToPlane()
    else:
        estimation = registration.TransformationEstimationPointToPoint()
    # point-to-plane steps turn about the cloud's middle here, about the origin in Open3D, so that they
    # differ to second order and agree in the end only
    for iterations in (20,) if by_planes else (0, 1, 2, 5, 20):
        found = strand.icp(
            source,
            target,
            share_of_reach * reach,
            target_normals=normals if by_planes else None,
            max_iterations=iterations,
            tolerance=0.0,
        )
        theirs = registration.registration_icp(
            open3d_cloud(source),
            open3d_cloud(target, normals),
            share_of_reach * reach,
            np.eye(4),
            estimation,
            registration.ICPConvergenceCriteria(0.0, 0.0, iterations),
        )
        # a pose that repeats itself to the last bit ends the iterations here
        assert found.iterations == iterations or found.stop == "tolerance"
        assert np.abs(found.transformation - theirs.transformation).max() < 1e-6
        assert abs(found.fitness - theirs.fitness) < 1e-9
        assert abs(found.inlier_rmse - theirs.inlier_rmse) < 1e-9
    assert found.fitness > 0.5
    assert np.abs(found.transformation - np.eye(4)).max() > 1e-3
