"""Masks of ropes for frames that have none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from strand.reconstruction.finding.ropes import NoRopeError, find_ropes
from strand.views.box import Bounds, Box, make_box
from strand.views.depth_image import DepthImage
from strand.views.view import View, check_views, masked


def mask_ropes(
    views: Sequence[View], radius: float | Sequence[float] | None = None, bounds: Bounds | None = None
) -> tuple[View, ...]:
    """Return views whose depth images have masks, as a tracker needs them.

    Without any mask, `strand.find_ropes` finds the ropes; where it finds none, the masks are empty. Without a
    table, all pixels with depth show ropes. Masks end at the bounds.

    Parameters
    ----------
    views : sequence of View
        The views of one time.
    radius : float or sequence of float, optional
        The ropes' radius or radii, metres.
    bounds : pair of (3,) array_like, or Box, optional
        The extraction range, world frame, metres.

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If there are no views, a view has no depth image, the radius is not positive or the bounds are no box.
    """
    views = check_views(views)
    box = None if bounds is None else make_box(bounds)
    images = [_get_image(f"views[{i}]", view) for i, view in enumerate(views)]
    masks = [image.labels for image in images]
    if all(mask is None for mask in masks):
        masks = _find_masks(views, radius, box)
    shown = []
    for view, image, mask in zip(views, images, masks, strict=True):
        labels = image.depth > 0 if mask is None else mask
        if box is not None:
            labels = labels * _show_inside(image, box)
        shown.append(view if labels is image.labels else masked(view, replace(image, labels=labels)))
    return tuple(shown)


def _get_image(name: str, view: View) -> DepthImage:
    if view.image is None:
        raise ValueError(f"{name}: expected a view of a depth image, got one of points")
    return view.image


def _find_masks(
    views: Sequence[View], radius: float | Sequence[float] | None, box: Box | None
) -> list[NDArray[np.int32] | NDArray[np.bool_] | None]:
    """Return the mask of each view; None for a view that shows no table."""
    try:
        found = find_ropes(views, radius, box).views
    except NoRopeError:
        return [np.zeros(view.image.depth.shape, dtype=np.bool_) for view in views if view.image is not None]
    return [None if view.image is None else view.image.labels for view in found]


def _show_inside(image: DepthImage, box: Box) -> NDArray[np.bool_]:
    """Return (H, W) the pixels whose points are inside a box."""
    rows, columns = np.nonzero(image.depth > 0)
    inside = np.zeros(image.depth.shape, dtype=np.bool_)
    inside[rows, columns] = box.holds(image.lift(rows, columns, image.depth[rows, columns]))
    return inside
