"""Where ropes end by the depths of all pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from strand._core import RopeImages
from strand.checks import Array
from strand.images.comparison import Explanation, Reading
from strand.images.nodes import corrected_poses
from strand.images.seen import RopeImage
from strand.polyline import path_length

# how far along the rope ends are looked for, and in which steps, radii; nodes that say where it goes there
_REACH, _STEP, _AHEAD = 3.0, 0.375, 4


def ends_moved(
    images: RopeImages,
    taken: Sequence[RopeImage],
    one: Explanation,
    table: tuple[Array, float],
    noise: float,
    radius: float,
) -> Reading:
    """Return the reading of which an explanation's ropes end where depth agrees most.

    Parameters
    ----------
    images : RopeImages
    taken : list of RopeImage
        What they were made of.
    one : Explanation
    table : ((3,) ndarray, float)
        Its unit normal n and n.x, metres.
    noise : float
        Standard deviation of depth, metres.
    radius : float
        Metres.

    Returns
    -------
    Reading
        Of the same view.
    """
    chains = list(one.fit.nodes)
    corrections = one.fit.corrections
    # of ends that depth tells as well, as behind other strands, the one that was found
    by = sorted(np.arange(-_REACH, _REACH + 0.5 * _STEP, _STEP) * radius, key=abs)
    for number in range(len(chains)):
        for _ in range(2):
            nodes = chains[number]
            ways = [_led_on(nodes, float(more)) for more in by]
            stem = _stem(nodes, radius)
            rest = [*chains[:number], nodes[:stem], *chains[number + 1 :]]
            ends = [way[stem - 1 :] for way in ways]
            best = int(np.argmax(images.end_gains(rest, ends, corrections, table, noise)))
            # both ends in turn, and back in order
            chains[number] = np.ascontiguousarray(ways[best][::-1])
    view = one.reading.view
    pose = corrected_poses([image.pose for image in taken], corrections)[view]
    image = replace(taken[view], pose=pose)
    return replace(one.reading, chains=[image.projected(nodes) for nodes in chains])


def _led_on(nodes: Array, more: float) -> Array:
    """Return a rope that ends so much further on, metres; negative: sooner, but not before its middle."""
    if more > 0.0:
        ahead = nodes[-1] - nodes[-min(_AHEAD, len(nodes))]
        return np.vstack([nodes, nodes[-1] + more * ahead / np.linalg.norm(ahead)])
    s = path_length(nodes)
    length = max(s[-1] + more, 0.5 * s[-1])
    last = [np.interp(length, s, nodes[:, k]) for k in range(3)]
    return np.vstack([nodes[s < length], last])


def _stem(nodes: Array, radius: float) -> int:
    """Return how many nodes all ways of an end begin with."""
    s = path_length(nodes)
    length = s[-1] - (_REACH + 1.0) * radius
    if length < 0.5 * s[-1]:
        length = 0.4 * s[-1]
    return max(int(np.searchsorted(s, length)), 2)
