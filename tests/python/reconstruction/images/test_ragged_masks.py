"""Ragged masks, replaced by the likeliest outline of mask and depth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strand.geometry.plane import Plane
from strand.reconstruction.images.ragged_masks import measure_raggedness, mend_ragged_masks
from strand.views.depth_image import DepthImage
from strand.views.pinhole import Pinhole

RADIUS = 0.004
TABLE = Plane(np.array([0.0, 0.0, -1.0]), -0.5)


def draw_rope():
    """Return a depth image, two pixels to a millimetre, of a rope along a row, and its exact mask."""
    rows, columns = np.mgrid[:80, :200]
    away = np.abs(rows - 40) / 2000.0
    inside = (np.abs(columns - 100) < 80) & (away < RADIUS)
    top = 0.5 - RADIUS - np.sqrt(np.maximum(RADIUS**2 - away**2, 0.0))
    camera = Pinhole((1000.0, 1000.0), (100.0, 40.0))
    return DepthImage(np.where(inside, top, 0.5), camera, np.eye(4), inside)


def make_ragged(image):
    """Return the image with a mask that has a rough edge, a hole, and a bit of the table."""
    rng = np.random.default_rng(0)
    rows, columns = np.nonzero(image.mask)
    mask = image.mask.copy()
    for _ in range(4):
        down, across = rng.integers(-2, 3, (2, len(rows)))
        mask[rows + down, columns + across] ^= rng.random(len(rows)) < 0.1
    mask[36:44, 90:96] = False
    mask[30:35, 130:136] = True
    return replace(image, labels=mask)


def test_an_exact_mask_is_not_ragged_and_stays():
    image = draw_rope()
    assert measure_raggedness(image.mask) < 0.02
    assert mend_ragged_masks([image], TABLE, None, RADIUS)[0] is image


def test_a_ragged_mask_becomes_nearly_that_of_the_rope():
    exact = draw_rope()
    ragged = make_ragged(exact)
    (found,) = mend_ragged_masks([ragged], TABLE, None, RADIUS)
    wrong = np.count_nonzero(found.mask != exact.mask)
    assert wrong < 0.4 * np.count_nonzero(ragged.mask != exact.mask)
    assert found.mask[36:44, 90:96].all()
    assert not found.mask[30:33, 130:136].any()


def test_a_ragged_mask_stays_without_a_table_or_where_depth_shows_no_rope():
    ragged = make_ragged(draw_rope())
    flat = replace(ragged, depth=np.full_like(ragged.depth, 0.5))
    assert mend_ragged_masks([ragged], None, None, RADIUS)[0] is ragged
    assert mend_ragged_masks([flat], TABLE, None, RADIUS)[0] is flat
    noisy = replace(flat, depth=0.5 + np.random.default_rng(1).normal(0.0, RADIUS, flat.depth.shape))
    assert mend_ragged_masks([noisy], TABLE, None, RADIUS)[0] is noisy
