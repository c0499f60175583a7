"""Ropes of a known colour: strips of the likelihood of that colour against all others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from strand.reconstruction.color_masks.color_choice import Choice, choose_ropes
from strand.reconstruction.color_masks.color_pieces import Mask, Piece, find_known_pieces
from strand.reconstruction.color_masks.near_table import NearTable
from strand.support.checks import Array

_ROUNDS = 2  # estimates of the colour
_DEVIATIONS = (12.0, 7.0, 7.0)  # Lab: standard deviations of a colour before it is estimated
_COLORED = 12.0  # Lab: chroma of colours whose chroma goes with light
_LIGHT_DEVIATION = 14.0  # Lab: standard deviation along that line
_CELLS = (21, 26, 28)  # cells of the histogram of other colours: light, a and b
_CELL = (5.0, 8.0, 8.0)  # Lab: side of a cell
_LOWEST = (0.0, -100.0, -110.0)  # Lab: the first cell begins there
_KERNEL = (0.12, 0.76, 0.12)  # smooths the histogram
_OWN = 6.0  # squared deviations: colours this near are left out of the histogram
_PRIOR = np.log(0.1 / 0.9)  # logarithm of the odds of a rope's pixel
_MAX_ODDS = 3.0  # logarithm of the odds, at most; and its inverse
_SCALE = 8.0  # units of a response for each unit of logarithm
_MAX_DIFFERENCE = 22.0  # Lab: pieces of other colours are dropped
_MIN_SHOWN = 0.2  # share of a piece's pixels that have a colour, if it is of the rope
_PLAIN_DIFFERENCE = 14.0  # Lab: pieces found without the colour have it
_MAX_ASIDE = 0.45  # of the contrast: difference of the sides of such a piece
_LIGHT = 0.5  # weight of light in these differences
_MAX_SHIFT = 12.0  # Lab: largest change of a colour when it is estimated
_MIN_PIXELS = 30  # pixels that give a colour
_CLOSE = 12.0  # squared deviations of pixels that give a colour
_KNOWN_CONTRAST = 40.0  # Lab: a piece of a known colour contrasts


def find_known_ropes(
    lab: NDArray[np.float32],
    color: Array,
    plain: list[Piece],
    table: NearTable | None,
    ropes: int | None,
) -> Choice:
    """Find ropes of a colour in a (3, H, W) image, both in Lab, given the pieces found without the colour."""
    shape = lab.shape[1:]
    near = None if table is None else table.near
    # pieces that show the colour by themselves
    own = choose_ropes(
        [piece for piece in plain if _is_plain(piece, color)], (shape[0], shape[1]), table, ropes, color
    )
    pixels = lab.reshape(3, -1).T
    cells = _number_cells(pixels)
    mean, spread = color.copy(), _spread_colors(color)
    mask = _mask_pieces(own.pieces, shape) if own.groups else None
    choice = own
    for last in (*(False,) * (_ROUNDS - 1), True):
        if mask is not None:
            mean, spread = _estimate(pixels[mask.ravel()], color, mean, spread)
        odds = _measure_odds(pixels, cells, mean, spread, mask).reshape(shape)
        found = [
            replace(piece, contrast=_KNOWN_CONTRAST)
            for piece in find_known_pieces(odds, lab, near)
            if _differ(piece.color, color) < _MAX_DIFFERENCE
        ]
        if last:
            found += [piece for piece in plain if _is_plain(piece, mean)]
        choice = choose_ropes(found, (shape[0], shape[1]), table, ropes, mean)
        if not choice.groups:
            break
        mask = _mask_pieces(choice.pieces, shape)
    return own if own.length > choice.length else choice


def split_by_color(choice: Choice, lab: NDArray[np.float32], colors: Array) -> list[Choice]:
    """Return the pieces of a choice that show each of (N, 3) colours, a choice for each."""
    groups: list[list[Piece]] = [[] for _ in colors]
    weight = np.array([_LIGHT, 1.0, 1.0])
    for piece in choice.pieces:
        own = lab[:, piece.slices[0], piece.slices[1]][:, piece.pixels].T
        shares = [
            float(np.mean(np.linalg.norm((own - color) * weight, axis=1) < _MAX_DIFFERENCE))
            for color in colors
        ]
        best = int(np.argmax(shares))
        if shares[best] > _MIN_SHOWN:
            groups[best].append(piece)
    return [
        replace(choice, groups=[group] if group else [], why="" if group else "no strip has the colour")
        for group in groups
    ]


def _is_plain(piece: Piece, color: Array) -> bool:
    return _differ(piece.color, color) < _PLAIN_DIFFERENCE and piece.aside < _MAX_ASIDE


def _mask_pieces(pieces: list[Piece], shape: tuple[int, ...]) -> Mask:
    mask: Mask = np.zeros(shape, dtype=bool)
    for piece in pieces:
        piece.add_to(mask)
    return mask


def _differ(a: Array, b: Array) -> float:
    return float(np.linalg.norm((a - b) * (_LIGHT, 1.0, 1.0)))


def _spread_colors(color: Array) -> Array:
    """Return the (3, 3) covariance of a rope's colours."""
    spread = np.diag(np.square(_DEVIATIONS))
    if np.hypot(*color[1:]) > _COLORED:
        line = np.concatenate([[1.0], color[1:] / max(color[0] + 16.0, 30.0)])
        spread = spread + np.outer(line, line) * _LIGHT_DEVIATION**2
    return spread


