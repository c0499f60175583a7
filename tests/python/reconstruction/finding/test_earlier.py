"""Ropes sought in colours near those of an earlier frame."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from strand.reconstruction.finding import in_color
from strand.reconstruction.finding.earlier import find_window, touches_side
from strand.synthetic import color_scene


@pytest.fixture(scope="module")
def shown():
    """Return an image of a rope in a part of it, and a model."""
    scene = color_scene("plain", 1)
    return scene.views[0].image, strand.reconstruct(scene.views)


def test_a_window_holds_the_earlier_ropes_and_a_margin(shown):
    image, model = shown
    rows, columns = find_window(image, model.chains)
    assert (rows.stop - rows.start) * (columns.stop - columns.start) < 0.7 * image.depth.size
    for chain in model.chains:
        x, y = image.project(chain.points).T
        assert x.min() > columns.start + 5
        assert y.min() > rows.start + 5
        assert x.max() < columns.stop - 5
        assert y.max() < rows.stop - 5
    assert find_window(image, ()) is None


def test_the_search_is_confined_to_the_window_and_finds_the_same(shown, monkeypatch):
    image, model = shown
    whole = in_color.find_in_color(image)
    areas, search = [], in_color.search_mask
    monkeypatch.setattr(
        in_color, "search_mask", lambda own, *rest: areas.append(own[..., 0].size) or search(own, *rest)
    )
    near = in_color.find_in_color(image, model.chains)
    assert len(areas) == 1
    assert areas[0] < 0.7 * image.depth.size
    both = np.count_nonzero(whole.mask & near.mask)
    assert both > 0.85 * np.count_nonzero(whole.mask | near.mask)


def test_a_rope_that_moved_away_is_found_in_the_whole_image(shown):
    image, model = shown
    _, columns = find_window(image, model.chains)
    distance = float((model.chains[0].points[0] - image.pose[:3, 3]) @ image.pose[:3, 2])
    # half of the rope is beyond the window's side
    away = image.pose[:3, 0] * 0.5 * (columns.stop - columns.start) * distance / image.camera.focal[0]
    moved = [strand.Chain(chain.points + away, chain.radius) for chain in model.chains]
    near, whole = in_color.find_in_color(image, moved), in_color.find_in_color(image)
    assert np.array_equal(near.labels, whole.labels)


def test_masks_that_leave_their_window_touch_its_side():
    mask = np.zeros((40, 60), dtype=bool)
    mask[20, 10:30] = True
    assert touches_side(mask, (slice(10, 30), slice(10, 40)))
    assert not touches_side(mask, (slice(10, 30), slice(9, 40)))
    mask[20, :10] = True
    assert not touches_side(mask, (slice(10, 30), slice(0, 40)))
