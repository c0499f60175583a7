"""Readers of single files: PNG, NPY, PLY."""

from __future__ import annotations

import shutil
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scene_files import DEPTH, POINTS, K, ply, save_png, scene_of

from strand import FileFormatError, View, load_scene


def png(bits, colour, rows):
    """A PNG of one's own making, for what Pillow does not write."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", 2, len(rows), bits, colour, 0, 0, 0)
    data = zlib.compress(b"".join(b"\0" + row for row in rows))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def test_png_keeps_all_16_bits(tmp_path):
    depth = np.array([[0, 1], [256, 65535]], dtype=np.uint16)
    save_png(tmp_path / "a.png", depth)
    view = load_scene(scene_of(tmp_path, "a.png")).views[0]
    np.testing.assert_allclose(view.points[:, 2], [0.001, 0.256, 65.535], rtol=1e-15)
    assert view.dropped == 0


@pytest.mark.parametrize(
    ("mode", "kind"),
    [
        ("L", "8-bit grey"),
        ("RGB", "8-bit RGB"),
        ("P", "8-bit palette"),
        ("1", "1-bit grey"),
        ("LA", "8-bit grey and alpha"),
        ("RGBA", "8-bit RGB and alpha"),
    ],
)
def test_png_of_another_kind(tmp_path, mode, kind):
    Image.new("L", (8, 6)).convert(mode).save(tmp_path / "a.png")
    with pytest.raises(FileFormatError, match=rf"a\.png: expected a 16-bit single-channel .* got {kind}"):
        load_scene(scene_of(tmp_path, "a.png"))


def test_png_with_16_bit_colours(tmp_path):
    (tmp_path / "a.png").write_bytes(png(16, 2, [bytes(12), bytes(12)]))
    with pytest.raises(FileFormatError, match="got 16-bit RGB"):
        load_scene(scene_of(tmp_path, "a.png"))
    (tmp_path / "a.png").write_bytes(png(16, 0, [b"\x01\x02\x03\x04", bytes(4)]))
    np.testing.assert_allclose(load_scene(tmp_path).views[0].points[:, 2], [0.258, 0.772])


def test_png_truncated_anywhere(tmp_path):
    save_png(tmp_path / "whole.png")
    data = (tmp_path / "whole.png").read_bytes()
    folder = scene_of(tmp_path, "a.png")
    for length in range(1, len(data) - 4):  # the last four bytes are the end mark's checksum
        (tmp_path / "a.png").write_bytes(data[:length])
        with pytest.raises(FileFormatError, match=r"a\.png: truncated"):
            load_scene(folder)


def test_png_that_is_another_file(tmp_path):
    Image.new("RGB", (8, 6)).save(tmp_path / "a.jpg")
    shutil.move(tmp_path / "a.jpg", tmp_path / "a.png")
    with pytest.raises(FileFormatError, match=r"a\.png: truncated, or not a PNG"):
        load_scene(scene_of(tmp_path, "a.png"))


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("order", ["C", "F"])
def test_npy_points(tmp_path, kind, order):
    np.save(tmp_path / "a.npy", np.asarray(POINTS, dtype=kind, order=order))
    view = load_scene(scene_of(tmp_path, "a.npy")).views[0]
    np.testing.assert_array_equal(view.points, POINTS.astype(kind))


def test_npy_depth(tmp_path):
    want = View.from_depth(DEPTH * 0.001, K).points
    np.save(tmp_path / "a.npy", DEPTH)
    np.testing.assert_array_equal(load_scene(scene_of(tmp_path, "a.npy")).views[0].points, want)
    metres = DEPTH * 0.001
    metres[0, 0], metres[1, 1] = np.nan, np.inf
    np.save(tmp_path / "a.npy", metres)
    view = load_scene(tmp_path).views[0]
    assert len(view.points) == DEPTH.size - 2
    assert view.dropped == 2


def test_cloud_drops_and_counts_what_is_not_finite(tmp_path):
    points = POINTS.copy()
    points[3, 1], points[7] = np.nan, np.inf
    np.save(tmp_path / "a.npy", points)
    (tmp_path / "a.ply").write_bytes(ply("binary_little_endian", points))
    for file in ("a.npy", "a.ply"):
        view = load_scene(scene_of(tmp_path, file)).views[0]
        np.testing.assert_array_equal(view.points, np.delete(POINTS, [3, 7], axis=0))
        assert view.dropped == 2


@pytest.mark.parametrize(
    "array",
    [
        np.zeros(3),
        np.zeros((2, 2, 3)),
        np.zeros((4, 3), int),
        np.zeros((4, 3), complex),
        np.zeros((4, 4), np.uint8),
    ],
)
def test_npy_of_another_kind(tmp_path, array):
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(FileFormatError, match=r"a\.npy: expected a depth image"):
        load_scene(scene_of(tmp_path, "a.npy"))


def test_npy_with_a_negative_depth(tmp_path):
    np.save(tmp_path / "a.npy", np.full((6, 8), -1.0))
    with pytest.raises(FileFormatError, match=r"a\.npy: depth: expected depths >= 0"):
        load_scene(scene_of(tmp_path, "a.npy"))


def test_npy_truncated_anywhere(tmp_path):
    np.save(tmp_path / "whole.npy", POINTS[:4])
    data = (tmp_path / "whole.npy").read_bytes()
    folder = scene_of(tmp_path, "a.npy")
    for length in range(1, len(data)):
        (tmp_path / "a.npy").write_bytes(data[:length])
        with pytest.raises(FileFormatError, match=r"a\.npy: truncated"):
            load_scene(folder)


def test_npy_with_pickled_objects_is_not_opened(tmp_path):
    class Harm:
        def __reduce__(self):
            return Path.touch, (tmp_path / "harm",)

    np.save(tmp_path / "a.npy", np.array([[Harm()] * 3]), allow_pickle=True)
    with pytest.raises(FileFormatError, match=r"a\.npy"):
        load_scene(scene_of(tmp_path, "a.npy"))
    assert not (tmp_path / "harm").exists()


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("kind", ["double", "float"])
def test_ply(tmp_path, encoding, kind):
    (tmp_path / "a.ply").write_bytes(ply(encoding, kind=kind))
    view = load_scene(scene_of(tmp_path, "a.ply")).views[0]
    want = POINTS if kind == "double" else POINTS.astype(np.float32)
    np.testing.assert_array_equal(view.points, want)


def test_ply_with_windows_line_ends_and_faces(tmp_path):
    faces = "element face 1\nproperty list uchar int vertex_indices\n"
    (tmp_path / "a.ply").write_bytes(ply(more=faces, tail=b"3 0 1 2\n"))
    folder = scene_of(tmp_path, "a.ply")
    np.testing.assert_array_equal(load_scene(folder).views[0].points, POINTS)
    (tmp_path / "a.ply").write_bytes(ply().replace(b"\n", b"\r\n"))
    np.testing.assert_array_equal(load_scene(folder).views[0].points, POINTS)


def test_ply_with_colours(tmp_path):
    row = np.zeros(3, dtype=[("xyz", "<f4", 3), ("rgb", "u1", 3)])
    row["xyz"] = POINTS[:3]
    colours = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    header = ply("binary_little_endian", POINTS[:3], "float", more=colours).split(b"end_header\n")[0]
    (tmp_path / "a.ply").write_bytes(header + b"end_header\n" + row.tobytes())
    points = load_scene(scene_of(tmp_path, "a.ply")).views[0].points
    np.testing.assert_array_equal(points, POINTS[:3].astype(np.float32))


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_truncated(tmp_path, encoding):
    data = ply(encoding, POINTS[:5])
    folder = scene_of(tmp_path, "a.ply")
    # an ASCII file that lost the end of its last number cannot be told from a whole one
    end = len(data.rstrip().rsplit(b" ", 1)[0]) if encoding == "ascii" else len(data)
    for length in range(1, end):
        (tmp_path / "a.ply").write_bytes(data[:length])
        with pytest.raises(FileFormatError, match=r"a\.ply: truncated"):
            load_scene(folder)


def test_ply_with_no_points(tmp_path):
    (tmp_path / "a.ply").write_bytes(ply(points=POINTS[:0]))
    assert load_scene(scene_of(tmp_path, "a.ply")).views[0].points.shape == (0, 3)


@pytest.mark.parametrize(
    "data",
    [
        b"solid a\n",
        ply().replace(b"ply\n", b"plx\n", 1),
        ply().replace(b"property double z\n", b""),
        ply().replace(b" z\n", b" w\n"),
        ply(kind="int"),
        ply().replace(b".", b"a", 9),
        ply().replace(b"element vertex", b"element face"),
    ],
)
def test_ply_with_wrong_content(tmp_path, data):
    (tmp_path / "a.ply").write_bytes(data)
    with pytest.raises(FileFormatError, match=r"a\.ply"):
        load_scene(scene_of(tmp_path, "a.ply"))
