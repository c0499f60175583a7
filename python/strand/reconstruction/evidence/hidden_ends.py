"""Ends of ropes that occluders hide: in a gripper or a hand, a rope goes on for an unknown length."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from strand.geometry.polyline import path_length
from strand.reconstruction.evidence.visibility import Visibility, sort_rays
from strand.ropes.chain import Chain
from strand.ropes.doubt import Doubt, ModelWarning
from strand.support.checks import Array
from strand.views.depth_image import DepthImage
from strand.views.view import View, placed

_PLACES = np.arange(0.0, 4.01, 0.5)  # radii beyond an end: places that an occluder may hide
_HEADING = 4.0  # radii before an end that give its direction
_MIN_FREE = 2  # places seen through before an occluder: with as many, the rope ends before it
_NEAR = 4.0  # radii around an end: other doubts there are about the same end
_DOUBT = 0.2  # amount of doubt: how far a rope goes on under an occluder changes little of its course

_Remark = TypeVar("_Remark", Doubt, ModelWarning)


def find_hidden_ends(
    chains: Sequence[Chain], views: Sequence[View], poses: Sequence[Array]
) -> list[tuple[bool, bool]]:
    """Tell of each chain whether an occluder hides its first and its last end.

    It does if it hides the end, or the next place beyond that no view saw through.

    Parameters
    ----------
    chains : sequence of Chain
    views : sequence of View
        Not cropped.
    poses : sequence of (4, 4) ndarray
        Their camera-to-world poses.
    """
    images = [
        placed(view, pose).image
        for view, pose in zip(views, poses, strict=True)
        if view.image is not None and view.image.occluders is not None
    ]
    if not images:
        return [(False, False)] * len(chains)
    visibility = sort_rays(views, poses, views)
    return [
        (False, False)
        if chain.closed
        else (
            _is_hidden(chain.points, chain.radius, images, visibility),
            _is_hidden(chain.points[::-1], chain.radius, images, visibility),
        )
        for chain in chains
    ]


def doubt_hidden_ends(chains: Sequence[Chain]) -> list[tuple[Doubt, tuple[int, ...]]]:
    """Return a doubt for each end that an occluder hides, with the number of its chain."""
    reason = "an occluder hides it: the rope goes on beneath for an unknown length"
    return [
        (Doubt("hidden end", _DOUBT, "where a rope ends", reason, place), (number,))
        for number, place, _ in _list_hidden(chains)
    ]


def drop_explained(remarks: Iterable[_Remark], chains: Sequence[Chain]) -> list[_Remark]:
    """Drop the other doubts about ends that occluders hide, and their warnings."""
    ends = list(_list_hidden(chains))

    def is_explained(place: Array | None) -> bool:
        return place is not None and any(np.linalg.norm(place - end) < reach for _, end, reach in ends)

    return [one for one in remarks if one.kind != "end" or not is_explained(one.place)]


def _list_hidden(chains: Sequence[Chain]) -> Iterator[tuple[int, Array, float]]:
    """Yield the chain's number, the place and the reach of each hidden end, metres."""
    for number, chain in enumerate(chains):
        for place, is_hidden in zip((chain.points[0], chain.points[-1]), chain.hidden_ends, strict=True):
            if is_hidden:
                yield number, place, _NEAR * chain.radius


def _is_hidden(
    nodes: Array, radius: float, images: Sequence[DepthImage | None], visibility: Visibility
) -> bool:
    """Tell whether an occluder hides the first end of a rope."""
    s = path_length(nodes)
    inner = nodes[min(int(np.searchsorted(s, _HEADING * radius)), len(nodes) - 1)]
    outward = nodes[0] - inner
    outward /= max(float(np.linalg.norm(outward)), np.finfo(float).tiny)
    places = nodes[0] + radius * _PLACES[:, None] * outward
    behind = np.any([_find_behind(image, places) for image in images if image is not None], axis=0)
    if not behind.any():
        return False
    first = int(behind.argmax())
    through = visibility.seen_through(places[:first], outward, radius)
    return int(np.count_nonzero(through)) < _MIN_FREE


def _find_behind(image: DepthImage, places: Array) -> NDArray[np.bool_]:
    """(N,) Tell which places project on occluders."""
    found = np.zeros(len(places), dtype=bool)
    ahead = (places - image.pose[:3, 3]) @ image.pose[:3, 2] > 0
    rows, columns, inside = image.find_pixels(places[ahead])
    assert image.occluders is not None
    found[np.flatnonzero(ahead)[inside]] = image.occluders[rows[inside], columns[inside]]
    return found
