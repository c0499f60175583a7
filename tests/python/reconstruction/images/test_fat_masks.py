"""Masks that are wider than their ropes: slimmed by depth, or read at their own radius."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from strand.geometry.plane import Plane
from strand.reconstruction.images.fat_masks import slim_fat_masks
from strand.reconstruction.images.prepare import prepare_views
from strand.synthetic import Camera, Layout, Segmentation, scene
from strand.views.depth_image import DepthImage
from strand.views.pinhole import Pinhole

RADIUS = 0.004
TABLE = Plane(np.array([0.0, 0.0, -1.0]), -0.5)


def draw_band(axes, width_px, stands_out=True):
    """Return a depth image, two pixels to a millimetre, of ropes along rows under a mask of a band."""
    rows, columns = np.mgrid[:120, :200]
    inside = np.abs(columns - 100) < 80
    depth = np.full((120, 200), 0.5)
    for axis in axes if stands_out else ():
        away = np.abs(rows - axis) / 2000.0
        top = 0.5 - RADIUS - np.sqrt(np.maximum(RADIUS**2 - away**2, 0.0))
        depth = np.where(inside & (away < RADIUS), np.minimum(depth, top), depth)
    mask = inside & (np.abs(rows - 60) < width_px)
    camera = Pinhole((1000.0, 1000.0), (100.0, 60.0))
    return DepthImage(depth, camera, np.eye(4), mask)


def test_a_mask_is_slimmed_to_what_stands_out():
    image = draw_band([60], 14)
    (found,) = slim_fat_masks([image], TABLE, None, RADIUS)
    rows = np.count_nonzero(found.mask.any(axis=1))
    assert 14 <= rows <= 19


def test_a_mask_stays_where_depth_shows_no_rope_and_keeps_two_beside_each_other():
    flat = draw_band([60], 14, stands_out=False)
    (found,) = slim_fat_masks([flat], TABLE, None, RADIUS)
    assert found is flat
    pair = draw_band([52, 68], 16)
    (found,) = slim_fat_masks([pair], TABLE, None, RADIUS)
    assert found.mask[[52, 68], 30:170].all()


def test_a_fat_mask_without_clear_depth_is_read_at_its_own_radius():
    flat = draw_band([60], 20, stands_out=False)
    views = prepare_views([flat], True, TABLE, None, RADIUS)
    assert views.images.radii[0] == pytest.approx(20.0, abs=1.0)
    assert views.wider == pytest.approx(12.0, abs=1.0)
    (reading, *_) = views.images.find_readings(None, 1, [0])
    assert len(reading[2]) == 1


@pytest.mark.parametrize("camera", ["d405", "tof"])
def test_masks_twice_as_wide_as_ropes_are_right_and_named(camera, measure):
    made = scene(
        "loop",
        seed=4,
        radius=0.003,
        views=1,
        camera=Camera(camera, size=(320, 240)),
        mask=Segmentation(grow=3),
        layout=Layout(distance=0.003 / 2.6 * 320 * 1.2),
    )
    model = strand.reconstruct(made.views, made.radius, ropes=1)
    found = measure(model, made.truth, made.radius)
    assert found.chains == 1
    assert found.frechet < 3.0
    assert model.chains[0].radius == made.radius
    assert any("pixels wider on each side" in doubt.reason for doubt in model.doubts)


def test_gaps_that_a_fat_mask_fills_are_opened():
    (found,) = slim_fat_masks([draw_band([48, 72], 28)], TABLE, None, RADIUS)
    assert not found.mask[58:63, 30:170].any()
    assert found.mask[[48, 72], 30:170].all()
