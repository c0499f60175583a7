"""Camera poses."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from strand.views.pose import make_rotation, to_rotation_vector


def random_pose(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return strand.pose_from_angles(*rng.uniform(-3, 3, 3), rng.uniform(-2, 2, 3))


def test_rotation_is_the_product_about_x_then_y_then_z():
    x, y, z = (strand.rotation_xyz(*angles) for angles in ((0.3, 0, 0), (0, -0.7, 0), (0, 0, 1.1)))
    np.testing.assert_allclose(strand.rotation_xyz(0.3, -0.7, 1.1), x @ y @ z, atol=1e-15)
    np.testing.assert_allclose(strand.rotation_xyz(0, 0, np.pi / 2) @ [1, 0, 0], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(strand.rotation_xyz(np.pi / 2, 0, 0) @ [0, 1, 0], [0, 0, 1], atol=1e-15)


def test_a_point_of_the_plate_stays_where_it_is_when_the_plate_turns():
    camera, centre, axis, angle = random_pose(4), np.array([0.1, 0.2, 0.0]), np.array([0.1, 0.0, 2.0]), 0.8
    on_plate = np.array([0.3, -0.1, 0.05])
    # the fixed camera sees the turned point where the moved camera sees the unturned one
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turn = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    turned = centre + turn @ (on_plate - centre)
    seen = camera[:3, :3].T @ (turned - camera[:3, 3])
    pose = strand.turntable_pose(camera, angle, centre, axis)
    np.testing.assert_allclose(pose[:3, :3] @ seen + pose[:3, 3], on_plate, atol=1e-12)


def test_vectors_and_poses_may_be_whole_numbers():
    whole = strand.pose_from_angles(1, 0, 2, [1, 2, 3])
    np.testing.assert_array_equal(whole, strand.pose_from_angles(1.0, 0.0, 2.0, [1.0, 2.0, 3.0]))
    turned = strand.turntable_pose(np.eye(4, dtype=int), 1, [0, 1, 0], np.array([0, 0, 2]))
    want = strand.turntable_pose(np.eye(4), 1.0, [0.0, 1.0, 0.0], [0.0, 0.0, 2.0])
    np.testing.assert_array_equal(turned, want)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: strand.turntable_pose(np.eye(4), 0.1, axis=[0.0, 0.0, 0.0]), "axis"),
        (lambda: strand.turntable_pose(np.eye(4), np.nan), "angle"),
        (lambda: strand.turntable_pose(np.eye(3), 0.1), "camera"),
        (lambda: strand.pose_from_angles(0.0, np.inf, 0.0, [0.0] * 3), "angles"),
        (lambda: strand.pose_from_angles(0.0, 0.0, 0.0, [0.0] * 2), r"origin: expected shape \(3,\)"),
    ],
)
def test_what_is_no_pose_is_refused_by_name(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_a_rotation_vector_gives_back_its_rotation():
    np.testing.assert_array_equal(to_rotation_vector(np.eye(3)), np.zeros(3))
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    for angle in (1e-9, 0.3, 3.0):
        np.testing.assert_allclose(to_rotation_vector(make_rotation(axis, angle)), angle * axis, rtol=1e-6)
