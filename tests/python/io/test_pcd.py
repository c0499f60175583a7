"""Tests of PCD files."""

from __future__ import annotations

import struct

import numpy as np
import open3d as o3d
import pytest

from lib.whole_files import make_pcd
from shared.scene_files import make_grid_cloud
from strand import FileFormatError
from strand.io.budget import Budget
from strand.io.pcd import read_pcd

ENCODINGS = ["ascii", "binary", "binary_compressed"]
POINTS = np.random.default_rng(0).normal(size=(40, 3)).astype(np.float32)
COLORS = np.random.default_rng(1).integers(0, 256, (40, 3)).astype(np.uint8)


def read(path, max_bytes=10**6):
    return read_pcd(path, Budget(max_bytes))


def write_pcd(path, data):
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("encoding", ["ascii", "binary", "compressed"])
def test_organised_clouds_from_pcl(data, encoding):
    cloud = read(data / "clouds" / f"pcl_{encoding}.pcd")
    points, colors = make_grid_cloud()
    np.testing.assert_allclose(cloud.points, points, rtol=1e-6)
    np.testing.assert_array_equal(cloud.colors, colors)
    np.testing.assert_allclose(cloud.viewpoint, [0.1, -0.2, 0.25])
    assert cloud.points.dtype == np.float32


@pytest.mark.parametrize("options", [{"write_ascii": True}, {}, {"compressed": True}], ids=ENCODINGS)
@pytest.mark.parametrize("normals", [False, True])
def test_clouds_from_open3d(tmp_path, options, normals):
    # repeated numbers, so that compression has an effect
    points = np.repeat(POINTS.astype(np.float64), 5, axis=0)
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    cloud.colors = o3d.utility.Vector3dVector(np.repeat(COLORS, 5, axis=0) / 255)
    if normals:
        cloud.normals = o3d.utility.Vector3dVector(np.tile([0.0, 0.6, 0.8], (len(points), 1)))
    assert o3d.io.write_point_cloud(str(tmp_path / "a.pcd"), cloud, **options)
    found = read(tmp_path / "a.pcd")
    np.testing.assert_allclose(found.points, points, rtol=1e-8)
    np.testing.assert_array_equal(found.colors, np.repeat(COLORS, 5, axis=0))
    assert found.viewpoint is None


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("color", ["F", "U", "I"])
def test_fields_in_any_order_with_others_between(tmp_path, encoding, color):
    path = write_pcd(tmp_path / "a.pcd", make_pcd(encoding, POINTS, COLORS, color, padded=True))
    cloud = read(path)
    np.testing.assert_array_equal(cloud.points, POINTS)
    np.testing.assert_array_equal(cloud.colors, COLORS)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_double_precision_and_no_colours(tmp_path, encoding):
    points = np.random.default_rng(2).normal(size=(9, 3))
    cloud = read(write_pcd(tmp_path / "a.pcd", make_pcd(encoding, points)))
    np.testing.assert_array_equal(cloud.points, points)
    assert cloud.points.dtype == np.float64
    assert cloud.colors is None


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_no_points(tmp_path, encoding):
    cloud = read(write_pcd(tmp_path / "a.pcd", make_pcd(encoding, POINTS[:0], COLORS[:0])))
    assert cloud.points.shape == cloud.colors.shape == (0, 3)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_truncated_anywhere(tmp_path, encoding):
    data = make_pcd(encoding, POINTS[:5], COLORS[:5])
    # an ASCII file without the end of its last number looks complete
    end = len(data.rstrip().rsplit(b" ", 1)[0]) if encoding == "ascii" else len(data)
    for length in range(1, end):
        with pytest.raises(FileFormatError, match=r"a\.pcd: (\w+: )?truncated"):
            read(write_pcd(tmp_path / "a.pcd", data[:length]))


def test_a_viewpoint_at_the_origin_counts_as_none(tmp_path):
    data = make_pcd("ascii", POINTS)
    assert read(write_pcd(tmp_path / "a.pcd", data)).viewpoint is None
    moved = data.replace(b"VIEWPOINT 0 0 0", b"VIEWPOINT 0 0 1.5")
    np.testing.assert_array_equal(read(write_pcd(tmp_path / "a.pcd", moved)).viewpoint, [0, 0, 1.5])
    without = data.replace(b"VIEWPOINT 0 0 0 1 0 0 0\n", b"").replace(b"COUNT 1 1 1\n", b"")
    assert read(write_pcd(tmp_path / "a.pcd", without)).viewpoint is None


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_counts_that_the_file_cannot_hold_cost_nothing(tmp_path, encoding):
    data = (
        make_pcd(encoding, POINTS)
        .replace(b"WIDTH 40", b"WIDTH 4000000000")
        .replace(b"POINTS 40", b"POINTS 4000000000")
    )
    with pytest.raises(FileFormatError, match=r"a\.pcd: truncated, fewer than 4000000000 whole points"):
        read(write_pcd(tmp_path / "a.pcd", data))


