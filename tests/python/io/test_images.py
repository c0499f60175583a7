"""Tests of depth images, masks and colour images."""

from __future__ import annotations

import shutil
import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from shared.scene_files import CAMERA, DEPTH, IDENTITY, save_png, write_scene
from strand import FileFormatError, load_scene
from strand.io.budget import Budget
from strand.io.images import read_color, read_depth_png


def make_png(bits, colour, rows):
    """Return a PNG of a kind that Pillow does not write."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", 2, len(rows), bits, colour, 0, 0, 0)
    data = zlib.compress(b"".join(b"\0" + row for row in rows))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def test_png_keeps_all_16_bits(tmp_path):
    depth = np.array([[0, 1], [256, 65535]], dtype=np.uint16)
    save_png(tmp_path / "a.png", depth)
    view = load_scene(write_scene(tmp_path, "a.png")).views[0]
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
        load_scene(write_scene(tmp_path, "a.png"))


def test_png_with_16_bit_colours(tmp_path):
    (tmp_path / "a.png").write_bytes(make_png(16, 2, [bytes(12), bytes(12)]))
    with pytest.raises(FileFormatError, match="got 16-bit RGB"):
        load_scene(write_scene(tmp_path, "a.png"))
    (tmp_path / "a.png").write_bytes(make_png(16, 0, [b"\x01\x02\x03\x04", bytes(4)]))
    np.testing.assert_allclose(load_scene(tmp_path).views[0].points[:, 2], [0.258, 0.772])


def test_png_truncated_anywhere(tmp_path):
    save_png(tmp_path / "whole.png")
    data = (tmp_path / "whole.png").read_bytes()
    folder = write_scene(tmp_path, "a.png")
    for length in range(1, len(data) - 4):  # the last four bytes are the checksum of the end mark
        (tmp_path / "a.png").write_bytes(data[:length])
        with pytest.raises(FileFormatError, match=r"a\.png: truncated"):
            load_scene(folder)


def test_png_that_is_another_file(tmp_path):
    Image.new("RGB", (8, 6)).save(tmp_path / "a.jpg")
    shutil.move(tmp_path / "a.jpg", tmp_path / "a.png")
    with pytest.raises(FileFormatError, match=r"a\.png: truncated, or not a PNG"):
        load_scene(write_scene(tmp_path, "a.png"))


def make_large_png(width, height):
    """Return a small PNG that declares this size."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(bytes(99))) + chunk(b"IEND", b"")


def test_a_png_that_declares_a_huge_size_is_not_decoded(tmp_path):
    (tmp_path / "a.png").write_bytes(make_large_png(2**31 - 1, 2**31 - 1))
    with pytest.raises(FileFormatError, match=r"a\.png: truncated.*decompression bomb"):
        read_depth_png(tmp_path / "a.png", Budget(2**80))
    (tmp_path / "a.png").write_bytes(make_large_png(1000, 1000))
    with pytest.raises(FileFormatError, match=r"a\.png: takes 2000000 bytes, but .* max_bytes=1000000"):
        read_depth_png(tmp_path / "a.png", Budget(1_000_000))


@pytest.mark.filterwarnings("ignore::PIL.Image.DecompressionBombWarning")
def test_images_above_pillows_limit_are_refused(tmp_path, monkeypatch):
    save_png(tmp_path / "a.png")
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", DEPTH.size - 1)
    with pytest.raises(FileFormatError, match=r"a\.png: 8 x 6 pixels, more than Pillow's limit of 47"):
        read_depth_png(tmp_path / "a.png", Budget(10**6))


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "BMP", "PPM"])
def test_colours_of_the_usual_formats(tmp_path, kind):
    image = np.full((6, 8, 3), (10, 200, 30), dtype=np.uint8)
    Image.fromarray(image).save(tmp_path / "a", kind)
    read = read_color(tmp_path / "a", Budget(10**6))
    assert np.abs(read.astype(int) - image).max() < 6


@pytest.mark.parametrize("kind", ["EPS", "GIF", "TIFF", "PCX"])
def test_other_formats_are_not_opened(tmp_path, kind):
    save_png(tmp_path / "a.png")
    Image.new("RGB", (8, 6)).save(tmp_path / "c", kind)
    with pytest.raises(FileFormatError, match=r"c: truncated, or not a colour image \(PNG, JPEG, BMP, PPM\)"):
        load_scene(write_scene(tmp_path, "a.png", CAMERA, IDENTITY + 'color = "c"\n'))
