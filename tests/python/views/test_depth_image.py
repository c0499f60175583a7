"""Depth images: their mask, and places of the world that they show."""

from __future__ import annotations

import numpy as np
import pytest

from strand import View, pose_from_angles
from strand.views.depth_image import DepthImage
from strand.views.pinhole import Pinhole

DEPTH = np.arange(12.0).reshape(3, 4)
CAMERA = Pinhole((50.0, 60.0), (1.5, 1.0))
POSE = pose_from_angles(0.3, -0.2, 1.0, [0.1, 0.2, 0.3])


def test_without_labels_every_pixel_may_be_a_rope():
    image = DepthImage(DEPTH, CAMERA, POSE)
    assert image.mask.all()
    assert image.rope_depth is image.depth
    assert image.distance == np.median(DEPTH[DEPTH > 0])
    np.testing.assert_array_equal(image.mask_depths, DEPTH.ravel())


@pytest.mark.parametrize("kind", [np.int32, bool])
def test_pixels_with_a_label_are_ropes(kind):
    labels = (DEPTH % 2 == 0).astype(kind)
    image = DepthImage(DEPTH, CAMERA, POSE, labels)
    np.testing.assert_array_equal(image.mask, DEPTH % 2 == 0)
    np.testing.assert_array_equal(image.rope_depth, np.where(DEPTH % 2 == 0, DEPTH, 0.0))
    np.testing.assert_array_equal(image.mask_depths, DEPTH[DEPTH % 2 == 0])
    assert np.isnan(DepthImage(DEPTH, CAMERA, POSE, np.zeros_like(labels)).distance)
    for array in (image.depth, image.labels):
        assert not array.flags.writeable


def test_pixels_are_where_the_world_sees_their_points():
    image = DepthImage(DEPTH + 1.0, CAMERA, POSE)
    rows, columns = np.indices(DEPTH.shape)
    world = image.lift(rows, columns, image.depth)
    seen = image.project(world.reshape(-1, 3))
    assert seen == pytest.approx(np.column_stack([columns.ravel(), rows.ravel()]), abs=1e-9)


@pytest.mark.parametrize("start", [0, 1])
@pytest.mark.parametrize("order", ["C", "F"])
def test_depths_of_16_bits_lie_anywhere_in_a_buffer(start, order):
    millimetres = np.arange(192, dtype=np.uint16).reshape(12, 16) + 500
    buffer = bytes(start) + millimetres.tobytes()
    depth = np.asarray(np.frombuffer(buffer, np.uint16, 192, start).reshape(12, 16), order=order)
    view = View.from_depth(depth, [[50.0, 0.0, 1.5], [0.0, 60.0, 1.0], [0.0, 0.0, 1.0]], depth_scale=0.001)
    np.testing.assert_array_equal(view.points[:, 2], millimetres.ravel() * 0.001)
