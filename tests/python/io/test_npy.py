"""Tests of NPY files and the arrays of NPZ archives."""

from __future__ import annotations

import io
import struct
import zipfile
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from shared.scene_files import DEPTH, POINTS, K, make_ply, save_npz, write_scene
from strand import FileFormatError, View, load_scene
from strand.io.budget import Budget
from strand.io.npy import read_npy


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("order", ["C", "F"])
def test_npy_points(tmp_path, kind, order):
    np.save(tmp_path / "a.npy", np.asarray(POINTS, dtype=kind, order=order))
    view = load_scene(write_scene(tmp_path, "a.npy")).views[0]
    np.testing.assert_array_equal(view.points, POINTS.astype(kind))


def test_npy_depth(tmp_path):
    want = View.from_depth(DEPTH * 0.001, K).points
    np.save(tmp_path / "a.npy", DEPTH)
    np.testing.assert_array_equal(load_scene(write_scene(tmp_path, "a.npy")).views[0].points, want)
    metres = DEPTH * 0.001
    metres[0, 0], metres[1, 1] = np.nan, np.inf
    np.save(tmp_path / "a.npy", metres)
    view = load_scene(tmp_path).views[0]
    assert len(view.points) == DEPTH.size - 2
    assert view.dropped == 2


def test_cloud_drops_and_counts_points_that_are_not_finite(tmp_path):
    points = POINTS.copy()
    points[3, 1], points[7] = np.nan, np.inf
    np.save(tmp_path / "a.npy", points)
    (tmp_path / "a.ply").write_bytes(make_ply("binary_little_endian", points))
    for file in ("a.npy", "a.ply"):
        view = load_scene(write_scene(tmp_path, file)).views[0]
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
        load_scene(write_scene(tmp_path, "a.npy"))


def test_npy_with_a_negative_depth(tmp_path):
    np.save(tmp_path / "a.npy", np.full((6, 8), -1.0))
    with pytest.raises(FileFormatError, match=r"a\.npy: depth: expected depths >= 0"):
        load_scene(write_scene(tmp_path, "a.npy"))


def test_npy_truncated_anywhere(tmp_path):
    np.save(tmp_path / "whole.npy", POINTS[:4])
    data = (tmp_path / "whole.npy").read_bytes()
    folder = write_scene(tmp_path, "a.npy")
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
        load_scene(write_scene(tmp_path, "a.npy"))
    assert not (tmp_path / "harm").exists()


def make_npy(header, body=bytes(96), version=1):
    return (
        b"\x93NUMPY"
        + bytes((version, 0))
        + struct.pack("<H" if version < 2 else "<I", len(header))
        + header
        + body
    )


@pytest.mark.parametrize(
    ("header", "reason"),
    [
        # NumPy's reader raises TokenError, OverflowError, TypeError, IndexError and others for these
        (b"{'descr': '<f8', 'fortran_order': False, 'shape': (3, 4), ", "not an .npy header"),
        (b"{'descr': '<f8', 'fortran_order': False, 'shape': (3, 4)}}", "not an .npy header"),
        (b"{'descr': '<f8', 'fortran_order': False, 'shape': (3, -4)}", "not an .npy header"),
        (b"{'descr': '<f8', 'fortran_order': False, 'shape': 12}", "not an .npy header"),
        (b"{'descr': '<f8', 'fortran_order': False}", "not an .npy header"),
        (b"{'descr': '<f8', 'fortran_order': None, 'shape': (3, 4)}", "not an .npy header"),
        (b"{'descr': '<f8', 'descr': '<f8', 'shape': (3, 4)}", "not an .npy header"),
        (b"[" * 3000, "not an .npy header"),
        (b"'" * 11_000, "expected an .npy header of up to 10000 bytes, got 11000"),
        (b"{'descr': [('a', '<f8')], 'fortran_order': False, 'shape': (3, 4)}", "not an .npy header"),
        (b"{'descr': '|O', 'fortran_order': False, 'shape': (3, 4)}", "pickles"),
        (b"{'descr': '<f3', 'fortran_order': False, 'shape': (3, 4)}", "expected a plain type"),
        (b"{'descr': 'i4,i4', 'fortran_order': False, 'shape': (3, 4)}", "expected a plain type"),
        (b"{'descr': '<U0', 'fortran_order': False, 'shape': (9999999999,)}", "expected a plain type"),
        (
            b"{'descr': '<f8', 'fortran_order': False, 'shape': (3, 5)}",
            r"truncated: \(3, 5\) float64 takes 120",
        ),
        (b"{'descr': '<f8', 'fortran_order': False, 'shape': (4294967296, 4294967296)}", "truncated"),
        (b"{'descr': '<f8', 'fortran_order': False, 'shape': (0, 999999999999999999)}", "truncated"),
        (b"{'descr': '<f8', 'fortran_order': False, 'shape': (" + b"1, " * 70 + b")}", "shape: "),
        (b"{'descr': '<U9999', 'fortran_order': False, 'shape': (1,)}", "truncated"),
    ],
)
def test_wrong_npy_headers(tmp_path, header, reason):
    (tmp_path / "a.npy").write_bytes(make_npy(header))
    with pytest.raises(FileFormatError, match=rf"a\.npy: .*{reason}"):
        read_npy(tmp_path / "a.npy", Budget(10**9))


