"""Depth beyond the ends of ropes: where a mask lost a piece of rope, depth goes on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

import strand._core as _core
from strand.geometry.lengths import measure_lengths
from strand.geometry.polyline import interpolate, path_length
from strand.ropes.doubt import Doubt
from strand.support.checks import Array
from strand.views.depth_image import DepthImage

_PLACES = np.arange(1.5, 4.1, 0.5)  # radii beyond an end, and back from it, where depth is compared
_ASIDE = 3.0  # radii beside the axis: what surrounds the rope
_MIN_OTHER_DISTANCE = 3.5  # radii: places nearer to other stretches are skipped
_OWN = 7.0  # radii from an end: farther along, the same rope is another stretch
_MIN_DEPTHS = 4  # depths beyond an end and along its rope: with fewer the end is not doubted
_MIN_HEIGHT = 0.3  # radii: ropes that stand out less say nothing
_MAX_HEIGHT = 6.0  # radii: what stands out more is something else
_DEVIATIONS = 2.0  # standard deviations of the noise that heights may have by chance
_NO_DOUBT_SHARE = 0.2  # of the rope's height: matchers lengthen ends by as much
_FULL_DOUBT_SHARE = 0.6  # of the rope's height
_DOUBT = 1.2  # amount of full doubt


def doubt_ends_beyond_masks(
    views: Sequence[DepthImage], chains: Sequence[Array], noise: float, radius: float
) -> Iterator[Doubt]:
    """Doubt ends beyond which depth stands out from its surroundings as it does along the rope.

    Parameters
    ----------
    views : sequence of DepthImage
        With corrected poses.
    chains : sequence of (M, 3) ndarray
        Nodes of the ropes, metres.
    noise : float
        Standard deviation of the depth that a disc of the rope's middle shows, radii.
    radius : float
        Metres.
    """
    ends = list(_find_ends(chains, radius))
    if not ends:
        return
    places = np.vstack([end.places for end in ends])
    outward = np.repeat([end.outward for end in ends], [len(end.places) for end in ends], axis=0)
    heights = np.stack([_measure_heights(view, places, outward, radius) for view in views])
    known = np.isfinite(heights) & (np.abs(heights) < _MAX_HEIGHT)
    first = 0
    for end in ends:
        middle, last = first + end.beyond, first + len(end.places)
        ahead, along = (
            heights[:, some][known[:, some]] for some in (slice(first, middle), slice(middle, last))
        )
        first = last
        if min(len(ahead), len(along)) < _MIN_DEPTHS:
            continue
        height, usual = _core.find_median(ahead), _core.find_median(along)
        # a height is the depth of a disc against the mean of two beside it
        chance = _DEVIATIONS * noise * np.sqrt(1.5 / 2.0 / max(len(ahead) / len(_PLACES), 1.0))
        if usual <= _MIN_HEIGHT:
            continue
        share = ((height - chance) / usual - _NO_DOUBT_SHARE) / (_FULL_DOUBT_SHARE - _NO_DOUBT_SHARE)
        if share > 0.0:
            reason = (
                f"depth goes on as if the rope did: {height:.1f} radii before its surroundings, "
                f"{usual:.1f} along the rope; the mask may have lost a piece"
            )
            yield Doubt("end", _DOUBT * min(share, 1.0), "where the rope ends", reason, end.place)


@dataclass(frozen=True, eq=False)
class _End:
    """An end of a rope: its place, its unit direction, and the places to look at.

    The first `beyond` of (K, 3) places lie beyond the end, the others on the rope.
    """

    place: Array
    outward: Array
    places: Array
    beyond: int


def _find_ends(chains: Sequence[Array], radius: float) -> Iterator[_End]:
    """Yield the ends of long ropes, and places beyond them that no other stretch is near."""
    for number, nodes in enumerate(chains):
        along = path_length(nodes)
        if along[-1] < 2.0 * _OWN * radius:
            continue
        for way, from_end in ((nodes, along), (nodes[::-1], along[-1] - along[::-1])):
            back = int(np.searchsorted(from_end, _PLACES[-1] * radius))
            outward = way[0] - way[back]
            outward /= max(float(np.linalg.norm(outward)), np.finfo(float).tiny)
            others = [way[from_end > _OWN * radius], *chains[:number], *chains[number + 1 :]]
            beyond = way[0] + radius * _PLACES[:, None] * outward
            away = _core.find_squared_distances(beyond, np.concatenate(others))
            beyond = beyond[away > (_MIN_OTHER_DISTANCE * radius) ** 2]
            inside = interpolate(_PLACES * radius, from_end, way)
            yield _End(way[0], outward, np.vstack([beyond, inside]), len(beyond))


def _measure_heights(view: DepthImage, places: Array, along: Array, radius: float) -> Array:
    """(K,) Return how far depth at places is before that beside them, radii; NaN where some is missing.

    Beside is at right angles to (K, 3) directions along the rope.
    """
    aside = np.cross(along, places - view.pose[:3, 3])
    aside *= _ASIDE * radius / np.maximum(measure_lengths(aside)[:, None], np.finfo(float).tiny)
    depths = _look_up_depth(view, np.vstack([places, places - aside, places + aside]))
    middle, left, right = depths.reshape(3, -1)
    return np.asarray((0.5 * (left + right) - middle) / radius)


def _look_up_depth(view: DepthImage, places: Array) -> Array:
    """(K,) Return the depth of places' pixels, metres; NaN where there is none."""
    rows, columns, inside = view.find_pixels(places)
    found = np.full(len(places), np.nan)
    found[inside] = view.depth[rows[inside], columns[inside]]
    found[~(found > 0)] = np.nan
    return found
