"""Pixels of the robot or a hand are neither rope nor seen through."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import strand
from shared.occluded import GRIPPER, HAND, ROPE, R, make_view
from strand.reconstruction.evidence.visibility import sort_rays
from strand.views.view import masked, placed

K = np.array([[60.0, 0.0, 2.0], [0.0, 60.0, 1.0], [0.0, 0.0, 1.0]])
DEPTH = np.full((3, 5), 0.5)
OCCLUDERS = np.arange(15).reshape(3, 5) % 4 == 0


def test_occluders_are_no_points_and_in_no_mask():
    colors = np.linspace(0.0, 1.0, 45).reshape(3, 5, 3)
    view = strand.View.from_depth(DEPTH, K, colors=colors, mask=np.full((3, 5), 7), occluders=OCCLUDERS)
    assert len(view.points) == len(view.colors) == np.count_nonzero(~OCCLUDERS)
    np.testing.assert_array_equal(view.colors, colors[~OCCLUDERS])
    np.testing.assert_array_equal(view.mask, ~OCCLUDERS)
    assert not view.image.depth[OCCLUDERS].any()
    assert "with occluders" in repr(view)
    without_mask = strand.View.from_depth(DEPTH, K, occluders=OCCLUDERS)
    assert without_mask.mask is None
    np.testing.assert_array_equal(without_mask.points, view.points)


def test_views_keep_their_occluders():
    view = strand.View.from_depth(DEPTH, K, mask=np.ones((3, 5), dtype=bool), occluders=OCCLUDERS)
    whole = masked(view, view.image)
    window = view.image.cropped((slice(1, 3), slice(0, 4)))
    for one in (placed(view, np.eye(4)), view.moved(np.eye(4)), whole, pickle.loads(pickle.dumps(view))):
        np.testing.assert_array_equal(one.image.occluders, OCCLUDERS)
    np.testing.assert_array_equal(window.occluders, OCCLUDERS[1:3, :4])
    inside = view.crop(([-1.0, -1.0, 0.0], [1.0, 1.0, 1.0]))
    assert len(inside.points) == np.count_nonzero(~OCCLUDERS)


@pytest.mark.parametrize("given", [np.uint8(255) * OCCLUDERS, -1 * OCCLUDERS, OCCLUDERS.tolist()])
def test_every_number_but_0_is_an_occluder(given):
    image = strand.View.from_depth(DEPTH, K, occluders=given).image
    assert image.occluders.dtype == np.bool_
    np.testing.assert_array_equal(image.occluders, OCCLUDERS)


def test_later_changes_of_the_callers_array_change_no_view():
    given = OCCLUDERS.copy()
    view = strand.View.from_depth(DEPTH, K, occluders=given)
    given[:] = False
    np.testing.assert_array_equal(view.image.occluders, OCCLUDERS)
    assert not view.image.occluders.flags.writeable


@pytest.mark.parametrize(
    ("occluders", "error", "message"),
    [
        (np.ones((5, 3), dtype=bool), ValueError, r"occluders: expected the depth image's shape \(3, 5\)"),
        (np.ones((3, 5)), TypeError, "occluders: expected bools, or whole .* got dtype float64"),
        ("arm", TypeError, "occluders: expected"),
    ],
)
def test_wrong_occluders_are_refused(occluders, error, message):
    with pytest.raises(error, match=message):
        strand.View.from_depth(DEPTH, K, occluders=occluders)


@pytest.mark.parametrize("objects", [GRIPPER, HAND])
def test_places_that_project_on_occluders_are_occluded_never_free(objects):
    view = make_view(objects)
    image = view.image
    # above all objects and before them, where the camera would see through
    places = ROPE[60:] + np.array([0.0, 0.0, 0.1])
    columns, rows = np.rint(image.project(places)).astype(int).T
    behind = image.occluders[rows, columns]
    assert 0 < np.count_nonzero(behind) < len(places)
    seen = sort_rays([view], [view.pose], [view])
    assert not seen.free(places[behind], R).any()
    assert seen.occluded(places[behind], R).all()
    assert seen.free(places[~behind], R).mean() > 0.9
