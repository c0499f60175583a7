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
_OUTWARD = np.array([[-1.0], [1.0]])  # sign of the way out along a rope at its start and its stop


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
    numbers = [number for number, chain in enumerate(chains) if not chain.closed]
    if not images or not numbers:
        return found
    reason = "the rope leaves the image there and may go on outside"
    ends = np.stack([chains[number].points[[0, -1]] for number in numbers])
    outward = np.stack([chains[number].tangents[[0, -1]] * _OUTWARD for number in numbers])
    radii = np.array([chains[number].radius for number in numbers])
    places = np.stack([ends, ends + _AHEAD * radii[:, None, None] * outward])
    margins = np.stack([_NEAR * radii, np.zeros(len(radii))]).repeat(2)
    inside = _are_inside(images, places.reshape(-1, 3), margins).reshape(2, len(numbers), 2)
    for k, which in np.argwhere(~inside.all(axis=0)).tolist():
        found.append((Doubt("cut end", _DOUBT, "where a rope ends", reason, ends[k, which]), (numbers[k],)))
    return found


def straighten_border_ends(
    images: RopeImages, fit: ImageFit, views: Sequence[DepthImage], radius: float
) -> ImageFit:
    """Return a fit whose ropes of a radius, metres, do not turn along the border where they leave all views.

    It is the same fit if none does.
    """
    chains = list(fit.nodes)
    if not views or not chains:
        return fit
    ends = np.concatenate([nodes[[0, -1]] for nodes in chains])
    if _are_inside(views, ends, _BIASED * radius).all():
        return fit
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
    inside = _are_inside(views, nodes, _BIASED * radius)
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
    shown = _are_inside(views, added, 0.0)
    return np.vstack([nodes[: last + 1], added[: int(np.append(shown, False).argmin())]])


def _are_inside(images: Sequence[DepthImage], places: Array, margins: Array | float) -> NDArray[np.bool_]:
    """(N,) Tell which places (N, 3) lie inside the border of one of the images, by margins in metres."""
    inside = np.zeros(len(places), dtype=bool)
    margins = np.broadcast_to(margins, len(places))
    for image in images:
        if inside.all():
            break
        seen = (places - image.pose[:3, 3]) @ image.pose[:3, :3]
        ahead = seen[:, 2] > 0.0
        half = 0.5 * np.array(image.depth.shape[::-1])
        pixels = (half - np.abs(image.camera.project(seen[ahead]) + 0.5 - half)).min(axis=1)
        inside[ahead] |= pixels * seen[ahead, 2] / min(image.camera.focal) >= margins[ahead]
    return inside
