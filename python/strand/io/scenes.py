"""Recorded scenes: `.npz` archives and folders with a `scene.toml`."""

from __future__ import annotations

import os
import re
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.checks import Array, Bounds, extraction_range, finite_array, mask_array, several
from strand.files import FileFormatError, read_toml
from strand.io.description import Description, RecordedView, parse_description
from strand.io.readers import content, read_color, read_mask, read_npy, read_ply, read_png
from strand.view import View


@dataclass(frozen=True, eq=False)
class Scene:
    """Views of ropes, and what is known about them.

    Attributes
    ----------
    name : str
        What to call it.
    views : tuple of View
        What the cameras saw.
    bounds : pair of (3,) ndarray, or None
        Low and high corner of the extraction range in the world frame, metres; None: everything.
    radius : float or None
        The ropes' radius, metres; None: not known.
    truth : tuple of (M, 3) ndarray
        The true centrelines in the world frame, metres, where they are known.
    """

    name: str
    views: tuple[View, ...]
    bounds: Bounds | None
    radius: float | None
    truth: tuple[Array, ...] = ()


def load_scene(path: str | os.PathLike[str], masks: Sequence[str | os.PathLike[str]] | None = None) -> Scene:
    """Read a scene: an `.npz` file, or a folder with a `scene.toml`.

    The `.npz` holds `depth` (V, H, W) uint16 in units of `depth_scale` metres, 0 where there is no
    return, the pinhole matrix `K` (3, 3) and the camera-to-world `poses` (V, 4, 4); optionally the
    extraction range `box` (2, 3), `radius`, `name`, the true centrelines `truth_0`, `truth_1`, ..., and, for
    each pixel of the depths, the colour images `color` (V, H, W, 3) uint8 and the masks `mask` (V, H, W),
    bools or labels.

    The `scene.toml` names one file a view and says how it was taken:

    .. code-block:: toml

        name = "knot"                  # optional: the folder's name
        radius = "4.2mm"               # optional: number in metres, or text with mm, cm or m

        [camera]                       # for depth images
        fx = 384.0                     # pixels; an integer pixel is a pixel centre
        fy = 384.0
        cx = 159.5
        cy = 119.5
        depth_scale = 0.001            # metres per unit of a 16-bit image

        [extract]                      # optional: extraction range in the world frame, metres
        low = [-0.2, -0.2, 0.002]
        high = [0.2, 0.2, 0.1]

        [turntable]                    # for views with turntable_deg
        angles_deg = [-140, 0, 90]     # camera pose at angle 0, as in a view
        origin = [0.4, 0.0, 0.45]
        centre = [0, 0, 0]             # optional: a point of the turning axis
        axis = [0, 0, 1]               # optional: its direction

        [[view]]
        file = "view0.png"
        color = "view0_color.png"      # optional: a colour image of the depth image's size
        mask = "view0_mask.png"        # optional: where the ropes are in it; 0 is no rope
        pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.5], [0, 0, 0, 1]]    # camera to world

        [[view]]
        file = "view1.ply"
        angles_deg = [-140, 0, 90]     # R_x R_y R_z (eq. 4-9)
        origin = [0.4, 0.0, 0.45]

        [[view]]
        file = "view2.npy"
        turntable_deg = 30             # the plate's angle, see `strand.view.turntable_pose`

    A view's file is a single-channel 16-bit depth PNG; a PLY file, ASCII or binary, with points in
    the camera frame; or an NPY file with either a depth image, (H, W) of floats in metres or uint16
    in units of `depth_scale`, or points (N, 3) of floats in the camera frame. An array of floats
    three columns wide is points. Pixels and points that are not finite are dropped and counted in
    `View.dropped`. A mask is a single-channel PNG of 1, 8 or 16 bits or an NPY file: 0 is no rope, every
    other number a rope or a piece of one.

    Parameters
    ----------
    path : str or path-like
        The `.npz` file, the folder, or its `scene.toml`.
    masks : sequence of str or path-like, optional
        Mask files, one for each view, in place of the scene's own.

    Returns
    -------
    Scene

    Raises
    ------
    FileNotFoundError
        If the file, the folder or a view's file does not exist.
    strand.FileFormatError
        If a file is empty, truncated or not what it should be; the message names the file.
    TypeError
        If `masks` is not a sequence of paths.
    ValueError
        If it does not hold one for each view.
    ImportError
        If reading a PNG or PLY file (or, on Python 3.10, TOML) needs a package that is not installed.
    """
    path = Path(path)
    given = None if masks is None else [Path(one) for one in several("masks", masks, "paths")]
    if path.is_dir():
        return _load_description(path / "scene.toml", given)
    if path.suffix.lower() == ".toml":
        return _load_description(path, given)
    if path.suffix.lower() == ".npz" or not path.exists():
        return _load_archive(path, given)
    raise FileFormatError(f"{path}: expected a folder with a scene.toml, a .toml or an .npz file")


def _require_one_each(masks: Sequence[Path], views: int) -> None:
    if len(masks) != views:
        raise ValueError(f"masks: expected one file for each of {views} views, got {len(masks)}")


def _read_mask(path: Path, shape: tuple[int, int]) -> NDArray[np.int32]:
    """Return the mask of an image of a shape."""
    labels = read_mask(path, content(path))
    try:
        return mask_array("mask", labels, shape)
    except (TypeError, ValueError) as error:
        raise FileFormatError(f"{path}: {error}") from error


