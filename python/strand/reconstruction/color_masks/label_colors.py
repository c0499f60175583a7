"""Labels split where a strip shows one colour in one part and another in the rest: two ropes that touch."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from strand.reconstruction.color_masks.color_pieces import Mask
from strand.reconstruction.color_masks.near_table import average
from strand.reconstruction.color_masks.refinement import find_colors
from strand.reconstruction.color_masks.shades import measure_from_line
from strand.support.checks import Array

_SAME_COLOR = 10.0  # Lab: labels whose colours differ less are one
_LIGHT = 0.5  # weight of light in these differences
_SHADE = (0.5, 1.6)  # a rope's light, third root, over its mean
_AROUND = 2.0  # half widths: a rope of two colours shows both this near to any pixel
_NEAR = 0.8  # half widths: a pixel takes the colour that most have this near
_ONE = 0.85  # share of one colour around pixels of a rope of one colour
_MIN_SPLIT = 0.6  # share of such pixels, if two ropes touch
_MIN_LENGTH = 8.0  # half widths: length of a rope, of twice as many squared half widths


def split_labels(lab: NDArray[np.float32], labels: NDArray[np.int32], half_width: float) -> NDArray[np.int32]:
    """Return (H, W) labels of ropes in a (3, H, W) image in Lab, each of one rope's colours, from 1 on."""
    split = _merge_labels(lab, labels)
    ground = np.median(lab[:, ::4, ::4].reshape(3, -1)[:, (labels[::4, ::4] == 0).ravel()], axis=1)
    for label in np.unique(split[split > 0]):
        own = np.asarray(split == label)
        second = _find_second(lab, own, half_width, ground.astype(np.float64))
        if second is not None:
            split[second] = split.max() + 1
    numbers = np.unique(np.append(split, 0))
    return np.searchsorted(numbers, split).astype(np.int32)


def _merge_labels(lab: NDArray[np.float32], labels: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return labels of which those of one colour are one."""
    merged = labels.copy()
    known: dict[int, Array] = {}
    for label in np.unique(labels[labels > 0]):
        color = np.median(lab[:, labels == label], axis=1).astype(np.float64)
        for other, its in known.items():
            if np.linalg.norm((color - its) * (_LIGHT, 1.0, 1.0)) < _SAME_COLOR:
                merged[labels == label] = other
                break
        else:
            known[int(label)] = color
    return merged


def _find_second(lab: NDArray[np.float32], own: Mask, half_width: float, ground: Array) -> Mask | None:
    """Return the pixels of a mask that show a second rope's colour; None if they show one rope."""
    pixels = lab[:, own].T.astype(np.float64)
    colors = find_colors(pixels, ground)
    if len(colors) < 2:
        return None
    away = [measure_from_line(pixels, color[None], _SHADE) for color in colors]
    second = np.zeros(own.shape, dtype=np.float32)
    second[own] = away[1] < away[0]
    share = _share(second, own, _AROUND * half_width)[own]
    alone = (share < 1.0 - _ONE) | (share > _ONE)
    if np.mean(alone) < _MIN_SPLIT:
        return None
    least = 2.0 * _MIN_LENGTH * half_width**2
    if min(np.count_nonzero(share > _ONE), np.count_nonzero(share < 1.0 - _ONE)) < least:
        return None
    return np.asarray(own & (_share(second, own, _NEAR * half_width) > 0.5))


def _share(values: NDArray[np.float32], own: Mask, reach: float) -> Array:
    """Return the mean of values in a mask around each pixel."""
    size = max(math.ceil(reach), 1)
    return np.asarray(average(values, size) / np.maximum(average(own.astype(np.float32), size), 1e-6))
