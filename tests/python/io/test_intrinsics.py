"""Tests of pinhole matrices from files."""

from __future__ import annotations

import json

import numpy as np
import open3d as o3d
import pytest

from strand import FileFormatError
from strand.io.intrinsics import read_intrinsics

K = [[600.5, 0, 320], [0, 601.25, 240], [0, 0, 1]]


def test_matrices_from_numpy_and_open3d(tmp_path):
    np.savetxt(tmp_path / "k.txt", K)
    camera = o3d.camera.PinholeCameraIntrinsic(640, 480, 600.5, 601.25, 320, 240)
    assert o3d.io.write_pinhole_camera_intrinsic(str(tmp_path / "k.json"), camera)
    for name in ("k.txt", "k.json"):
        np.testing.assert_array_equal(read_intrinsics(tmp_path / name), K)


@pytest.mark.parametrize("centre", ["c", "pp"])
def test_focal_lengths_and_principal_point_by_name(tmp_path, centre):
    camera = {"width": 640, "fx": 600.5, "fy": 601.25, f"{centre}x": 320, f"{centre}y": 240}
    (tmp_path / "k.json").write_text(json.dumps(camera))
    np.testing.assert_array_equal(read_intrinsics(tmp_path / "k.json"), K)


@pytest.mark.parametrize(
    ("name", "text", "reason"),
    [
        ("k.txt", "1 2 3 4", r"a matrix of nine numbers \(got 4\)"),
        ("k.txt", "1 0 0 0 1 0 0 0 a", "nine numbers"),
        ("k.txt", "1 0 0 0 -1 0 0 0 1", "fx, fy > 0"),
        ("k.txt", "", "got 0"),
        ("k.json", "[1, 2]", "got 1, 2"),
        ("k.json", "7", "nine numbers"),
        ("k.json", "{}", "got nothing"),
        ("k.json", '{"fx": 600, "fy": 600, "cx": 320}', "got 'fx', 'fy', 'cx'"),
        ("k.json", '{"fx": 600, "cx": 320, "cy": 240}', "'fy'"),
        ("k.json", '{"fx": 600, "fy": [1], "cx": 320, "cy": 240}', "fx, fy, cx and cy"),
        ("k.json", '{"fx": 600, "fy": "NaN", "cx": 320, "cy": 240}', "finite numbers"),
        ("k.json", '{"intrinsic_matrix": 5}', "nine numbers"),
        ("k.json", '{"intrinsic_matrix": [[1], 0, 0, 0, 1, 0, 0, 0, 1]}', "nine numbers"),
        ("k.json", '{"intrinsic_matrix": [1', "truncated, or not JSON"),
        ("k.txt", "1 " * 50_000, "larger than"),
    ],
)
def test_other_content_is_refused(tmp_path, name, text, reason):
    (tmp_path / name).write_text(text)
    with pytest.raises(FileFormatError, match=reason) as caught:
        read_intrinsics(tmp_path / name)
    assert caught.value.file == str(tmp_path / name)
