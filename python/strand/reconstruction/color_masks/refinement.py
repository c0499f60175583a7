"""Masks drawn anew from the colours of chosen ropes: crossings are filled, shadows and fringes go."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.reconstruction.color_masks.beside_things import (
    AWAY,
    FAR,
    MAX_BACKGROUND,
    NEAR,
    draw_beside_things,
)
from strand.reconstruction.color_masks.color_pieces import Mask, Piece
from strand.reconstruction.color_masks.shades import BLACK, TABLE_SHADE, measure_from_line
from strand.support.checks import Array

_INNER = 0.5  # half widths from a mask's edge: pixels deeper show the rope's colour alone
_MAX_SAMPLES = 3000  # pixels that give a rope's colours
_ROUNDS = 6  # rounds of two means
_GROUND = 0.35  # of the clear pixels' difference from the background: pixels that differ less are background
_MIN_AWAY = 6.0  # Lab: pixels that differ more are no background
_CLEAR = 0.9  # share of a rough mask's pixels that differ less than the clear ones
_TWO_COLORS = 20.0  # Lab: means of a rope's pixels that differ more are two colours
_MIN_SECOND = 0.2  # share of a second colour
_BACKGROUND = 0.35  # of the other colour's difference: a colour that differs less is the background's
_MIN_PIECE = 1.5  # squared half widths of such a piece
_MIN_LIGHT = 0.55  # of the light, third root: in shadow
_MAX_LIGHT = 1.1  # the same, in full light
_MAX_RESIDUAL = 8.0  # Lab: mixtures of rope and background differ less from what they are computed to be
_WIDE = 1.7  # half widths, and a pixel: discs that are wider than crossing strands
_HIGHLIGHT = 8.0  # Lab: highlights are brighter than the rope by this
_AMID = 0.8  # half widths: highlights as bright as the background are at most twice as wide
_MIN_SMOOTHED = 3.0  # pixels: half width of ropes whose edge is smoothed
_CLOSED = 0.6  # half widths: slits in a rope are at most twice as wide
_SLIT = 6.0  # Lab: pixels in slits differ more from the background
_BEYOND = 30.0  # half widths: reach of the search beyond things
_RIM = 4.0  # pixels beyond a half width: pieces of a rope this near to a thing stand beside it
_MIN_BESIDE = 4.0  # squared half widths of such a piece
_MAX_HOLE = 0.7  # squared half widths: smaller holes are highlights
_MIN_BLOB = 12.0  # squared half widths: smaller blobs are no rope


def refine_labels(
    lab: NDArray[np.float32],
    groups: Sequence[tuple[int, Sequence[Piece]]],
    half_width: float,
    things: Mask | None = None,
) -> NDArray[np.int32]:
    """Return (H, W) labels of ropes, from groups of a label and pieces in a (3, H, W) image in Lab.

    Things, (H, W), are no background, and pixels beside them may have their colour.
    """
    shape = (lab.shape[1], lab.shape[2])
    rough = np.zeros(shape, dtype=np.int32)
    for label, group in reversed(groups):
        for piece in group:
            rough[piece.places] = label
    margin = FAR if things is None else _BEYOND
    window = _find_window(rough > 0, math.ceil(margin * half_width) + 2)
    labels = np.zeros(shape, dtype=np.int32)
    numbers = [label for label, _ in groups]
    own = np.ascontiguousarray(lab[:, window[0], window[1]])
    near = None if things is None or not things[window].any() else np.ascontiguousarray(things[window])
    labels[window] = _refine(own, rough[window], numbers, half_width, near)
    return labels


def _find_window(mask: Mask, margin: int) -> tuple[slice, slice]:
    """Return the rows and columns of a mask and of a margin around it."""
    spans = []
    for axis in (1, 0):
        own = np.flatnonzero(mask.any(axis=axis))
        spans.append(slice(max(int(own[0]) - margin, 0), int(own[-1]) + margin + 1))
    return spans[0], spans[1]


def _refine(
    lab: NDArray[np.float32],
    rough: NDArray[np.int32],
    numbers: Sequence[int],
    half_width: float,
    things: Mask | None,
) -> NDArray[np.int32]:
    """Return labels, given (H, W) rough ones and their numbers."""
    mask: Mask = rough > 0
    far = FAR * half_width + 2.0
    away = _core.measure_edge_distances(np.asarray(~mask), int(far) + 2)
    inner = _core.measure_edge_distances(mask, int(half_width) + 2) >= _INNER * half_width
    free = (away > AWAY * half_width + 2.0) & (away <= far)
    around = np.flatnonzero(free if things is None else free & ~things)
    around = around[:: max(len(around) // _MAX_SAMPLES, 1)]
    planes = lab.reshape(3, -1)
    usual = np.median(planes[:, around] if len(around) else planes, axis=1).astype(np.float64)
    ropes: list[tuple[int, Array]] = []
    for label in numbers:
        own = lab[:, inner & (rough == label)].T.astype(np.float64)
        if not len(own):
            own = lab[:, rough == label].T.astype(np.float64)
        own = _drop_ground(own, usual)
        ropes += [(label, color) for color in find_colors(own, usual)] if len(own) else []
    if things is None:
        found, from_ground = _core.draw_ropes(lab, mask, away, ropes, half_width)
    else:
        found, from_ground, things = draw_beside_things(lab, mask, away, ropes, half_width, things)
    # highlights are brighter than the rope, and unlike the background or amid the rope
    unlike = inner & _close(found > 0, max(_AMID * half_width, 1.0)) | (from_ground > MAX_BACKGROUND)
    for label in numbers:
        own = rough == label
        if own.any():
            bright = unlike & (lab[0] > np.median(lab[0][own]) + _HIGHLIGHT)
            found[own & (found == 0) & bright] = label
    # so are slits between parts of a rope
    slits = _close(found > 0, max(_CLOSED * half_width, 1.0)) & (found == 0) & (from_ground > _SLIT) & mask
    found[slits] = rough[slits]
    found[_find_wide(found > 0, half_width) & ~mask] = 0
    beside: Mask = np.zeros(rough.shape, dtype=bool)
    if things is not None:
        found[things] = 0
        reach = half_width + _RIM
        beside = np.asarray(_core.measure_edge_distances(np.asarray(~things), int(reach) + 2) <= reach)
    return _clean(found, rough, half_width, away > NEAR * half_width + 2.0, beside)


def _close(mask: Mask, reach: float) -> Mask:
    """Return a mask grown by some pixels and shrunk again."""
    most = int(reach) + 2
    grown = np.asarray(_core.measure_edge_distances(~mask, most) <= reach)
    return np.asarray(_core.measure_edge_distances(grown, most) > reach)


def _find_wide(mask: Mask, half_width: float) -> Mask:
    """Return the pixels of discs in a mask that are wider than crossing strands."""
    reach = _WIDE * half_width + 1.0
    core = np.asarray(_core.measure_edge_distances(mask, int(reach) + 2) > reach)
    if not core.any():
        return core
    return np.asarray(mask & (_core.measure_edge_distances(~core, int(reach) + 2) <= reach))


def _drop_ground(own: Array, ground: Array) -> Array:
    """Return the (N, 3) colours in a rough mask that are not those of the background between strands."""
    if not len(own):
        return own
    away = measure_from_line(own, ground[None], TABLE_SHADE)
    return own[away >= min(_GROUND * float(np.quantile(away, _CLEAR)), _MIN_AWAY)]


def find_colors(own: Array, ground: Array) -> list[Array]:
    """Return one or two colours of a rope's (N, 3) pixels, on a background of another."""
    own = own[:: max(len(own) // _MAX_SAMPLES, 1)]
    middle = np.median(own, axis=0)
    if len(own) < 10:
        return [middle]
    away = own - middle
    axis = np.linalg.eigh(away.T @ away)[1][:, -1]
    second = away @ axis > 0.0
    for _ in range(_ROUNDS):
        if second.all() or not second.any():
            return [middle]
        means = own[~second].mean(axis=0), own[second].mean(axis=0)
        second = ((own - means[1]) ** 2).sum(axis=1) < ((own - means[0]) ** 2).sum(axis=1)
    share = float(second.mean())
    turned = float(np.linalg.norm((means[1] - means[0])[1:]))
    if turned < _TWO_COLORS or min(share, 1.0 - share) < _MIN_SECOND:
        return [middle]
    # a rough mask may hold background and shadows
    differences = [float(measure_from_line(mean[None], ground[None], TABLE_SHADE)[0]) for mean in means]
    best, other = (0, 1) if differences[0] >= differences[1] else (1, 0)
    if differences[other] < min(_BACKGROUND * differences[best], MAX_BACKGROUND):
        return [means[best]]
    return [means[best]] if _is_mixed(means[other], means[best], ground) else list(means)


def _is_mixed(color: Array, rope: Array, ground: Array) -> bool:
    """Tell whether a colour is a mixture of a rope's and that of the background in light or shadow."""
    black = np.array([BLACK, 0.0, 0.0])
    parts = np.column_stack([rope - black, ground - black])
    shares, _, rank, _ = np.linalg.lstsq(parts, color - black, rcond=None)
    residual = float(np.linalg.norm(parts @ shares - (color - black)))
    lit = _MIN_LIGHT < shares.sum() < _MAX_LIGHT
    return bool(rank == 2 and shares.min() > 0.0 and lit and residual < _MAX_RESIDUAL)


def _clean(
    labels: NDArray[np.int32],
    rough: NDArray[np.int32],
    half_width: float,
    farther: Mask,
    beside: Mask,
) -> NDArray[np.int32]:
    """Return labels without small holes and blobs; those farther away or beside things may be smaller."""
    square = half_width * half_width
    holes = _core.number_blobs(np.asarray(labels == 0))
    small = (np.bincount(holes.ravel())[holes] <= max(_MAX_HOLE * square, 1.0)) & (labels == 0)
    if small.any():
        labels = np.where(small, np.where(rough > 0, rough, _spread(labels)), labels)
    if half_width >= _MIN_SMOOTHED:
        labels = np.where(_count_around(labels > 0) >= 5, np.maximum(labels, _spread(labels)), 0)
    blobs = _core.number_blobs(np.asarray(labels > 0))
    areas = np.bincount(blobs.ravel())
    alone = np.bincount(blobs.ravel(), farther.ravel()) >= areas
    least = np.where(alone, _MIN_PIECE, _MIN_BLOB)
    least[np.unique(blobs[beside & (blobs > 0)])] = _MIN_BESIDE
    kept = (areas >= least * square)[blobs]
    return np.where(kept, labels, 0).astype(np.int32)


def _spread(labels: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the largest label of each pixel's neighbours."""
    around = np.pad(labels, 1)
    return np.asarray(
        np.max([around[:-2, 1:-1], around[2:, 1:-1], around[1:-1, :-2], around[1:-1, 2:]], axis=0)
    )


def _count_around(mask: Mask) -> NDArray[np.int64]:
    """Return how many of the 3 x 3 pixels around each are in a mask."""
    around = np.pad(mask, 1, mode="edge").astype(np.int64)
    rows = around[:-2] + around[1:-1] + around[2:]
    return np.asarray(rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:])
