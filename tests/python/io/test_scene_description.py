"""Tests of the content of scene.toml."""

from __future__ import annotations

import numpy as np
import pytest

from shared.scene_files import CAMERA, DEPTH, IDENTITY, POINTS, K, make_ply, save_png, write_scene
from strand import FileFormatError, View, load_scene, pose_from_angles, turntable_pose
from strand.io.scene_description import parse_length


@pytest.mark.parametrize(
    ("text", "metres"),
    [
        ("4.2mm", 0.0042),
        ("4.2 mm", 0.0042),
        ("0.42cm", 0.0042),
        (" .0042 m ", 0.0042),
        ("0.0042", 0.0042),
        ("4.2e-3", 0.0042),
        ("-3mm", -0.003),
        ("1.mm", 0.001),
        (0.0042, 0.0042),
        (1e-7, 1e-7),
        (2, 2.0),
    ],
)
def test_parse_length(text, metres):
    assert parse_length(text) == metres


@pytest.mark.parametrize(
    "text",
    ["", "mm", "4.2 in", "4,2mm", "nan", "inf", "1e999", "1e99999999", "4.2mm 3", float("nan"), float("inf")],
)
def test_parse_length_refuses(text):
    with pytest.raises(ValueError, match="length: expected"):
        parse_length(text)


@pytest.mark.parametrize("value", [None, True, [0.1], b"4mm"])
def test_parse_length_refuses_other_things(value):
    with pytest.raises(TypeError, match="length: expected"):
        parse_length(value)


def test_description_in_full(tmp_path):
    save_png(tmp_path / "a.png")
    (tmp_path / "b.ply").write_bytes(make_ply())
    np.save(tmp_path / "c.npy", POINTS)
    (tmp_path / "scene.toml").write_text(
        'name = "knot"\nradius = "4.2mm"\n'
        + CAMERA
        + "[extract]\nlow = [-1, -2.5, -inf]\nhigh = [1, 2, inf]\n"
        + "[turntable]\nangles_deg = [-140, 0, 90]\norigin = [0.4, 0, 0.45]\n"
        + "center = [0, 0.1, 0]\naxis = [0, 0, 2]\n"
        + f'[[view]]\nfile = "a.png"\nstamp = 1\n{IDENTITY}'
        + '[[view]]\nfile = "b.ply"\nstamp = 12.5\nangles_deg = [10, 20.5, -30]\norigin = [1, 2, 3]\n'
        + '[[view]]\nfile = "c.npy"\nturntable_deg = 30\nstamp = -2\n'
    )
    for path in (tmp_path, tmp_path / "scene.toml"):
        scene = load_scene(path)
        assert (scene.name, scene.radius, scene.truth) == ("knot", 0.0042, ())
        np.testing.assert_array_equal(scene.bounds, [[-1, -2.5, -np.inf], [1, 2, np.inf]])
        image, cloud, turned = scene.views
        assert [view.stamp for view in scene.views] == [1.0, 12.5, -2.0]
        np.testing.assert_array_equal(image.points, View.from_depth(DEPTH * 0.001, K).points)
        np.testing.assert_array_equal(cloud.points, POINTS)
        pose = pose_from_angles(*np.radians([10, 20.5, -30]), np.array([1.0, 2, 3]))
        np.testing.assert_allclose(cloud.pose, pose, atol=1e-15)
        camera = pose_from_angles(*np.radians([-140.0, 0, 90]), np.array([0.4, 0, 0.45]))
        pose = turntable_pose(camera, np.radians(30), (0.0, 0.1, 0.0), (0.0, 0.0, 1.0))
        np.testing.assert_allclose(turned.pose, pose, atol=1e-15)


def test_description_with_required_keys_only(tmp_path):
    np.save(tmp_path / "a.npy", POINTS)
    scene = load_scene(write_scene(tmp_path, "a.npy", head=""))
    assert (scene.name, scene.bounds, scene.radius) == (tmp_path.name, None, None)
    scene = load_scene(write_scene(tmp_path, "a.npy", head="radius = 0.005"))
    assert scene.radius == 0.005


def test_turntable_may_give_its_pose_as_a_matrix(tmp_path):
    np.save(tmp_path / "a.npy", POINTS)
    scene = load_scene(write_scene(tmp_path, "a.npy", f"[turntable]\n{IDENTITY}", "turntable_deg = 90"))
    np.testing.assert_allclose(scene.views[0].pose, turntable_pose(np.eye(4), np.pi / 2))


