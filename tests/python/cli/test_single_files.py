"""The command line on single files of points and depth, and the files that it writes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import open3d as o3d
import pytest
from PIL import Image

import strand
from strand import cli

MADE = strand.synthetic.scene("s", seed=1, views=1)
CAMERA = ",".join(map(repr, MADE.poses[0][:3, 3].tolist()))
(FX, _, CX), (_, FY, CY), _ = MADE.intrinsics.tolist()
INTRINSICS = f"{FX},{FY},{CX},{CY}"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, with a scene's points in the world frame and its depth image."""
    monkeypatch.chdir(tmp_path)
    (view,) = MADE.views
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(view.crop(MADE.bounds).world_points))
    assert o3d.io.write_point_cloud("cloud.pcd", cloud, compressed=True)
    assert o3d.io.write_point_cloud("cloud.ply", cloud)
    Image.fromarray(MADE.depth[0]).save("depth.png")
    np.savetxt("k.txt", MADE.intrinsics)
    return tmp_path


def run(*arguments):
    return cli.main(["reconstruct", *map(str, arguments)])


def test_a_cloud_becomes_a_model_in_every_format(folder, capsys, measure):
    for out in ("a.json", "a.csv", "a.ply"):
        code = run("cloud.pcd", "--viewpoint", CAMERA, "-o", out, "--tube", "tube.ply", "--radius", "4.2mm")
        assert code == 0
        assert capsys.readouterr().out.splitlines()[-2:] == [out, "tube.ply"]
    model = strand.load_model("a.json")
    assert measure(model, MADE.truth, MADE.radius).right
    table = np.loadtxt("a.csv", delimiter=",", skiprows=1)
    np.testing.assert_array_equal(table[:, 3:6], model.chains[0].points)
    lines = o3d.io.read_line_set("a.ply")
    np.testing.assert_array_equal(np.asarray(lines.points), model.chains[0].points)
    mesh = o3d.io.read_triangle_mesh("tube.ply")
    chain = model.chains[0]
    assert mesh.is_watertight()
    assert mesh.get_volume() == pytest.approx(np.pi * chain.radius**2 * chain.length, rel=0.04)


@pytest.fixture
def given(monkeypatch):
    """The views that reach `strand.reconstruct`, which is replaced."""
    views = []

    def reconstruct(seen, **_):
        views.extend(seen)
        return strand.Model((), np.eye(4)[None])

    monkeypatch.setattr(strand, "reconstruct", reconstruct)
    return views


@pytest.mark.parametrize("intrinsics", [INTRINSICS, "k.txt"])
def test_a_depth_image_is_a_view_with_its_camera(folder, given, intrinsics):
    scale = ["--depth-scale", MADE.depth_scale]
    np.save("mask.npy", MADE.depth[0] % 2 == 0)
    assert run("depth.png", "-o", "a.json", "--intrinsics", intrinsics, *scale, "--mask", "mask.npy") == 0
    (view,) = given
    expected = MADE.views[0].image
    np.testing.assert_array_equal(view.image.depth, expected.depth)
    assert view.image.camera == expected.camera
    np.testing.assert_array_equal(view.mask, MADE.depth[0] % 2 == 0)


def test_positions_may_be_negative_and_have_units(folder, given):
    assert run("cloud.ply", "-o", "a.json", "--viewpoint", "-100mm,-.2,30cm") == 0
    np.testing.assert_array_equal(given[0].viewpoint, [-0.1, -0.2, 0.3])
    assert run("cloud.ply", "-o", "a.json", "--camera-frame") == 0
    np.testing.assert_array_equal(given[1].pose, np.eye(4))


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["cloud.pcd", "-o", "a.json"], 2, "viewpoint: cloud.pcd does not say where the camera was"),
        (["depth.png", "-o", "a.json"], 2, "intrinsics: depth.png is a depth image"),
        (["depth.png", "-o", "a.json", "--intrinsics", INTRINSICS], 2, "depth_scale: depth.png holds whole"),
        (["depth.png", "-o", "a.json", "--intrinsics", "no.txt"], 3, "no.txt: No such file"),
        (
            ["depth.png", "-o", "a.json", "--intrinsics", "depth.png"],
            1,
            "depth.png: larger than the 65536",
        ),
        (["cloud.pcd", "-o", "a.json", "--intrinsics", INTRINSICS], 2, "intrinsics: cloud.pcd holds points"),
        (
            ["cloud.pcd", "cloud.ply", "-o", "a.json"],
            2,
            "SCENE: expected one, got 2; for files of several views",
        ),
        (
            ["cloud.pcd", "--viewpoint", "0,0,1", "-o", "a.obj"],
            2,
            "a.obj: expected a name that ends with .json",
        ),
        (
            ["cloud.pcd", "--viewpoint", "0,0,1", "-o", "cloud.ply", "--tube", "cloud.pcd"],
            2,
            "expected another file than the inputs",
        ),
        (
            ["cloud.pcd", "--viewpoint", "0,0,1", "-o", "a.ply", "--tube", "./a.ply"],
            2,
            "--out, --tube, --report: expected different files, got one of them twice",
        ),
        (
            ["cloud.pcd", "--viewpoint", "0,0,1", "-o", "a.ply", "--tube", "a.stl"],
            2,
            "a.stl: expected a name that ends with .ply",
        ),
        (["cloud.pcd", "--viewpoint", "0,0,1", "-o", "a.ply", "--tube", "no/a.ply"], 3, "no/a.ply: No such"),
        (["depth.png", "-o", "k.txt", "--intrinsics", "k.txt", "--depth-scale", "1"], 2, "inputs, got k.txt"),
    ],
)
def test_errors_are_one_line(folder, given, capsys, arguments, code, said):
    assert run(*arguments) == code
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("strand: error: ")
    assert said in line
    assert not given
    assert not list(Path().glob("a.*"))


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("--viewpoint", "0,0", "expected x,y,z, got '0,0'"),
        ("--viewpoint", "0,0,up", "expected metres, or a number with mm, cm or m, got 'up'"),
        ("--intrinsics", "1,2,3", "expected fx,fy,cx,cy with commas and no spaces, or a file, got '1,2,3'"),
        ("--depth-scale", "mm", "invalid float value: 'mm'"),
    ],
)
def test_wrong_values_are_refused_by_their_option(folder, capsys, option, value, said):
    with pytest.raises(SystemExit) as caught:
        run("cloud.pcd", "-o", "a.json", option, value)
    assert caught.value.code == 2
    assert said in capsys.readouterr().err
