"""Masks beside hands and grippers, labels of ropes that touch, and widths above noisy tables."""

import numpy as np
import pytest

import strand
from strand.reconstruction.color_masks.label_colors import split_labels
from strand.synthetic import color_scene


def measure(made):
    """Return the mask's share in the true one and in that of things."""
    (view,) = strand.find_ropes(made.views).views
    true = made.labels[0] > 0
    return np.mean(view.mask[true]), np.mean(true[view.mask]), np.mean(made.occluders[0][view.mask])


@pytest.mark.parametrize(
    ("kind", "seed"), [("gripper", 301), ("gripper", 304), ("gripper", 307), ("hand", 303)]
)
def test_masks_end_at_things_and_go_on_beyond(kind, seed):
    recall, precision, on_thing = measure(color_scene(kind, seed))
    assert recall > 0.85
    assert precision > 0.9
    assert on_thing < 0.02


def test_ropes_of_two_colors_that_touch_have_two_labels():
    made = color_scene("two ropes", 304)
    (view,) = strand.find_ropes(made.views).views
    labels = view.image.labels
    assert set(np.unique(labels)) == {0, 1, 2}
    for own in (1, 2):
        counts = np.bincount(labels[made.labels[0] == own], minlength=3)[1:]
        assert counts.max() > 0.9 * counts.sum()


def test_ropes_of_two_colors_each_keep_one_label():
    made = color_scene("two colors", 301)
    (view,) = strand.find_ropes(made.views).views
    assert set(np.unique(view.image.labels)) == {0, 1}


def test_labels_of_one_color_are_one():
    lab = np.full((3, 60, 80), 20.0, dtype=np.float32)
    lab[0] = 80.0
    labels = np.zeros((60, 80), dtype=np.int32)
    labels[10:14, 5:75], labels[40:44, 5:75] = 1, 3
    lab[:, labels > 0] = np.array([40.0, 50.0, 20.0])[:, None]
    assert set(np.unique(split_labels(lab, labels, 2.0))) == {0, 1}


def test_table_in_a_loop_of_rope_is_none():
    made = color_scene("wood", 302)
    found = strand.rope_mask(
        made.color[0], made.scene.depth[0] * made.scene.depth_scale, made.scene.intrinsics
    )
    assert found, found.why
    assert np.mean((made.labels[0] > 0)[found.mask]) > 0.9


@pytest.mark.parametrize("seed", [305, 313])
def test_specks_of_noise_do_not_hide_how_wide_ropes_are(seed):
    made = color_scene("table color", seed)
    found = strand.find_ropes(made.views)
    assert found.radius == pytest.approx(made.scene.radius, rel=0.35)
    assert np.mean(found.views[0].mask[made.labels[0] > 0]) > 0.8