def _number_cells(pixels: NDArray[np.float32]) -> NDArray[np.int64]:
    """Return each colour's cell of the histogram."""
    cells = np.floor((pixels - np.asarray(_LOWEST)) / np.asarray(_CELL)).astype(np.int64)
    cells = np.clip(cells, 0, np.asarray(_CELLS) - 1)
    return np.asarray((cells[:, 0] * _CELLS[1] + cells[:, 1]) * _CELLS[2] + cells[:, 2])


def _measure_odds(
    pixels: NDArray[np.float32], cells: NDArray[np.int64], mean: Array, spread: Array, mask: Mask | None
) -> NDArray[np.float32]:
    """Return (N,) scaled logarithms of the odds that pixels are rope."""
    away = pixels - mean.astype(np.float32)
    inverse = np.linalg.inv(spread).astype(np.float32)
    # a product of large matrices would wake threads of BLAS
    turned = sum(away[:, k, None] * inverse[k] for k in range(3))
    squares = np.asarray((turned * away).sum(axis=1))
    likelihood = -0.5 * squares - 0.5 * np.log(np.linalg.det(spread)) - 1.5 * np.log(2.0 * np.pi)
    others = squares > _OWN if mask is None else ~mask.ravel()
    histogram = np.bincount(cells[others], minlength=int(np.prod(_CELLS))).reshape(_CELLS).astype(np.float64)
    for axis in range(3):
        around = np.pad(histogram, [(1, 1) if k == axis else (0, 0) for k in range(3)])
        count = _CELLS[axis]
        histogram = np.asarray(
            sum(weight * np.take(around, np.arange(k, k + count), axis) for k, weight in enumerate(_KERNEL))
        )
    density = histogram.ravel()[cells] / max(int(others.sum()), 1) / np.prod(_CELL)
    odds = likelihood - np.log(density + 1e-7) + _PRIOR
    return np.asarray(_SCALE * np.clip(odds, -_MAX_ODDS, _MAX_ODDS), dtype=np.float32)


def _estimate(own: NDArray[np.float32], color: Array, mean: Array, spread: Array) -> tuple[Array, Array]:
    """Return mean and covariance of the colours of a rope's pixels, near the known colour."""
    away = own - mean
    squares = ((away @ np.linalg.inv(spread)) * away).sum(axis=1)
    close = own[squares < _CLOSE].astype(np.float64)
    if len(close) < _MIN_PIXELS:
        return mean, spread
    shift = np.clip(np.median(close, axis=0) - color, -_MAX_SHIFT, _MAX_SHIFT)
    return color + shift, np.cov(close.T) * 1.3 + np.diag([25.0, 9.0, 9.0])
