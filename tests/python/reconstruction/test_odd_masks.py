"""Masks of nets, noise and many pieces: refused, or answered with little confidence, after little work."""

from __future__ import annotations

import time

import numpy as np
import pytest

import strand

SIZE = (480, 640)
ROWS, COLUMNS = np.mgrid[: SIZE[0], : SIZE[1]]
CAMERA = [[600.0, 0.0, 319.5], [0.0, 600.0, 239.5], [0.0, 0.0, 1.0]]
MAX_TIME = 20.0  # seconds of processor time; a quiet machine takes a tenth
RADIUS = 0.004  # metres
CHANCE = np.random.default_rng(3)


def make_grid(period: int, width: int) -> np.ndarray:
    return (COLUMNS % period < width) | (ROWS % period < width)


def make_walk(steps: int) -> np.ndarray:
    chance, mask = np.random.default_rng(3), np.zeros(SIZE, dtype=bool)
    place, angle = np.array([240.0, 320.0]), 0.0
    for _ in range(steps):
        angle += chance.normal(0.0, 0.25)
        place = np.clip(place + 3.0 * np.array([np.sin(angle), np.cos(angle)]), 8, [471, 631])
        row, column = place.astype(int)
        mask[row - 2 : row + 3, column - 2 : column + 3] = True
    return mask


REFUSED = {
    "a fine net": make_grid(6, 2),
    "a net": make_grid(24, 6),
    "a wide net": make_grid(40, 8),
    "half of all pixels": CHANCE.random(SIZE) < 0.5,
    "most pixels": CHANCE.random(SIZE) < 0.8,
    "speckle": CHANCE.random(SIZE) < 0.05,
    "a chessboard": (COLUMNS // 16 + ROWS // 16) % 2 == 0,
    "fine stripes": COLUMNS % 8 < 4,
    "a comb": (ROWS < 20) | (COLUMNS % 12 < 5),
}
ANSWERED = {
    "large meshes": make_grid(80, 10),
    "stripes": COLUMNS % 20 < 6,
    "a tangle": make_walk(1500),
}


def view(mask: np.ndarray) -> strand.View:
    depth = np.where(mask, 0.99, 1.0) + np.random.default_rng(7).normal(0.0, 8e-4, SIZE)
    return strand.View.from_depth(depth, CAMERA, mask=mask)


@pytest.mark.parametrize("radius", [None, RADIUS])
@pytest.mark.parametrize("name", REFUSED)
def test_nets_and_noise_are_refused(name, radius):
    begun = time.process_time()
    with pytest.raises(strand.NotEnoughDataError, match=r"net|pieces|no rope|radii of rope"):
        strand.reconstruct([view(REFUSED[name])], radius=radius)
    assert time.process_time() - begun < MAX_TIME


@pytest.mark.parametrize("name", ANSWERED)
def test_many_crossings_and_pieces_take_little_work(name):
    begun = time.process_time()
    model = strand.reconstruct([view(ANSWERED[name])], radius=RADIUS)
    assert time.process_time() - begun < MAX_TIME
    assert name == "stripes" or model.confidence < 0.1


def test_a_net_outside_the_extraction_range_does_not_count():
    mask = make_grid(24, 6) & (COLUMNS < 300) | (np.abs(ROWS - 240) < 3) & (COLUMNS > 330)
    model = strand.reconstruct([view(mask)], radius=RADIUS, bounds=([0.0, -0.5, 0.5], [0.6, 0.5, 1.5]))
    assert len(model.chains) == 1


def test_a_mask_of_the_whole_image_is_smaller_than_a_wide_rope():
    whole = view(np.ones(SIZE, dtype=bool))
    with pytest.raises(strand.NotEnoughDataError, match="a mask that shows no rope"):
        strand.reconstruct([whole], radius=4.2)


def test_pixels_that_strand_found_are_no_mask_of_the_caller():
    made = strand.synthetic.sequence("still", seed=1, frames=1, color=True)[0]
    colored = made.depth[0], made.intrinsics, made.poses[0], made.color[0]
    seen = [strand.View.from_depth(*colored, depth_scale=made.depth_scale)]
    with pytest.raises(strand.NotEnoughDataError, match="view 0 has no rope in the pixels that strand found"):
        strand.reconstruct(seen, radius=0.1)
    with pytest.raises(strand.NotEnoughDataError, match="the pixels that strand found show the background"):
        strand.reconstruct(seen, radius=0.04)


@pytest.mark.parametrize("focal", [1e200, 1e307])
def test_a_focal_length_beyond_all_cameras_is_refused(focal):
    lens = [[focal, 0.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]]
    seen = strand.View.from_depth(np.full(SIZE, 1.0), lens, mask=np.ones(SIZE, dtype=bool))
    with pytest.raises(strand.NotEnoughDataError, match="a mask that shows no rope"):
        strand.reconstruct([seen], radius=RADIUS)


def test_other_views_are_used_beside_one_of_a_net():
    x = np.arange(60, 580)
    y = 240 + 100 * np.sin(x / 60)
    mask = np.zeros(SIZE, dtype=bool)
    for column, row in zip(x, y, strict=True):
        mask |= (np.abs(ROWS - row) < 3) & (np.abs(COLUMNS - column) < 3)
    model = strand.reconstruct([view(mask), view(make_grid(24, 6))], radius=RADIUS)
    assert len(model.chains) == 1
    assert any(warning.kind == "unused view" and "net" in warning.message for warning in model.warnings)
