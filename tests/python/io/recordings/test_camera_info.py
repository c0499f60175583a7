"""Tests of calibrations from CameraInfo, and of the topics that have them."""

from __future__ import annotations

import numpy as np
import pytest

from lib.bag_files import Messages
from strand.io.recordings.camera_info import is_rectified, name_info_topic, name_units_topic, read_calibration

K = np.array([[200.0, 0, 79.5], [0, 210.0, 59.5], [0, 0, 1]])


def read(info, rectified=False, ignore=False):
    return read_calibration(info, rectified=rectified, ignore_distortion=ignore)


@pytest.mark.parametrize("ros1", [False, True])
def test_k_of_images_and_p_of_rectified_ones(ros1):
    info = Messages(ros1).info(K, (120, 160), 0, d=[0.0] * 5)
    p = info.P if ros1 else info.p
    p[:] = [190, 0, 80, -20, 0, 190, 60, 0, 0, 0, 1, 0]
    np.testing.assert_array_equal(read(info).matrix, K)
    assert read(info).size == (120, 160)
    np.testing.assert_array_equal(read(info, True).matrix, [[190, 0, 80], [0, 190, 60], [0, 0, 1]])
    p[:] = 0
    np.testing.assert_array_equal(read(info, True).matrix, K)
    info.height = 0
    assert read(info).size is None


def test_distortion_is_refused_except_for_rectified_images():
    info = Messages().info(K, (120, 160), 0, d=[0.1, 0.0])
    with pytest.raises(ValueError, match=r"CameraInfo.D: expected no distortion, got \[0.1, 0.0\]; rectify"):
        read(info)
    np.testing.assert_array_equal(read(info, ignore=True).matrix, K)
    np.testing.assert_array_equal(read(info, rectified=True).matrix, K)


@pytest.mark.parametrize(
    ("k", "reason"),
    [
        (np.zeros((3, 3)), r"CameraInfo.K: expected a pinhole matrix, got zeros"),
        (np.diag([200.0, -200.0, 1.0]), r"CameraInfo.K: expected"),
        (np.full((3, 3), np.nan), r"CameraInfo.K: expected finite numbers"),
    ],
)
def test_other_matrices_are_refused(k, reason):
    with pytest.raises(ValueError, match=reason):
        read(Messages().info(k, (120, 160), 0))


@pytest.mark.parametrize(
    ("topic", "info", "rectified"),
    [
        ("/depth", "/camera_info", False),
        ("/camera/depth/image_raw", "/camera/depth/camera_info", False),
        ("/camera/depth/image_rect_raw", "/camera/depth/camera_info", True),
        ("/camera/depth/image_rect_raw/compressedDepth", "/camera/depth/camera_info", True),
        ("/zed/depth/depth_registered", "/zed/depth/camera_info", False),
        ("/rectangle/depth", "/rectangle/camera_info", False),
        ("/device_0/sensor_0/Depth_0/image/data", "/device_0/sensor_0/Depth_0/info/camera_info", False),
    ],
)
def test_topics_of_the_camera_info(topic, info, rectified):
    assert name_info_topic(topic) == info
    assert is_rectified(topic) is rectified


def test_topic_of_the_unit_of_realsense():
    topic = "/device_0/sensor_0/Depth_0/image/data"
    assert name_units_topic(topic) == "/device_0/sensor_0/option/Depth Units/value"
