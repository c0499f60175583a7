"""Doubts of answers that were read from images, and their places."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import strand
from strand.reconstruction.images.image_doubts import (
    _locate_difference,
    doubt_ends_at_strands,
    doubt_uneven_widths,
)
from strand.synthetic import Camera, Layout, Segmentation, scene

RADIUS = 0.004


def test_a_rival_is_named_where_it_is_farthest_away_or_joined_otherwise():
    # more nodes than are compared at a time
    nodes = np.arange(1300)[:, None] * [0.5 * RADIUS, 0.0, 0.0]
    assert _locate_difference([nodes], [nodes + 0.1 * RADIUS], RADIUS) == (None, False)
    away = nodes.copy()
    away[690:711, 1] = (10.0 - np.abs(np.arange(-10, 11))) * RADIUS
    place, joined = _locate_difference([nodes], [away], RADIUS)
    assert np.array_equal(place, nodes[700])
    assert not joined
    # the same places, in another order
    halves = np.vstack([nodes[1000:], nodes[:1000]])
    for others, at in (([halves], 999), ([nodes[:600], nodes[600:]], 599)):
        place, joined = _locate_difference([nodes], others, RADIUS)
        assert np.array_equal(place, nodes[at])
        assert joined


def test_mask_that_no_rope_covers_is_doubted_where_it_is():
    made = scene(
        "arc",
        seed=1,
        views=1,
        camera=Camera("d435", size=(640, 480)),
        mask=Segmentation(),
        layout=Layout(distance=0.5),
    )
    mask = made.mask.copy()
    rows, columns = np.nonzero(mask[0])
    corner = rows.min() - 20, columns.min() - 20
    mask[0, corner[0] : corner[0] + 25, corner[1] : corner[1] + 25] = True
    model = strand.reconstruct(dataclasses.replace(made, mask=mask).views, made.radius, made.bounds, ropes=1)
    (doubt,) = [doubt for doubt in model.doubts if doubt.kind == "uncovered"]
    assert model.confidence < 0.85
    seen = (doubt.place - made.poses[0][:3, 3]) @ made.poses[0][:3, :3]
    column, row = (made.intrinsics @ seen)[:2] / seen[2]
    assert corner[0] <= round(row) < corner[0] + 25
    assert corner[1] <= round(column) < corner[1] + 25
    assert doubt in model.next_view()[0].settles


@pytest.mark.parametrize("camera", ["d435", "tof"])
@pytest.mark.parametrize("name", ["s", "loop", "overhand"])
def test_masks_two_pixels_too_wide_are_read_and_doubted(camera, name, measure):
    made = scene(
        name,
        seed=1,
        views=1,
        camera=Camera(camera, size=(640, 480)),
        mask=Segmentation(grow=2),
        layout=Layout(distance=0.5),
    )
    model = strand.reconstruct(made.views, made.radius, made.bounds, ropes=1)
    found = measure(model, made.truth, made.radius)
    # ends reach as far beyond the ropes' as the masks do
    assert found.chains == found.ropes
    assert found.frechet < 2.0
    assert found.crossings.right == found.crossings.true
    # depth shows how wide they are
    assert "wider on each side than the radius says" in str([doubt.reason for doubt in model.doubts])


@pytest.mark.parametrize("larger", [1.4, 1.5])
def test_a_pair_of_strands_that_a_radius_too_large_makes_one_is_doubted(larger):
    along = np.linspace(-0.1, 0.1, 201)
    pair = [np.column_stack([along, np.full(201, y), np.full(201, 0.0042)]) for y in (-0.0043, 0.0043)]
    made = scene(chains=pair, camera=Camera("sgbm", size=(640, 480)), views=1, mask=Segmentation(), seed=1)
    model = strand.reconstruct(made.views, larger * made.radius, made.bounds)
    assert len(model.chains) == 2 or model.confidence < 0.9


def test_ends_are_doubted_farther_from_strands_where_depths_scatter():
    along = np.arange(60)[:, None] * [0.5 * RADIUS, 0.0, 0.0]
    # an end 4.5 radii above the other rope
    across = np.array([10.0, 0.0, 0.0]) * RADIUS + np.arange(9, 60)[:, None] * [0.0, 0.5 * RADIUS, 0.0]
    for scatter, doubted in ((0.0, 0), (0.6, 1)):
        found = list(doubt_ends_at_strands([along, across], scatter * RADIUS, RADIUS))
        assert sum(doubt.amount > 0.0 for doubt in found) == doubted


def test_ropes_twice_as_wide_in_one_part_of_an_image_are_doubted_at_the_far_part():
    view = strand.View.from_depth(np.full((48, 64), 0.5), np.diag([60.0, 60.0, 1.0]), np.eye(4)).image
    ropes = [np.linspace((0.0, 0.0, near), (0.1, 0.0, near), 9) for near in (0.3, 0.4)]
    (usual,) = doubt_uneven_widths([view], ropes)
    assert usual.amount == 0.0
    ropes = [*ropes, ropes[0] + [0.0, 0.0, 0.3]]
    (doubt,) = doubt_uneven_widths([view], ropes)
    assert doubt.amount > 0.3
    assert doubt.place[2] == pytest.approx(0.6)
    assert "2.0 times as wide" in doubt.reason
    (again,) = doubt_uneven_widths([view, view], ropes)
    assert again.amount == doubt.amount
    # from the other side, far ropes are near ones
    below = np.diag([1.0, -1.0, -1.0, 1.0])
    below[2, 3] = 0.9
    turned = dataclasses.replace(view, pose=below)
    (seen,) = doubt_uneven_widths([view, turned], ropes)
    assert seen.amount == 0.0
