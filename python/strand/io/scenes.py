"""Recorded scenes: `.npz` archives, folders with a `scene.toml`, and single files of one view."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strand.io.budget import MAX_BYTES, Budget
from strand.io.images import read_color
from strand.io.npy import Archive
from strand.io.point_cloud import PointCloud
from strand.io.scene_description import Description, parse_description
from strand.io.single_view import KnownCamera, read_single_view
from strand.io.view_files import SUFFIXES, read_mask, read_view_file, require_one_each
from strand.support.checks import Array, check_finite_array, check_integer, check_sequence
from strand.support.files import TOML_BYTES, FileFormatError, read_toml
from strand.views.box import Bounds, extraction_range
from strand.views.view import View

_TRUTH = re.compile(r"truth_[0-9]{1,9}")
# bytes of a view beside its arrays, and of each pixel's depth (float64), mask (int32) and colours (3 float64)
_VIEW, _DEPTH, _MASK, _COLOUR = 4096, 8, 4, 24


@dataclass(frozen=True, eq=False)
class Scene:
    """Views of ropes, and what is known about them.

    Attributes
    ----------
    name : str
        What to call it.
    views : tuple of View
        What the cameras saw.
    bounds : pair of (3,) ndarray, Box, or None
        The extraction range in the world frame, metres: low and high corner, or a box that is turned; None:
        everything.
    radius : float or None
        The ropes' radius, metres; None: not known.
    truth : tuple of (M, 3) ndarray
        The true centrelines in the world frame, metres, where they are known.
    files : tuple of Path
        What it was read from.
    """

    name: str
    views: tuple[View, ...]
    bounds: Bounds | None
    radius: float | None
    truth: tuple[Array, ...] = ()
    files: tuple[Path, ...] = ()


def load_scene(
    path: str | os.PathLike[str],
    masks: Sequence[str | os.PathLike[str]] | None = None,
    *,
    viewpoint: ArrayLike | None = None,
    camera_frame: bool = False,
    intrinsics: ArrayLike | None = None,
    depth_scale: float | None = None,
    max_bytes: int = MAX_BYTES,
    outside: bool = False,
) -> Scene:
    """Read a scene: an `.npz` file, a folder with a `scene.toml`, or a single file of one view.

    The `.npz` holds `depth` (V, H, W) uint16 in units of `depth_scale` metres, 0 where there is no
    return, the pinhole matrix `K` (3, 3) and the camera-to-world `poses` (V, 4, 4); optionally the
    extraction range `box` (2, 3), `radius`, `name`, the true centrelines `truth_0`, `truth_1`, ..., and, for
    each pixel of the depths, the colour images `color` (V, H, W, 3) uint8 and the masks `mask` (V, H, W),
    bools or labels.

    The `scene.toml` names one file a view and says how it was taken:

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
        origin = [0.5, 0.1, 0]         # optional: the range is a box with a frame of its own, whose pose is
        angles_deg = [0, 0, 30]        # given as a view's is

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
        turntable_deg = 30             # the plate's angle, see `strand.turntable_pose`

    A view's file is a depth image: a single-channel 16-bit PNG, or a TIFF of 16-bit whole numbers or 32-bit
    floats; or points in the camera frame: PLY, PCD, or text with x, y, z and perhaps red, green, blue
    (`.xyz`, `.xyzrgb`, `.csv`, `.txt`); or an NPY file with either. Whole numbers of depth are in units of
    `depth_scale`, floats are metres. Floats of an NPY file three columns wide are points, and six columns
    wide points with their colours. Pixels and points that are not finite are dropped and counted in
    `View.dropped`. A mask is a single-channel PNG of 1, 8 or 16 bits or an NPY file: 0 is no rope, every
    other number a rope or a piece of one.

    One such file alone is a scene of one view. Points need to be told where they were seen from: `viewpoint`
    or `camera_frame`, unless a PCD file's header has a VIEWPOINT that is not the origin. Depth images need
    `intrinsics`, and `depth_scale` if they hold whole numbers; the world frame is the camera's then.

    Parameters
    ----------
    path : str or path-like
        The `.npz` file, the folder, its `scene.toml`, or the single file.
    masks : sequence of str or path-like, optional
        Mask files, one for each view, in place of the scene's own. These may be anywhere.
    viewpoint : (3,) array_like, optional
        Of a single file of points in the world frame: where the camera was, metres.
    camera_frame : bool
        That a single file's points are in the camera frame: x right, y down, z forward.
    intrinsics : (3, 3) array_like, optional
        Of a single depth image: the pinhole matrix, pixels.
    depth_scale : float, optional
        Of a single depth image: metres for each unit. Floats without it are metres.
    max_bytes : int
        How many bytes the arrays of the files, and the views that are made of them, may take together; 4 GiB
        if not given. It is asked before anything is decoded.
    outside : bool
        Whether a `scene.toml` may name files, or links to files, outside of its folder.

    Returns
    -------
    Scene

    Raises
    ------
    FileNotFoundError
        If the file, the folder or a view's file does not exist.
    OSError
        If one cannot be read: a folder, for example, or a link to itself.
    strand.FileFormatError
        If a file is empty, truncated or not what it should be; takes more than `max_bytes`; is no regular
        file, or is outside of the scene's folder. `file`, `place` and `reason` say which, where, and why.
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If `masks` does not hold one for each view, `max_bytes` is not positive, what a single file needs is
        not given, or something is given that the scene says itself.
    ImportError
        If reading an image (or, on Python 3.10, TOML) needs a package that is not installed.
    """
    path = Path(path)
    given = None if masks is None else [Path(one) for one in check_sequence("masks", masks, "paths")]
    budget = Budget(check_integer("max_bytes", max_bytes, 1))
    camera = KnownCamera(viewpoint, camera_frame, intrinsics, depth_scale)
    suffix = path.suffix.lower()
    if suffix in SUFFIXES and not path.is_dir():
        view = read_single_view(path, camera, given, budget)
        return Scene(path.stem, (view,), None, None, files=(path, *(given or ())))
    camera.refuse(f"only of a single file of points or depth; {path} says it itself")
    if path.is_dir():
        return _load_description(path / "scene.toml", given, budget, outside)
    if suffix == ".toml":
        return _load_description(path, given, budget, outside)
    if suffix == ".npz" or not path.exists():
        return _load_archive(path, given, budget)
    raise FileFormatError(
        path, f"expected a folder with a scene.toml, or a .toml, .npz, {', '.join(SUFFIXES)} file"
    )


def _load_archive(path: Path, masks: Sequence[Path] | None, budget: Budget) -> Scene:
    with Archive(path, budget) as archive:
        wanted = {"depth", "depth_scale", "K", "poses", "box", "radius", "name", "color", "mask"}
        if masks is not None:
            wanted.remove("mask")
        names = [name for name in archive.names if name in wanted or _TRUTH.fullmatch(name)]
        arrays = {name: archive.read(name) for name in names}
    depth = arrays.get("depth", np.empty(0))
    if depth.ndim == 3:
        colour = _COLOUR if "color" in arrays else 0
        budget.take(path, len(depth) * _VIEW + depth.size * (_DEPTH + _MASK + colour), "depth")
    if masks is not None and depth.ndim == 3:
        require_one_each(masks, len(depth))
        labels = [read_mask(one, image.shape, budget) for one, image in zip(masks, depth, strict=True)]
        arrays["mask"] = np.array(labels, dtype=np.int32).reshape(depth.shape)
    try:
        return replace(_archived_scene(path.stem, arrays), files=(path, *(masks or ())))
    except (TypeError, ValueError) as error:
        raise FileFormatError.from_error(path, error) from error


def _archived_scene(name: str, arrays: dict[str, NDArray[Any]]) -> Scene:
    missing = [key for key in ("depth", "depth_scale", "K", "poses") if key not in arrays]
    if missing:
        raise ValueError(f"missing {', '.join(missing)}")
    depth, poses = arrays["depth"], arrays["poses"]
    if depth.dtype != np.uint16 or depth.ndim != 3:
        raise ValueError(f"depth: expected (V, H, W) uint16, got {depth.shape} {depth.dtype}")
    if not len(depth):
        raise ValueError("depth: expected at least one image")
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
        box = extraction_range(tuple(check_finite_array("box", arrays["box"], (2, 3))))
        bounds = box.low, box.high
    radius = _scalar("radius", arrays["radius"]) if "radius" in arrays else None
    truths = sorted((key for key in arrays if _TRUTH.fullmatch(key)), key=lambda key: int(key[6:]))
    truth = tuple(check_finite_array(key, arrays[key], ("N", 3)) for key in truths)
    if "name" in arrays:
        name = _text("name", arrays["name"])
    return Scene(name, views, bounds, radius, truth)


def _text(name: str, array: NDArray[Any]) -> str:
    if array.shape != () or array.dtype.kind != "U":
        raise ValueError(f"{name}: expected one text, got {array.shape} {array.dtype}")
    text = str(array)
    text.encode()  # halves of characters cannot be printed
    return text


def _scalar(name: str, array: NDArray[Any]) -> float:
    if array.shape != () or array.dtype.kind not in "iuf":
        raise ValueError(f"{name}: expected one positive number, got {array.shape} {array.dtype}")
    number = float(array)
    if not 0 < number < np.inf:
        raise ValueError(f"{name}: expected one positive number, got {number}")
    return number


def _load_description(path: Path, masks: Sequence[Path] | None, budget: Budget, outside: bool) -> Scene:
    table = read_toml(path, min(TOML_BYTES, budget.max_bytes))
    try:
        description = parse_description(table)
    except (TypeError, ValueError, OverflowError, RecursionError) as error:
        raise FileFormatError.from_error(path, error) from error
    recorded = description.views
    if masks is not None:
        require_one_each(masks, len(recorded))
        recorded = tuple(replace(view, mask=None) for view in recorded)
    # where a link to a description points to is no matter: files are beside the link
    folder = None if outside else Path(os.path.realpath(path.parent))
    views, files = [], [path]
    for i, view in enumerate(recorded):
        own = {key: _own_file(path, f"view {i}.{key}", name, folder) for key, name in view.files.items()}
        if masks is not None:
            own["mask"] = masks[i]
        views.append(_load_view(own, view.pose, description, budget))
        files += own.values()
    name = description.name or Path(os.path.realpath(path)).parent.name
    return Scene(name, tuple(views), description.bounds, description.radius, files=tuple(files))


def _own_file(description: Path, place: str, name: str, folder: Path | None) -> Path:
    """Return the path of a file that a description names, inside of a folder if there is one.

    Raises
    ------
    strand.FileFormatError
        If the file, or what it links to, is outside.
    """
    file = description.parent / name
    if folder is not None and folder not in Path(os.path.realpath(file)).parents:
        reason = f"{name} is outside of the scene's folder; outside=True (--outside) allows that"
        raise FileFormatError(description, reason, place)
    return file


def _load_view(files: Mapping[str, Path], pose: Array, description: Description, budget: Budget) -> View:
    path = files["file"]
    seen = read_view_file(path, budget)
    colors = read_color(files["color"], budget) if "color" in files else None
    try:
        if isinstance(seen, PointCloud):
            budget.take(path, _VIEW + seen.numbers * _DEPTH)
            for key, what in (("color", "colour images"), ("mask", "masks")):
                if key in files:
                    raise ValueError(f"{key}: only depth images have {what}")
            return seen.make_view(pose)
        budget.take(path, _VIEW + seen.size * (_DEPTH if colors is None else _DEPTH + _COLOUR))
        scale = None
        if seen.dtype == np.uint16:
            if description.depth_scale is None:
                raise ValueError("a 16-bit depth image needs depth_scale in the [camera] table")
            scale = description.depth_scale
        if description.intrinsics is None:
            raise ValueError("a depth image needs a [camera] table with fx, fy, cx, cy")
        mask = read_mask(files["mask"], seen.shape, budget) if "mask" in files else None
        return View.from_depth(seen, description.intrinsics, pose, colors, depth_scale=scale, mask=mask)
    except FileFormatError:  # the mask's, which names it
        raise
    except (TypeError, ValueError) as error:
        raise FileFormatError.from_error(path, error) from error
