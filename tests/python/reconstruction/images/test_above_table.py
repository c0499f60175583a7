"""Ropes segmented from their table where depth is noisy."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import strand
from strand import pose_from_angles
from strand._core import convolved
from strand.geometry.plane import Plane
from strand.reconstruction.evidence.prior import Prior
from strand.reconstruction.images.above_table import (
    add_masks,
    mask_above_table,
    measure_heights,
    segment_above_table,
)
from strand.reconstruction.images.table_plane import find_table_beside_ropes
from strand.reconstruction.radius import Radii
from strand.reconstruction.stages import Observed
from strand.synthetic import Camera, Noise, Segmentation, scene
from strand.views.rope_images import make_rope_images
from strand.views.view import cropped


def test_what_stands_out_of_a_table_is_rope():
    made = scene("loop", seed=1, views=1, noise=Noise(depth=0.8 * 0.0042))
    still = scene("loop", seed=1, views=1, noise=Noise(depth=1e-5))
    views = made.views
    points = [view.crop(made.bounds) for view in views]
    images = make_rope_images(points, views, strand.Box(*made.bounds))
    table = find_table_beside_ropes(images[0], made.radius)
    assert table is not None
    (image,) = mask_above_table(images, table, strand.Box(*made.bounds), made.radius)
    true = make_rope_images(
        [view.crop(still.bounds) for view in still.views], still.views, strand.Box(*still.bounds)
    )[0].mask
    both = np.count_nonzero(image.mask & true)
    assert both > 0.8 * np.count_nonzero(true)
    assert both > 0.75 * np.count_nonzero(image.mask)
    # pixel by pixel it is lost in the table's noise
    assert np.count_nonzero(images[0].mask & true) < 0.75 * np.count_nonzero(images[0].mask)
    assert mask_above_table(images, None, strand.Box(*made.bounds), made.radius)[0] is images[0]


def test_a_view_without_a_mask_gets_one_of_what_stands_out_near_the_others_ropes():
    made = scene("loop", seed=1, views=2, camera=Camera("zed"), mask=Segmentation())
    first, true = made.views
    image = true.image
    (fx, fy), (cx, cy) = image.camera
    camera = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    bare = strand.View.from_depth(image.depth, camera, true.pose, np.full((*image.depth.shape, 3), 0.5))
    whole, box = (first, bare), strand.Box(*made.bounds)
    radii = Radii(np.array([made.radius]), np.array([0.0]), free=False)
    observed = Observed(cropped(whole, box), whole, [0, 1], box, radii, Prior())
    given = add_masks(observed)
    assert given.whole[0] is first
    both = np.count_nonzero(given.whole[1].mask & true.mask)
    assert both > 0.7 * np.count_nonzero(true.mask)
    assert both > 0.7 * np.count_nonzero(given.whole[1].mask)
    assert 0 < len(given.views[1].points) <= len(given.whole[1].points)
    assert (given.views[1].colors == 0.5).all()
    assert len(given.views[1].colors) == len(given.views[1].points)
    # without a mask there is nothing to go by
    alone = dataclasses.replace(observed, whole=(bare, bare))
    assert add_masks(alone) is alone


@pytest.mark.parametrize("turned", [False, True])
def test_heights_are_those_of_the_points_that_pixels_show(turned):
    made = scene("loop", seed=1, views=1, noise=Noise(depth=0.002))
    (image,) = (view.image for view in made.views)
    table = Plane(np.array([0.0, 0.6, 0.8]), 0.01)
    low, high = np.array([-0.1, -np.inf, -0.05]), np.array([0.1, 0.2, 0.05])
    box = strand.Box(low, high, pose_from_angles(0.1, 0.2, 0.3, [0.0, 0.01, 0.0]) if turned else None)
    above, seen, pixels = measure_heights(image, table, box, made.radius)
    rows, columns = np.indices(image.depth.shape)
    world = image.lift(rows, columns, image.depth)
    assert above == pytest.approx(world @ table.normal - table.offset, abs=1e-12)
    axes = world + (made.radius - above)[..., None] * table.normal
    np.testing.assert_array_equal(seen, (image.depth > 0) & box.holds(axes, made.radius))
    assert 0 < np.count_nonzero(seen) < seen.size
    assert pixels == made.radius * image.camera.focal[0] / np.median(image.depth[seen])


def test_nothing_stands_out_of_an_image_without_depth():
    (image,) = (view.image for view in scene("loop", seed=1, views=1).views)
    empty = dataclasses.replace(image, depth=np.zeros_like(image.depth))
    table = Plane(np.array([0.0, 0.0, 1.0]), 0.0)
    assert measure_heights(empty, table, None, 0.004)[2] == 0.0
    assert not segment_above_table(empty, table, None, 0.004).any()


def test_a_convolution_is_that_of_a_full_sum():
    image = np.random.default_rng(0).random((70, 50)).astype(np.float32)
    kernel = [0.4, 0.2, 0.1]
    found = convolved(image, kernel)
    padded = np.pad(image, 2)
    expected = np.zeros(image.shape)
    for down in range(5):
        for right in range(5):
            weight = kernel[abs(down - 2)] * kernel[abs(right - 2)]
            expected += weight * padded[down : down + 70, right : right + 50]
    assert found == pytest.approx(expected, abs=1e-6)
    with pytest.raises(ValueError, match="kernel"):
        convolved(image, [])


def test_wide_plain_noise_is_read_as_an_image(measure):
    made = scene("loop", seed=1, views=3, noise=Noise(depth=0.8 * 0.0042))
    model = strand.reconstruct(made.views, made.radius, made.bounds)
    assert "readings" in model.timings
    assert measure(model, made.truth, made.radius).right
