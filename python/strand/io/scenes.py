"""Load scenes from `.npz` archives, folders with a `scene.toml`, and single files of one view."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strand.io.budget import MAX_BYTES, Budget
from strand.io.npy import Archive, Declared
from strand.io.point_cloud import PointCloud
from strand.io.recordings.bags import SUFFIXES as RECORDED
from strand.io.scene_description import Description, parse_description
from strand.io.single_view import KnownCamera, read_single_view
from strand.io.view_files import SUFFIXES, collect_given, read_images, read_view_file, require_one_each
from strand.support.checks import (
    Array,
    check_bool,
    check_finite_array,
    check_integer,
    check_numbers,
    check_path,
    check_stamp,
)
from strand.support.files import TOML_BYTES, FileFormatError, read_toml
from strand.views.box import Bounds, make_box
from strand.views.view import View

_TRUTH = re.compile(r"truth_[0-9]{1,9}")
_SCALARS = ("depth_scale", "radius")  # arrays of one number
# arrays of images beside the depth: the letters of their types, and these in words
_IMAGES = {
    "color": ("B", "uint8"),
    "mask": ("?bBhHiIlLqQ", "of bools or whole numbers"),
    "occluders": ("?bBhHiIlLqQ", "of bools or whole numbers"),
}
_COPIED = 9  # bytes of an element of other arrays that is checked: a float64 and a bool
_PICTURES = (".jpg", ".jpeg", ".bmp", ".ppm", ".webp")  # suffixes of images without depth
_MAX_NAME = 1 << 16  # longest name, bytes


@dataclass(frozen=True, eq=False)
class Scene:
    """Views of ropes, and known facts about the ropes.

    Attributes
    ----------
    name : str
    views : tuple of View
    bounds : pair of (3,) ndarray, Box, or None
        The extraction range in the world frame, metres: low and high corner, or a turned box. None if not
        given.
    radius : float or None
        The ropes' radius, metres; None if not given.
    truth : tuple of (M, 3) ndarray
        The true centrelines in the world frame, metres, if known.
    files : tuple of Path
        All files that were read.
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
    colors: Sequence[str | os.PathLike[str]] | None = None,
    occluders: Sequence[str | os.PathLike[str]] | None = None,
    viewpoint: ArrayLike | None = None,
    camera_frame: bool = False,
    intrinsics: ArrayLike | None = None,
    depth_scale: float | None = None,
    max_bytes: int = MAX_BYTES,
    outside: bool = False,
) -> Scene:
    """Read a scene: an `.npz` file, a folder with a `scene.toml`, or a single file of one view.

    An `.npz` file must have these arrays:

    - `depth` (V, H, W) uint16, in units of `depth_scale` metres, 0 without a return
    - `depth_scale`, a positive number
    - `K` (3, 3), the pinhole matrix
    - `poses` (V, 4, 4), camera to world

    It may have `color` (V, H, W, 3) uint8, `mask` (V, H, W) of bools or labels, `occluders` (V, H, W) of
    bools or whole numbers, `stamps` (V,) in seconds, the extraction range `box` (2, 3), `radius`, `name`, and
    the true centrelines `truth_0`, `truth_1`, ...

    A `scene.toml` names the file and the pose of each view:

        name = "knot"                  # optional; default: the folder's name
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
        origin = [0.5, 0.1, 0]         # optional: pose of a turned box, in the keys of a view's pose
        angles_deg = [0, 0, 30]

        [turntable]                    # for views with turntable_deg
        angles_deg = [-140, 0, 90]     # camera pose at angle 0, as in a view
        origin = [0.4, 0.0, 0.45]
        center = [0, 0, 0]             # optional: a point of the turning axis
        axis = [0, 0, 1]               # optional: its direction

        [[view]]
        file = "view0.png"
        color = "view0_color.png"      # optional: a colour image of the depth image's size
        mask = "view0_mask.png"        # optional: the ropes' pixels; 0 is no rope
        occluders = "view0_robot.png"  # optional: the robot's or a hand's pixels; 0 is none
        stamp = 12.5                   # optional: when it was taken, seconds
        pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.5], [0, 0, 0, 1]]    # camera to world

        [[view]]
        file = "view1.ply"
        angles_deg = [-140, 0, 90]     # R_x R_y R_z (eq. 4-9)
        origin = [0.4, 0.0, 0.45]

        [[view]]
        file = "view2.npy"
        turntable_deg = 30             # the plate's angle, see `strand.turntable_pose`

    The file of a view is one of:

    - a depth image: a single-channel 16-bit PNG, or a TIFF of 16-bit whole numbers or 32-bit floats
    - points in the camera frame: PLY, PCD, or text (`.xyz`, `.xyzrgb`, `.csv`, `.txt`)
    - an NPY file: floats in 3 columns are points, in 6 columns points with colours, any others a depth image

    Depths of whole numbers are in units of `depth_scale`, floats in metres. Pixels and points that are not
    finite are dropped and counted in `View.dropped`. A mask is a single-channel PNG of 1, 8 or 16 bits, or an
    NPY file; 0 is no rope, and any other number labels a rope or a piece of one.

    A single file is a scene of one view. Points need `viewpoint` or `camera_frame`, unless a PCD file has a
    VIEWPOINT other than the origin. A depth image needs `intrinsics`, and `depth_scale` for whole numbers;
    its camera frame becomes the world frame.

    Parameters
    ----------
    path : str or path-like
        The `.npz` file, the folder, its `scene.toml`, or the single file.
    masks : sequence of str or path-like, optional
        One mask file for each view, instead of the scene's masks. They may be in any folder.
    colors, occluders : sequence of str or path-like, optional
        The same of colour images and of occluders, which are files as masks are: not 0 is an occluder.
    viewpoint : (3,) array_like, optional
        For a single file of points in the world frame: the camera's position, metres.
    camera_frame : bool
        For a single file of points: whether they are in the camera frame (x right, y down, z forward).
    intrinsics : (3, 3) array_like, optional
        For a single depth image: the pinhole matrix, pixels.
    depth_scale : float, optional
        For a single depth image: metres per unit. Floats are metres by default.
    max_bytes : int
        Memory limit for the files' arrays and the views together, bytes; 4 GiB by default. strand checks it
        before it decodes anything.
    outside : bool
        Whether a `scene.toml` may name files, or links to files, outside of its folder.

    Returns
    -------
    Scene

    Raises
    ------
    FileNotFoundError
        If a file or the folder does not exist.
    OSError
        If a file cannot be read.
    strand.FileFormatError
        If a file is empty, truncated, of the wrong format, above `max_bytes`, not a regular file, or
        outside of the scene's folder. `file`, `place` and `reason` say which, where and why.
    TypeError
        If an argument is of the wrong type.
    ValueError
        If there is not one mask, colour image or occluder file for each view, `max_bytes` is not positive, a
        single file needs an argument that is missing, or an argument repeats a fact that the scene gives
        itself.
    ImportError
        If a package that reads images (or TOML, on Python 3.10) is not installed.
    """
    path, outside = check_path("path", path), check_bool("outside", outside)
    given = collect_given(masks=masks, colors=colors, occluders=occluders)
    budget = Budget(check_integer("max_bytes", max_bytes, 1))
    camera = KnownCamera(viewpoint, camera_frame, intrinsics, depth_scale)
    suffix = path.suffix.lower()
    if suffix in SUFFIXES and not path.is_dir():
        view = read_single_view(path, camera, given, budget)
        return Scene(
            path.stem, (view,), None, None, files=(path, *(one for files in given.values() for one in files))
        )
    if not path.is_dir() and suffix not in (".toml", ".npz") and path.exists():
        picture = f"a {suffix[1:].upper()} image holds colours but no depth; " if suffix in _PICTURES else ""
        raise FileFormatError(
            path,
            f"{picture}expected a folder with a scene.toml, or a .toml, .npz, {', '.join(SUFFIXES)} file; "
            f"recordings are {', '.join(RECORDED)} files, folders of ROS 2 bags, or LeRobot data sets",
        )
    camera.refuse(f"accepted only for a single file of points or depth; {path} has its own cameras")
    if path.is_dir():
        return _load_description(path / "scene.toml", given, budget, outside)
    if suffix == ".toml":
        return _load_description(path, given, budget, outside)
    return _load_archive(path, given, budget)


