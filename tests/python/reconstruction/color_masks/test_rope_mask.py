"""Masks of ropes from colour."""

from __future__ import annotations

import time
from contextlib import suppress

import numpy as np
import pytest

import strand
from strand.reconstruction.color_masks.color_pieces import find_pieces
from strand.synthetic import Paint, color_scene, paint_scene


def make_scene(seed=3, **paint):
    """Return a scene with one small image, its colours and its exact mask."""
    camera = strand.synthetic.Camera(size=(320, 240))
    scene = strand.synthetic.scene("loop", seed=seed, views=1, camera=camera)
    color, labels = paint_scene(scene, Paint(**paint), seed=seed)
    return scene, color[0], labels[0] > 0


def measure(found, exact):
    """Return recall and precision of a mask, by pixels."""
    both = np.count_nonzero(found.mask & exact)
    return both / np.count_nonzero(exact), both / max(np.count_nonzero(found.mask), 1)


@pytest.mark.parametrize(
    "paint",
    [
        {},
        {"ropes": (((0.05, 0.05, 0.06),),), "table": (0.6, 0.62, 0.6)},
        {"texture": "wood", "table": (0.6, 0.42, 0.25), "ropes": (((0.1, 0.2, 0.7),),)},
        {"highlight": 0.7, "shadow": 0.6, "softness": 3.0},
        {"ropes": (((0.9, 0.85, 0.2), (0.1, 0.1, 0.6)),), "table": (0.4, 0.42, 0.4)},
    ],
    ids=["red", "black", "wood", "shadow and highlight", "two colours"],
)
def test_a_rope_is_found_on_a_plain_table(paint):
    _, color, exact = make_scene(**paint)
    found = strand.rope_mask(color)
    recall, precision = measure(found, exact)
    assert found
    assert found.why == ""
    assert recall > 0.8
    assert precision > 0.9


def test_labels_are_by_color_and_follow_the_known_colors():
    chains = strand.synthetic.random_ropes(1, 2, 0.0042, 5)
    camera = strand.synthetic.Camera(size=(320, 240))
    scene = strand.synthetic.scene("two", chains=chains, views=1, camera=camera)
    colors = [(0.8, 0.1, 0.1), (0.1, 0.2, 0.8)]
    color, labels = paint_scene(scene, Paint(tuple((one,) for one in colors)), seed=1)
    found = strand.rope_mask(color[0])
    assert set(np.unique(found.labels)) == {0, 1, 2}
    told = strand.rope_mask(color[0], rope_color=np.array(colors[::-1]))
    for number, own in enumerate((2, 1), 1):
        mine = told.labels[(labels[0] == own) & told.mask]
        assert np.mean(mine == number) > 0.9
    clicked = np.zeros(labels[0].shape, dtype=bool)
    clicked[tuple(np.argwhere(labels[0] == 1)[::40].T)] = True
    one = strand.rope_mask(color[0], rope_color=clicked)
    assert one
    assert np.mean(labels[0][one.mask] == 1) > 0.8


def test_clicked_pixels_may_be_whole_numbers():
    image = np.full((120, 160, 3), 180, dtype=np.uint8)
    image[57:62, 20:140] = (147, 22, 40)
    clicks = np.zeros((120, 160), dtype=np.uint8)
    clicks[59, 60:70] = 255
    found, want = (strand.rope_mask(image, rope_color=given) for given in (clicks, clicks > 0))
    assert found
    np.testing.assert_array_equal(found.labels, want.labels)


def test_a_known_color_that_nothing_has_is_named():
    image = np.full((120, 160, 3), 180, dtype=np.uint8)
    image[57:62, 20:140] = (147, 22, 40)
    found = strand.rope_mask(image, rope_color=(0, 200, 0))
    assert found.why == "nothing in the image looks like a rope: no strip has a colour near rope_color"


def test_a_known_color_finds_no_less_than_none():
    paint = {"ropes": (((0.9, 0.85, 0.2), (0.1, 0.1, 0.6)),), "table": (0.4, 0.42, 0.4)}
    _, color, exact = make_scene(**paint)
    for known in ((230, 217, 51), (25, 25, 153)):
        recall, precision = measure(strand.rope_mask(color, rope_color=known), exact)
        assert recall > 0.8
        assert precision > 0.9


def test_ropes_keep_their_width_on_a_table_of_a_near_color_and_beside_dark_shadows():
    for seed, table in ((2, (0.78, 0.62, 0.66)), (3, (0.75, 0.8, 0.85))):
        paint = {"ropes": (((0.75, 0.35, 0.3),),), "table": table, "shadow": 0.65, "softness": 1.0}
        _, color, exact = make_scene(seed=seed, **paint)
        recall, precision = measure(strand.rope_mask(color), exact)
        assert recall > 0.85
        assert precision > 0.9


