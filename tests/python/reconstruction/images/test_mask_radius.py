"""The radius of ropes by masks."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

import strand
import strand._core as _core
from strand._core import NotEnoughDataError
from strand.reconstruction.images import mask_radius
from strand.reconstruction.images.fat_masks import slim_fat_masks
from strand.reconstruction.images.mask_radius import estimate_mask_radius
from strand.synthetic import Camera, Segmentation, scene
from strand.views.rope_images import make_rope_images


@pytest.mark.parametrize("camera", ["d435", "tof"])
@pytest.mark.parametrize("radius", [0.003, 0.006])
def test_exact_masks_show_the_radius(camera, radius):
    made = scene(
        "loop", seed=3, radius=radius, views=1, camera=Camera(camera, size=(640, 480)), mask=Segmentation()
    )
    (image,) = make_rope_images(made.views, made.views, None)
    (found,), (sd,) = estimate_mask_radius(image)
    assert found == pytest.approx(radius, rel=0.15)
    assert abs(found - radius) < 2.0 * sd


@pytest.mark.parametrize(("grow", "slimmed"), [(-1, 0), (3, 1)])
def test_masks_that_are_wider_than_ropes_are_high_are_slimmed(monkeypatch, grow, slimmed):
    calls = []

    def slim(*arguments):
        calls.append(arguments)
        return slim_fat_masks(*arguments)

    monkeypatch.setattr(mask_radius, "slim_fat_masks", slim)
    camera, mask = Camera("d435", size=(640, 480)), Segmentation(grow=grow)
    made = scene("loop", seed=3, radius=5e-3, views=1, camera=camera, mask=mask)
    (image,) = make_rope_images(made.views, made.views, None)
    (found,), _ = estimate_mask_radius(image)
    assert found == pytest.approx(5e-3, rel=0.2)
    assert len(calls) == slimmed


@pytest.mark.parametrize("width", [5, 9, 14])
def test_strands_that_cross_are_as_wide_as_one(width):
    rows, columns = np.mgrid[:300, :400]
    level, slope = np.abs(rows - 150) <= width // 2, np.abs(rows - 0.7 * columns) * 0.8192 <= 0.5 * width
    wide = 2 * (width // 2) + 1
    radius, strands = _core.RopeMask(level).measure_strands(0.5 * width)
    assert radius == pytest.approx(0.5 * wide, rel=0.01)
    assert np.abs(np.vstack(strands)[:, 1] - 150.0).max() <= 0.25
    radius, strands = _core.RopeMask(level | slope).measure_strands(0.5 * width)
    assert radius == pytest.approx(0.25 * (wide + width), rel=0.02)
    assert len(strands) == 4


def test_a_disc_has_no_strands():
    rows, columns = np.mgrid[:80, :80]
    assert _core.RopeMask(np.hypot(rows - 40, columns - 40) < 25).measure_strands(8.0) is None
    assert _core.RopeMask(np.zeros((80, 80), dtype=bool)).measure_strands(8.0) is None


def test_a_mask_without_rope_shows_no_radius():
    made = scene("arc", views=1, camera=Camera("zed"), mask=Segmentation())
    (image,) = make_rope_images(made.views, made.views, None)
    with pytest.raises(NotEnoughDataError, match="no rope"):
        estimate_mask_radius(dataclasses.replace(image, labels=np.zeros_like(image.mask)))


@pytest.mark.parametrize("columns", [200, 500, 640])
def test_a_mask_of_most_of_an_image_is_as_wide_as_it_is(columns):
    mask = np.zeros((480, 640), bool)
    mask[:, :columns] = True
    assert _core.RopeMask(mask).estimate_radius() == pytest.approx(min(columns, 480) / 2, rel=0.02)


def test_an_unknown_radius_of_masked_ropes_is_estimated_and_warned_of():
    made = scene("arc", seed=1, views=1, camera=Camera("d435"), mask=Segmentation())
    model = strand.reconstruct(made.views, ropes=1)
    assert model.chains[0].radius == pytest.approx(made.radius, rel=0.2)
    assert model.chains[0].radius_sd > 0.0
    assert "radius" in {warning.kind for warning in model.warnings}


@pytest.mark.parametrize(("shown", "asked"), [(1.0, [1.12]), (0.75, [0.84, 1.12]), (1.4, [1.568, 1.12])])
def test_a_guess_that_is_far_off_is_measured_again(shown, asked):
    widths = []

    def measure_strands(radius_px):
        widths.append(radius_px)
        return 11.2, []

    image = SimpleNamespace(
        distance=0.5,
        camera=SimpleNamespace(focal=(500.0, 500.0)),
        rope_mask=SimpleNamespace(measure_strands=measure_strands),
    )
    radius, _ = mask_radius._measure_area(image, 0.01 * shown)
    assert radius == pytest.approx(0.0112)
    assert widths == pytest.approx(10.0 * np.array(asked))


def test_the_radius_hardly_depends_on_the_first_guess(monkeypatch):
    made = scene("loop", seed=3, radius=0.004, views=1, camera=Camera("d435"), mask=Segmentation())
    (image,) = make_rope_images(made.views, made.views, None)
    found = []
    for guess in (0.9, 1.12, 1.4):
        monkeypatch.setattr(mask_radius, "_OVER_WIDTHS", guess)
        found.append(estimate_mask_radius(image)[0][0])
    assert found == pytest.approx([0.004] * 3, rel=0.1)
    assert found[::2] == pytest.approx([found[1]] * 2, rel=0.02)
