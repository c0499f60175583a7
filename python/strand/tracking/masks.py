"""Masks of ropes in images without one: pixels near the predicted ropes, told apart by colour and height.

The ropes of the last frame show which colours are theirs, and the pixels beside them which are not. Colours
are counted in bins. A pixel is rope if the logarithms of both ratios, of colour and of height over the table,
add up to more than 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.geometry.plane import Plane
from strand.support.checks import Array
from strand.tracking.rope_state import RopeState
from strand.views.depth_image import DepthImage

_BINS = 16  # for each of red, green and blue
_REACH = 4.0  # radii around the predicted ropes in which their pixels are sought
_REACH_MOVED = 2.0  # times the way of the fastest node in a frame, beside that
_MARGIN = 3.0  # pixels, beside that
_CORE = 0.6  # radii: pixels this near to a rope that is seen show its colour
_BESIDE = 2.0  # radii: pixels farther away show other colours
_MEMORY = 0.8  # of the colours of earlier frames
_SMOOTHING = 0.5  # pixels that each bin counts more
_MOST_RATIO = 3.0  # logarithm of the ratio that colours give at most
_HEIGHT = 0.7  # radii above the table: half way between its pixels and a rope's
_HEIGHT_SHARE = 4.0  # logarithm of the ratio for each radius of height
_MOST_HIGH = 0.3  # logarithm of the ratio that heights give at most: hands and grippers are high, too
_MOST_LOW = 2.0  # likewise, against a rope
_NEARER = 5.0  # radii before the predicted rope: pixels there are something else
_BEHIND = 4.0  # radii behind it: likewise
_STEP = 0.5  # of a node: places along the predicted rope that are drawn
_HALF_WINDOW = 12  # pixels around the ropes' box


@dataclass(frozen=True, eq=False)
class Appearance:
    """The colours of ropes and of what is beside them.

    Attributes
    ----------
    ropes, others : (4096,) ndarray
        Pixels in each bin of colour, of the last frames.
    """

    ropes: Array
    others: Array


def find_mask(
    image: DepthImage,
    ropes: Sequence[RopeState],
    table: Plane | None,
    appearance: Appearance | None,
    elapsed: float,
) -> NDArray[np.bool_]:
    """Return the (H, W) mask of ropes near where they are predicted, `elapsed` seconds after their state."""
    mask = np.zeros(image.depth.shape, dtype=bool)
    near = _look_near(image, ropes, elapsed)
    if near is None:
        return mask
    window, distance, depth, radius, moved = near
    cut = image.cropped(window)
    focal = image.camera.focal[0]
    pixels = radius * focal / depth
    within = distance < _REACH * pixels + _REACH_MOVED * moved * focal / depth + _MARGIN
    if image.occluders is not None:
        within &= ~image.occluders[window]
    seen = cut.depth > 0
    aside = seen & (
        (cut.depth < depth - _NEARER * radius - moved) | (cut.depth > depth + _BEHIND * radius + moved)
    )
    ratio = np.zeros(within.shape)
    if appearance is not None and image.colors is not None:
        ratio += _compare_colors(image.colors[window], appearance)
    if table is not None:
        above, _, _ = _core.measure_heights(cut.depth, cut.camera, cut.pose, table, None, radius)
        high = np.clip(_HEIGHT_SHARE * (above / radius - _HEIGHT), -_MOST_LOW, _MOST_HIGH)
        ratio += np.where(seen, high, 0.0)
        aside &= above > 2.0 * radius
    mask[window] = within & ~aside & (ratio > 0.0)
    return mask


def learn_colors(
    image: DepthImage, ropes: Sequence[RopeState], before: Appearance | None
) -> Appearance | None:
    """Return the colours of ropes that an image shows, and of what is beside them or hides them."""
    if image.colors is None:
        return before
    near = _look_near(image, ropes, 0.0, hidden=False)
    if near is None:
        return before
    window, distance, depth, radius, _ = near
    pixels = radius * image.camera.focal[0] / depth
    bins = _find_bins(image.colors[window])
    seen = image.depth[window]
    close = (seen > 0) & (np.abs(seen - depth) < _NEARER * radius)
    core = close & (distance < np.maximum(_CORE * pixels, 1.0))
    beside = (distance > _BESIDE * pixels + 1.0) & (distance < 2.0 * _REACH * pixels + _MARGIN)
    if image.occluders is not None:
        core &= ~image.occluders[window]
        beside &= ~image.occluders[window]
    counts = [np.bincount(bins[chosen], minlength=_BINS**3).astype(float) for chosen in (core, beside)]
    if before is None:
        return Appearance(*counts) if core.any() else None
    old = (before.ropes, before.others)
    mixed = [_MEMORY * a + (1.0 - _MEMORY) * b for a, b in zip(old, counts, strict=True)]
    return Appearance(*mixed)


def _find_bins(colors: NDArray[np.uint8]) -> NDArray[np.int64]:
    step = 256 // _BINS
    red, green, blue = (colors[..., k].astype(np.int64) // step for k in range(3))
    return (red * _BINS + green) * _BINS + blue


def _compare_colors(colors: NDArray[np.uint8], appearance: Appearance) -> Array:
    shares = [
        (_spread(counts) + _SMOOTHING) / (counts.sum() + _SMOOTHING * len(counts))
        for counts in (appearance.ropes, appearance.others)
    ]
    ratios = np.clip(np.log(shares[0] / shares[1]), -_MOST_RATIO, _MOST_RATIO)
    return np.asarray(ratios[_find_bins(colors)])


def _spread(counts: Array) -> Array:
    """Return counts that neighbouring bins share, because light changes a little."""
    cube = counts.reshape(_BINS, _BINS, _BINS)
    for axis in range(3):
        padded = np.pad(cube, [(1, 1) if k == axis else (0, 0) for k in range(3)], mode="edge")
        low, high = (np.take(padded, range(start, start + _BINS), axis) for start in (0, 2))
        cube = 0.25 * low + 0.5 * cube + 0.25 * high
    return np.asarray(cube.reshape(-1))


_Near = tuple[tuple[slice, slice], Array, Array, float, float]


def _look_near(
    image: DepthImage, ropes: Sequence[RopeState], elapsed: float, hidden: bool = True
) -> _Near | None:
    """Return a window around the predicted ropes; there, the distance to them and their depth.

    Without `hidden`, only their nodes that were seen count.

    Distances are in pixels, depths, the greatest radius and the way of the fastest node in metres.
    Depths are those of the nearest place of a rope.
    """
    lines, fastest = [], 0.0
    for rope in ropes:
        nodes = rope.nodes + elapsed * rope.velocities
        at = np.arange(0.0, len(nodes) - 1.0 + 1e-9, _STEP / 4.0)
        if not hidden:
            at = at[~(rope.hidden[at.astype(int)] | rope.hidden[np.ceil(at).astype(int)])]
        lines.append(np.stack([np.interp(at, np.arange(len(nodes)), nodes[:, k]) for k in range(3)], axis=1))
        fastest = max(fastest, float(np.linalg.norm(rope.velocities, axis=1).max()))
    places = np.concatenate(lines)
    z = (places - image.pose[:3, 3]) @ image.pose[:3, 2]
    places, z = places[z > 0], z[z > 0]
    rows, columns, inside = image.find_pixels(places)
    rows, columns, z = rows[inside], columns[inside], z[inside]
    if not len(rows):
        return None
    radius, moved = max(rope.radius for rope in ropes), fastest * elapsed
    reach = 2.0 * _REACH * radius + _REACH_MOVED * moved
    margin = int(reach * image.camera.focal[0] / float(z.min())) + _HALF_WINDOW
    window = (
        slice(max(int(rows.min()) - margin, 0), int(rows.max()) + margin + 1),
        slice(max(int(columns.min()) - margin, 0), int(columns.max()) + margin + 1),
    )
    shape = image.depth[window].shape
    r, c = rows - window[0].start, columns - window[1].start
    empty = np.ones(shape, dtype=bool)
    empty[r, c] = False
    distance = np.asarray(_core.measure_edge_distances(empty, margin), dtype=float)
    return window, distance, _fill_depths(shape, r, c, z), radius, moved


def _fill_depths(
    shape: tuple[int, ...], rows: NDArray[np.int64], columns: NDArray[np.int64], z: Array
) -> Array:
    """Return (H, W) depths of ropes, averaged over coarse cells and those around them."""
    cell = 16
    height, width = shape[0] // cell + 1, shape[1] // cell + 1
    sums = np.zeros((height + 2, width + 2))
    counts = np.zeros((height + 2, width + 2))
    np.add.at(sums, (rows // cell + 1, columns // cell + 1), z)
    np.add.at(counts, (rows // cell + 1, columns // cell + 1), 1.0)
    usual = float(z.mean())
    for _ in range(3):
        full = counts > 0
        near = sum(
            (
                np.roll(np.where(full, sums / np.maximum(counts, 1e-9), 0.0), shift, axis)
                for axis in (0, 1)
                for shift in (-1, 1)
            ),
            np.zeros_like(sums),
        )
        number = sum(
            (np.roll(full, shift, axis).astype(float) for axis in (0, 1) for shift in (-1, 1)),
            np.zeros_like(sums),
        )
        grow = ~full & (number > 0)
        sums[grow], counts[grow] = near[grow] / number[grow], 1.0
    means = np.where(counts > 0, sums / np.maximum(counts, 1e-9), usual)[1:-1, 1:-1]
    return np.asarray(np.repeat(np.repeat(means, cell, axis=0), cell, axis=1)[: shape[0], : shape[1]])