def _load_archive(path: Path, given: Mapping[str, Sequence[Path]], budget: Budget) -> Scene:
    with Archive(path, budget.max_bytes) as archive:
        wanted = {*_SCALARS, *_IMAGES, "depth", "K", "poses", "stamps", "box", "name"} - set(given)
        names = [name for name in archive.names if name in wanted or _TRUTH.fullmatch(name)]
        declared = {name: archive.declare(name) for name in names}
        try:
            _check_declared(declared)
        except ValueError as error:
            raise FileFormatError.from_error(path, error) from error
        depth = declared["depth"]
        for name, one in declared.items():
            if name in _IMAGES:
                budget.take_image(path, name, depth.size)
            elif name != "depth":
                budget.take(path, _COPIED * one.size, name)
            budget.take(path, one.nbytes, name)
        require_one_each(given, depth.shape[0])
        views, pixels = depth.shape[0], prod(depth.shape[1:])
        with budget.hold_view(path, pixels, views, "depth"):
            arrays = {name: archive.read(name) for name in names}
            images: list[dict[str, Any]] = [
                read_images({key: files[i] for key, files in given.items()}, depth.shape[1:], budget)
                for i in range(views)
            ]
            try:
                made = _make_scene(path.stem, arrays, images)
            except (TypeError, ValueError) as error:
                raise FileFormatError.from_error(path, error) from error
    return replace(made, files=(path, *(one for files in given.values() for one in files)))


