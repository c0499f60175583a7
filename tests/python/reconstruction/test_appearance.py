"""Chains have the labels of masks and the colours of images."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from shared.occluded import ROPE, R, make_view
from strand.synthetic import color_scene

LIGHT = 0.12  # the middle of a rope is so much brighter than its sides


@pytest.fixture(scope="module")
def two_ropes():
    return color_scene("two ropes", 0)


def near(scene, chain):
    """The number of the true rope that a chain follows."""
    away = [np.linalg.norm(chain.points[:, None] - rope[None], axis=2).min(axis=1) for rope in scene.truth]
    return int(np.argmin([np.median(distance) for distance in away]))


def median_color(scene, number):
    return np.median(scene.color[0][scene.labels[0] == number + 1], axis=0) / 255.0


def test_given_labels_and_colours_come_back(two_ropes):
    scene = two_ropes.scene
    labels = np.where(two_ropes.labels[0] > 0, 10 * two_ropes.labels[0] + 3, 0)
    view = strand.View.from_depth(
        scene.depth[0], scene.intrinsics, scene.poses[0], two_ropes.color[0],
        depth_scale=scene.depth_scale, mask=labels,
    )  # fmt: skip
    model = strand.reconstruct([view], scene.radius)
    assert sorted(chain.label for chain in model.chains) == [13, 23]
    for chain in model.chains:
        number = near(scene, chain)
        assert chain.label == 10 * (number + 1) + 3
        np.testing.assert_allclose(chain.color, median_color(two_ropes, number), atol=LIGHT)
        assert not chain.color.flags.writeable


def test_ropes_found_by_colour_have_a_label_for_each_colour(two_ropes):
    model = strand.reconstruct(two_ropes.views)
    assert {chain.label for chain in model.chains} == {1, 2}
    for chain in model.chains:
        number = near(two_ropes.scene, chain)
        np.testing.assert_allclose(chain.color, median_color(two_ropes, number), atol=LIGHT)


def test_several_views_share_the_labels_of_colours():
    views = [make_view([], azimuth, colored=True, known=False, noise=0.004) for azimuth in (0.3, 2.4)]
    (chain,) = strand.reconstruct(views).chains
    assert chain.label == 1
    np.testing.assert_allclose(255.0 * chain.color, (200.0, 40.0, 40.0), atol=6.0)


def test_bools_have_no_label_and_plain_views_no_colour():
    (chain,) = strand.reconstruct([make_view([], masked=True, known=False)], R).chains
    assert chain.label is None
    assert chain.color is None


def test_coloured_points_give_the_colour(paper):
    views = [
        strand.View(view.points, view.pose, colors=np.full((len(view.points), 3), 0.25))
        for view in paper.views
    ]
    model = strand.reconstruct(views, paper.radius, paper.bounds)
    np.testing.assert_array_equal(model.chains[0].color, 0.25)


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"label": -1}, ValueError, "label: "),
        ({"label": 1.5}, TypeError, "label: "),
        ({"color": [0.1, 0.2]}, ValueError, "color: expected"),
        ({"color": [0.1, 0.2, 1.5]}, ValueError, "color: expected colours from 0 to 1"),
    ],
)
def test_wrong_labels_and_colours_are_refused(given, error, message):
    with pytest.raises(error, match=message):
        strand.Chain(ROPE, R, **given)
