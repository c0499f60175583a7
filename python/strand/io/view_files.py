"""Read the file of one view, a depth image or a point cloud, by its suffix."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.io.budget import Budget
from strand.io.images import read_color, read_depth_png, read_depth_tiff, read_mask_png
from strand.io.npy import read_npy
from strand.io.pcd import read_pcd
from strand.io.ply import read_ply
from strand.io.point_cloud import PointCloud, scale_colors
from strand.io.xyz import read_xyz
from strand.support.checks import check_mask, check_occluders, check_path, check_sequence
from strand.support.files import FileFormatError

_KEYS = {"masks": "mask", "colors": "color", "occluders": "occluders"}  # a view's key by the argument's name


def read_view_file(path: Path, budget: Budget) -> NDArray[Any] | PointCloud:
    """Return a point cloud, or an (H, W) depth image: uint16 in the file's unit or floats in metres."""
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise FileFormatError(path, f"expected a {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]} file")
    return reader(path, budget)


def collect_given(**given: Sequence[str | os.PathLike[str]] | None) -> dict[str, list[Path]]:
    """Return the files that the caller gives for each view, by the key of a view: mask, color, occluders."""
    return {
        _KEYS[name]: [check_path(name, one) for one in check_sequence(name, files, "paths")]
        for name, files in given.items()
        if files is not None
    }


def require_one_each(given: Mapping[str, Sequence[Path]], views: int) -> None:
    """Raise ValueError unless there is one file of each kind for each view."""
    for name, key in _KEYS.items():
        if key in given and len(given[key]) != views:
            raise ValueError(f"{name}: expected one file for each of {views} views, got {len(given[key])}")


def read_images(files: Mapping[str, Path], shape: tuple[int, ...], budget: Budget) -> dict[str, Any]:
    """Return the mask, the colours and the occluders of a depth image, as `View.from_depth` takes them."""
    images: dict[str, Any] = {}
    pixels = prod(shape)
    if "color" in files:
        images["colors"] = read_color(files["color"], budget, shape)
        budget.take_image(files["color"], "color", pixels)
    for key, check in (("mask", check_mask), ("occluders", check_occluders)):
        if key in files:
            images[key] = _read_pixels(files[key], shape, budget, key, check)
            budget.take_image(files[key], key, pixels)
    return images


def _read_pixels(
    path: Path,
    shape: tuple[int, ...],
    budget: Budget,
    key: str,
    check: Callable[[str, NDArray[Any], tuple[int, ...]], NDArray[Any]],
) -> NDArray[Any]:
    """Return the (H, W) pixels of a mask file as a check returns them; errors name the file and the key."""
    if path.suffix.lower() == ".npy":
        pixels = read_npy(path, budget, shape, key)
    else:
        pixels = read_mask_png(path, budget, shape, key)
    try:
        return check(key, pixels, shape)
    except (TypeError, ValueError) as error:
        raise FileFormatError.from_error(path, error) from error


def _read_depth_or_points(path: Path, budget: Budget) -> NDArray[Any] | PointCloud:
    """Return the content of an NPY file: floats in 3 or 6 columns are points, in 6 with colours."""
    array = read_npy(path, budget)
    if array.ndim != 2 or not (array.dtype.kind == "f" or array.dtype == np.uint16):
        raise FileFormatError(
            path,
            "expected a depth image (H, W) of floats or uint16, or points (N, 3) of floats, or (N, 6) with "
            f"colours, got {array.shape} {array.dtype}",
        )
    if array.dtype == np.uint16 or array.shape[1] not in (3, 6):
        return array
    try:
        return PointCloud(array[:, :3], scale_colors(array[:, 3:], False) if array.shape[1] == 6 else None)
    except ValueError as error:
        raise FileFormatError.from_error(path, error) from error


_READERS = {
    ".png": read_depth_png,
    ".tif": read_depth_tiff,
    ".tiff": read_depth_tiff,
    ".npy": _read_depth_or_points,
    ".ply": read_ply,
    ".pcd": read_pcd,
    **dict.fromkeys((".xyz", ".xyzrgb", ".csv", ".txt"), read_xyz),
}
SUFFIXES = tuple(_READERS)  # suffixes of files that hold one view
