"""A depth image: a camera's depths, its pinhole, its pose, and the pixels of ropes and of occluders."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

import strand._core as _core
from strand.support.checks import Array, check_float_array, check_positive, to_array
from strand.support.lazy import lazy_property
from strand.views.pinhole import Pinhole, Pixels
from strand.views.pose import moved

_MIN_STRIP = 1.5  # pixels from a strip's middle to its edge
_MAX_UINT16 = float(np.iinfo(np.uint16).max)
_NEAREST = 1e-3  # metres from the camera: occluders count as this near, so that they hide all behind


@dataclass(frozen=True, eq=False)
class DepthImage:
    """A checked depth image and its camera. Its arrays are read-only.

    Attributes
    ----------
    depth : (H, W) ndarray
        Depth along the camera's z axis, metres; 0 where there is no return.
    camera : Pinhole
    pose : (4, 4) ndarray
        Camera to world.
    labels : (H, W) ndarray of int32 or bool, or None
        Where the ropes are: 0 is no rope, every other number a rope or a piece of one. None: anywhere.
    colors : (H, W, 3) ndarray of uint8, or None
        The colour of each pixel, with or without depth.
    occluders : (H, W) ndarray of bool, or None
        Pixels of the robot or a hand: no rope, without depth, and not seen through. None: no pixel.
    """

    depth: Array
    camera: Pinhole
    pose: Array
    labels: NDArray[np.int32] | NDArray[np.bool_] | None = None
    colors: NDArray[np.uint8] | None = None
    occluders: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        for array in (self.depth, self.labels, self.colors, self.occluders):
            if array is not None:
                array.setflags(write=False)

    @lazy_property
    def mask(self) -> NDArray[np.bool_]:
        """(H, W) The ropes' pixels: those that have a label, all if there are no labels; never occluders."""
        if self.labels is None:
            everywhere = np.ones(self.depth.shape, dtype=np.bool_)
            return everywhere if self.occluders is None else ~self.occluders
        mask = self.labels.astype(np.bool_, copy=False)
        return mask if self.occluders is None else mask & ~self.occluders

    @property
    def rope_depth(self) -> Array:
        """(H, W) The depths of the ropes' pixels, metres; 0 elsewhere."""
        return self.depth if self.labels is None else np.where(self.mask, self.depth, 0.0)

    @property
    def blocked_depth(self) -> Array:
        """(H, W) The depths with occluders right before the camera, metres: what they hide is not free."""
        return self.depth if self.occluders is None else np.where(self.occluders, _NEAREST, self.depth)

    @lazy_property
    def mask_pixels(self) -> NDArray[np.intp]:
        """(N,) The numbers of the ropes' pixels, row by row."""
        return np.flatnonzero(self.mask)

    @lazy_property
    def mask_depths(self) -> Array:
        """(N,) The depths of the ropes' pixels, row by row, metres; 0 where there is no return."""
        return self.depth.take(self.mask_pixels)

    @lazy_property
    def distance(self) -> float:
        """The median depth of the ropes' pixels, metres; NaN if none has depth."""
        depths = self.mask_depths[self.mask_depths > 0]
        return _core.find_median(depths) if len(depths) else float("nan")

    @lazy_property
    def rope_mask(self) -> _core.RopeMask:
        """The ropes' pixels as kernels measure their radius."""
        return _core.RopeMask(self.mask)

    @lazy_property
    def mask_radius(self) -> float | None:
        """The ropes' radius in the image by the widths of the mask, pixels; None if it shows no rope."""
        return self.rope_mask.estimate_radius()

    @lazy_property
    def strip_middles(self) -> tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.int64]]:
        """The middles of the mask's strips, as `find_strip_middles` of the core returns them."""
        return _core.find_strip_middles(self.mask, _MIN_STRIP)

    def placed(self, pose: Array) -> DepthImage:
        """Return the image with another pose, (4, 4), camera to world; with its own it is the same object."""
        return self if pose is self.pose else replace(self, pose=pose)

    def list_seen(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the rows and columns (N,) of the ropes' pixels with depth, row by row."""
        rows, columns = np.divmod(self.mask_pixels[self.mask_depths > 0], self.mask.shape[1])
        return rows, columns

    def frame_mask(self, margin: int) -> tuple[slice, slice]:
        """Return the rows and columns at most `margin` pixels around the mask, which is not empty."""
        rows, columns = (np.flatnonzero(self.mask.any(axis=axis)) for axis in (1, 0))
        return (
            slice(max(int(rows[0]) - margin, 0), int(rows[-1]) + margin + 1),
            slice(max(int(columns[0]) - margin, 0), int(columns[-1]) + margin + 1),
        )

    def cropped(self, window: tuple[slice, slice]) -> DepthImage:
        """Return the image of some rows and columns."""
        labels = None if self.labels is None else self.labels[window].copy()
        occluders = None if self.occluders is None else self.occluders[window].copy()
        camera = self.camera.magnified(1, (float(window[1].start), float(window[0].start)))
        return DepthImage(self.depth[window].copy(), camera, self.pose, labels, None, occluders)

    def project(self, points: Array) -> Array:
        """Return the (N, 2) columns and rows of points (N, 3) of the world, pixels."""
        return self.camera.project((points - self.pose[:3, 3]) @ self.pose[:3, :3])

    def find_pixels(self, points: Array) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
        """Return rows and columns (N,) of points (N, 3) of the world, and which of these are in the image."""
        columns, rows = np.rint(self.project(points)).astype(np.int64).T
        height, width = self.depth.shape
        return rows, columns, (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)

    def lift(self, rows: Pixels, columns: Pixels, z: Array) -> Array:
        """Return the points (..., 3) of the world that pixels show at depths z, metres."""
        return moved(self.camera.lift(rows, columns, z), self.pose)


def list_pixels(mask: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the rows and columns (N,) of a mask's pixels, row by row; NumPy's own search takes longer."""
    rows, columns = np.divmod(np.flatnonzero(mask), mask.shape[1])
    return rows, columns


def check_depth(
    depth: ArrayLike, depth_scale: float | None
) -> tuple[Array | NDArray[np.uint16], float | None]:
    """Return a depth image (H, W) and the metres of its units; None if they are metres.

    Only whole numbers of 16 bits keep their units.
    """
    image = to_array("depth", depth)
    if depth_scale is not None:
        scale = check_positive("depth_scale", depth_scale)
        if image.dtype == np.uint16 and image.ndim == 2 and np.isfinite(_MAX_UINT16 * scale):
            # images of messages start anywhere in a buffer
            return np.require(image, requirements=("C", "A")), scale
        if image.dtype.kind not in "fiu":
            raise TypeError(f"depth: expected numbers, got dtype {image.dtype}")
        given = image
        with np.errstate(over="ignore"):
            image = np.multiply(given, scale, dtype=np.float64)
        finite = np.isfinite(image)
        if not finite.all() and np.isfinite(given[~finite]).any():
            raise ValueError(
                f"depth: expected depths that are finite in metres, got up to {np.nanmax(given)} units"
            )
    elif image.dtype.kind in "iu":
        raise TypeError(
            f"depth: expected floating point numbers in metres, got dtype {image.dtype}; "
            "depth_scale= gives the metres of a unit, such as 0.001 for millimetres"
        )
    return check_float_array("depth", image, ("H", "W")), None


def list_points(points: ArrayLike, colors: ArrayLike | None) -> tuple[Array, ArrayLike | None, int]:
    """Return the finite points of an (H, W, 3) cloud, their colours, and the number of the others."""
    cloud = check_float_array("points", points, ("H", "W", 3))
    finite = np.isfinite(cloud).all(axis=2)
    if colors is not None:
        own = to_array("colors", colors)
        if own.shape != cloud.shape:
            raise ValueError(f"colors: expected the shape of the points {cloud.shape}, got {own.shape}")
        colors = own[finite]
    return cloud[finite], colors, int(np.count_nonzero(~finite))
