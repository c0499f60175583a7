"""Views, whole and inside the extraction range, and the images that are made of them once."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import strand
from strand.views.extract import Extract, extract_views

SCENE = strand.synthetic.scene("arc", seed=1, views=2)
VIEWS = SCENE.views
BOUNDS = strand.Box(*SCENE.bounds)


def test_views_are_cropped_once_and_images_made_once():
    extract = extract_views(VIEWS, BOUNDS)
    for own, view in zip(extract.inside, VIEWS, strict=True):
        np.testing.assert_array_equal(own.points, view.crop(BOUNDS).points)
    assert extract.inside is extract.inside
    for image, own, view in zip(extract.images, extract.inside, VIEWS, strict=True):
        assert image.depth is view.image.depth
        assert np.count_nonzero(image.mask) == len(own.points)
    assert extract.images is extract.images
    pairs = zip(extract.whole_images, VIEWS, strict=True)
    assert all(image is view.image for image, view in pairs)


def test_without_a_range_all_is_inside():
    extract = extract_views(VIEWS, None)
    assert extract.inside == extract.whole
    assert not extract.empty
    assert extract_views([strand.View(np.zeros((0, 3)))], None).empty
    assert extract_views([strand.View.from_depth(np.zeros((4, 5)), SCENE.intrinsics)], None).empty
    assert not extract_views([strand.View.from_depth(np.ones((4, 5)), SCENE.intrinsics)], None).empty
    with pytest.raises(ValueError, match="at least one View"):
        extract_views([], None)


def test_ropes_that_are_known_are_what_is_inside():
    ropes = tuple(view.crop(BOUNDS).select(np.arange(len(view.crop(BOUNDS).points)) < 50) for view in VIEWS)
    extract = Extract(VIEWS, BOUNDS, ropes)
    assert extract.inside is ropes


def test_views_with_a_mask_or_without_points_have_no_whole_image():
    masked = dataclasses.replace(SCENE, mask=SCENE.depth > 0).views[0]
    empty = strand.View(np.zeros((0, 3)))
    extract = Extract((masked, empty, VIEWS[1]), None)
    assert [image is None for image in extract.whole_images] == [True, True, False]
    assert [image is None for image in extract.images] == [False, True, False]


def test_nothing_is_unprojected_to_tell_that_there_are_points():
    view = strand.View.from_depth(SCENE.depth[0], SCENE.intrinsics, depth_scale=SCENE.depth_scale)
    extract = extract_views([view], None)
    assert not extract.empty
    assert extract.whole_images[0] is view.image
    # the image, as long as no one has asked for points
    assert view.measured is view.image


def test_points_that_were_dropped_from_masked_images_do_not_count():
    masked = dataclasses.replace(SCENE, mask=SCENE.depth > 0).views[0]
    extract = Extract((masked,), None, (masked.select(np.zeros(len(masked.points), dtype=bool)),))
    assert extract.empty
