"""Thin ropes: they are read on a finer grid, and answers are in pixels of the given images."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from strand.reconstruction.images.finer_grid import magnify_thin_ropes
from strand.synthetic import Camera, Layout, Segmentation, scene
from strand.views.depth_image import DepthImage
from strand.views.pinhole import Pinhole

FOCAL = 200.0
DISTANCE = 0.5


def draw_strip(radius_px, slope=0.4):
    """Return a depth image of a straight strip, and its radius in metres."""
    rows, columns = np.mgrid[:80, :120]
    across = (rows - 40.0 - slope * (columns - 60.0)) / np.hypot(1.0, slope)
    mask = (np.abs(across) < radius_px) & (np.abs(columns - 60) < 45)
    camera = Pinhole((FOCAL, FOCAL), (59.5, 39.5))
    image = DepthImage(np.full((80, 120), DISTANCE), camera, np.eye(4), mask)
    return image, radius_px * DISTANCE / FOCAL


def make_thin(name, radius_px, camera="tof", seed=1):
    radius = 0.004
    distance = radius / radius_px * 320 * 1.2
    return scene(
        name,
        seed=seed,
        radius=radius,
        views=1,
        camera=Camera(camera, size=(320, 240)),
        mask=Segmentation(),
        layout=Layout(distance=distance),
    )


@pytest.mark.parametrize(("radius_px", "factor"), [(1.0, 5), (1.5, 3), (2.0, 3), (3.0, 1)])
def test_images_are_magnified_until_a_rope_is_wide_enough(radius_px, factor):
    image, radius = draw_strip(radius_px)
    (fine,), found = magnify_thin_ropes([image], radius)
    assert found == factor
    shown = np.count_nonzero(fine.mask) / factor**2
    assert shown == pytest.approx(np.count_nonzero(image.mask), rel=0.05)


def test_a_finer_pixel_shows_the_same_place_and_depth():
    image, radius = draw_strip(1.5)
    image.depth.setflags(write=True)
    image.depth[:] += 0.001 * np.arange(120)
    (fine,), _ = magnify_thin_ropes([image], radius)
    rows, columns = np.nonzero(fine.mask)
    back = np.rint(image.camera.convert(np.column_stack([columns, rows]), fine.camera)).astype(int)
    assert np.allclose(fine.depth[rows, columns], image.depth[back[:, 1], back[:, 0]])


def test_a_wide_mask_of_a_thin_rope_is_not_magnified():
    image, radius = draw_strip(4.0)
    (same,), factor = magnify_thin_ropes([image], 0.4 * radius)
    assert factor == 1
    assert same is image


@pytest.mark.parametrize("given", [True, False])
@pytest.mark.parametrize(("name", "radius_px"), [("s", 1.6), ("loop", 1.8)])
def test_ropes_of_three_pixels_are_right(name, radius_px, given, measure):
    made = make_thin(name, radius_px)
    model = strand.reconstruct(made.views, made.radius if given else None, ropes=1)
    found = measure(model, made.truth, made.radius)
    assert found.chains == 1
    assert found.frechet < 3.0
    assert found.crossings.right == found.crossings.true
    # the errors of edges are in pixels of the given image
    assert 0.05 < model.sensor.lateral < 0.8
    assert model.branch == "images"
