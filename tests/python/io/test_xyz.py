"""Tests of points in text: XYZ and CSV."""

from __future__ import annotations

import numpy as np
import open3d as o3d
import pytest

from strand import FileFormatError
from strand.io.budget import Budget
from strand.io.xyz import read_xyz

POINTS = np.random.default_rng(0).normal(size=(7, 3))
COLORS = np.random.default_rng(1).integers(0, 256, (7, 3))


def read(path, text, max_bytes=10**6):
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_xyz(path, Budget(max_bytes))


def make_rows(*columns, separator=" "):
    return "".join(separator.join(map(str, row)) + "\n" for row in np.hstack(columns).tolist())


def test_clouds_from_open3d(tmp_path):
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(POINTS))
    cloud.colors = o3d.utility.Vector3dVector(COLORS / 255)
    for suffix in ("xyz", "xyzrgb"):
        path = tmp_path / f"a.{suffix}"
        assert o3d.io.write_point_cloud(str(path), cloud)
        found = read_xyz(path, Budget(10**6))
        np.testing.assert_allclose(found.points, POINTS, atol=1e-10)
        if suffix == "xyz":
            assert found.colors is None
        else:
            np.testing.assert_allclose(found.colors, COLORS / 255, atol=1e-9)


def test_tables_from_numpy(tmp_path):
    np.savetxt(
        tmp_path / "a.csv", np.hstack([COLORS, POINTS]), delimiter=",", header="r,g,b,x,y,z", fmt="%.17g"
    )
    found = read_xyz(tmp_path / "a.csv", Budget(10**6))
    np.testing.assert_array_equal(found.points, POINTS)
    np.testing.assert_array_equal(found.colors, COLORS / 255)


@pytest.mark.parametrize("separator", [" ", "\t", "   ", ",", ", ", ";"])
@pytest.mark.parametrize("names", ["", "x y z", "X Y Z", "# x y z", "//X Y Z", '"x" "y" "z"'])
def test_separators_and_names(tmp_path, separator, names):
    mark = names[: names.lower().find("x")].strip('"')
    heading = mark + separator.join(names.removeprefix(mark).split())
    text = (heading + "\n" if heading else "") + make_rows(POINTS, separator=separator)
    for given in (text, text.replace("\n", "\r\n"), text.rstrip(), "\ufeff" + text):
        found = read(tmp_path / "a.txt", given)
        np.testing.assert_array_equal(found.points, POINTS)
        assert found.colors is None


def test_columns_in_any_order_with_others_beside_them(tmp_path):
    heading = "label,Z,nx,X,red,Y,green,blue\n"
    body = "".join(
        f"rope,{z!r},0.5,{x!r},{r},{y!r},{g},{b}\n"
        for (x, y, z), (r, g, b) in zip(POINTS.tolist(), COLORS.tolist(), strict=True)
    )
    found = read(tmp_path / "a.csv", heading + body)
    np.testing.assert_array_equal(found.points, POINTS)
    np.testing.assert_array_equal(found.colors, COLORS / 255)


def test_colours_are_from_0_to_1_if_none_is_larger(tmp_path):
    small = read(tmp_path / "a.xyz", make_rows(POINTS, COLORS / 255))
    large = read(tmp_path / "a.xyz", make_rows(POINTS, COLORS))
    np.testing.assert_array_equal(small.colors, COLORS / 255)
    np.testing.assert_array_equal(large.colors, COLORS / 255)


def test_blank_lines_and_comments_are_no_points(tmp_path):
    text = "# made by hand\n\n1 2 3\n  \n// between\n4 5 6\n#end\n"
    np.testing.assert_array_equal(read(tmp_path / "a.txt", text).points, [[1, 2, 3], [4, 5, 6]])


def test_a_table_of_names_alone_has_no_points(tmp_path):
    assert read(tmp_path / "a.csv", "x,y,z\n").points.shape == (0, 3)


def test_points_without_a_return_are_kept_for_counting(tmp_path):
    found = read(tmp_path / "a.xyz", "nan nan nan\n1 2 3\n4 inf 6\n")
    np.testing.assert_array_equal(found.points[1], [1, 2, 3])
    assert not np.isfinite(found.points[[0, 2]]).all(axis=1).any()


@pytest.mark.parametrize(
    ("text", "place", "reason"),
    [
        (
            "7\nmade\nC 1 2 3\n",
            "point 0",
            "expected x y z or x y z red green blue, or a first line that names",
        ),
        ("1 2\n3 4\n", "point 0", "got '1 2'"),
        ("1 2 3 4\n", "point 0", "got '1 2 3 4'"),
        ("a b c\n1 2 3\n", "point 0", "expected numbers, got 'a b c'"),
        ("1 2 3\n4 5\n", "point 1", "truncated: expected 3 numbers"),
        ("1 2 3\n4 5 6 7\n1 2 3\n", "point 1", "expected 3 numbers, got 4"),
        ("1 2 3\n4 five 6\n", "point 1", "expected numbers, got '4 five 6'"),
        ("1,5;2,5;3,5\n", "point 0", "expected numbers, got '1,5 2,5 3,5'"),
        ("x,y,z\n1,2\n3,4,5\n", "point 0", "expected 3 numbers, got 2"),
        ("x,y,z,x\n1,2,3,4\n", "line 1", "different names"),
        ("1 2 3 0 0 -1\n", "colours", "got -1.0 to 0.0; if these are no colours, add a first line such as"),
        ("1 2 3 0 0 256\n", "colours", "from 0 to 255, got 0.0 to 256.0"),
        ("x y z r g b\n1 2 3 0 0 nan\n", "colours", "got nan to nan"),
        ("", None, "the file is empty"),
        ("1 2 3\n" + "1" * 200_000, None, "a line of more than 65536 bytes"),
        (b"\x89PNG\r\n\x1a\n" + bytes(40), "point 0", "expected x y z"),
    ],
)
def test_errors_name_the_place(tmp_path, text, place, reason):
    with pytest.raises(FileFormatError) as caught:
        read(tmp_path / "a.xyz", text)
    assert (caught.value.file, caught.value.place) == (str(tmp_path / "a.xyz"), place)
    assert reason in caught.value.reason


def test_many_short_lines_count_for_the_budget(tmp_path):
    text = "1 2 3\n" * 10_000
    assert len(read(tmp_path / "a.xyz", text, 300_000).points) == 10_000
    with pytest.raises(FileFormatError, match=r"a\.xyz: takes 240000 bytes, but 190000 are left"):
        read(tmp_path / "a.xyz", text, 250_000)
