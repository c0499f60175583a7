"""Corners of masks that a segmenter filled: strands that touch and strands that cross are told apart."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import strand
from strand.synthetic import Camera, Layout, Segmentation, scene

RADIUS = 0.004
FILLED = 4  # pixels: corners that a disc of this radius does not reach into are filled


def draw_pair(kind, degrees, seed):
    """Return two ropes that touch and part, or cross, at an angle."""
    x = np.linspace(-35.0, 35.0, 301) * RADIUS
    slope = np.tan(np.radians(degrees) / 2.0)
    if kind == "touch":
        y = np.hypot(1.06 * RADIUS, slope * x)
        lift = np.zeros_like(x)
    else:
        y = slope * x
        lift = RADIUS * np.where(np.abs(x) < 14 * RADIUS, 1.0 + np.cos(np.pi * x / (14 * RADIUS)), 0.0)
    turn = np.random.default_rng(seed).uniform(0.0, np.pi)
    cosine, sine = np.cos(turn), np.sin(turn)
    ropes = []
    for sign, height in ((1.0, RADIUS + lift), (-1.0, np.full_like(x, RADIUS))):
        ropes.append(np.column_stack([cosine * x - sine * sign * y, sine * x + cosine * sign * y, height]))
    return ropes


def fill_corners(mask):
    """Return a mask closed by a disc."""
    rows, columns = np.mgrid[-FILLED : FILLED + 1, -FILLED : FILLED + 1]
    disc = np.argwhere(rows**2 + columns**2 <= FILLED**2 + 0.3) - FILLED

    def grow(image):
        return np.any([np.roll(image, tuple(shift), (0, 1)) for shift in disc], axis=0)

    return ~grow(~grow(mask))


@pytest.mark.parametrize(
    ("kind", "degrees", "seed"),
    [("touch", 24, 5), ("touch", 32, 9), ("cross", 24, 9), ("cross", 32, 9), ("cross", 42, 11)],
)
def test_strands_under_an_acute_angle_touch_or_cross(kind, degrees, seed, measure):
    made = scene(
        chains=draw_pair(kind, degrees, seed),
        radius=RADIUS,
        seed=seed,
        views=1,
        camera=Camera("sgbm", size=(480, 360)),
        mask=Segmentation(),
        layout=Layout(distance=0.45),
    )
    mask = np.stack([fill_corners(each) for each in made.mask])
    model = strand.reconstruct(dataclasses.replace(made, mask=mask).views, RADIUS, ropes=2)
    found = measure(model, made.truth, RADIUS)
    assert found.chains == 2
    assert found.frechet < 3.0
