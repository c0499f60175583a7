"""Labels and colours of ropes, as masks and images show them along each chain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from strand.ropes.chain import Chain
from strand.support.checks import Array
from strand.views.depth_image import DepthImage
from strand.views.view import View

_REACH = 1.5  # radii from the axis: coloured points there are the rope's
_BEFORE = 4.0  # radii: what is so much nearer than a node hides it


def find_label(chain: Chain, views: Sequence[View]) -> int | None:
    """Return the label that most nodes of a chain have in the views' masks; None without labels.

    Parameters
    ----------
    chain : Chain
    views : sequence of View
        Not cropped, in the frame of the chain. Masks of bools have no labels.
    """
    found = [np.empty(0, dtype=np.int64)]
    for view in views:
        image = view.image
        if image is not None and image.labels is not None and image.labels.dtype != np.bool_:
            rows, columns, _ = _find_pixels(image, chain)
            found.append(image.labels[rows, columns].astype(np.int64))
    labels = np.concatenate(found)
    labels = labels[labels != 0]
    if not len(labels):
        return None
    values, counts = np.unique(labels, return_counts=True)
    return int(values[counts.argmax()])


def find_color(chain: Chain, views: Sequence[View]) -> Array | None:
    """Return the (3,) median colour along a chain, from 0 to 1; None if no view shows its colour."""
    found = [np.empty((0, 3))]
    for view in views:
        image = view.image
        if image is not None and image.colors is not None:
            rows, columns, depth = _find_pixels(image, chain)
            seen = image.depth[rows, columns]
            shown = image.mask[rows, columns] & ~((seen > 0) & (seen < depth - _BEFORE * chain.radius))
            found.append(image.colors[rows[shown], columns[shown]] / 255.0)
        elif image is None and view.colors is not None:
            away = chain.nearest(view.world_points).distance
            found.append(view.colors[away < _REACH * chain.radius])
    colors = np.concatenate(found)
    return np.median(colors, axis=0) if len(colors) else None


def _find_pixels(image: DepthImage, chain: Chain) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
    """Return rows, columns and depths (metres) of the nodes in an image that some points support."""
    nodes = chain.points[~chain.bridged]
    depth = (nodes - image.pose[:3, 3]) @ image.pose[:3, 2]
    nodes, depth = nodes[depth > 0], depth[depth > 0]
    rows, columns, inside = image.find_pixels(nodes)
    return rows[inside], columns[inside], depth[inside]
