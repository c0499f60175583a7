"""Ends of ropes at the images' borders: a rope that leaves the image goes on for an unknown length."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from strand._core import ImageFit, RopeImages
from strand.geometry.polyline import path_length
from strand.ropes.chain import Chain
from strand.ropes.doubt import Doubt
from strand.support.checks import Array
from strand.views.depth_image import DepthImage

_NEAR = 1.25  # radii from the border: a rope whose end is nearer leaves the image
_AHEAD = 2.0  # radii beyond an end: outside the image, the rope leaves it too
_DOUBT = 1.2  # amount of doubt of an end at the border
_BIASED = 1.25  # radii from the border: nearer, the border cuts the mask, and its middle is not the rope's
_HEADING = 4.0  # radii before the border that give a rope's direction
_MIN_ASIDE = 0.75  # radii: an end that lies as far from that direction is a hook along the border
_MAX_EXTENSION = 3.0  # radii: a rope is extended to the border by no more
_MIN_REST = 8.0  # radii that are left of a rope without its hook


def doubt_ends_at_border(
    chains: Sequence[Chain], images: Sequence[DepthImage]
) -> list[tuple[Doubt, tuple[int, ...]]]:
    """Doubt ends where ropes leave all images: they go on outside.

    Returns
    -------
    list of (Doubt, tuple of int)
        Each with the number of its chain.
    """
    found: list[tuple[Doubt, tuple[int, ...]]] = []
    if not images:
        return found
    reason = "the rope leaves the image there and may go on outside"
    for number, chain in enumerate(chains):
        ends = ((chain.points[0], -chain.tangents[0]), (chain.points[-1], chain.tangents[-1]))
        for end, outward in () if chain.closed else ends:
            places = np.stack([end, end + _AHEAD * chain.radius * outward])
            at, ahead = np.max([_measure_margins(image, places, chain.radius) for image in images], axis=0)
            if at < _NEAR or ahead < 0.0:
                found.append((Doubt("cut end", _DOUBT, "where a rope ends", reason, end), (number,)))
    return found


def straighten_border_ends(
    images: RopeImages, fit: ImageFit, views: Sequence[DepthImage], radius: float
) -> ImageFit:
    """Return a fit whose ropes of a radius, metres, do not turn along the border where they leave all views.

    It is the same fit if none does.
    """
    if not views:
        return fit
    chains = list(fit.nodes)
    for number, nodes in enumerate(chains):
        for _ in range(2):
            # reversed for the other end, and back in order after it
            nodes = np.ascontiguousarray(_straighten_end(nodes, views, radius)[::-1])
        chains[number] = nodes
    same = all(len(one) == len(other) for one, other in zip(chains, fit.nodes, strict=True))
    same = same and all(np.array_equal(one, other) for one, other in zip(chains, fit.nodes, strict=True))
    return fit if same else images.replace_nodes(fit, chains)


def _straighten_end(nodes: Array, views: Sequence[DepthImage], radius: float) -> Array:
    """Return a rope whose last end, if it turns along the border, goes straight on to it instead."""
    s = path_length(nodes)
    inside = np.max([_measure_margins(view, nodes, radius) for view in views], axis=0) >= _BIASED
    if inside[-1] or not inside.any():
        return nodes
    last = len(nodes) - 1 - int(inside[::-1].argmax())
    first = int(np.searchsorted(s, s[last] - _HEADING * radius))
    if s[last] < _MIN_REST * radius or first == last:
        return nodes
    ahead = nodes[last] - nodes[first]
    ahead /= float(np.linalg.norm(ahead))
    aside = nodes[last:] - nodes[last]
    aside = aside - (aside @ ahead)[:, None] * ahead
    if float(np.linalg.norm(aside, axis=1).max()) < _MIN_ASIDE * radius:
        return nodes
    step = s[-1] / (len(nodes) - 1)
    added = nodes[last] + np.arange(step, _MAX_EXTENSION * radius, step)[:, None] * ahead
    shown = np.max([_measure_margins(view, added, radius) for view in views], axis=0) >= 0.0
    return np.vstack([nodes[: last + 1], added[: int(np.append(shown, False).argmin())]])


def _measure_margins(image: DepthImage, places: Array, radius: float) -> NDArray[np.float64]:
    """(N,) Return how far places (N, 3) are inside an image's border, in radii, metres, of a rope there."""
    z = (places - image.pose[:3, 3]) @ image.pose[:3, 2]
    height, width = image.depth.shape
    margins = np.full(len(places), -np.inf)
    ahead = z > 0.0
    columns, rows = image.project(places[ahead]).T
    pixels = np.min([columns + 0.5, width - 0.5 - columns, rows + 0.5, height - 0.5 - rows], axis=0)
    margins[ahead] = pixels * z[ahead] / (radius * min(image.camera.focal))
    return margins
