"""Make a view from one file, a point cloud or a depth image, and the caller's knowledge of the camera."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from strand.io.budget import Budget
from strand.io.point_cloud import PointCloud
from strand.io.view_files import read_images, read_view_file, require_one_each
from strand.support.checks import Array, check_bool, check_intrinsics, check_positive, check_small_array
from strand.support.files import FileFormatError
from strand.views.view import View


@dataclass(frozen=True, eq=False)
class KnownCamera:
    """The caller's knowledge of the camera that made a file: arguments of `strand.load_scene`.

    Attributes
    ----------
    viewpoint : (3,) array_like or None
        The camera's position, metres. If given, points are in the world frame.
    camera_frame : bool
        Whether points are in the camera frame.
    intrinsics : (3, 3) array_like or None
        The pinhole matrix, pixels.
    depth_scale : float or None
        Metres per unit of the depth image.
    """

    viewpoint: ArrayLike | None = None
    camera_frame: bool = False
    intrinsics: ArrayLike | None = None
    depth_scale: float | None = None

    def __post_init__(self) -> None:
        check_bool("camera_frame", self.camera_frame)
        if self.viewpoint is not None:
            check_small_array("viewpoint", self.viewpoint, (3,))
            if self.camera_frame:
                raise ValueError(
                    "viewpoint: expected either viewpoint (points in the world frame) or camera_frame=True, "
                    "got both"
                )
        if self.intrinsics is not None:
            check_intrinsics("intrinsics", self.intrinsics)
        if self.depth_scale is not None:
            check_positive("depth_scale", self.depth_scale)

    def refuse(self, reason: str, *names: str) -> None:
        """Raise a ValueError with the reason if one of the named fields is given; of all if none is named."""
        for name in names or [field.name for field in fields(self)]:
            value = getattr(self, name)
            if value is not None and value is not False:
                raise ValueError(f"{name}: {reason}")


def read_single_view(
    path: Path, camera: KnownCamera, given: Mapping[str, Sequence[Path]], budget: Budget
) -> View:
    """Return the view of a single file; ValueError names a missing or unsuitable argument."""
    seen = read_view_file(path, budget)
    if isinstance(seen, PointCloud):
        viewpoint = _find_viewpoint(path, seen, camera, given)
        with _name_file(path), budget.hold_cloud(path, seen.numbers):
            return seen.make_view(np.eye(4)) if viewpoint is None else seen.make_view_from(viewpoint)
    camera.refuse(f"{path} is a depth image, always in its camera's frame", "viewpoint", "camera_frame")
    if camera.intrinsics is None:
        raise ValueError(
            f"intrinsics: {path} is a depth image and needs the camera's pinhole matrix: give intrinsics "
            "(--intrinsics fx,fy,cx,cy)"
        )
    if seen.dtype == np.uint16 and camera.depth_scale is None:
        raise ValueError(
            f"depth_scale: {path} holds whole numbers in an unknown unit: give depth_scale (--depth-scale), "
            "0.001 for millimetres"
        )
    require_one_each(given, 1)
    with _name_file(path), budget.hold_view(path, seen.size):
        images = read_images({key: paths[0] for key, paths in given.items()}, seen.shape, budget)
        return View.from_depth(seen, camera.intrinsics, depth_scale=camera.depth_scale, **images)


def _find_viewpoint(
    path: Path, seen: PointCloud, camera: KnownCamera, given: Mapping[str, Sequence[Path]]
) -> Array | None:
    """Return the (3,) viewpoint of a file's points; None if they are in the camera frame."""
    camera.refuse(f"{path} holds points, not a depth image", "intrinsics", "depth_scale")
    for name, what in (("masks", "masks"), ("colors", "colour images"), ("occluders", "occluders")):
        if name.removesuffix("s") in given or name in given:
            raise ValueError(f"{name}: {path} holds points, and only depth images have {what}")
    if camera.camera_frame:
        return None
    if camera.viewpoint is not None:
        return check_small_array("viewpoint", camera.viewpoint, (3,))
    if seen.viewpoint is None:
        raise ValueError(
            f"viewpoint: {path} does not say where the camera was: give viewpoint (--viewpoint x,y,z) if the "
            "points are in the world frame, or camera_frame=True (--camera-frame) if they are in the camera "
            "frame: x right, y down, z forward"
        )
    return seen.viewpoint


@contextmanager
def _name_file(path: Path) -> Iterator[None]:
    """Convert errors about a file's numbers to FileFormatError, which names the file."""
    try:
        yield
    except FileFormatError:  # names the file already
        raise
    except (TypeError, ValueError) as error:
        raise FileFormatError.from_error(path, error) from error
