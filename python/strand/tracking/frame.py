"""The images of one time, as the kernel takes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import Array, check_number, check_sequence
from strand.views.depth_image import DepthImage
from strand.views.view import View

_LEAST_INTERVAL = 1e-3  # s between two frames: velocities of nearer ones are noise
_MOST_APART = 0.5  # s between the images of a frame


@dataclass(frozen=True, eq=False)
class Frame:
    """The views of one time.

    Attributes
    ----------
    time : float
        Time of the answer, that of the latest image, s.
    views : tuple of View or None
        One for each camera; None where a camera has no image, or in a past frame.
    times : tuple of float
        Time of each view, s.
    sizes : tuple of (int, int), or None
        Height and width of each camera's images, as far as they are known.
    masks : tuple of (H, W) ndarray of bool, or None
        The ropes' pixels of each view; None where they are not known.
    """

    time: float
    views: tuple[View | None, ...]
    times: tuple[float, ...]
    sizes: tuple[tuple[int, ...] | None, ...]
    masks: tuple[NDArray[np.bool_] | None, ...]

    @property
    def images(self) -> list[tuple[int, DepthImage, NDArray[np.bool_]]]:
        """Number, image and mask of each camera that has an image."""
        return [
            (i, view.image, mask)
            for i, (view, mask) in enumerate(zip(self.views, self.masks, strict=True))
            if view is not None and view.image is not None and mask is not None
        ]

    @property
    def given_views(self) -> list[View]:
        """The views of cameras that have an image, for a reconstruction."""
        return [view for view in self.views if view is not None]

    @property
    def is_masked(self) -> bool:
        """Whether all images came with a mask."""
        return all(view is None or view.mask is not None for view in self.views)

    def list_cameras(self, biases: Array) -> list[Any]:
        """Return the images as the kernel takes them; `biases` are the cameras' errors of depth, metres."""
        return [
            (
                image.depth,
                mask,
                image.occluders,
                tuple(image.camera),
                image.pose,
                self.times[i] - self.time,
                float(biases[i]),
            )
            for i, image, mask in self.images
        ]


def check_frame(views: Sequence[View | None], time: Any, last: Frame | None, interval: float) -> Frame:
    """Return the frame of some views, after checking them against the last frame.

    `interval` is the time between frames without times, s.
    """
    if isinstance(views, View):
        raise TypeError("views: expected a sequence of View, got a single View")
    given = check_sequence("views", views, "View or None")
    if not given:
        raise ValueError("views: expected at least one view, got none")
    for i, view in enumerate(given):
        if view is None:
            continue
        if not isinstance(view, View):
            raise TypeError(f"views[{i}]: expected a View or None, got {type(view).__name__}")
        if view.image is None:
            raise ValueError(f"views[{i}]: expected a view of a depth image, got one of points")
    if last is not None:
        if len(given) != len(last.views):
            raise ValueError(
                f"views: expected {len(last.views)} cameras as in earlier frames, got {len(given)}; "
                "a camera without an image is None"
            )
        for i, (view, size) in enumerate(zip(given, last.sizes, strict=True)):
            if view is not None and size is not None and _size(view) != size:
                raise ValueError(
                    f"views[{i}]: expected an image of {size} pixels as in earlier frames, got {_size(view)}"
                )
    times = _check_times(time, given, last, interval)
    latest = max(times)
    if last is not None and not latest >= last.time + _LEAST_INTERVAL:
        raise ValueError(
            f"time: expected a time after {last.time:.15g} s, that of the last frame, by "
            f"{_LEAST_INTERVAL:g} s or more, got {latest:.15g}"
        )
    for i, (view, at) in enumerate(zip(given, times, strict=True)):
        if view is not None and latest - at > _MOST_APART:
            raise ValueError(
                f"time[{i}]: expected times within {_MOST_APART:g} s of each other, got {at:.15g} and "
                f"{latest:.15g}"
            )
        if view is not None and last is not None and last.views[i] is not None and at <= last.times[i]:
            raise ValueError(f"time[{i}]: expected a time after {last.times[i]:.15g} s, got {at:.15g}")
    masks = tuple(
        None if view is None or view.image is None or view.mask is None else np.ascontiguousarray(view.mask)
        for view in given
    )
    known = (None,) * len(given) if last is None else last.sizes
    sizes = tuple(size if view is None else _size(view) for view, size in zip(given, known, strict=True))
    return Frame(latest, tuple(given), times, sizes, masks)


def make_past_frame(time: float, cameras: int) -> Frame:
    """Return a frame of which only the time is known."""
    return Frame(time, (None,) * cameras, (time,) * cameras, (None,) * cameras, (None,) * cameras)


def _size(view: View) -> tuple[int, ...]:
    assert view.image is not None
    return view.image.depth.shape


def _check_times(
    time: Any, views: Sequence[View | None], last: Frame | None, interval: float
) -> tuple[float, ...]:
    count = len(views)
    if time is None:
        stamps = [None if view is None else view.stamp for view in views]
        latest = max((stamp for stamp in stamps if stamp is not None), default=None)
        if latest is None:
            latest = 0.0 if last is None else last.time + interval
        return tuple(latest if stamp is None else stamp for stamp in stamps)
    if np.ndim(time) == 0:
        return (check_number("time", time),) * count
    times = check_sequence("time", time, "a number for each view")
    if len(times) != count:
        raise ValueError(f"time: expected one time, or one for each of {count} views, got {len(times)}")
    return tuple(check_number(f"time[{i}]", one) for i, one in enumerate(times))
