"""Imitated segmentation masks."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import binary_dilation, binary_erosion, distance_transform_edt, label

from strand.synthetic import Segmentation

ROPES = np.zeros((200, 300), dtype=bool)
ROPES[60:72, 20:280] = True
ROPES[20:180, 150:162] = True
SQUARE = np.ones((3, 3), dtype=bool)


def found(segmentation, seed=0):
    return segmentation.make_mask(ROPES, np.random.default_rng(seed))


def test_exact_without_arguments():
    mask = found(Segmentation())
    assert mask.dtype == bool
    assert np.array_equal(mask, ROPES)


def test_too_wide_and_too_narrow():
    for pixels in (1, 3):
        assert np.array_equal(found(Segmentation(grow=pixels)), binary_dilation(ROPES, SQUARE, pixels))
        assert np.array_equal(found(Segmentation(grow=-pixels)), binary_erosion(ROPES, SQUARE, pixels))


def test_ragged_at_the_edge_only():
    mask = found(Segmentation(ragged=1.0))
    changed = mask != ROPES
    depth = np.maximum(distance_transform_edt(ROPES), distance_transform_edt(~ROPES))
    assert 0.1 * (depth <= 1).sum() < changed.sum()
    assert depth[changed].max() < 7.0
    assert not changed[depth > 7].any()


def test_pixels_are_lost_in_patches():
    mask = found(Segmentation(lost=0.1))
    assert not (mask & ~ROPES).any()
    assert (ROPES & ~mask).sum() == pytest.approx(0.1 * ROPES.sum(), abs=1)
    _, holes = label(ROPES & ~mask)
    assert holes > 10
    # larger patches are fewer
    assert label(ROPES & ~found(Segmentation(lost=0.1, patch=4.0)))[1] < holes


def test_background_pixels_are_taken():
    mask = found(Segmentation(taken=0.2, grow=1))
    extra = mask & ~binary_dilation(ROPES, SQUARE)
    assert extra.sum() == pytest.approx(0.2 * ROPES.sum(), abs=2)
    away = distance_transform_edt(~ROPES)
    assert 0.45 < (away[extra] < 11).mean() < 0.8  # half of them beside a rope, specks by chance too
    assert (away[extra] > 30).any()


def test_same_generator_same_mask():
    rough = Segmentation(grow=-1, ragged=0.7, lost=0.1, taken=0.1)
    assert np.array_equal(found(rough), found(rough))
    assert not np.array_equal(found(rough), found(rough, 1))
    nothing = rough.make_mask(np.zeros((20, 30), dtype=bool), np.random.default_rng(0))
    assert not nothing.any()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (dict(grow=-65), "grow: expected at least -64"),
        (dict(ragged=-1.0), "ragged: expected a number >= 0"),
        (dict(patch=100.0), "patch: expected at most 64 pixels"),
        (dict(lost=1.1), "lost: expected a fraction from 0 to 1, got 1.1"),
        (dict(taken=float("nan")), "taken: expected a number >= 0"),
    ],
)
def test_wrong_values(arguments, message):
    with pytest.raises(ValueError, match=message):
        Segmentation(**arguments)


def test_wrong_types():
    with pytest.raises(TypeError, match="grow: expected an integer, got float"):
        Segmentation(grow=0.5)
    with pytest.raises(TypeError, match="lost: expected a number, got str"):
        Segmentation(lost="some")