@pytest.mark.parametrize(
    ("head", "view", "message"),
    [
        ("radios = 1", IDENTITY, "scene: unknown key radios; accepted are name, radius, camera"),
        (
            CAMERA + "width = 8",
            IDENTITY,
            "camera: unknown key width; accepted are fx, fy, cx, cy, depth_scale",
        ),
        ("[camera]\nfx = 1\nfy = 1\ncy = 1", IDENTITY, "camera: missing key cx"),
        ("[camera]\nfx = 0\nfy = 1\ncx = 1\ncy = 1", IDENTITY, "camera: expected fx, fy > 0"),
        ("[camera]\nfx = 'a'\nfy = 1\ncx = 1\ncy = 1", IDENTITY, r"camera\.fx: expected a finite number"),
        ("[camera]\nfx = true\nfy = 1\ncx = 1\ncy = 1", IDENTITY, r"camera\.fx: expected a finite number"),
        (CAMERA.replace("0.001", "-0.001"), IDENTITY, r"camera\.depth_scale: expected metres per unit > 0"),
        ("camera = 3", IDENTITY, "camera: expected a table"),
        ("[extract]\nlow = [0, 0, 0]", IDENTITY, "extract: missing key high"),
        ("[extract]\nlow = [0, 0, 0]\nhigh = [1, 1, 0]", IDENTITY, "bounds: expected low < high"),
        ("[extract]\nlow = [0, 0]\nhigh = [1, 1]", IDENTITY, r"expected shape \(3,\)"),
        ("[extract]\nlow = 'a'\nhigh = [1, 1, 1]", IDENTITY, r"extract\.low: expected a list of numbers"),
        ("radius = 0", IDENTITY, "radius: expected a positive length"),
        ("radius = '4 inch'", IDENTITY, "length: expected metres"),
        ("radius = [1]", IDENTITY, "length: expected a number of metres"),
        ("", "", "view 0: expected either pose.*none of them"),
        ("", "angles_deg = [1, 2, 3]", "view 0: expected either pose.*angles_deg"),
        ("", IDENTITY + "origin = [1, 2, 3]", "view 0: expected either pose.*origin, pose"),
        ("", IDENTITY + "turntable_deg = 3", "view 0: expected one pose"),
        ("", "turntable_deg = 3", r"view 0: turntable_deg needs a \[turntable\] table"),
        ("[turntable]\ncenter = [0, 0, 0]", "turntable_deg = 3", "turntable: expected either pose"),
        ("[turntable]\ncentre = [0, 0, 0]", "turntable_deg = 3", "turntable: unknown key centre; .*center"),
        (f"[turntable]\naxis = [0, 0, 0]\n{IDENTITY}", "turntable_deg = 3", "axis: expected a direction"),
        ("", "angles_deg = [1, 2]\norigin = [1, 2, 3]", r"view 0\.angles_deg: expected three angles"),
        ("", "angles_deg = [1, 2, 3]\norigin = [1, 2]", "origin: expected shape"),
        ("", "pose = [[1, 0], [0]]", r"view 0\.pose: expected a list of numbers"),
        ("", IDENTITY.replace("[1,", "[2,"), r"view 0\.pose: expected a rigid motion"),
        ("", IDENTITY + "poes = 3", "view 0: unknown key poes"),
        ("", IDENTITY + "stamp = 1e18", r"view 0\.stamp: expected seconds, got 1e\+18, as large as nanosec"),
        ("", IDENTITY + "stamp = nan", r"view 0\.stamp: expected a finite number"),
        ("", IDENTITY + "stamp = '12 s'", r"view 0\.stamp: expected a number, got str"),
    ],
)
def test_description_with_wrong_content(tmp_path, head, view, message):
    np.save(tmp_path / "a.npy", POINTS)
    with pytest.raises(FileFormatError, match=rf"(?s)scene\.toml: .*{message}"):
        load_scene(write_scene(tmp_path, "a.npy", head, view))


@pytest.mark.parametrize(
    "text", ["", "name = 'a'", "view = 3", "view = []", "[[view]]\npose = 3", "[[view]]\nfile = 3"]
)
def test_description_without_views(tmp_path, text):
    (tmp_path / "scene.toml").write_text(text)
    with pytest.raises(FileFormatError, match=r"scene\.toml: view"):
        load_scene(tmp_path)


@pytest.mark.parametrize("data", [b"[camera\nfx", b'name = "a', b"name = \xff"])
def test_toml_truncated_or_damaged(tmp_path, data):
    (tmp_path / "scene.toml").write_bytes(data)
    with pytest.raises(FileFormatError, match=r"scene\.toml: truncated, or not TOML"):
        load_scene(tmp_path)