def _check_declared(declared: Mapping[str, Declared]) -> None:
    """Raise ValueError unless the arrays of an archive have the shapes and types of a scene."""
    missing = [key for key in ("depth", "depth_scale", "K", "poses") if key not in declared]
    if missing:
        raise ValueError(f"missing {', '.join(missing)}")
    depth = declared["depth"]
    if depth.dtype != np.uint16 or depth.ndim != 3:
        raise ValueError(f"depth: expected (V, H, W) uint16, got {depth.shape} {depth.dtype}")
    if not depth.shape[0]:
        raise ValueError("depth: expected at least one image")
    views = depth.shape[0]
    shapes = {"poses": (views, 4, 4), "K": (3, 3), "stamps": (views,), "box": (2, 3)}
    shapes |= dict.fromkeys(_SCALARS, ())
    for name, one in declared.items():
        if name in _IMAGES:
            shape = (*depth.shape, 3) if name == "color" else depth.shape
            kinds, what = _IMAGES[name]
            if one.shape != shape or one.dtype.char not in kinds:
                raise ValueError(f"{name}: expected {shape} {what}, got {one.shape} {one.dtype}")
        elif name in shapes and one.shape != shapes[name]:
            raise ValueError(f"{name}: expected {shapes[name]}, got {one.shape}")
        elif name == "name" and one.nbytes > _MAX_NAME:
            raise ValueError(f"name: expected at most {_MAX_NAME} bytes, got {one.nbytes}")


def _make_scene(name: str, arrays: dict[str, NDArray[Any]], images: list[dict[str, Any]]) -> Scene:
    """Return the scene of an archive's arrays, and of the images that the caller gives for each view."""
    scale = _parse_scalar("depth_scale", arrays["depth_scale"])
    for key in _IMAGES:
        for own, array in zip(images, arrays.get(key, ()), strict=False):
            own["colors" if key == "color" else key] = array
    if "stamps" in arrays:
        stamps = check_numbers("stamps", arrays["stamps"]).tolist()
        for k, (own, stamp) in enumerate(zip(images, stamps, strict=True)):
            own["stamp"] = check_stamp(f"stamps[{k}]", stamp)
    views = tuple(
        View.from_depth(image, arrays["K"], pose, depth_scale=scale, **own)
        for image, pose, own in zip(arrays["depth"], arrays["poses"], images, strict=True)
    )
    bounds = None
    if "box" in arrays:
        box = make_box(tuple(check_finite_array("box", arrays["box"], (2, 3))))
        bounds = box.low, box.high
    radius = _parse_scalar("radius", arrays["radius"]) if "radius" in arrays else None
    truths = sorted((key for key in arrays if _TRUTH.fullmatch(key)), key=lambda key: int(key[6:]))
    truth = tuple(check_finite_array(key, arrays[key], ("N", 3)) for key in truths)
    if "name" in arrays:
        name = _parse_text("name", arrays["name"])
    return Scene(name, views, bounds, radius, truth)


