"""Tests of PLY files."""

from __future__ import annotations

import numpy as np
import open3d as o3d
import pytest

from shared.scene_files import POINTS, make_grid_cloud, make_ply, write_scene
from strand import FileFormatError, load_scene
from strand.io.budget import Budget
from strand.io.ply import read_ply


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_clouds_from_pcl(data, encoding):
    cloud = read_ply(data / "clouds" / f"pcl_{encoding}.ply", Budget(10**6))
    points, colors = make_grid_cloud()
    np.testing.assert_allclose(cloud.points, points, rtol=1e-5)
    np.testing.assert_array_equal(cloud.colors, colors)


def test_rows_wider_than_the_header_declares(tmp_path):
    """PCL 1.13 writes integer colours so: three numbers in the header, one in each row."""
    data = make_ply("binary_little_endian")
    for tail in (b"", b"\n", b"  \r\n"):
        (tmp_path / "a.ply").write_bytes(data + tail)
        assert len(read_ply(tmp_path / "a.ply", Budget(10**6)).points) == 40
    (tmp_path / "a.ply").write_bytes(data + bytes(40))
    with pytest.raises(FileFormatError, match=r"a\.ply: expected 960 bytes after the header, got 1000"):
        read_ply(tmp_path / "a.ply", Budget(10**6))


@pytest.mark.parametrize("ascii", [True, False])
def test_clouds_with_normals_and_colours_from_open3d(tmp_path, ascii):
    shades = np.random.default_rng(1).integers(0, 256, POINTS.shape)
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(POINTS))
    cloud.normals = o3d.utility.Vector3dVector(np.tile([0.0, 0.6, 0.8], (len(POINTS), 1)))
    cloud.colors = o3d.utility.Vector3dVector(shades / 255)
    assert o3d.io.write_point_cloud(str(tmp_path / "a.ply"), cloud, write_ascii=ascii)
    found = read_ply(tmp_path / "a.ply", Budget(10**6))
    np.testing.assert_allclose(found.points, POINTS, rtol=1e-5 if ascii else 0)
    np.testing.assert_array_equal(found.colors, shades)


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("kind", ["double", "float"])
def test_ply(tmp_path, encoding, kind):
    (tmp_path / "a.ply").write_bytes(make_ply(encoding, kind=kind))
    view = load_scene(write_scene(tmp_path, "a.ply")).views[0]
    want = POINTS if kind == "double" else POINTS.astype(np.float32)
    np.testing.assert_array_equal(view.points, want)


def test_ply_with_windows_line_ends_and_faces(tmp_path):
    faces = "element face 1\nproperty list uchar int vertex_indices\n"
    (tmp_path / "a.ply").write_bytes(make_ply(more=faces, tail=b"3 0 1 2\n"))
    folder = write_scene(tmp_path, "a.ply")
    np.testing.assert_array_equal(load_scene(folder).views[0].points, POINTS)
    (tmp_path / "a.ply").write_bytes(make_ply().replace(b"\n", b"\r\n"))
    np.testing.assert_array_equal(load_scene(folder).views[0].points, POINTS)


def test_ply_with_colours(tmp_path):
    row = np.zeros(3, dtype=[("xyz", "<f4", 3), ("rgb", "u1", 3)])
    row["xyz"] = POINTS[:3]
    colours = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    header = make_ply("binary_little_endian", POINTS[:3], "float", more=colours).split(b"end_header\n")[0]
    (tmp_path / "a.ply").write_bytes(header + b"end_header\n" + row.tobytes())
    points = load_scene(write_scene(tmp_path, "a.ply")).views[0].points
    np.testing.assert_array_equal(points, POINTS[:3].astype(np.float32))


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_truncated(tmp_path, encoding):
    data = make_ply(encoding, POINTS[:5])
    folder = write_scene(tmp_path, "a.ply")
    # an ASCII file without the end of its last number looks complete
    end = len(data.rstrip().rsplit(b" ", 1)[0]) if encoding == "ascii" else len(data)
    for length in range(1, end):
        (tmp_path / "a.ply").write_bytes(data[:length])
        with pytest.raises(FileFormatError, match=r"a\.ply: truncated"):
            load_scene(folder)


def test_ply_with_no_points(tmp_path):
    (tmp_path / "a.ply").write_bytes(make_ply(points=POINTS[:0]))
    assert load_scene(write_scene(tmp_path, "a.ply")).views[0].points.shape == (0, 3)