def _load_archive(path: Path, masks: Sequence[Path] | None) -> Scene:
    data = content(path)
    if not zipfile.is_zipfile(BytesIO(data)):
        raise FileFormatError(f"{path}: truncated, or not an .npz file")
    try:
        with np.load(BytesIO(data), allow_pickle=False) as archive:
            arrays = {key: archive[key] for key in archive.files}
    except (ValueError, EOFError, OSError, zipfile.BadZipFile, zlib.error) as error:
        raise FileFormatError(f"{path}: truncated, or not an .npz file ({error})") from error
    depth = arrays.get("depth", np.empty(0))
    if masks is not None and depth.ndim == 3:
        _require_one_each(masks, len(depth))
        labels = [_read_mask(one, image.shape) for one, image in zip(masks, depth, strict=True)]
        arrays["mask"] = np.array(labels, dtype=np.int32).reshape(depth.shape)
    try:
        return _archived_scene(path.stem, arrays)
    except (TypeError, ValueError) as error:
        raise FileFormatError(f"{path}: {error}") from error


def _archived_scene(name: str, arrays: dict[str, NDArray[Any]]) -> Scene:
    missing = [key for key in ("depth", "depth_scale", "K", "poses") if key not in arrays]
    if missing:
        raise ValueError(f"missing {', '.join(missing)}")
    depth, poses = arrays["depth"], arrays["poses"]
    if depth.dtype != np.uint16 or depth.ndim != 3:
        raise ValueError(f"depth: expected (V, H, W) uint16, got {depth.shape} {depth.dtype}")
    if poses.shape != (len(depth), 4, 4):
        raise ValueError(f"poses: expected {(len(depth), 4, 4)}, got {poses.shape}")
    scale = _scalar("depth_scale", arrays["depth_scale"])
    colors = [None] * len(depth)
    if "color" in arrays:
        images = arrays["color"]
        if images.shape != (*depth.shape, 3) or images.dtype != np.uint8:
            raise ValueError(f"color: expected {(*depth.shape, 3)} uint8, got {images.shape} {images.dtype}")
        colors = list(images)
    masks = [None] * len(depth)
    if "mask" in arrays:
        labels = arrays["mask"]
        if labels.shape != depth.shape or labels.dtype.kind not in "biu":
            raise ValueError(
                f"mask: expected {depth.shape} of bools or whole numbers, got {labels.shape} {labels.dtype}"
            )
        masks = list(labels)
    views = tuple(
        View.from_depth(image, arrays["K"], pose, color, depth_scale=scale, mask=mask)
        for image, pose, color, mask in zip(depth, poses, colors, masks, strict=True)
    )
    bounds = None
    if "box" in arrays:
        bounds = extraction_range(tuple(finite_array("box", arrays["box"], (2, 3))))
    radius = _scalar("radius", arrays["radius"]) if "radius" in arrays else None
    truths = sorted((key for key in arrays if re.fullmatch(r"truth_\d+", key)), key=lambda key: int(key[6:]))
    truth = tuple(finite_array(key, arrays[key], ("N", 3)) for key in truths)
    return Scene(str(arrays.get("name", name)), views, bounds, radius, truth)


def _scalar(name: str, array: NDArray[Any]) -> float:
    if array.shape != () or array.dtype.kind not in "iuf" or not (np.isfinite(array) and array > 0):
        raise ValueError(f"{name}: expected one positive number, got {array}")
    return float(array)


def _load_description(path: Path, masks: Sequence[Path] | None) -> Scene:
    table = read_toml(path)
    try:
        description = parse_description(table)
    except (TypeError, ValueError) as error:
        raise FileFormatError(f"{path}: {error}") from error
    recorded = description.views
    if masks is not None:
        _require_one_each(masks, len(recorded))
        # absolute, as the scene's own are relative to it
        recorded = tuple(
            replace(view, mask=str(mask.absolute())) for view, mask in zip(recorded, masks, strict=True)
        )
    views = tuple(_load_view(view, path.parent, description) for view in recorded)
    name = description.name or path.resolve().parent.name
    return Scene(name, views, description.bounds, description.radius)


def _load_view(recorded: RecordedView, folder: Path, description: Description) -> View:
    path, pose = folder / recorded.file, recorded.pose
    readers = {".png": read_png, ".npy": read_npy, ".ply": read_ply}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise FileFormatError(f"{path}: expected a .png, .ply or .npy file")
    array = reader(path, content(path))
    colors = None
    if recorded.color is not None:
        color = folder / recorded.color
        colors = read_color(color, content(color))
    try:
        if array.dtype == np.uint16:
            if description.depth_scale is None:
                raise ValueError("a 16-bit depth image needs depth_scale in the [camera] table")
            array = array * description.depth_scale
        elif array.shape[1] == 3:
            if colors is not None:
                raise ValueError("color: only depth images have colour images")
            if recorded.mask is not None:
                raise ValueError("mask: only depth images have masks")
            finite = np.isfinite(array).all(axis=1)
            return View(array[finite], pose, int((~finite).sum()))
        if description.intrinsics is None:
            raise ValueError("a depth image needs a [camera] table with fx, fy, cx, cy")
        mask = None if recorded.mask is None else _read_mask(folder / recorded.mask, array.shape)
        return View.from_depth(array, description.intrinsics, pose, colors, mask=mask)
    except FileFormatError:  # the mask's, which names it
        raise
    except (TypeError, ValueError) as error:
        raise FileFormatError(f"{path}: {error}") from error