@pytest.mark.parametrize(
    "header",
    [
        b"{'descr': '<f8', 'fortran_order': False, 'shape': (3, 4), }          \n",
        b'{"shape": (3L, 4L), "descr": "<f8", "fortran_order": False}',
        b"{'descr':'<f8','fortran_order':False,'shape':(3,4)}",
    ],
)
@pytest.mark.parametrize("version", [1, 2, 3])
def test_npy_headers_of_other_writers(tmp_path, header, version):
    want = np.arange(12.0).reshape(3, 4)
    (tmp_path / "a.npy").write_bytes(make_npy(header, want.tobytes(), version))
    np.testing.assert_array_equal(read_npy(tmp_path / "a.npy", Budget(1000)), want)


@pytest.mark.parametrize(
    "kind", ["<f2", ">f4", "<f8", "|u1", ">u2", "<i8", "|b1", "<c16", "<U3", "|S2", "<M8[ns]"]
)
def test_npy_arrays_come_back_as_numpy_reads_them(tmp_path, kind):
    for shape, order in product([(), (0,), (0, 3), (4,), (2, 3), (2, 3, 4)], "CF"):
        array = np.asarray(np.arange(np.prod(shape, dtype=int)).reshape(shape).astype(kind), order=order)
        np.save(tmp_path / "a.npy", array)
        read = read_npy(tmp_path / "a.npy", Budget(10_000))
        assert (read.dtype, read.shape) == (array.dtype, shape)
        np.testing.assert_array_equal(read, np.load(tmp_path / "a.npy"))


def test_an_array_that_does_not_fit_the_limit_is_not_read(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros(1000))
    with pytest.raises(
        FileFormatError, match=r"a\.npy: takes 8000 bytes, but 7999 are left of max_bytes=7999"
    ):
        read_npy(tmp_path / "a.npy", Budget(7999))


def rewrite(path, change, method=zipfile.ZIP_DEFLATED):
    """Rewrite an archive; `change` returns the new bytes of each member, or None to drop it."""
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()} | change
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, data in members.items():
            if data is not None:
                archive.writestr(name, data)


def test_other_members_are_not_read(tmp_path):
    save_npz(tmp_path / "a.npz")
    members = {"other.npy": b"no array", "notes.txt": b"", "poses_true.npy": bytes(10**8)}
    rewrite(tmp_path / "a.npz", members)
    assert len(load_scene(tmp_path / "a.npz", max_bytes=100_000).views) == 2


def test_the_size_of_a_member_is_checked_before_decoding(tmp_path):
    save_npz(tmp_path / "a.npz")
    out = io.BytesIO()
    np.save(out, np.zeros((2, 2500, 10_000), dtype=np.uint16))
    rewrite(tmp_path / "a.npz", {"depth.npy": out.getvalue()})
    assert (tmp_path / "a.npz").stat().st_size < 200_000
    with pytest.raises(FileFormatError, match=r"a\.npz: depth: takes 100000000 bytes, .* max_bytes=1000000$"):
        load_scene(tmp_path / "a.npz", max_bytes=1_000_000)
    # a small array, followed by many bytes
    np.save(out := io.BytesIO(), np.stack([DEPTH, DEPTH]))
    rewrite(tmp_path / "a.npz", {"depth.npy": out.getvalue() + bytes(10**8)})
    with pytest.raises(FileFormatError, match=r"a\.npz: depth: expected 192 bytes after .* got 100000192"):
        load_scene(tmp_path / "a.npz", max_bytes=1_000_000)


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_archives_compressed_in_another_way_are_refused(tmp_path, method):
    save_npz(tmp_path / "a.npz")
    rewrite(tmp_path / "a.npz", {}, method)
    with pytest.raises(FileFormatError, match=r"a\.npz: \w+: encrypted, or compressed by a method") as caught:
        load_scene(tmp_path / "a.npz")
    assert caught.value.file == str(tmp_path / "a.npz")
    assert caught.value.place in ("depth", "depth_scale", "K", "poses")


def test_every_bit_of_a_member_counts(tmp_path):
    save_npz(tmp_path / "whole.npz")
    rewrite(tmp_path / "whole.npz", {}, zipfile.ZIP_STORED)
    data = (tmp_path / "whole.npz").read_bytes()
    for name in ("depth", "K", "poses"):
        start = data.index(f"{name}.npy".encode()) + len(name) + 4
        for at in (start, start + 7, start + 60, start + 128, start + 150):
            (tmp_path / "a.npz").write_bytes(data[:at] + bytes([data[at] ^ 4]) + data[at + 1 :])
            with pytest.raises(FileFormatError, match=rf"a\.npz: {name}: "):
                load_scene(tmp_path / "a.npz")


def test_an_archive_with_an_endless_directory_is_refused(tmp_path):
    size = 2 << 20
    end = b"PK\5\6" + struct.pack("<4H2LH", 0, 0, 1, 1, size, 0, 0)
    (tmp_path / "a.npz").write_bytes(bytes(size) + end)
    with pytest.raises(FileFormatError, match=r"a\.npz: .*directory of more than 1048576 bytes"):
        load_scene(tmp_path / "a.npz")
    (tmp_path / "a.npz").write_bytes(b"PK\5\6" + bytes(18))
    with pytest.raises(FileFormatError, match="missing depth, depth_scale, K, poses"):
        load_scene(tmp_path / "a.npz")