@pytest.mark.parametrize(
    "data",
    [
        b"solid a\n",
        make_ply().replace(b"ply\n", b"plx\n", 1),
        make_ply().replace(b"property double z\n", b""),
        make_ply().replace(b" z\n", b" w\n"),
        make_ply(kind="int"),
        make_ply().replace(b".", b"a", 9),
        make_ply().replace(b"element vertex", b"element face"),
    ],
)
def test_ply_with_wrong_content(tmp_path, data):
    (tmp_path / "a.ply").write_bytes(data)
    with pytest.raises(FileFormatError, match=r"a\.ply"):
        load_scene(write_scene(tmp_path, "a.ply"))


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_elements_before_the_vertices_and_columns_between(tmp_path, encoding):
    order = ">" if "big" in encoding else "<"
    row = np.dtype([("z", order + "f8"), ("red", "u1"), ("x", order + "f4"), ("y", order + "f4")])
    table = np.zeros(3, dtype=row)
    table["x"], table["y"], table["z"] = [1, 2, 3], [4, 5, 6], [7, 8, 9]
    header = f"ply\nformat {encoding} 1.0\nelement camera 2\nproperty short x\nproperty uchar \xe9\n"
    header += "element vertex 3\nproperty double z\nproperty uint8 red\nproperty float32 x\n"
    header += "property float y\nend_header\n"
    body = bytes(6) + table.tobytes()
    if encoding == "ascii":
        body = b"7 7\n\n7 7\n7 0 1 4\n  8 0 2 5 \n\n9 0 3 6"
    (tmp_path / "a.ply").write_bytes(header.encode("latin-1") + body)
    points = read_ply(tmp_path / "a.ply", Budget(10_000)).points
    np.testing.assert_array_equal(points, [[1, 4, 7], [2, 5, 8], [3, 6, 9]])
    assert points.dtype == np.float64


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian"])
def test_counts_that_the_file_cannot_hold_cost_nothing(tmp_path, encoding):
    data = make_ply(encoding).replace(b"vertex 40", b"vertex 999999999999999999")
    (tmp_path / "a.ply").write_bytes(data)
    with pytest.raises(
        FileFormatError, match=r"a\.ply: truncated, fewer than 999999999999999999 whole vertices"
    ):
        read_ply(tmp_path / "a.ply", Budget(10**6))


@pytest.mark.parametrize(
    ("data", "place", "reason"),
    [
        (make_ply(more="property list uchar int faces\n"), "header", "no lists"),
        (
            make_ply().replace(b"element vertex", b"element face 1\nproperty list int int a\nelement vertex"),
            "header",
            "no lists",
        ),
        (make_ply(more="property float x\n"), "header", "two vertex properties"),
        (make_ply().replace(b"ascii 1.0", b"ascii 2.0"), "line 2", "not understood"),
        (make_ply().replace(b"vertex 40", b"vertex -1"), "line 4", "not understood"),
        (make_ply().replace(b"vertex 40", b"vertex 9" + b"9" * 5000), "line 4", "not understood"),
        (make_ply(more="property half a\n"), "line 8", "not understood"),
        (make_ply().replace(b"format ascii 1.0\n", b""), "header", "expected a format"),
        (
            make_ply().replace(b"end_header\n", b"end_header\n1 2 3 4\n"),
            "vertex 0",
            "expected 3 numbers, got 4",
        ),
        (
            make_ply().replace(b"end_header\n", b"end_header\n1 2 a\n"),
            "vertex 0",
            "expected numbers, got '1 2 a'",
        ),
        (
            make_ply().replace(b"end_header\n", b"end_header\n" + b"1" * 200_000),
            None,
            "a line of more than 65536 bytes",
        ),
    ],
)
def test_errors_name_the_place(tmp_path, data, place, reason):
    (tmp_path / "a.ply").write_bytes(data)
    with pytest.raises(FileFormatError, match=reason) as caught:
        read_ply(tmp_path / "a.ply", Budget(10**6))
    assert (caught.value.file, caught.value.place) == (str(tmp_path / "a.ply"), place)


def test_numbers_too_large_for_a_float_are_dropped(tmp_path):
    points = POINTS.copy()
    points[2, 1] = 1e300
    header, body = make_ply("ascii", points, "double").split(b"end_header\n")
    (tmp_path / "a.ply").write_bytes(header.replace(b"double", b"float") + b"end_header\n" + body)
    with np.errstate(over="raise"):
        view = load_scene(write_scene(tmp_path, "a.ply")).views[0]
    assert (len(view.points), view.dropped) == (39, 1)
