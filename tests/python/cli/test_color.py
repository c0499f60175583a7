"""`strand mask`, and colour images and occluders of single depth images."""

from __future__ import annotations

import json

import numpy as np
import pytest
from PIL import Image

import strand
from lib.bag_files import START, Messages, write_bag
from strand import cli
from strand.synthetic import color_scene

MADE = color_scene("two ropes", 0)
(FX, _, CX), (_, FY, CY), _ = MADE.scene.intrinsics.tolist()
CAMERA = ["--intrinsics", f"{FX},{FY},{CX},{CY}", "--depth-scale", str(MADE.scene.depth_scale)]
MASK = ["color.png", "-o", "mask.png"]
WITH_DEPTH = [*MASK, "--depth", "depth.png"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, with the images of a scene."""
    monkeypatch.chdir(tmp_path)
    Image.fromarray(MADE.scene.depth[0]).save("depth.png")
    Image.fromarray(MADE.color[0]).save("color.png")
    Image.fromarray(MADE.color[0][:100]).save("small.png")
    Image.fromarray(np.full((80, 120, 3), 90, dtype=np.uint8)).save("bare.png")
    Image.fromarray(MADE.color[0]).save("color.tiff")
    Image.fromarray(np.zeros(MADE.scene.depth[0].shape, dtype=np.uint8)).save("robot.png")
    return tmp_path


def run(*arguments):
    return cli.main([str(one) for one in arguments])


def test_mask_writes_the_labels_that_rope_mask_finds(folder, capsys):
    assert run("mask", "color.png", "-o", "mask.png", "--depth", "depth.png", *CAMERA) == 0
    assert capsys.readouterr().out.startswith("mask.png: 2 colours, half width")
    depth = MADE.scene.depth[0] * MADE.scene.depth_scale
    want = strand.rope_mask(MADE.color[0], depth, MADE.scene.intrinsics).labels
    np.testing.assert_array_equal(np.asarray(Image.open("mask.png")), want)
    assert run("reconstruct", "depth.png", *CAMERA, "--mask", "mask.png", "--json") == 0
    model = json.loads(capsys.readouterr().out)
    assert {chain["label"] for chain in model["chains"]} == {1, 2}


def test_mask_seeks_the_colours_that_are_given(folder):
    rgb = np.median(MADE.color[0][MADE.labels[0] == 2], axis=0).astype(int).tolist()
    assert run("mask", "color.png", "-o", "mask.png", "--rope-color", ",".join(map(str, rgb))) == 0
    found = np.asarray(Image.open("mask.png")) > 0
    assert np.count_nonzero(found & (MADE.labels[0] == 2)) > 0.7 * np.count_nonzero(found)


def test_mask_names_the_colours_that_it_does_not_find(folder, capsys):
    color = np.full((120, 160, 3), 180, dtype=np.uint8)
    color[57:62, 20:140] = (30, 30, 220)
    Image.fromarray(color).save("blue.png")
    colors = ["--rope-color", "0,255,0", "--rope-color", "30,30,220"]
    assert run("mask", "blue.png", "-o", "mask.png", *colors) == 0
    out, err = capsys.readouterr()
    assert out.startswith("mask.png: 1 colour, half width")
    assert err == "strand: no rope of --rope-color 0,255,0 (label 1)\n"
    assert np.unique(Image.open("mask.png")).tolist() == [0, 2]


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["color.png", "-o", "mask.jpg"], 2, "--output: expected a .png file"),
        (["color.png", "-o", "color.png"], 2, "another file than the inputs, got color.png"),
        (["bare.png", "-o", "mask.png"], 1, "rope"),
        (["no.png", "-o", "mask.png"], 3, "no.png: No such file"),
        (["depth.png", "-o", "no/mask.png"], 3, "no/mask.png"),
        ([*WITH_DEPTH, *CAMERA[2:]], 2, "intrinsics: expected"),
        ([*MASK, *CAMERA[:2]], 2, "--intrinsics: expected --depth"),
        ([*MASK, *CAMERA[2:]], 2, "--depth-scale: expected --depth"),
        ([*WITH_DEPTH, *CAMERA[:2]], 2, "--depth-scale: depth.png holds"),
        *(
            ([*WITH_DEPTH, *CAMERA[:3], scale], 2, "--depth-scale: expected")
            for scale in ("0", "-1", "nan")
        ),
        (["small.png", "-o", "mask.png", "--depth", "depth.png", *CAMERA], 2, "depth: expected"),
        (["depth.png", "-o", "mask.png"], 1, "depth.png: expected a colour image of 8 bits"),
        (["color.tiff", "-o", "mask.png"], 1, "color.tiff: truncated, or not a colour image (PNG,"),
        ([*MASK, "--rope-color", "300,0,0"], 2, "--rope-color: expected three"),
        ([*MASK, "--ropes", "0"], 2, "ropes: expected"),
    ],
)  # fmt: skip
def test_errors_of_mask_are_one_line_and_leave_no_file(folder, capsys, arguments, code, said):
    try:
        answer = run("mask", *arguments)
    except SystemExit as exit:
        answer = exit.code
    error = capsys.readouterr().err
    assert answer == code
    assert said in error.splitlines()[-1]
    assert " at 0x" not in error
    assert not (folder / "mask.png").exists()


def test_reconstruct_finds_ropes_in_a_colour_image(folder, capsys):
    assert (
        run("reconstruct", "depth.png", *CAMERA, "--color", "color.png", "--occluders", "robot.png", "--json")
        == 0
    )
    model = json.loads(capsys.readouterr().out)
    view = strand.View.from_depth(
        MADE.scene.depth[0], MADE.scene.intrinsics, colors=MADE.color[0], depth_scale=MADE.scene.depth_scale
    )
    want = strand.reconstruct([view])
    assert {chain["label"] for chain in model["chains"]} == {1, 2}
    assert [chain["label"] for chain in model["chains"]] == [chain.label for chain in want.chains]
    for chain, other in zip(model["chains"], want.chains, strict=True):
        np.testing.assert_array_equal(chain["points"], other.points)
        np.testing.assert_array_equal(chain["color"], other.color)


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["--color", "small.png"], 1, "small.png: color: expected the depth image's shape"),
        (["--color", "depth.png"], 1, "depth.png: expected a colour image of 8 bits per channel"),
        (["--color", "no.png"], 3, "no.png: No such file"),
        (["--color", "color.png", "color.png"], 2, "colors: expected one file for each of 1 views, got 2"),
        (["--occluders", "color.png"], 1, "color.png: expected a single-channel mask PNG"),
        (["--occluders", "small.png"], 1, "small.png"),
    ],
)
def test_wrong_colour_images_and_occluders_are_named(folder, capsys, arguments, code, said):
    assert run("reconstruct", "depth.png", *CAMERA, *arguments) == code
    assert said in capsys.readouterr().err.splitlines()[-1]


def test_the_colour_topic_of_a_recording_is_used_unless_it_is_turned_off(folder, capsys):
    made, size = Messages(), MADE.scene.depth[0].shape
    millimeters = np.rint(1e3 * MADE.scene.depth_scale * MADE.scene.depth[0]).astype(np.uint16)
    entries = [
        ("/cam/depth/camera_info", START, made.info(MADE.scene.intrinsics, size, START)),
        ("/cam/depth/image", START, made.image(millimeters, START)),
        ("/cam/rgb/image", START, made.color(MADE.color[0], START)),
    ]
    path = write_bag(folder / "bag", "mcap", entries)
    for more in ([], ["--color-topic", "/cam/rgb/image"]):
        assert run("reconstruct", path, "--json", *more) == 0
        assert {chain["label"] for chain in json.loads(capsys.readouterr().out)["chains"]} == {1, 2}
    run("reconstruct", path, "--json", "--no-color")
    out = capsys.readouterr().out
    assert not out or all(chain["color"] is None for chain in json.loads(out)["chains"])
    for more, said in (
        (["--color-topic", "/no"], "color_topics: "),
        (["--color-topic", "/cam/rgb/image", "--no-color"], "--no-color: expected either"),
        (["--color", "color.png"], "--color: for scenes only"),
    ):
        assert run("reconstruct", path, *more) == 2
        assert said in capsys.readouterr().err.splitlines()[-1]
    assert run("reconstruct", "depth.png", *CAMERA, "--no-color") == 2
    assert "--no-color: for recordings only" in capsys.readouterr().err.splitlines()[-1]
