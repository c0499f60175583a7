"""Occluders and colour images of scenes and of single depth images."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

import strand
from shared.scene_files import DEPTH, IDENTITY, K, save_npz, save_png, write_scene
from strand.io.scenes import load_scene

OCCLUDERS = np.arange(DEPTH.size).reshape(DEPTH.shape) % 3 == 0
CAMERA = {"intrinsics": K, "depth_scale": 0.001}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, with a depth image, a colour image and two files of occluders."""
    monkeypatch.chdir(tmp_path)
    save_png(tmp_path / "depth.png")
    Image.fromarray(np.full((*DEPTH.shape, 3), 70, dtype=np.uint8)).save("color.png")
    Image.fromarray(np.where(OCCLUDERS, 255, 0).astype(np.uint8)).save("robot.png")
    np.save("robot.npy", OCCLUDERS)
    return tmp_path


@pytest.mark.parametrize("name", ["robot.png", "robot.npy"])
def test_a_single_depth_image_takes_colours_and_occluders(folder, name):
    (view,) = load_scene("depth.png", colors=["color.png"], occluders=[name], **CAMERA).views
    np.testing.assert_array_equal(view.image.occluders, OCCLUDERS)
    np.testing.assert_array_equal(view.image.colors, 70)
    assert len(view.points) == len(view.colors) == np.count_nonzero(~OCCLUDERS & (DEPTH > 0))


def test_a_description_names_occluders_which_arguments_replace(folder):
    write_scene(folder, "depth.png", pose=IDENTITY + 'occluders = "robot.png"\ncolor = "color.png"\n')
    (view,) = load_scene(folder).views
    np.testing.assert_array_equal(view.image.occluders, OCCLUDERS)
    np.save("other.npy", ~OCCLUDERS)
    scene = load_scene(folder, occluders=["other.npy"])
    np.testing.assert_array_equal(scene.views[0].image.occluders, ~OCCLUDERS)
    assert [path.name for path in scene.files] == ["scene.toml", "depth.png", "color.png", "other.npy"]


def test_an_archive_has_occluders_which_arguments_replace(folder):
    save_npz(folder / "a.npz", occluders=np.stack([OCCLUDERS, ~OCCLUDERS]))
    for view, want in zip(load_scene("a.npz").views, (OCCLUDERS, ~OCCLUDERS), strict=True):
        np.testing.assert_array_equal(view.image.occluders, want)
    scene = load_scene("a.npz", colors=["color.png"] * 2, occluders=["robot.npy"] * 2)
    for view in scene.views:
        np.testing.assert_array_equal(view.image.occluders, OCCLUDERS)
        np.testing.assert_array_equal(view.image.colors, 70)


def test_every_number_but_0_is_an_occluder(folder):
    save_npz(folder / "a.npz", occluders=255 * np.stack([OCCLUDERS] * 2).astype(np.uint8))
    np.save("signed.npy", -OCCLUDERS.astype(int))
    for given in ({}, {"occluders": ["signed.npy"] * 2}):
        for view in load_scene("a.npz", **given).views:
            np.testing.assert_array_equal(view.image.occluders, OCCLUDERS)


def test_files_of_wrong_sizes_kinds_and_numbers_are_refused(folder):
    Image.fromarray(np.zeros((2, 2, 3), dtype=np.uint8)).save("small.png")
    np.save("small.npy", np.zeros((2, 2), dtype=bool))
    np.save("float.npy", np.zeros(DEPTH.shape))
    for given, reason in (
        ({"colors": ["small.png"]}, r"small\.png: color: expected the depth image's shape .* got \(2, 2\)"),
        ({"colors": ["robot.npy"]}, r"robot\.npy: truncated, or not a colour image"),
        ({"occluders": ["small.npy"]}, r"small\.npy: occluders: expected the depth image's shape"),
        ({"occluders": ["float.npy"]}, r"float\.npy: occluders: expected bools"),
        ({"occluders": []}, "occluders: expected one file for each of 1 views, got 0"),
        ({"colors": ["color.png"] * 2}, "colors: expected one file for each of 1 views, got 2"),
    ):
        with pytest.raises(ValueError, match=reason):
            load_scene("depth.png", **given, **CAMERA)
    save_npz(folder / "a.npz", occluders=np.zeros((2, *DEPTH.shape)))
    with pytest.raises(strand.FileFormatError, match=r"a\.npz: occluders: expected .* of bools or whole"):
        load_scene("a.npz")
    np.savetxt("a.csv", np.ones((3, 3)), delimiter=",")
    for name in ("colors", "occluders"):
        with pytest.raises(ValueError, match=f"{name}: .* only depth images have"):
            load_scene("a.csv", camera_frame=True, **{name: ["robot.png"]})
