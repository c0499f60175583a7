"""Textures of tables: plain, of wood, or printed with a pattern."""

from __future__ import annotations

import math

import numpy as np

from strand.support.checks import Array
from strand.synthetic.fields import draw_field

TEXTURES = ("plain", "wood", "checks", "stripes", "strokes")
"""The names of textures; the last three are patterns."""

_CELL = 0.001  # metres: side of a texture's cell
_CELLS = 800  # cells along each side; the texture repeats
_PLAIN_CONTRAST = 0.01  # share of the light by which a plain table varies
_WOOD_CONTRAST = (0.04, 0.12)  # range of the contrast of grain, share of the light
_GRAIN_LENGTH = 60  # cells: smoothness along the grain
_RING = (6.0, 25.0)  # cells: range of the distance of rings
_TILE = (0.012, 0.035)  # metres: range of the width of checks and stripes
_STROKES = 60  # printed strokes on a table
_STROKE_NODES = 400  # places along a stroke
_STROKE_WIDTH = (2, 8)  # cells: range of the half width of a stroke
_PRINT_CONTRAST = (0.35, 0.8)  # range of the contrast of prints, share of the light


def draw_texture(name: str, color: Array, rng: np.random.Generator) -> Array:
    """Return a texture of one of `TEXTURES`: (N, N, 3) colours from 0 to 1, of cells of a millimetre."""
    shape = (_CELLS, _CELLS)
    if name == "plain":
        return _shade(color, _PLAIN_CONTRAST * draw_field(shape, 3.0, rng))
    if name == "wood":
        return _draw_wood(color, rng)
    other = np.clip(color + rng.choice([-1.0, 1.0], 3) * rng.uniform(*_PRINT_CONTRAST, 3), 0.02, 0.95)
    y, x = np.mgrid[:_CELLS, :_CELLS] * (_CELL / rng.uniform(*_TILE))
    if name == "checks":
        share = (np.floor(x) + np.floor(y)) % 2.0
    elif name == "stripes":
        share = np.floor(x) % 2.0
    elif name == "strokes":
        return _draw_strokes(color, rng)
    else:
        raise ValueError(f"texture: expected one of {', '.join(TEXTURES)}, got {name!r}")
    return np.asarray(color + share[..., None] * (other - color))


def look_up(texture: Array, x: Array, y: Array) -> Array:
    """Return (..., 3) colours of a texture at places x, y on the table, metres."""
    columns, rows = x / _CELL, y / _CELL
    j, i = np.floor(columns).astype(np.int64), np.floor(rows).astype(np.int64)
    b, a = (columns - j)[..., None], (rows - i)[..., None]
    height, width = texture.shape[:2]

    def at(di: int, dj: int) -> Array:
        return np.asarray(texture[(i + di) % height, (j + dj) % width])

    return np.asarray(
        (at(0, 0) * (1.0 - b) + at(0, 1) * b) * (1.0 - a) + (at(1, 0) * (1.0 - b) + at(1, 1) * b) * a
    )


def _shade(color: Array, light: Array) -> Array:
    return np.clip(color * (1.0 + light[..., None]), 0.0, 1.0)


def _draw_wood(color: Array, rng: np.random.Generator) -> Array:
    """Return wood: fine streaks along x, and rings that wander."""
    fine = draw_field((_CELLS, _CELLS), 1.0, rng)
    streaks = np.cumsum(np.concatenate([fine[:, -_GRAIN_LENGTH:], fine], axis=1), axis=1)
    streaks = streaks[:, _GRAIN_LENGTH:] - streaks[:, :-_GRAIN_LENGTH]
    wander = draw_field((_CELLS, _CELLS), 40.0, rng)
    rows = np.arange(_CELLS)[:, None] / rng.uniform(*_RING)
    rings = np.sin(2.0 * math.pi * rows + 2.5 * wander) ** 3
    grain = 0.5 * streaks / streaks.std() + 0.7 * rings
    return _shade(color, rng.uniform(*_WOOD_CONTRAST) * grain)


def _draw_strokes(color: Array, rng: np.random.Generator) -> Array:
    """Return a print of crooked strokes of several colours."""
    texture = np.broadcast_to(color, (_CELLS, _CELLS, 3)).copy()
    for _ in range(_STROKES):
        heading = rng.uniform(0.0, 2.0 * math.pi) + np.cumsum(rng.normal(0.0, 0.08, _STROKE_NODES))
        steps = np.stack([np.sin(heading), np.cos(heading)], axis=1)[: int(rng.integers(60, _STROKE_NODES))]
        places = (rng.uniform(0.0, _CELLS, 2) + np.cumsum(steps, axis=0)).astype(np.int64)
        half = int(rng.integers(*_STROKE_WIDTH))
        offsets = np.argwhere(np.hypot(*np.mgrid[-half : half + 1, -half : half + 1]) <= half) - half
        rows, columns = ((places[:, None] + offsets) % _CELLS).reshape(-1, 2).T
        texture[rows, columns] = rng.uniform(0.05, 0.95, 3)
    return texture
