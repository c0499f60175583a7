"""Ropes drawn by their colours beside things, which are no background and have a colour of their own."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.reconstruction.color_masks.color_pieces import Mask
from strand.reconstruction.color_masks.shades import TABLE_SHADE, measure_from_line
from strand.support.checks import Array

NEAR = 2.5  # half widths from a mask: a rope's pixels lie within, and two pixels on
AWAY = 2.0  # half widths from a mask: the background begins there, and two pixels on
FAR = 10.0  # half widths from a mask: pieces of a rope that something hides lie within, and two pixels on
MAX_BACKGROUND = 12.0  # Lab: a colour that differs more from the background is none of it
_AROUND = 10.0  # half widths: reach of means
_MIN_SHARE = 0.05  # share of background around
_SURE = 0.5  # of the difference from the background: pieces farther away differ less from the rope
_SIDES = 0.6  # half widths around such pixels: others need only be more like the rope
_UNLIKE = 0.5  # of the contrast: pixels that differ more from a rope's colour are no part of it
_ROPE_SHADE = (0.85, 1.12)  # a rope's light, third root, over its mean
_THIN = 3.0  # pixels: half width of ropes whose edge pixels count by their share of rope
_EDGE = 0.45  # the least share
_RIM = 4  # pixels: rim of things, which may show what is around
_CLEARLY = 0.7  # of the difference from the rope: a thing's pixels differ less from it
_THING_SHADE = (0.6, 1.6)  # a thing's light, third root, over that of the part of it nearby


def draw_beside_things(
    lab: NDArray[np.float32],
    rough: Mask,
    away: NDArray[np.float32],
    ropes: Sequence[tuple[int, Array]],
    half_width: float,
    things: Mask,
) -> tuple[NDArray[np.int32], NDArray[np.float32], Mask]:
    """Draw ropes of labels and colours, given things, a rough mask, and each pixel's distance from it.

    Returns
    -------
    labels : (H, W) ndarray of int32
    from_ground : (H, W) ndarray of float32
        Differences of the colours from the background, Lab; 0 where it was not measured.
    things : (H, W) ndarray of bool
        With pixels of their colour that are connected to them, and without those that surely show rope.
    """
    reach = FAR * half_width
    near = away <= reach + 2.0
    near |= _core.measure_edge_distances(np.asarray(~things), int(reach) + 4) <= reach
    rows, columns = np.nonzero(near)
    pixels = lab[:, rows, columns].T.astype(np.float64)
    free = np.asarray((away > AWAY * half_width + 2.0) & ~things)
    ground = _average_around(lab, free, rows, columns, _AROUND * half_width)
    from_ground = measure_from_line(pixels, ground, TABLE_SHADE)
    best, share = np.full(len(rows), np.inf), np.zeros(len(rows))
    labels = np.zeros(len(rows), dtype=np.int32)
    for label, color in ropes:
        away_from = measure_from_line(pixels, color[None], _ROPE_SHADE)
        # what is like neither belongs to something else
        away_from[away_from > _UNLIKE * np.linalg.norm(color - ground, axis=1) + MAX_BACKGROUND] = np.inf
        full = color - ground
        part = ((pixels - ground) * full).sum(axis=1) / np.maximum((full * full).sum(axis=1), 1e-9)
        share = np.maximum(share, part)
        closer = away_from <= best
        best[closer], labels[closer] = away_from[closer], label
    # farther away, only what is surely rope counts, with its sides
    farther = away[rows, columns] > NEAR * half_width + 2.0
    certain = farther & (best < np.minimum(_SURE * from_ground, MAX_BACKGROUND))
    some = np.ones(rough.shape, dtype=bool)
    some[rows[certain], columns[certain]] = False
    edge = max(_SIDES * half_width, 1.0)
    sides = _core.measure_edge_distances(some, int(edge) + 2)[rows, columns] <= edge
    like = (best < from_ground) & (~farther | sides)
    if half_width < _THIN:
        like |= rough[rows, columns] & (share > _EDGE)
    deep = _core.measure_edge_distances(things, _RIM + 2) > _RIM
    shades = _average_around(lab, deep if deep.any() else things, rows, columns, _AROUND * half_width)
    from_thing = measure_from_line(pixels, shades, _THING_SHADE)
    alike = from_thing < np.minimum(_CLEARLY * best, from_ground)
    things = _grow_things(things, rows[alike], columns[alike])
    sure = best < _SURE * np.minimum(np.minimum(from_ground, from_thing), 2.0 * MAX_BACKGROUND)
    things[rows[sure], columns[sure]] = False
    found, differences = np.zeros(rough.shape, dtype=np.int32), np.zeros(rough.shape, dtype=np.float32)
    found[rows, columns] = np.where(like, labels, 0)
    differences[rows, columns] = from_ground
    return found, differences, things


def _grow_things(things: Mask, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> Mask:
    """Return things with the pixels of their colour, among some, that are connected to them."""
    grown = things.copy()
    grown[rows, columns] = True
    blobs = _core.number_blobs(grown)
    return np.asarray(grown & np.isin(blobs, np.unique(blobs[things])))


def _average_around(
    lab: NDArray[np.float32],
    chosen: Mask,
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    reach: float,
) -> Array:
    """Return (N, 3) mean colours of chosen pixels around places; of all of them where few are around."""
    lab, chosen = lab[:, ::2, ::2], chosen[::2, ::2]
    height, width = chosen.shape
    sums = np.zeros((height + 1, width + 1, 4))
    sums[1:, 1:, :3] = np.where(chosen, lab, 0.0).transpose(1, 2, 0)
    sums[1:, 1:, 3] = chosen
    sums = sums.cumsum(axis=0).cumsum(axis=1)
    # every second pixel is enough
    rows, columns = rows // 2, columns // 2
    size = max(round(0.5 * reach), 1)
    top, bottom = np.maximum(rows - size, 0), np.minimum(rows + size + 1, height)
    left, right = np.maximum(columns - size, 0), np.minimum(columns + size + 1, width)
    total = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]
    whole = sums[-1, -1]
    few = total[:, 3] < _MIN_SHARE * (bottom - top) * (right - left)
    total[few] = whole
    return np.asarray(total[:, :3] / np.maximum(total[:, 3:], 1e-9))
