"""Ropes that end where something stands before the camera: they may go on behind it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from strand.geometry.lengths import measure_lengths
from strand.ropes.chain import Chain
from strand.ropes.doubt import Doubt
from strand.support.checks import Array
from strand.views.depth_image import DepthImage
from strand.views.view import View

_STEPS = (1.5, 2.5, 3.5)  # radii beyond an end: something is sought there
_ASIDE = 1.2  # radii to both sides of these places: a thing may hide a bend there
_BACK = 3.0  # radii along the rope that give the direction of its end
_IN_FRONT = 5.0  # radii: what is this much nearer to the camera is no rope on the rope
_BESIDE = 1.0  # radii: the same, of what is not in the mask of the ropes that were found
_MIN_DISTANCE = 0.02  # of the end's distance from the camera: the same, where depth is coarse
_MIN_BESIDE = 0.01  # of that distance: the same, of what is not in the mask
_DOUBT = 1.4  # amount of doubt of an end


def doubt_ends_at_things(
    chains: Sequence[Chain], views: Sequence[View], segmented: bool
) -> list[tuple[Doubt, tuple[int, ...]]]:
    """Doubt ends beyond which all views show something in front: the rope may go on behind it.

    Parameters
    ----------
    chains : sequence of Chain
    views : sequence of View
    segmented : bool
        Whether strand made the masks, so that noise beside the ropes is in them.

    Returns
    -------
    list of (Doubt, tuple of int)
        Each with the number of its chain.
    """
    images = [view.image for view in views if view.image is not None]
    numbers = [number for number, chain in enumerate(chains) if not chain.closed for _ in range(2)]
    if not images or len(images) < len(views) or not numbers:
        return []
    ends, steps = (np.concatenate(each) for each in zip(*map(_find_ends, chains), strict=True))
    radii = np.array([chains[number].radius for number in numbers])
    hidden = np.arange(len(ends))
    for image in images:
        hidden = hidden[_hides(image, ends[hidden], steps[hidden], radii[hidden], segmented)]
        if not len(hidden):
            break
    reason = "something stands in front of this end: the rope may go on behind it"
    return [
        (Doubt("hidden end", _DOUBT, "where a rope ends", reason, ends[k]), (numbers[k],))
        for k in hidden.tolist()
    ]


def _find_ends(chain: Chain) -> tuple[Array, Array]:
    """Return the (E, 3) ends of a chain, and the ways out of them, one radius long."""
    if chain.closed:
        return np.empty((0, 3)), np.empty((0, 3))
    back = min(_BACK * chain.radius, chain.length)
    ends, inner = chain.at([[0.0, chain.length], [back, chain.length - back]])
    out = ends - inner
    return ends, out / np.maximum(measure_lengths(out)[:, None], 1e-12) * chain.radius


def _hides(image: DepthImage, ends: Array, steps: Array, radii: Array, segmented: bool) -> NDArray[np.bool_]:
    """Tell at which of (E, 3) ends an image shows something clearly in front, or in front of places beside.

    They are sought along steps (E, 3) out of the ends, one radius long.
    """
    # at right angles to the step and the camera's axis
    across = (steps @ image.pose[:3, 1::-1]) * (1.0, -1.0)
    across *= _ASIDE * radii[:, None] / np.maximum(measure_lengths(across)[:, None], 1e-12)
    aside = across @ image.pose[:3, :2].T
    middle = ends + np.multiply.outer(_STEPS, steps)
    places = np.stack([middle, middle + aside, middle - aside])
    rows, columns, inside = (
        some.reshape(places.shape[:-1]) for some in image.find_pixels(places.reshape(-1, 3))
    )
    away = (places - image.pose[:3, 3]) @ image.pose[:3, 2]
    inside &= away > 0
    rows, columns = np.where(inside, rows, 0), np.where(inside, columns, 0)
    shown = image.depth[rows, columns]
    least = np.where(
        image.mask[rows, columns] | (not segmented),
        np.maximum(_IN_FRONT * radii, _MIN_DISTANCE * away),
        np.maximum(_BESIDE * radii, _MIN_BESIDE * away),
    )
    return np.asarray((inside & (shown > 0) & (away - shown > least)).any(axis=(0, 1)))
