"""Masks with short outlines, and means of depths in squares and along ropes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import strand
from strand.reconstruction.images.above_table import mask_above_table, measure_heights
from strand.reconstruction.images.along_ropes import average_along_ropes
from strand.reconstruction.images.outlines import average_pixels, outline_ropes
from strand.reconstruction.images.table_plane import find_table_beside_ropes
from strand.synthetic import Camera, Noise, scene
from strand.views.rope_images import find_pixels, make_rope_images

RADIUS = 0.004


def noisy(name, relative, **options):
    return scene(name, radius=RADIUS, noise=Noise(depth=relative * RADIUS), **options)


def image_of(made):
    (image,) = make_rope_images(
        [view.crop(made.bounds) for view in made.views], made.views, strand.Box(*made.bounds)
    )
    return image


def test_outlines_are_nearer_to_the_truth_than_smoothed_heights():
    made, clear = (noisy("figure8", relative, views=1, seed=5) for relative in (0.8, 0.0))
    true, image = image_of(clear), image_of(made)
    table = find_table_beside_ropes(image, RADIUS)
    (smoothed,) = mask_above_table([image], table, strand.Box(*made.bounds), RADIUS)
    heights = measure_heights(smoothed, table, strand.Box(*made.bounds), RADIUS)
    (found,) = outline_ropes(smoothed, heights, table, RADIUS, made.noise, [0.9])

    def wrong(mask):
        return np.count_nonzero(mask != true.mask) / np.count_nonzero(true.mask)

    assert wrong(found.mask) < 0.8 * wrong(smoothed.mask)
    assert wrong(found.mask) < 0.25


def test_averaged_pixels_see_the_same_places():
    made = noisy("arc", 0.0, views=1, seed=6, camera=Camera(size=(1280, 720)))
    (image,) = make_rope_images(made.views, made.views, None)
    coarse, side = average_pixels(image, RADIUS)
    assert side > 2
    nodes = made.truth[0]
    fine = image.project(nodes)
    # a square's middle is half a pixel less than half its side from its first pixel
    assert np.allclose(coarse.project(nodes) * side + 0.5 * (side - 1), fine)
    column, row = np.rint(coarse.project(nodes[len(nodes) // 2 :][:1])[0]).astype(int)
    column_there, row_there = np.rint(fine[len(nodes) // 2]).astype(int)
    assert coarse.depth[row, column] == pytest.approx(image.depth[row_there, column_there], abs=RADIUS)


def test_means_along_a_rope_leave_little_of_the_noise():
    made, clear = (noisy("figure8", relative, views=1, seed=9) for relative in (0.8, 0.0))
    true = image_of(clear)
    image = dataclasses.replace(image_of(made), labels=true.mask)
    table = find_table_beside_ropes(image, RADIUS)
    points = average_along_ropes(image, table, strand.Box(*made.bounds), RADIUS)
    rows, columns = find_pixels(points, made.views[0].image)
    assert np.count_nonzero(true.mask) == len(points)
    errors = points[:, 2] - true.depth[rows, columns]
    single = image.depth[rows, columns] - true.depth[rows, columns]
    assert np.std(single) > 0.7 * RADIUS
    assert np.std(errors) < 0.5 * np.std(single)
    assert abs(np.median(errors)) < 0.3 * RADIUS
