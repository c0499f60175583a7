"""Other courses of ropes near those found: where a rope ends on a strand, or runs over bare table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.geometry.polyline import find_runs
from strand.support.checks import Array
from strand.views.depth_image import DepthImage, list_pixels

_NEAR = 3.2  # radii between an end and the axis of a strand that it may lie on
_OWN_NODES = 16  # nodes at an end that are no other strand
_JOINT = 3  # nodes that a new course leaves out where it turns: a fit makes the curve
_HEADING = 8  # nodes that give a direction
_MIN_NODES = 12  # nodes of a rope
_STEP = 0.5  # radii between nodes
_MAX_WAY = 9.0  # radii from a new end to a tip
_MIN_AWAY = 1.8  # radii between the axis of any rope and a tip that they leave uncovered
_MIN_BEHIND = 1.0  # radii behind a rope's surface: depths there show what is beneath it
_MIN_BARE = 3  # nodes: shorter stretches over bare table are noise


def list_swapped(chains: Sequence[Array], radius: float) -> Iterator[list[Array]]:
    """Yield ropes that run otherwise where one ends on a strand: it goes on along it, and the strand ends.

    The strand is the last of the yielded ropes, and ends at its last node. A rope that ends on itself runs
    through its loop the other way.

    Parameters
    ----------
    chains : sequence of (M, 3) ndarray
        Nodes of each rope, metres, half a radius apart.
    radius : float
        Metres.
    """
    for number, nodes in enumerate(chains):
        for way in (nodes, nodes[::-1]):
            for other, strand in enumerate(chains):
                part = way[:-_OWN_NODES] if other == number else strand
                squares = ((part - way[-1]) ** 2).sum(axis=1)
                if squares.min(initial=np.inf) > (_NEAR * radius) ** 2:
                    continue
                place = int(squares.argmin())
                rest = [rope for k, rope in enumerate(chains) if k not in (number, other)]
                if other == number:
                    turned = _turn_loop(way, place)
                    if turned is not None:
                        yield [*rest, turned]
                    continue
                for along, at in ((strand, place), (strand[::-1], len(strand) - 1 - place)):
                    parted = _lead_on(way, along, at)
                    if parted is not None:
                        yield [*rest, *parted]


def _turn_loop(way: Array, place: int) -> Array | None:
    """Return a rope that ends on a node of itself with the loop that this makes run the other way."""
    before, loop = way[: max(place - _JOINT, 0)], way[: place + _JOINT : -1]
    if min(len(before), len(loop)) < _MIN_NODES or not _is_onward(before, loop):
        return None
    return np.vstack([before, loop])


def _lead_on(way: Array, along: Array, place: int) -> tuple[Array, Array] | None:
    """Return a rope that goes on along a strand from one of its nodes, and the strand up to there."""
    before, onward, rest = way[:-_JOINT], along[place + _JOINT :], along[: place + 1]
    if min(len(before), len(onward), len(rest)) < _MIN_NODES or not _is_onward(before, onward):
        return None
    return np.vstack([before, onward]), rest


def _is_onward(before: Array, after: Array) -> bool:
    """Tell whether a polyline that goes on at the start of another turns by less than a right angle."""
    return float((before[-1] - before[-_HEADING]) @ (after[_HEADING - 1] - after[0])) > 0.0


def reach_tip(image: DepthImage, chains: Sequence[Array], normal: Array, radius: float) -> list[Array] | None:
    """Return ropes of which the last is led straight on to a tip that a mask shows; None without such a tip.

    A tip is the mask's pixel that is farthest from all ropes, ahead of that rope's last node and near it.

    Parameters
    ----------
    image : DepthImage
        With a mask and a corrected pose.
    chains : sequence of (M, 3) ndarray
        Nodes of each rope, metres.
    normal : (3,) ndarray
        The table's. The way to the tip is level.
    radius : float
        Metres.
    """
    *others, nodes = chains
    pixels = radius * image.camera.focal[0] / image.distance
    before, middle = image.project(nodes[[-_HEADING, -1]])
    reach = int(_MAX_WAY * pixels) + 1
    left, top = (max(int(at) - reach, 0) for at in middle)
    part = (slice(top, max(top, int(middle[1]) + reach)), slice(left, max(left, int(middle[0]) + reach)))
    rows, columns = list_pixels(image.mask[part] & (image.depth[part] > 0))
    rows, columns = rows + top, columns + left
    ahead = (np.column_stack([columns, rows]) - middle) @ (middle - before) > 0.0
    rows, columns = rows[ahead], columns[ahead]
    if not len(rows):
        return None
    seen = image.project(np.vstack(chains))
    places = np.column_stack([columns, rows, np.zeros(len(rows))])
    away = _core.find_squared_distances(places, np.column_stack([seen, np.zeros(len(seen))]))
    k = int(away.argmax())
    if away[k] < (_MIN_AWAY * pixels) ** 2:
        return None
    down = nodes[-1] - image.pose[:3, 3]
    (tip,) = image.lift(rows[k : k + 1], columns[k : k + 1], np.ones(1))
    ray = tip - image.pose[:3, 3]
    fall = float(ray @ normal)
    if fall * float(down @ normal) <= 0.0:
        return None
    way = float(down @ normal) / fall * ray - down
    count = int(np.linalg.norm(way) / (_STEP * radius)) + 1
    if count * _STEP > _MAX_WAY or (nodes[-1] - nodes[-_HEADING]) @ way <= 0.0:
        return None
    return [*others, np.vstack([nodes, nodes[-1] + np.arange(1.0, count + 1.0)[:, None] / count * way])]


def cut_over_table(
    images: Sequence[DepthImage], chains: Sequence[Array], radius: float
) -> tuple[list[Array], list[Array]]:
    """Cut stretches over bare table out of ropes, except at their ends.

    Parameters
    ----------
    images : sequence of DepthImage
        With corrected poses. The noise of their depths is far less than a radius.
    chains : sequence of (M, 3) ndarray
        Nodes of each rope, metres, half a radius apart.
    radius : float
        Metres.

    Returns
    -------
    kept : list of (M, 3) ndarray
        The ropes that are left, but for short ones.
    cut : list of (K, 3) ndarray
        The stretches over bare table.
    """
    kept, cut = [], []
    for nodes in chains:
        first = 0
        for start, stop in find_runs(_find_bare(images, nodes, radius)):
            if stop - start >= _MIN_BARE and start > first and stop < len(nodes):
                kept.append(nodes[first:start])
                cut.append(nodes[start:stop])
                first = stop
        kept.append(nodes[first:])
    return [part for part in kept if len(part) >= _MIN_NODES], cut


def _find_bare(images: Sequence[DepthImage], nodes: Array, radius: float) -> NDArray[np.bool_]:
    """(M,) Tell at which nodes of a rope more views show what is beneath it than its surface."""
    votes = np.zeros(len(nodes), dtype=np.int64)
    for image in images:
        behind = _core.measure_behind(image.depth, image.camera, image.pose, nodes, radius) / radius + 1.0
        # it is NaN outside the image, and infinite without depth
        votes += (behind > _MIN_BEHIND) & (behind < np.inf)
        votes -= np.abs(behind) <= _MIN_BEHIND
    bare = np.pad(votes > 0, 1, mode="edge").astype(np.int64)
    # one node alone is noise
    return np.asarray(bare[:-2] + bare[1:-1] + bare[2:] >= 2)
