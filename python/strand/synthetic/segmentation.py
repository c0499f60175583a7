"""Imitated segmentation masks: too wide or too narrow, ragged, with holes and false pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import check_instance, check_integer, check_nonnegative, to_array
from strand.synthetic.fields import check_pixels, dilate, draw_field

_EDGE_SMOOTHNESS = 1.5  # pixels: smoothness of the edge's displacement
_BESIDE = 6  # pixels: false pixels this near to a rope merge with it
_MAX_GROWTH = 64  # pixels


@dataclass(frozen=True)
class Segmentation:
    """The errors of a mask of the ropes; none by default.

    Attributes
    ----------
    grow : int
        Pixels by which the mask is too wide on every side; negative if it is too narrow.
    ragged : float
        Standard deviation of the edge's displacement, pixels.
    lost : float
        Fraction of the ropes' pixels that the mask misses in patches, from 0 to 1.
    taken : float
        Number of background pixels in the mask, relative to the ropes' pixels, from 0 to 1. Half of them are
        next to a rope and make it thicker; the others are specks anywhere.
    filled : float
        Corners between strands, and gaps, that no disc of this radius, pixels, reaches into are in the mask.
    patch : float
        Standard deviation of the Gaussian that shapes the patches, pixels. A patch is about twice as wide.

    Raises
    ------
    TypeError
        If a value is not a number, or `grow` is not an integer.
    ValueError
        If a number is out of its range.
    """

    grow: int = 0
    ragged: float = 0.0
    lost: float = 0.0
    taken: float = 0.0
    patch: float = 1.5
    filled: float = 0.0

    def __post_init__(self) -> None:
        check_integer("grow", self.grow, -_MAX_GROWTH, _MAX_GROWTH)
        for name in ("ragged", "patch", "filled"):
            check_pixels(name, getattr(self, name))
        for name in ("lost", "taken"):
            if check_nonnegative(name, getattr(self, name)) > 1:
                raise ValueError(f"{name}: expected a fraction from 0 to 1, got {getattr(self, name)}")

    def make_mask(self, ropes: NDArray[np.bool_], rng: np.random.Generator) -> NDArray[np.bool_]:
        """Return the (H, W) mask with these errors.

        Parameters
        ----------
        ropes : (H, W) ndarray of bool
            The exact mask.
        rng : numpy.random.Generator
            The random number generator.

        Raises
        ------
        TypeError
            If the mask has a mask of its own.
        ValueError
            If the mask does not hold bools, or is not of two dimensions.
        """
        ropes = to_array("ropes", ropes)
        if ropes.ndim != 2 or ropes.dtype != np.bool_:
            raise ValueError(f"ropes: expected bools of shape (H, W), got {ropes.dtype} of {ropes.shape}")
        check_instance("rng", rng, np.random.Generator)
        mask = _fill_corners(ropes, self.filled) if self.filled >= 1 else ropes
        mask = dilate(mask, self.grow) if self.grow >= 0 else ~dilate(~mask, -self.grow)
        height, width = mask.shape
        if self.ragged > 0:
            v, u = np.mgrid[:height, :width]
            down, right = (
                np.rint(self.ragged * draw_field(mask.shape, _EDGE_SMOOTHNESS, rng)).astype(np.int64)
                for _ in range(2)
            )
            mask = mask[np.clip(v + down, 0, height - 1), np.clip(u + right, 0, width - 1)]
        count = int(ropes.sum())
        patches = draw_field(ropes.shape, self.patch, rng)
        lost = _pick_greatest(patches, mask, self.lost * mask.sum())
        beside = _pick_greatest(patches, dilate(mask, _BESIDE) & ~mask, 0.5 * self.taken * count)
        specks = _pick_greatest(patches, ~mask & ~beside, 0.5 * self.taken * count)
        return (mask & ~lost) | beside | specks


def _fill_corners(mask: NDArray[np.bool_], radius: float) -> NDArray[np.bool_]:
    """Return an (H, W) mask closed by a disc: dilated by it, then eroded."""
    reach = math.floor(radius)
    around = np.pad(mask, 2 * reach)
    return ~_dilate_by_disc(~_dilate_by_disc(around, radius), radius)[
        2 * reach : -2 * reach, 2 * reach : -2 * reach
    ]


def _dilate_by_disc(mask: NDArray[np.bool_], radius: float) -> NDArray[np.bool_]:
    reach = math.floor(radius)
    height, width = mask.shape
    around, result = np.pad(mask, reach, mode="edge"), np.zeros_like(mask)
    for down in range(-reach, reach + 1):
        for right in range(-reach, reach + 1):
            if down * down + right * right <= radius * radius:
                rows = slice(reach + down, reach + down + height)
                result |= around[rows, reach + right : reach + right + width]
    return result


def _pick_greatest(values: NDArray[np.float64], among: NDArray[np.bool_], count: float) -> NDArray[np.bool_]:
    """Return an (H, W) mask of the `count` pixels with the greatest values among some."""
    chosen = np.zeros(among.shape, dtype=bool)
    where = np.flatnonzero(among)
    number = min(math.floor(count), len(where))
    if number > 0:
        order = np.argsort(-values.reshape(-1)[where], kind="stable")
        chosen.reshape(-1)[where[order[:number]]] = True
    return chosen
