"""Tests of depth images in TIFF files."""

from __future__ import annotations

import struct

import numpy as np
import pytest
import tifffile
from PIL import Image

from shared.scene_files import DEPTH, write_scene
from strand import FileFormatError, load_scene
from strand.io.budget import Budget
from strand.io.images import read_depth_tiff

METRES = (DEPTH * 0.001).astype(np.float32)
WAYS = [
    {},
    {"byteorder": ">"},
    {"compression": "zlib"},
    {"compression": "zlib", "rowsperstrip": 2},
    {"tile": (16, 32)},
    {"bigtiff": True},
]


def read(path, max_bytes=10**6):
    return read_depth_tiff(path, Budget(max_bytes))


@pytest.mark.parametrize("ways", WAYS, ids=str)
@pytest.mark.parametrize("depth", [DEPTH, METRES], ids=["uint16", "float32"])
def test_images_from_tifffile(tmp_path, ways, depth):
    tifffile.imwrite(tmp_path / "a.tiff", depth, **ways)
    found = read(tmp_path / "a.tiff")
    np.testing.assert_array_equal(found, depth)
    assert found.dtype == depth.dtype


def test_tiff_files_in_scenes(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", DEPTH)
    (view,) = load_scene(write_scene(tmp_path, "a.tif")).views
    np.testing.assert_allclose(view.image.depth, DEPTH * 0.001)
    tifffile.imwrite(tmp_path / "a.tif", np.where(METRES > 0.5, METRES, np.nan).astype(np.float32))
    (view,) = load_scene(write_scene(tmp_path, "a.tif")).views
    np.testing.assert_array_equal(view.image.depth, np.where(METRES > 0.5, METRES, 0))
    assert view.dropped == np.count_nonzero(METRES <= 0.5)


@pytest.mark.parametrize(
    ("array", "ways", "reason"),
    [
        (DEPTH.astype(np.uint8), {}, "got 1 of 8 bits of kind 1"),
        (DEPTH.astype(np.int16), {}, "got 1 of 16 bits of kind 2"),
        (DEPTH.astype(np.uint32), {}, "got 1 of 32 bits of kind 1"),
        (DEPTH, {"photometric": "miniswhite"}, "photometric 0"),
        (np.stack([DEPTH] * 3, axis=-1), {"photometric": "rgb"}, "got 3 of 16 bits"),
        (METRES.astype(np.float64), {}, "got 1 of 64 bits of kind 3"),
        (
            np.stack([DEPTH, DEPTH]),
            {"photometric": "minisblack"},
            "expected a TIFF of one image, got several",
        ),
    ],
)
def test_images_of_another_kind(tmp_path, array, ways, reason):
    tifffile.imwrite(tmp_path / "a.tiff", array, **ways)
    with pytest.raises(FileFormatError, match=rf"a\.tiff: .*{reason}"):
        read(tmp_path / "a.tiff")


def test_compressions_of_pillow(tmp_path):
    for name in ("tiff_lzw", "tiff_deflate", "tiff_adobe_deflate", "packbits"):
        Image.fromarray(DEPTH).save(tmp_path / "a.tiff", compression=name)
        np.testing.assert_array_equal(read(tmp_path / "a.tiff"), DEPTH)
    Image.fromarray(DEPTH).save(tmp_path / "a.tiff", compression="lzma")
    with pytest.raises(FileFormatError, match=r"a\.tiff: expected a TIFF without compression, .* got 34925"):
        read(tmp_path / "a.tiff")


@pytest.mark.parametrize("ways", WAYS[:4], ids=str)
def test_truncated_anywhere(tmp_path, ways):
    tifffile.imwrite(tmp_path / "whole.tiff", DEPTH, metadata=None, software=None, **ways)
    data = (tmp_path / "whole.tiff").read_bytes()
    for length in range(1, len(data) - 1):
        (tmp_path / "a.tiff").write_bytes(data[:length])
        with pytest.raises(FileFormatError, match=r"a\.tiff: (truncated|expected a TIFF)"):
            read(tmp_path / "a.tiff")


def test_sizes_are_checked_before_pixels_are_decoded(tmp_path):
    """A file of a few kilobytes declares an image or tiles of gigabytes."""
    tifffile.imwrite(
        tmp_path / "a.tiff", np.zeros((6000, 6000), np.uint16), compression="zlib", rowsperstrip=6000
    )
    assert (tmp_path / "a.tiff").stat().st_size < 100_000
    with pytest.raises(FileFormatError, match="takes 720000000 bytes"):
        read(tmp_path / "a.tiff", 10**8)
    tifffile.imwrite(tmp_path / "a.tiff", DEPTH, compression="zlib", tile=(16384, 16384))
    assert (tmp_path / "a.tiff").stat().st_size < 1_000_000
    with pytest.raises(FileFormatError, match="takes 2147484160 bytes"):
        read(tmp_path / "a.tiff", 10**8)


def test_a_loop_of_directories_is_refused(tmp_path):
    Image.fromarray(DEPTH).save(tmp_path / "a.tiff")
    np.testing.assert_array_equal(read(tmp_path / "a.tiff"), DEPTH)
    data = bytearray((tmp_path / "a.tiff").read_bytes())
    (start,) = struct.unpack("<I", data[4:8])
    (count,) = struct.unpack("<H", data[start : start + 2])
    end = start + 2 + 12 * count
    assert data[end : end + 4] == bytes(4)
    data[end : end + 4] = struct.pack("<I", start)
    (tmp_path / "a.tiff").write_bytes(data)
    np.testing.assert_array_equal(read(tmp_path / "a.tiff"), DEPTH)
