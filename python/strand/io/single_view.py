"""A single file of one view: a point cloud or a depth image, and what its caller knows of the camera."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from strand.io.budget import Budget
from strand.io.point_cloud import PointCloud
from strand.io.view_files import read_mask, read_view_file, require_one_each
from strand.support.checks import Array, check_bool, check_intrinsics, check_positive, check_small_array
from strand.support.files import FileFormatError
from strand.views.view import View

# bytes of a view beside its arrays, and of each number of them
_VIEW, _NUMBER = 4096, 8


@dataclass(frozen=True, eq=False)
class KnownCamera:
    """What is known of the camera that made a file, as `strand.load_scene` takes it.

    Attributes
    ----------
    viewpoint : (3,) array_like or None
        Where it stood, metres; points are in the world frame then.
    camera_frame : bool
        Whether points are in its frame.
    intrinsics : (3, 3) array_like or None
        Its pinhole matrix, pixels.
    depth_scale : float or None
        Metres for each unit of its depth image.
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
                    "viewpoint: points are in the world frame or in the camera frame, not in both"
                )
        if self.intrinsics is not None:
            check_intrinsics("intrinsics", self.intrinsics)
        if self.depth_scale is not None:
            check_positive("depth_scale", self.depth_scale)

    def refuse(self, reason: str, *names: str) -> None:
        """Raise a ValueError with a reason if one of some fields is given; of any if none is named."""
        for name in names or [field.name for field in fields(self)]:
            value = getattr(self, name)
            if value is not None and value is not False:
                raise ValueError(f"{name}: {reason}")


def read_single_view(path: Path, camera: KnownCamera, masks: Sequence[Path] | None, budget: Budget) -> View:
    """Return the view of a single file.

    Raises
    ------
    strand.FileFormatError
        If the file or the mask is not what it should be, or takes more than the budget.
    ValueError
        If something is needed that is not known, or something is known that such a file does not have.
    """
    seen = read_view_file(path, budget)
    if isinstance(seen, PointCloud):
        viewpoint = _viewpoint_of(path, seen, camera, masks)
        budget.take(path, _VIEW + _NUMBER * seen.numbers)
        with _named(path):
            return seen.make_view(np.eye(4)) if viewpoint is None else seen.make_view_from(viewpoint)
    camera.refuse(f"{path} is a depth image, which is in its camera's frame", "viewpoint", "camera_frame")
    if camera.intrinsics is None:
        raise ValueError(
            f"intrinsics: {path} is a depth image, which needs its camera's pinhole matrix: give intrinsics "
            "(--intrinsics fx,fy,cx,cy)"
        )
    if seen.dtype == np.uint16 and camera.depth_scale is None:
        raise ValueError(
            f"depth_scale: {path} holds whole numbers, which do not say their unit: give depth_scale "
            "(--depth-scale), 0.001 for millimetres"
        )
    mask = None
    if masks is not None:
        require_one_each(masks, 1)
        mask = read_mask(masks[0], seen.shape, budget)
    budget.take(path, _VIEW + _NUMBER * seen.size)
    with _named(path):
        return View.from_depth(seen, camera.intrinsics, depth_scale=camera.depth_scale, mask=mask)


def _viewpoint_of(
    path: Path, seen: PointCloud, camera: KnownCamera, masks: Sequence[Path] | None
) -> Array | None:
    """(3,) Where the points of a file were seen from; None: they are in the camera's frame."""
    camera.refuse(f"{path} holds points, not a depth image", "intrinsics", "depth_scale")
    if masks is not None:
        raise ValueError(f"masks: {path} holds points, and only depth images have masks")
    if camera.camera_frame:
        return None
    if camera.viewpoint is not None:
        return check_small_array("viewpoint", camera.viewpoint, (3,))
    if seen.viewpoint is None:
        raise ValueError(
            f"viewpoint: {path} does not say from where its points were seen: give viewpoint "
            "(--viewpoint x,y,z) if they are in the world frame, or camera_frame=True (--camera-frame) if "
            "they are in the camera's: x right, y down, z forward"
        )
    return seen.viewpoint


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Name the file in what is wrong with its numbers."""
    try:
        yield
    except (TypeError, ValueError) as error:
        raise FileFormatError.from_error(path, error) from error
