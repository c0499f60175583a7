"""Scenes as cameras and segmenters give them."""

import numpy as np
import pytest

from strand.synthetic import FRAMES, Camera, Noise, Segmentation, frame_scene, scene


def find_mask_area(made):
    return int(made.mask.sum())


@pytest.mark.parametrize("kind", FRAMES)
def test_a_frame_is_the_same_each_time_and_shows_its_ropes(kind):
    made, again = frame_scene(kind, 3), frame_scene(kind, 3)
    np.testing.assert_array_equal(made.depth, again.depth)
    np.testing.assert_array_equal(made.mask, again.mask)
    assert len(made.radii) == len(made.truth)
    motion = np.linalg.inv(made.poses_true[0])
    for nodes in made.truth:
        seen = nodes @ motion[:3, :3].T + motion[:3, 3]
        places = np.rint((seen @ made.intrinsics.T)[:, :2] / seen[:, 2:]).astype(int)
        assert ((places >= 0) & (places < (640, 480))).all()
        # thin ropes are about as wide as an error of the mask
        assert made.mask[0][places[:, 1], places[:, 0]].mean() > 0.85


@pytest.mark.parametrize("kind", ["thin", "coarse"])
def test_thin_ropes_are_a_few_pixels_wide(kind):
    for seed in range(5):
        made = frame_scene(kind, seed)
        distance = np.linalg.norm(made.poses_true[0][:3, 3])
        assert made.radius * made.intrinsics[0, 0] / distance < 2.51


def test_a_coarse_camera_has_steps_deeper_than_the_rope():
    made = frame_scene("coarse", 1)
    around = made.depth[0][made.mask[0]] * made.depth_scale
    steps = np.diff(np.unique(around))
    assert np.median(steps) > 2.0 * made.radius


def test_ropes_of_two_radii_cross_and_those_that_touch_do_not():
    mixed, touch = frame_scene("mixed", 2), frame_scene("touch", 2)
    assert 1.25 <= mixed.radii[1] / mixed.radii[0] <= 1.9
    assert mixed.radius == pytest.approx(np.mean(mixed.radii))
    first, second = touch.truth
    gaps = np.linalg.norm(first[:, None] - second[None], axis=2).min(axis=1)
    assert 1.9 < gaps.min() / touch.radius < 2.3
    assert (gaps[[0, -1]] > 4.0 * touch.radius).all()


def test_a_radius_of_each_chain_is_drawn():
    y = np.linspace(-0.05, 0.05, 60)
    thin, thick = (np.column_stack([np.full(60, x), y, np.full(60, 0.004)]) for x in (-0.02, 0.02))
    made = scene(
        chains=[thin, thick], radius=(0.002, 0.004), views=1, noise=Noise(0.0, 0.0), mask=Segmentation()
    )
    # the camera stands on the thick rope's side
    far, near = made.mask[0][:120].sum(), made.mask[0][120:].sum()
    assert near / far == pytest.approx(2.1, rel=0.2)
    with pytest.raises(ValueError, match="radius"):
        scene(chains=[thin], radius=(0.002, 0.004), views=1)
    with pytest.raises(ValueError, match="radius"):
        scene("arc", radius=(0.002,), views=1)


def test_filled_corners_are_added_to_the_mask_and_nothing_is_lost():
    exact = scene("figure8", views=1, camera=Camera(size=(320, 240)), mask=Segmentation())
    filled = scene("figure8", views=1, camera=Camera(size=(320, 240)), mask=Segmentation(filled=4.0))
    assert (filled.mask | exact.mask == filled.mask).all()
    assert find_mask_area(exact) < find_mask_area(filled) < 1.2 * find_mask_area(exact)


def test_wrong_arguments_are_refused():
    with pytest.raises(ValueError, match="kind"):
        frame_scene("thinner")
    with pytest.raises(ValueError, match="seed"):
        frame_scene("thin", -1)
    with pytest.raises(ValueError, match="filled"):
        Segmentation(filled=-1.0)
