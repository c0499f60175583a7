"""Tests of the contents of files of each kind."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from shared.scene_files import DEPTH, LABELS, POINTS, make_ply, save_npz, save_png, write_scene
from strand.io.file_contents import read_contents
from strand.support.files import FileFormatError

MOST = 1 << 24


def read_held(path, *topics, **limits):
    return read_contents(path, topics or None, **{"max_bytes": MOST} | limits)


def test_an_archive(tmp_path):
    depth = np.stack([DEPTH, np.where(DEPTH > 500, DEPTH, 0)])
    masks = np.stack([LABELS, np.zeros_like(LABELS)])
    save_npz(tmp_path / "a.npz", depth=depth, mask=masks)
    scene = read_held(tmp_path / "a.npz")
    assert (scene.name, scene.radius, scene.true_ropes, len(scene.views)) == ("knot", 0.004, 3, 2)
    assert [view.size for view in scene.views] == [(8, 6)] * 2
    assert [view.labels for view in scene.views] == [2, 0]
    assert scene.views[1].no_return == np.count_nonzero(DEPTH <= 500)
    assert scene.views[0].distance == pytest.approx((DEPTH.min() * 1e-3, DEPTH.max() * 1e-3))
    low, high = scene.bounds.low, scene.bounds.high
    views = strand.load_scene(tmp_path / "a.npz").views
    inside = [
        (view.world_points >= low).all(axis=1) & (view.world_points <= high).all(axis=1) for view in views
    ]
    assert scene.points_in_bounds == sum(map(np.count_nonzero, inside)) > 0


def test_a_folder(tmp_path):
    save_png(tmp_path / "a.png")
    scene = read_held(write_scene(tmp_path, "a.png"))
    assert (scene.name, scene.bounds, scene.points_in_bounds, scene.radius) == (
        tmp_path.name,
        None,
        None,
        None,
    )
    assert (scene.true_ropes, scene.views[0].intrinsics) == (0, (10.0, 11.0, 3.5, 2.5))
    (tmp_path / "b.ply").write_bytes(make_ply())
    assert read_held(write_scene(tmp_path, "b.ply")).views[0].points == len(POINTS)
    with pytest.raises(FileFormatError, match="outside"):
        read_held(write_scene(tmp_path, "../b.ply"))


def test_a_folder_without_a_description_says_what_it_has(tmp_path):
    for name in ("a.png", "b.PNG", "notes", "k.json"):
        (tmp_path / name).touch()
    with pytest.raises(FileNotFoundError, match=r"the folder has 2 \.png, 1 ") as caught:
        read_held(tmp_path)
    assert caught.value.filename == str(tmp_path / "scene.toml")
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileNotFoundError, match="the folder has no files"):
        read_held(tmp_path / "empty")


def test_points_without_a_camera(tmp_path):
    points = POINTS.copy()
    points[0], points[1, 2] = 0.0, np.nan
    (tmp_path / "a.ply").write_bytes(make_ply("binary_little_endian", points))
    found = read_held(tmp_path / "a.ply")
    assert (found.viewpoint, found.whole) == (None, False)
    assert (found.view.points, found.view.no_return, found.view.not_finite) == (38, 1, 1)
    np.testing.assert_array_equal(found.view.corners, [points[2:].min(axis=0), points[2:].max(axis=0)])


def test_viewpoints_in_files(data):
    found = read_held(data / "clouds" / "pcl_compressed.pcd")
    np.testing.assert_allclose(found.viewpoint, [0.1, -0.2, 0.25])
    assert found.view.colors


def test_a_depth_image_without_a_camera(tmp_path):
    save_png(tmp_path / "a.png")
    found = read_held(tmp_path / "a.png")
    assert (found.whole, found.view.intrinsics, found.view.size) == (True, None, (8, 6))
    assert found.view.distance == (DEPTH.min(), DEPTH.max())
    np.save(tmp_path / "b.npy", DEPTH * 1e-3)
    assert not read_held(tmp_path / "b.npy").whole
    np.save(tmp_path / "c.npy", DEPTH * -1e-3)
    with pytest.raises(FileFormatError, match=r"c\.npy: depth: "):
        read_held(tmp_path / "c.npy")


def test_a_model(tmp_path):
    chain = strand.Chain(POINTS, 0.004)
    strand.Model((chain,), np.eye(4)[None], method="default").save(tmp_path / "a.json")
    found = read_held(tmp_path / "a.json")
    assert (found.method, found.chains[0].length) == ("default", chain.length)
    with pytest.raises(FileFormatError, match="larger than the 100 bytes"):
        read_held(tmp_path / "a.json", max_bytes=100)


@pytest.mark.parametrize(
    ("name", "error", "said"),
    [
        ("no.npz", FileNotFoundError, "No such file"),
        ("no.json", FileNotFoundError, "No such file"),
        ("empty.npz", FileFormatError, "the file is empty"),
        ("empty.json", FileFormatError, "truncated, or not JSON"),
        ("empty.ply", FileFormatError, "the file is empty"),
        ("empty.mcap", FileFormatError, "truncated, damaged or not a bag"),
        (
            "empty.html",
            FileFormatError,
            r"expected a folder with a scene\.toml.* recordings are \.bag, .*ROS 2 bags",
        ),
    ],
)
def test_unreadable_files_are_errors(tmp_path, name, error, said):
    if name.startswith("empty"):
        (tmp_path / name).touch()
    with pytest.raises(error, match=said):
        read_held(tmp_path / name)


def test_limits_and_topics_are_kept(tmp_path):
    save_npz(tmp_path / "a.npz")
    with pytest.raises(FileFormatError, match="max_bytes=100"):
        read_held(tmp_path / "a.npz", max_bytes=100)
    with pytest.raises(ValueError, match=r"topics: only recordings have topics, and .*a\.npz is not"):
        read_held(tmp_path / "a.npz", "/depth")
