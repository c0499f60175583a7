"""Files in and out: writing that is whole or not at all, JSON, TOML, and scenes of depth data."""

from __future__ import annotations

import contextlib
import errno
import importlib
import json
import os
import re
import secrets
import sys
import zipfile
import zlib
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand._core import StrandError
from strand.scene import Description, Scene, parse_description
from strand.view import Array, View, extraction_range, finite_array

PNG_COLOURS = {0: "grey", 2: "RGB", 3: "palette", 4: "grey and alpha", 6: "RGB and alpha"}
PLY_VERTICES = re.compile(rb"^element\s+vertex\s+(\d+)\s*$", re.MULTILINE)


class FileFormatError(StrandError, ValueError):
    """A file is truncated, or not what it should be."""


def extra(module: str) -> Any:
    """Import a package that only some uses need.

    Parameters
    ----------
    module : str
        Its import name, such as "PIL.Image".

    Raises
    ------
    ImportError
        If it is not installed; the message says how to install it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = {"PIL": "pillow"}.get(module.split(".")[0], module.split(".")[0])
        raise ImportError(f'{package} is needed here: pip install ".[cli]" installs it') from error


def write_bytes(path: str | os.PathLike[str], data: bytes) -> None:
    """Write a file whole or not at all.

    The bytes go to a temporary file in the same folder, which then takes the file's place: nobody
    sees half a file, and one that exists stays as it was if anything fails.

    Parameters
    ----------
    path : str or path-like
        The file; one that exists is replaced, through links.
    data : bytes
        Its content.

    Raises
    ------
    OSError
        If the file cannot be written, or `path` is something other than a file.
    """
    target = Path(path).resolve()
    if target.exists() and not target.is_file():
        raise OSError(errno.EINVAL, "Not a regular file", str(path))
    temporary = target.with_name(f".strand-{secrets.token_hex(8)}.tmp")
    try:
        with open(temporary, "xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, target)
    except BaseException as error:
        with contextlib.suppress(OSError):
            temporary.unlink()
        if isinstance(error, OSError):  # said of the temporary file
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise


def write_json(path: str | os.PathLike[str], value: object) -> None:
    """Write a JSON file whole or not at all.

    Parameters
    ----------
    path : str or path-like
        The file; one that exists is replaced.
    value : object
        Dictionaries, lists, text, numbers, booleans and None.

    Raises
    ------
    TypeError
        If something in `value` has no form in JSON.
    ValueError
        If a number is NaN or infinite, which JSON cannot say.
    OSError
        If the file cannot be written.
    """
    try:
        text = json.dumps(value, allow_nan=False)
    except ValueError as error:
        raise ValueError(f"{path}: cannot be written as JSON ({error})") from error
    write_bytes(path, text.encode() + b"\n")


def read_json(path: str | os.PathLike[str]) -> Any:
    """Read a JSON file.

    Parameters
    ----------
    path : str or path-like
        The file.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    strand.FileFormatError
        If it is truncated or not JSON, or says NaN or Infinity.
    """
    data = Path(path).read_bytes()
    try:
        return json.loads(data, parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise FileFormatError(f"{path}: truncated, or not JSON ({error})") from error


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is not JSON")


def read_toml(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read a TOML file.

    Parameters
    ----------
    path : str or path-like
        The file.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    strand.FileFormatError
        If it is truncated or not TOML.
    ImportError
        On Python 3.10, which has no TOML reader, if the package tomli is not installed.
    """
    toml = extra("tomllib" if sys.version_info >= (3, 11) else "tomli")
    data = Path(path).read_bytes()
    try:
        content: dict[str, Any] = toml.loads(data.decode())
    except ValueError as error:
        raise FileFormatError(f"{path}: truncated, or not TOML ({error})") from error
    return content