def test_fingers_that_stand_higher_than_ropes_are_left_out():
    scene = color_scene("gripper", 2)
    depth = scene.scene.depth[0] * scene.scene.depth_scale
    found = strand.rope_mask(scene.color[0], depth, scene.scene.intrinsics)
    assert found
    assert np.mean(scene.labels[0][found.mask] > 0) > 0.9
    assert "high" in found.left_out


def test_a_pattern_is_refused_with_advice_and_an_empty_table_has_no_rope():
    _, color, _ = make_scene(texture="checks")
    found = strand.rope_mask(color)
    assert not found
    assert not found.mask.any()
    assert np.isnan(found.radius_px)
    assert "give a mask or rope_color" in found.why or "nothing" in found.why
    empty = np.full((240, 320, 3), 128, dtype=np.uint8)
    assert "nothing" in strand.rope_mask(empty).why


def test_reconstruct_refuses_a_pattern_that_depth_does_not_resolve():
    with pytest.raises(strand.NoRopeError, match="patterned"):
        strand.reconstruct(color_scene("patterned", 2).views)


def test_a_mask_that_grows_into_the_background_is_refused():
    _, color, exact = make_scene(highlight=0.5)
    v, u = np.mgrid[:240, :320]
    bands = ((u + v // 2) // 20 % 2)[..., None]
    light = color[exact].mean(axis=1, keepdims=True)
    color = np.where(bands, (250, 250, 120), (220, 200, 230)).astype(np.float64)
    color[exact] = np.array([120, 160, 60]) * light / light.mean()
    found = strand.rope_mask(np.clip(color, 0, 255).astype(np.uint8))
    assert not found
    assert not found.mask.any()
    assert "give a mask" in found.why


@pytest.mark.parametrize("seed", [201, 204])
def test_patterns_end_early(seed):
    views = color_scene("patterned", seed).views
    begin = time.process_time()
    with suppress(strand.NoRopeError):
        strand.reconstruct(views)
    # a search among dozens of pieces takes 4 s and more
    assert time.process_time() - begin < 1.5


def test_depth_gives_the_radius_and_the_scatter():
    scene, color, _ = make_scene()
    found = strand.rope_mask(color, scene.depth[0] * scene.depth_scale, scene.intrinsics)
    assert found.radius == pytest.approx(scene.radius, rel=0.25)
    assert 0.0 < found.scatter < 0.002


def test_results_do_not_depend_on_the_number_of_threads():
    _, color, _ = make_scene()
    before = strand.num_threads()
    try:
        answers = []
        for threads in (1, 3):
            strand.set_num_threads(threads)
            answers.append(strand.rope_mask(color).labels)
    finally:
        strand.set_num_threads(before)
    assert np.array_equal(*answers)


def test_pixels_of_wide_pieces_are_those_of_the_whole_image():
    color = np.full((300, 400, 3), 160, dtype=np.uint8)
    color[140:164, 40:360] = (30, 60, 160)
    pieces = find_pieces(strand._core.convert_to_lab(color), None)
    best = max(pieces, key=lambda piece: piece.score)
    mask = best.make_mask((300, 400))
    exact = np.zeros((300, 400), dtype=bool)
    exact[140:164, 40:360] = True
    assert np.count_nonzero(mask & exact) > 0.9 * np.count_nonzero(mask | exact)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"color": np.zeros((40, 40))}, "color: expected"),
        ({"depth": np.ones((50, 60))}, "intrinsics: expected"),
        (
            {"depth": np.ones((50, 60), dtype=np.uint16), "intrinsics": np.eye(3)},
            "depth: .* multiply .* by the metres of a unit",
        ),
        ({"intrinsics": np.eye(3)}, "intrinsics: expected depth along with it"),
        ({"intrinsics": "x"}, "intrinsics: expected"),
        ({"rope_color": np.zeros((2, 2))}, "rope_color: expected"),
        ({"rope_color": np.zeros((50, 60), dtype=np.uint8)}, "rope_color: expected a mask with pixels"),
        ({"ropes": 0}, "ropes: expected"),
    ],
)
def test_wrong_arguments_are_named(arguments, message):
    given = {"color": np.zeros((50, 60, 3), dtype=np.uint8), **arguments}
    with pytest.raises((TypeError, ValueError), match=message):
        strand.rope_mask(**given)


def test_reconstruct_takes_the_mask_from_colors():
    scene = color_scene("plain", 1)
    model = strand.reconstruct(scene.views)
    assert len(model.chains) == len(scene.scene.truth)
    assert all(view.image.colors is not None for view in scene.views)


def test_color_scenes_are_the_same_for_a_seed_and_can_be_empty():
    one, other = color_scene("hand", 2, rope=False), color_scene("hand", 2, rope=False)
    assert np.array_equal(one.color, other.color)
    assert np.array_equal(one.scene.depth, other.scene.depth)
    assert not one.labels.any()
    assert one.scene.truth == ()
