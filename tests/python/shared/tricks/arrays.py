"""Tricks with NPY files and NPZ archives."""

from __future__ import annotations

import io
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

import strand
from shared.scene_files import CAMERA, IDENTITY, K, save_png, write_scene
from shared.tricks import MAX_BYTES, Trick

MAX_SCENE = 1 << 32  # default limit of a scene, bytes
Make = Callable[[], bytes]


def list_tricks() -> list[Trick]:
    """Return the tricks with arrays."""
    large, huge = (declare_later((1, side, 17_500), "<u2") for side in (3000, 16_000))
    small = (1, 300, 300)
    colored = {
        "depth": declare_later(small, "<u2"),
        "color": declare_later((*small, 3), "|u1"),
        "mask": declare_later(small, "<i8"),
        "occluders": declare_later(small, "|b1"),
    }
    truths = {f"truth_{i}": declare_later((0, 3), "<f2") for i in range(9000)}
    return [
        _try_archive("npz of 50 million pixels", {"depth": large}),
        _try_archive("npz of 280 million pixels at the default limit", {"depth": huge}, MAX_SCENE),
        _try_archive("npz within the limit", {"depth": declare_later((1, 700, 700), "<u2")}, answered=True),
        _try_archive("npz of colours within the limit", colored, answered=True),
        _try_archive("npz of 64-bit masks", {"mask": declare_later((1, 5000, 5000), "<i8")}),
        _try_archive("npz of a long truth", {"truth_0": declare_later((2_500_000, 3), "<f2")}),
        _try_archive("npz of many truths", truths, answered=True),
        _try_archive("npz of a long name", {"name": declare_later((), "<U4000000")}),
        _try_archive("npz of large poses", {"poses": declare_later((1_000_000, 4, 4), "<f8")}),
        _try_archive("npz of a tail", {"K": lambda: declare((3, 3), "<f8") + bytes(10**8)}),
        Trick("npz of a directory", _write_directory, lambda folder: _read_archive(folder, MAX_BYTES)),
        _try_npy("npy of a million by a million", lambda: declare_header((10**6, 10**6), "<f8"), _read_depth),
        _try_npy("npy of half floats", declare_later((2000, 3000), "<f2"), _read_depth),
        _try_npy("npy of half floats within the limit", declare_later((500, 700), "<f2"), _read_depth, True),
        _try_npy("npy of points within the limit", declare_later((100_000, 3), "<f4"), _read_cloud, True),
        _try_npy("npy of half points", declare_later((2_500_000, 3), "<f2"), _read_cloud),
        Trick("npy as a mask", _write_mask, lambda folder: strand.load_scene(folder, max_bytes=MAX_BYTES)),
    ]


def _try_archive(
    name: str, members: dict[str, Make], max_bytes: int = MAX_BYTES, answered: bool = False
) -> Trick:
    return Trick(
        name,
        lambda folder: (folder / "a.npz").write_bytes(make_archive(members)),
        lambda folder: _read_archive(folder, max_bytes),
        answered,
    )


def _try_npy(name: str, make: Make, read: Callable[[Path], object], answered: bool = False) -> Trick:
    return Trick(name, lambda folder: (folder / "a.npy").write_bytes(make()), read, answered)


def _read_archive(folder: Path, max_bytes: int) -> object:
    return strand.load_scene(folder / "a.npz", max_bytes=max_bytes)


def _write_directory(folder: Path) -> None:
    end = struct.pack("<4H2LH", 0, 0, 1, 1, 1 << 30, 0, 0)
    (folder / "a.npz").write_bytes(bytes(2 << 20) + b"PK\5\6" + end)


def declare_later(shape: tuple[int, ...], kind: str) -> Make:
    """Return a function that makes an NPY file of zeros."""
    return lambda: declare(shape, kind)


def declare_header(shape: tuple[int, ...], kind: str) -> bytes:
    """Return the header of an NPY file."""
    out = io.BytesIO()
    np.lib.format.write_array_header_1_0(out, {"descr": kind, "fortran_order": False, "shape": shape})
    return out.getvalue()


def declare(shape: tuple[int, ...], kind: str) -> bytes:
    """Return an NPY file of zeros."""
    return declare_header(shape, kind) + bytes(int(np.prod(shape)) * np.dtype(kind).itemsize)


def make_archive(members: dict[str, Make]) -> bytes:
    """Return a scene of one view of 8 x 6 pixels, or others in its members, deflated."""
    whole = {
        "depth": declare_later((1, 6, 8), "<u2"),
        "depth_scale": lambda: _save(np.float64(0.001)),
        "K": lambda: _save(K),
        "poses": lambda: _save(np.eye(4)[None]),
    } | members
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, make in whole.items():
            archive.writestr(name + ".npy", make())
    return out.getvalue()


def _save(array: np.ndarray) -> bytes:
    out = io.BytesIO()
    np.save(out, array)
    return out.getvalue()


def _read_depth(folder: Path) -> object:
    return strand.load_scene(folder / "a.npy", intrinsics=np.eye(3), max_bytes=MAX_BYTES)


def _read_cloud(folder: Path) -> object:
    return strand.load_scene(folder / "a.npy", camera_frame=True, max_bytes=MAX_BYTES)


def _write_mask(folder: Path) -> None:
    save_png(folder / "a.png")
    (folder / "m.npy").write_bytes(declare((3000, 5000), "|u1"))
    write_scene(folder, "a.png", CAMERA, IDENTITY + 'mask = "m.npy"\n')