def load_scene(path: str | os.PathLike[str]) -> Scene:
    """Read a scene: an `.npz` file, or a folder with a `scene.toml`.

    The `.npz` holds `depth` (V, H, W) uint16 in units of `depth_scale` metres, 0 where there is no
    return, the pinhole matrix `K` (3, 3) and the camera-to-world `poses` (V, 4, 4); optionally the
    extraction range `box` (2, 3), `radius`, `name`, the colour images `color` (V, H, W, 3) uint8 that belong
    to the depths pixel by pixel, and the true centrelines `truth_0`, `truth_1`, ...

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
    `View.dropped`.

    Parameters
    ----------
    path : str or path-like
        The `.npz` file, the folder, or its `scene.toml`.

    Returns
    -------
    Scene

    Raises
    ------
    FileNotFoundError
        If the file, the folder or a view's file does not exist.
    strand.FileFormatError
        If a file is empty, truncated or not what it should be; the message names the file.
    ImportError
        If reading a PNG or PLY file (or, on Python 3.10, TOML) needs a package that is not installed.
    """
    path = Path(path)
    if path.is_dir():
        return _load_description(path / "scene.toml")
    if path.suffix.lower() == ".toml":
        return _load_description(path)
    if path.suffix.lower() == ".npz" or not path.exists():
        return _load_archive(path)
    raise FileFormatError(f"{path}: expected a folder with a scene.toml, a .toml or an .npz file")


def _load_archive(path: Path) -> Scene:
    data = _content(path)
    if not zipfile.is_zipfile(BytesIO(data)):
        raise FileFormatError(f"{path}: truncated, or not an .npz file")
    try:
        with np.load(BytesIO(data), allow_pickle=False) as archive:
            arrays = {key: archive[key] for key in archive.files}
    except (ValueError, EOFError, OSError, zipfile.BadZipFile, zlib.error) as error:
        raise FileFormatError(f"{path}: truncated, or not an .npz file ({error})") from error
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
    views = tuple(
        View.from_depth(image * scale, arrays["K"], pose, color)
        for image, pose, color in zip(depth, poses, colors, strict=True)
    )
    bounds = None
    if "box" in arrays:
        bounds = extraction_range(tuple(finite_array("box", arrays["box"], (2, 3))))
    radius = _scalar("radius", arrays["radius"]) if "radius" in arrays else None
    truths = sorted((key for key in arrays if re.fullmatch(r"truth_\d+", key)), key=lambda key: int(key[6:]))
    truth = tuple(finite_array(key, arrays[key], (None, 3)) for key in truths)
    return Scene(str(arrays.get("name", name)), views, bounds, radius, truth)


def _scalar(name: str, array: NDArray[Any]) -> float:
    if array.shape != () or array.dtype.kind not in "iuf" or not (np.isfinite(array) and array > 0):
        raise ValueError(f"{name}: expected one positive number, got {array}")
    return float(array)


def _load_description(path: Path) -> Scene:
    table = read_toml(path)
    try:
        description = parse_description(table)
    except (TypeError, ValueError) as error:
        raise FileFormatError(f"{path}: {error}") from error
    views = tuple(
        _load_view(path.parent / file, pose, description, None if color is None else path.parent / color)
        for file, pose, color in description.views
    )
    name = description.name or path.resolve().parent.name
    return Scene(name, views, description.bounds, description.radius)


def _load_view(path: Path, pose: Array, description: Description, color: Path | None) -> View:
    readers = {".png": _read_png, ".npy": _read_npy, ".ply": _read_ply}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise FileFormatError(f"{path}: expected a .png, .ply or .npy file")
    array = reader(path, _content(path))
    colors = None if color is None else _read_color(color, _content(color))
    try:
        if array.dtype == np.uint16:
            if description.depth_scale is None:
                raise ValueError("a 16-bit depth image needs depth_scale in the [camera] table")
            array = array * description.depth_scale
        elif array.shape[1] == 3:
            if colors is not None:
                raise ValueError("color: only depth images have colour images")
            finite = np.isfinite(array).all(axis=1)
            return View(array[finite], pose, int((~finite).sum()))
        if description.intrinsics is None:
            raise ValueError("a depth image needs a [camera] table with fx, fy, cx, cy")
        return View.from_depth(array, description.intrinsics, pose, colors)
    except (TypeError, ValueError) as error:
        raise FileFormatError(f"{path}: {error}") from error


