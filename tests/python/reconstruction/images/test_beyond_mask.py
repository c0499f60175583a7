"""Masks that lost a piece of rope: depth beyond an end shows it, and the answer is unsure of that end."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

import strand
from strand.synthetic import Camera, Layout, Segmentation, scene

RADIUS = 0.0045


def drawn(camera, views):
    return scene(
        "s",
        radius=RADIUS,
        seed=5,
        views=views,
        camera=Camera(camera, size=(640, 480)),
        layout=Layout(distance=0.6, elevation=math.radians(70.0)),
        mask=Segmentation(),
    )


def without(made, low, high):
    """The scene with masks that lost a stretch of the rope, from one share of its length to another."""
    (rope,) = made.truth
    (fx, _, cx), (_, fy, cy), _ = made.intrinsics
    masks = []
    for mask, pose in zip(made.mask, made.poses, strict=True):
        x, y, z = ((rope - pose[:3, 3]) @ pose[:3, :3]).T
        rows, columns = np.nonzero(mask)
        squares = (columns[:, None] - fx * x / z - cx) ** 2 + (rows[:, None] - fy * y / z - cy) ** 2
        share = squares.argmin(axis=1) / len(rope)
        lost = (share > low) & (share < high)
        masks.append(mask.copy())
        masks[-1][rows[lost], columns[lost]] = False
    return dataclasses.replace(made, mask=np.array(masks))


def doubted(model):
    """Places of ends that are doubted because depth goes on beyond them."""
    return [doubt.place for doubt in model.doubts if "goes on" in doubt.reason and doubt.amount > 0.3]


@pytest.mark.parametrize(("camera", "views"), [("d435", 1), ("d435", 3), ("zed", 1)])
def test_an_end_that_a_mask_lost_is_unsure_and_one_that_is_there_is_not(camera, views):
    made = drawn(camera, views)
    whole = strand.reconstruct(made.views, RADIUS, made.bounds, ropes=1)
    assert not doubted(whole)
    assert whole.confidence > 0.7
    cut = strand.reconstruct(without(made, 0.8, 1.1).views, RADIUS, made.bounds, ropes=1)
    (place,) = doubted(cut)
    (rope,) = made.truth
    assert np.linalg.norm(place - rope[int(0.8 * len(rope))]) < 4.0 * RADIUS
    assert cut.confidence < 0.85


def test_a_gap_of_the_mask_in_which_depth_shows_the_rope_is_filled(measure):
    made = without(drawn("d435", 1), 0.45, 0.55)
    model = strand.reconstruct(made.views, RADIUS, made.bounds)
    assert measure(model, made.truth, RADIUS).right
    assert model.confidence > 0.7


def test_without_masks_correlated_noise_is_read_from_the_images(measure):
    made = drawn("d435", 1)
    low, high = made.bounds
    bounds = np.array([low[0], low[1], 0.4 * RADIUS]), high
    model = strand.reconstruct(dataclasses.replace(made, mask=None).views, RADIUS, bounds, ropes=1)
    assert measure(model, made.truth, RADIUS).right