def _parse_text(name: str, array: NDArray[Any]) -> str:
    if array.shape != () or array.dtype.kind != "U":
        raise ValueError(f"{name}: expected one text, got {array.shape} {array.dtype}")
    text = str(array)
    text.encode()  # raises ValueError for lone surrogates, which cannot be printed
    return text


def _parse_scalar(name: str, array: NDArray[Any]) -> float:
    if array.shape != () or array.dtype.kind not in "iuf":
        raise ValueError(f"{name}: expected one positive number, got {array.shape} {array.dtype}")
    number = float(array)
    if not 0 < number < np.inf:
        raise ValueError(f"{name}: expected one positive number, got {number}")
    return number


def _load_description(
    path: Path, given: Mapping[str, Sequence[Path]], budget: Budget, outside: bool
) -> Scene:
    table = read_toml(path, min(TOML_BYTES, budget.max_bytes))
    try:
        description = parse_description(table)
    except (TypeError, ValueError, OverflowError, RecursionError) as error:
        raise FileFormatError.from_error(path, error) from error
    require_one_each(given, len(description.views))
    nothing: dict[str, Any] = dict.fromkeys(given)
    recorded = tuple(replace(view, **nothing) for view in description.views)
    # files are beside the description; if it is a link, beside the link
    folder = None if outside else Path(os.path.realpath(path.parent))
    views, files = [], [path]
    for i, view in enumerate(recorded):
        own = {key: _find_file(path, f"view {i}.{key}", name, folder) for key, name in view.files.items()}
        own.update({key: paths[i] for key, paths in given.items()})
        views.append(_load_view(own, view.pose, view.stamp, description, budget))
        files += own.values()
    name = description.name or Path(os.path.realpath(path)).parent.name
    return Scene(name, tuple(views), description.bounds, description.radius, files=tuple(files))


def _find_file(description: Path, place: str, name: str, folder: Path | None) -> Path:
    """Return the path of a file that a description names; refuse files and links outside of `folder`."""
    file = description.parent / name
    if folder is not None and folder not in Path(os.path.realpath(file)).parents:
        reason = f"{name} is outside of the scene's folder; outside=True (--outside) allows that"
        raise FileFormatError(description, reason, place)
    return file


def _load_view(
    files: Mapping[str, Path], pose: Array, stamp: float | None, description: Description, budget: Budget
) -> View:
    path = files["file"]
    seen = read_view_file(path, budget)
    try:
        if isinstance(seen, PointCloud):
            for key, what in (("color", "colour images"), ("mask", "masks"), ("occluders", "occluders")):
                if key in files:
                    raise ValueError(f"{key}: only depth images have {what}")
            with budget.hold_cloud(path, seen.numbers):
                return seen.make_view(pose, stamp)
        scale = None
        if seen.dtype == np.uint16:
            if description.depth_scale is None:
                raise ValueError("a 16-bit depth image needs depth_scale in the [camera] table")
            scale = description.depth_scale
        if description.intrinsics is None:
            raise ValueError("a depth image needs a [camera] table with fx, fy, cx, cy")
        with budget.hold_view(path, seen.size):
            images = read_images(files, seen.shape, budget)
            return View.from_depth(
                seen, description.intrinsics, pose, depth_scale=scale, stamp=stamp, **images
            )
    except FileFormatError:  # names the image already
        raise
    except (TypeError, ValueError) as error:
        raise FileFormatError.from_error(path, error) from error