def _content(path: Path) -> bytes:
    data = path.read_bytes()
    if not data:
        raise FileFormatError(f"{path}: the file is empty")
    return data


def _read_png(path: Path, data: bytes) -> NDArray[Any]:
    """(H, W) uint16 of a single-channel 16-bit PNG."""
    pillow = extra("PIL.Image")
    if data[:8] != b"\x89PNG\r\n\x1a\n" or data[12:16] != b"IHDR" or len(data) < 26:
        raise FileFormatError(f"{path}: truncated, or not a PNG file")
    # Pillow shortens some 16-bit images to 8 bits without saying so, hence the look at the header
    bits, colour = data[24], data[25]
    if (bits, colour) != (16, 0):
        kind = PNG_COLOURS.get(colour, "unknown")
        raise FileFormatError(f"{path}: expected a 16-bit single-channel depth PNG, got {bits}-bit {kind}")
    try:
        with pillow.open(BytesIO(data), formats=["PNG"]) as image:
            image.verify()
        with pillow.open(BytesIO(data), formats=["PNG"]) as image:
            return np.asarray(image).astype(np.uint16)
    except Exception as error:  # Pillow has an error of its own kind for every way to be damaged
        raise FileFormatError(f"{path}: truncated or damaged PNG ({error})") from error


def _read_color(path: Path, data: bytes) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 of a colour image in any format that Pillow reads."""
    pillow = extra("PIL.Image")
    try:
        with pillow.open(BytesIO(data)) as image:
            return np.asarray(image.convert("RGB"), dtype=np.uint8)
    except Exception as error:  # Pillow has an error of its own kind for every way to be damaged
        raise FileFormatError(f"{path}: truncated, or not a colour image ({error})") from error


def _read_npy(path: Path, data: bytes) -> NDArray[Any]:
    """(H, W) uint16, or (H, W) or (N, 3) of floats."""
    try:
        array = np.lib.format.read_array(BytesIO(data), allow_pickle=False)
    except (ValueError, EOFError, OSError, MemoryError) as error:
        raise FileFormatError(f"{path}: truncated, or not an .npy file ({error})") from error
    if array.ndim != 2 or not (array.dtype.kind == "f" or array.dtype == np.uint16):
        raise FileFormatError(
            f"{path}: expected a depth image (H, W) of floats or uint16, or points (N, 3) of floats, "
            f"got {array.shape} {array.dtype}"
        )
    return array


def _read_ply(path: Path, data: bytes) -> NDArray[Any]:
    """(N, 3) of floats, the vertices of a PLY file."""
    ply = extra("trimesh.exchange.ply")
    end = data.find(b"end_header")
    count = PLY_VERTICES.search(data[:end].replace(b"\r\n", b"\n")) if end >= 0 else None
    if count is None:
        raise FileFormatError(f"{path}: truncated, or not a PLY file with vertices")
    if int(count[1]) == 0:
        return np.empty((0, 3))
    try:
        vertices = ply.load_ply(BytesIO(data), fix_texture=False, skip_materials=True)["vertices"]
    except Exception as error:  # the reader has an error of its own kind for every way to be damaged
        raise FileFormatError(f"{path}: truncated or damaged PLY ({error})") from error
    # of an ASCII file that ends too early the reader returns what there is, with ragged rows as objects
    if vertices.shape != (int(count[1]), 3) or vertices.dtype == object:
        raise FileFormatError(f"{path}: truncated, fewer than {int(count[1])} whole vertices")
    if vertices.dtype.kind != "f":
        raise FileFormatError(f"{path}: expected vertices with float or double x, y and z")
    return np.asarray(vertices)
