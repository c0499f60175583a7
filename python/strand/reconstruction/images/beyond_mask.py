"""What depth shows beyond the ends of ropes: masks that lost a piece of rope end it where depth goes on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

import strand._core as _core
from strand.ropes.doubt import Doubt
from strand.support.checks import Array
from strand.views.depth_image import DepthImage

# places beyond an end and inside of it, and how far beside the axis the surroundings are, in radii
_AHEAD, _ASIDE = np.arange(1.5, 4.1, 0.5), 3.0
# other stretches nearer than this to a place say nothing of it; the own rope's begin so far back, radii
_OTHERS, _OWN = 3.5, 7.0
# fewest places that say anything; ropes stand out from their surroundings by so many radii at least, and what
# does by so many is something else
_FEWEST, _STANDS_OUT, _HIDES = 4, 0.3, 6.0
# deviations of the noise that chance may have; the shares of the rope's height that are none of a doubt, as
# matchers draw ends out, and all of it, and how much that is
_CHANCE, _SHARES, _GOES_ON = 2.0, (0.2, 0.6), 1.2


def ends_that_go_on(
    views: Sequence[DepthImage],
    chains: Sequence[Array],
    noise: float,
    radius: float,
) -> Iterator[Doubt]:
    """Doubt ends beyond which depth stands out from what is beside it, as it does along the rope before.

    Parameters
    ----------
    views : sequence of DepthImage
        With poses as corrected.
    chains : sequence of (M, 3) ndarray
        Nodes of the ropes, metres.
    noise : float
        Standard deviation of the depth that a disc of the rope's middle shows, radii.
    radius : float
        Metres.
    """
    for number, nodes in enumerate(chains):
        for way in (nodes, nodes[::-1]):
            from_end = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
            if from_end[-1] < 2.0 * _OWN * radius:
                continue
            back = int(np.searchsorted(from_end, _AHEAD[-1] * radius))
            outward = way[0] - way[back]
            outward /= max(float(np.linalg.norm(outward)), np.finfo(float).tiny)
            others = [way[from_end > _OWN * radius], *(x for k, x in enumerate(chains) if k != number)]
            beyond = way[0] + radius * _AHEAD[:, None] * outward
            beyond = beyond[_core.squared_distances(beyond, np.concatenate(others)) > (_OTHERS * radius) ** 2]
            inside = np.column_stack([np.interp(_AHEAD * radius, from_end, axis) for axis in way.T])
            both = np.vstack([beyond, inside])
            heights = np.stack([_height(view, both, outward, radius) for view in views])
            told = np.isfinite(heights) & (np.abs(heights) < _HIDES)
            ahead, along = (
                heights[:, some][told[:, some]]
                for some in (slice(len(beyond)), slice(len(beyond), len(both)))
            )
            if min(len(ahead), len(along)) < _FEWEST:
                continue
            height, usual = float(np.median(ahead)), float(np.median(along))
            # depth of two discs, one after the other, and of what is beside them
            chance = _CHANCE * noise * np.sqrt(1.5 / 2.0 / max(len(ahead) / len(_AHEAD), 1.0))
            if usual > _STANDS_OUT:
                none, whole = _SHARES
                share = ((height - chance) / usual - none) / (whole - none)
                reason = (
                    f"depth goes on as if the rope did: {height:.1f} radii before what is beside it, "
                    f"{usual:.1f} along the rope; the mask may have lost a piece"
                )
                amount = _GOES_ON * min(max(share, 0.0), 1.0)
                yield Doubt("end", amount, "where the rope ends", reason, way[0])


def _height(view: DepthImage, places: Array, along: Array, radius: float) -> Array:
    """(K,) How far depth at places is before that beside them, radii; NaN where not all is seen."""
    aside = np.cross(along, places - view.pose[:3, 3])
    aside *= _ASIDE * radius / np.maximum(np.linalg.norm(aside, axis=1, keepdims=True), np.finfo(float).tiny)
    middle, left, right = np.split(_depth(view, np.vstack([places, places - aside, places + aside])), 3)
    return np.asarray((0.5 * (left + right) - middle) / radius)


def _depth(view: DepthImage, places: Array) -> Array:
    """(K,) The depth of places' pixels, metres; NaN where there is none."""
    columns, rows = np.rint(view.project(places)).astype(np.int64).T
    height, width = view.depth.shape
    inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    found = np.full(len(places), np.nan)
    found[inside] = view.depth[rows[inside], columns[inside]]
    found[~(found > 0)] = np.nan
    return found
