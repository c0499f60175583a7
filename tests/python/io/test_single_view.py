"""Tests of single files as scenes of one view."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from PIL import Image

import strand
from lib.whole_files import make_pcd
from shared.scene_files import (
    DEPTH,
    LABELS,
    POINTS,
    K,
    make_grid_cloud,
    make_grid_depth,
    make_ply,
    save_npz,
    save_png,
    write_scene,
)
from strand import FileFormatError, View, load_scene

CAMERA = [0.1, -0.2, 0.25]
# pixels of the grid in tests/data/clouds
GRID = [[100.0, 0, 6], [0, 100.0, 5], [0, 0, 1]]
COLORS = np.random.default_rng(5).integers(0, 256, POINTS.shape).astype(np.uint8)


@pytest.fixture
def clouds(tmp_path):
    """Write the same points to files of every kind."""
    text = "".join(f"{x!r} {y!r} {z!r}\n" for x, y, z in POINTS.tolist())
    for suffix in ("xyz", "txt"):
        (tmp_path / f"a.{suffix}").write_text(text)
    (tmp_path / "a.csv").write_text("x,y,z\n" + text.replace(" ", ","))
    (tmp_path / "a.ply").write_bytes(make_ply())
    (tmp_path / "a.pcd").write_bytes(make_pcd("binary", POINTS))
    np.save(tmp_path / "a.npy", POINTS)
    return tmp_path


@pytest.mark.parametrize("suffix", ["xyz", "txt", "csv", "ply", "pcd", "npy"])
def test_points_in_both_frames(clouds, suffix):
    path = clouds / f"a.{suffix}"
    scene = load_scene(path, viewpoint=CAMERA)
    assert (scene.name, scene.bounds, scene.radius, scene.files) == ("a", None, None, (path,))
    (view,) = scene.views
    expected = View.from_world(POINTS, CAMERA)
    np.testing.assert_array_equal(view.points, expected.points)
    np.testing.assert_array_equal(view.pose, expected.pose)
    assert view.colors is None
    (view,) = load_scene(str(path), camera_frame=True).views
    np.testing.assert_array_equal(view.points, POINTS)
    np.testing.assert_array_equal(view.pose, np.eye(4))


@pytest.mark.parametrize("suffix", ["xyz", "txt", "csv", "ply", "pcd", "npy"])
def test_points_need_a_viewpoint_or_the_camera_frame(clouds, suffix):
    with pytest.raises(
        ValueError, match=r"viewpoint: .*does not say where the camera was.*--viewpoint x,y,z.*--camera-frame"
    ):
        load_scene(clouds / f"a.{suffix}")


def test_the_viewpoint_of_a_file(data):
    points, colors = make_grid_cloud()
    seen = np.isfinite(points).all(axis=1)
    path = data / "clouds" / "pcl_compressed.pcd"
    (view,) = load_scene(path).views
    np.testing.assert_allclose(view.viewpoint, CAMERA)
    np.testing.assert_allclose(view.world_points, points[seen], atol=1e-8)
    np.testing.assert_array_equal(view.colors, colors[seen] / 255)
    assert view.dropped == 24
    # the caller's viewpoint replaces the file's
    (view,) = load_scene(path, viewpoint=[0, 0, 0]).views
    np.testing.assert_array_equal(view.pose, np.eye(4))
    (view,) = load_scene(path, camera_frame=True).views
    np.testing.assert_array_equal(view.pose, np.eye(4))


def test_points_at_the_camera_have_no_return(tmp_path):
    points = np.vstack([POINTS, np.zeros((3, 3)), np.full((2, 3), np.nan)])
    np.save(tmp_path / "a.npy", np.hstack([points, np.tile([0.1, 0.2, 0.3], (45, 1))]))
    (view,) = load_scene(tmp_path / "a.npy", camera_frame=True).views
    np.testing.assert_array_equal(view.points, POINTS)
    np.testing.assert_array_equal(view.colors, np.tile([0.1, 0.2, 0.3], (40, 1)))
    assert view.dropped == 2
    (view,) = load_scene(tmp_path / "a.npy", viewpoint=(1, 2, 3)).views
    assert len(view.points) == 43


@pytest.mark.parametrize("kind", ["uchar", "float", "ushort"])
def test_colours_of_ply_files_reach_the_view_in_scenes_too(tmp_path, kind):
    numbers = COLORS / 255 if kind == "float" else COLORS
    row = np.dtype([("xyz", "<f8", 3), ("rgb", {"uchar": "u1", "float": "<f4", "ushort": "<u2"}[kind], 3)])
    table = np.zeros(len(POINTS), row)
    table["xyz"], table["rgb"] = POINTS, numbers
    properties = "".join(f"property {kind} {name}\n" for name in ("red", "green", "blue"))
    head = make_ply("binary_little_endian", more=properties).split(b"end_header\n")[0]
    (tmp_path / "a.ply").write_bytes(head + b"end_header\n" + table.tobytes())
    for scene in (
        load_scene(tmp_path / "a.ply", viewpoint=CAMERA),
        load_scene(write_scene(tmp_path, "a.ply")),
    ):
        np.testing.assert_allclose(scene.views[0].colors, COLORS / 255, atol=1e-7)
    table["rgb"][7, 1] = 300 if kind == "ushort" else 1
    if kind == "ushort":
        (tmp_path / "a.ply").write_bytes(head + b"end_header\n" + table.tobytes())
        with pytest.raises(FileFormatError, match=r"a\.ply: colours: .* from 0 to 255, got 0 to 300"):
            load_scene(tmp_path / "a.ply", viewpoint=CAMERA)


def test_colours_separate_the_ropes_of_a_single_file(tmp_path):
    """`reconstruct` gets the colours of the file."""
    made = strand.synthetic.scene("s", seed=1, views=1)
    (given,) = [view.crop(made.bounds) for view in made.views]
    shades = np.tile([0.2, 0.4, 0.9], (len(given.points), 1))
    np.save(tmp_path / "a.npy", np.hstack([given.points, shades]))
    (view,) = load_scene(tmp_path / "a.npy", camera_frame=True).views
    np.testing.assert_array_equal(view.colors, shades)
    expected = strand.reconstruct([View(given.points, colors=shades)], made.radius)
    found = strand.reconstruct([view], made.radius)
    np.testing.assert_array_equal(found.chains[0].points, expected.chains[0].points)


@pytest.mark.parametrize("name", ["opencv.png", "opencv_16bit.tiff", "opencv_float.tiff"])
def test_depth_images_from_opencv(data, name):
    scale = None if "float" in name else 1e-4
    (view,) = load_scene(data / "clouds" / name, intrinsics=GRID, depth_scale=scale).views
    assert view.image.depth.shape == (10, 12)
    np.testing.assert_allclose(view.image.depth, make_grid_depth(), atol=5.1e-5)
    np.testing.assert_array_equal(view.pose, np.eye(4))


@pytest.mark.parametrize("suffix", ["png", "tiff", "tif", "npy"])
def test_whole_numbers_of_depth_need_a_scale(tmp_path, suffix):
    save_png(tmp_path / "a.png")
    Image.fromarray(DEPTH).save(tmp_path / "a.tiff")
    shutil.copy(tmp_path / "a.tiff", tmp_path / "a.tif")
    np.save(tmp_path / "a.npy", DEPTH)
    path = tmp_path / f"a.{suffix}"
    with pytest.raises(
        ValueError, match=r"intrinsics: .* needs the camera's pinhole matrix.*--intrinsics fx"
    ):
        load_scene(path, depth_scale=0.001)
    with pytest.raises(ValueError, match=r"depth_scale: .*--depth-scale\), 0\.001 for millimetres"):
        load_scene(path, intrinsics=K)
    save_png(tmp_path / "m.png", LABELS)
    scene = load_scene(path, [tmp_path / "m.png"], intrinsics=K, depth_scale=0.001)
    np.testing.assert_allclose(scene.views[0].image.depth, DEPTH * 0.001)
    np.testing.assert_array_equal(scene.views[0].mask, LABELS > 0)
    assert scene.files == (path, tmp_path / "m.png")


def test_floats_of_depth_are_metres_or_in_units(tmp_path):
    for save in (
        lambda depth: np.save(tmp_path / "a.npy", depth),
        lambda depth: Image.fromarray(depth).save(tmp_path / "a.tiff"),
    ):
        save((DEPTH * 0.001).astype(np.float32))
    for name in ("a.npy", "a.tiff"):
        (view,) = load_scene(tmp_path / name, intrinsics=K).views
        np.testing.assert_allclose(view.image.depth, DEPTH * 0.001, rtol=1e-6)
        (view,) = load_scene(tmp_path / name, intrinsics=K, depth_scale=0.5).views
        np.testing.assert_allclose(view.image.depth, DEPTH * 0.0005, rtol=1e-6)


def test_unsuitable_arguments_are_refused(clouds):
    save_png(clouds / "d.png")
    camera = {"intrinsics": K, "depth_scale": 0.001}
    for path, given, reason in (
        ("a.ply", {"intrinsics": K, "camera_frame": True}, "intrinsics: .* holds points, not a depth image"),
        ("a.ply", {"depth_scale": 1.0, "camera_frame": True}, "depth_scale: .* holds points"),
        ("a.ply", {"masks": ["m.png"], "camera_frame": True}, "masks: .* only depth images have masks"),
        ("a.ply", {"viewpoint": CAMERA, "camera_frame": True}, "viewpoint: expected either .* got both"),
        ("a.ply", {"viewpoint": [0.0, 1.0]}, "viewpoint: expected shape"),
        ("a.ply", {"viewpoint": [0.0, 1.0, np.nan]}, "viewpoint: expected finite"),
        ("d.png", {"viewpoint": CAMERA, **camera}, "viewpoint: .* always in its camera's frame"),
        ("d.png", {"camera_frame": True, **camera}, "camera_frame: .* always in its camera's frame"),
        ("d.png", {"masks": [], **camera}, "masks: expected one file for each of 1 views, got 0"),
        ("d.png", {"intrinsics": np.eye(3) * 2, "depth_scale": 0.001}, "intrinsics: expected"),
        ("d.png", {"intrinsics": K, "depth_scale": 0.0}, "depth_scale: expected a positive number"),
    ):
        with pytest.raises(ValueError, match=reason) as caught:
            load_scene(clouds / path, **given)
        assert not isinstance(caught.value, FileFormatError)
    for given in ({"camera_frame": 1}, {"viewpoint": "000"}, {"intrinsics": "K"}, {"depth_scale": "mm"}):
        with pytest.raises(TypeError, match=next(iter(given))):
            load_scene(clouds / "a.ply", **given)


def test_scenes_take_no_facts_about_the_camera(tmp_path):
    save_npz(tmp_path / "a.npz")
    save_png(tmp_path / "a.png")
    write_scene(tmp_path, "a.png")
    for path in (tmp_path / "a.npz", tmp_path, tmp_path / "scene.toml"):
        for given in (
            {"viewpoint": CAMERA},
            {"camera_frame": True},
            {"intrinsics": K},
            {"depth_scale": 0.001},
        ):
            with pytest.raises(ValueError, match=f"{next(iter(given))}: accepted only for a single file"):
                load_scene(path, **given)


def test_errors_in_numbers_name_the_file(tmp_path):
    np.save(tmp_path / "a.npy", -np.ones((6, 8)))
    with pytest.raises(FileFormatError, match=r"a\.npy: depth"):
        load_scene(tmp_path / "a.npy", intrinsics=K)
    np.save(tmp_path / "a.npy", -np.ones((6, 6)))
    with pytest.raises(FileFormatError, match=r"a\.npy: colours: .* got -1\.0 to -1\.0"):
        load_scene(tmp_path / "a.npy", camera_frame=True)


@pytest.mark.parametrize("suffix", ["png", "tiff", "npy", "ply", "pcd", "xyz", "csv"])
def test_missing_empty_and_foreign_files(tmp_path, suffix):
    path = tmp_path / f"a.{suffix}"
    given = {"intrinsics": K} if suffix in ("png", "tiff") else {"camera_frame": True}
    with pytest.raises(FileNotFoundError):
        load_scene(path, **given)
    path.write_bytes(b"")
    with pytest.raises(FileFormatError, match="the file is empty"):
        load_scene(path, **given)
    path.write_bytes(b"solid cube\n" * 30)
    with pytest.raises(FileFormatError) as caught:
        load_scene(path, **given)
    assert caught.value.file == str(path)