def test_data_that_would_exceed_the_budget_are_not_decompressed(tmp_path):
    data = make_pcd("binary_compressed", np.zeros((100_000, 3), dtype=np.float32))
    assert len(data) < 20_000
    path = write_pcd(tmp_path / "a.pcd", data)
    assert not read(path, 10**7).points.any()
    with pytest.raises(FileFormatError, match=r"a\.pcd: takes 1200000 bytes, but"):
        read(path, 1_300_000)


HEADER = make_pcd("ascii", POINTS).split(b"DATA")[0]


@pytest.mark.parametrize(
    ("change", "place", "reason"),
    [
        ((b"FIELDS x y z", b"FIELDS x y w"), "FIELDS", "expected points with x, y and z of TYPE F"),
        ((b"TYPE F F F", b"TYPE F F U"), "FIELDS", "expected points with x, y and z of TYPE F"),
        ((b"COUNT 1 1 1", b"COUNT 1 1 2"), "FIELDS", "expected points with x, y and z of TYPE F"),
        ((b"FIELDS x y z", b"FIELDS x x z"), "FIELDS", "fields of different names"),
        ((b"SIZE 4 4 4", b"SIZE 4 4"), "header", "FIELDS, SIZE, TYPE and COUNT of one length"),
        ((b"SIZE 4 4 4", b"SIZE 4 4 3"), "field z", "not understood: TYPE F, SIZE 3, COUNT 1"),
        ((b"COUNT 1 1 1", b"COUNT 1 1 0"), "field z", "not understood: TYPE F, SIZE 4, COUNT 0"),
        ((b"WIDTH 40\n", b""), "header", "missing WIDTH"),
        ((b"WIDTH 40", b"WIDTH -1"), "WIDTH", "expected a whole number, got '-1'"),
        ((b"POINTS 40", b"POINTS 41"), "POINTS", "expected WIDTH x HEIGHT = 40, got 41"),
        ((b"VIEWPOINT 0 0 0 1", b"VIEWPOINT 0 0 nan 1"), "VIEWPOINT", "expected seven numbers"),
        ((b"VIEWPOINT 0 0 0 1", b"VIEWPOINT 0 0"), "VIEWPOINT", "expected seven numbers"),
        ((b"HEIGHT 1", b"HEIGHT 1\nHEIGHT 1"), "line 9", "not understood: 'HEIGHT 1'"),
        ((b"HEIGHT 1", b"HEIGHT 1\nSIDES 1"), "line 9", "not understood: 'SIDES 1'"),
        ((b"DATA ascii", b"DATA zip"), "DATA", "expected one of ascii, binary, binary_compressed, got 'zip'"),
        ((b"ascii\n", b"ascii\n1 2 3 4\n"), "point 0", "expected 3 numbers, got 4"),
        ((b"ascii\n", b"ascii\n1 2 a\n"), "point 0", "expected numbers, got '1 2 a'"),
    ],
)
def test_errors_name_the_place(tmp_path, change, place, reason):
    data = make_pcd("ascii", POINTS)
    assert change[0] in data
    with pytest.raises(FileFormatError, match=reason) as caught:
        read(write_pcd(tmp_path / "a.pcd", data.replace(*change)))
    assert (caught.value.file, caught.value.place) == (str(tmp_path / "a.pcd"), place)


def test_compressed_data_that_are_damaged(tmp_path):
    data = make_pcd("binary_compressed", POINTS)
    start = data.index(b"compressed\n") + 11
    packed, size = struct.unpack("<II", data[start : start + 8])
    for change, reason in (
        (struct.pack("<II", packed, size + 1), "expected 480 bytes when decompressed, got 481"),
        (struct.pack("<II", packed + 1, size), "truncated"),
        (struct.pack("<II", packed - 1, size), "truncated or damaged"),
        (struct.pack("<II", packed, size) + b"\xff\xff\xff", "a copy starts before the first byte"),
    ):
        damaged = data[:start] + change + data[start + len(change) :]
        with pytest.raises(FileFormatError, match=reason):
            read(write_pcd(tmp_path / "a.pcd", damaged))


def test_points_without_a_return_may_have_no_colour(tmp_path):
    data = make_pcd("ascii", POINTS[:2], COLORS[:2], "F")
    lost = b"nan nan nan nan\n" + data.rstrip().rsplit(b"\n", 1)[1]
    cloud = read(write_pcd(tmp_path / "a.pcd", data.split(b"ascii\n")[0] + b"ascii\n" + lost))
    np.testing.assert_array_equal(cloud.points[1], POINTS[1])
    np.testing.assert_array_equal(cloud.colors[1], COLORS[1])
    seen = b"1 2 3 nan\n" + data.rstrip().rsplit(b"\n", 1)[1]
    with pytest.raises(FileFormatError, match="rgb: expected numbers"):
        read(write_pcd(tmp_path / "a.pcd", data.split(b"ascii\n")[0] + b"ascii\n" + seen))


def test_packed_colours_of_text_that_are_too_large(tmp_path):
    data = make_pcd("ascii", POINTS[:1], COLORS[:1], "U")
    first, _ = data.rstrip().rsplit(b" ", 1)
    with pytest.raises(FileFormatError, match=r"a\.pcd: rgb: expected numbers of type <u4"):
        read(write_pcd(tmp_path / "a.pcd", first + b" " + b"9" * 12))
