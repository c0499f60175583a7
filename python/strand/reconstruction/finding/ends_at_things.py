"""Ropes that end where something stands before the camera: they may go on behind it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

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
    images = [view.image for view in views]
    found: list[tuple[Doubt, tuple[int, ...]]] = []
    for number, chain in enumerate(chains):
        for at in () if chain.closed else (0.0, chain.length):
            inward = abs(at - min(_BACK * chain.radius, chain.length))
            end, back = chain.at([at, inward])
            step = (end - back) / max(float(np.linalg.norm(end - back)), 1e-12) * chain.radius
            places = end + np.outer(_STEPS, step)
            if images and all(_hides(image, places, step, chain.radius, segmented) for image in images):
                reason = "something stands in front of this end: the rope may go on behind it"
                found.append((Doubt("hidden end", _DOUBT, "where a rope ends", reason, end), (number,)))
    return found


def _hides(image: DepthImage | None, places: Array, step: Array, radius: float, segmented: bool) -> bool:
    """Tell whether an image shows something clearly in front of one of (N, 3) places, or beside it.

    They follow each other in the direction of a step.
    """
    if image is None:
        return False
    aside = np.cross(step, image.pose[:3, 2])
    aside *= _ASIDE * radius / max(float(np.linalg.norm(aside)), 1e-12)
    places = np.concatenate([places, places + aside, places - aside])
    rows, columns, inside = image.find_pixels(places)
    away = (places - image.pose[:3, 3]) @ image.pose[:3, 2]
    inside &= away > 0
    shown = image.depth[rows[inside], columns[inside]]
    before = away[inside] - shown
    on_rope = image.mask[rows[inside], columns[inside]]
    far = away[inside]
    least = np.where(
        on_rope | (not segmented),
        np.maximum(_IN_FRONT * radius, _MIN_DISTANCE * far),
        np.maximum(_BESIDE * radius, _MIN_BESIDE * far),
    )
    return bool(((shown > 0) & (before > least)).any())
