"""Masks as segmenters give them: grown or eaten, ragged, with bits lost and bits of the background."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import check_integer, check_nonnegative
from strand.synthetic.fields import field, pixels, spread

_RAGGED = 1.5  # pixels, smoothness of the edge's displacement
_BESIDE = 6  # pixels from the rope within which background merges with it
_MOST = 64  # pixels grown or eaten


@dataclass(frozen=True)
class Segmentation:
    """How a segmenter finds the ropes' pixels. Without arguments it finds them exactly.

    Attributes
    ----------
    grow : int
        Pixels by which the mask is too wide on every side; negative: eaten.
    ragged : float
        Standard deviation of how far the edge is displaced from place to place, pixels.
    lost : float
        Part, from 0 to 1, of the ropes' pixels that are missing in bits.
    taken : float
        Pixels of the background in the mask, over those of the ropes: half of them next to a rope, where they
        make it thicker, half as specks anywhere.
    patch : float
        Standard deviation of the Gaussian that makes the bits, pixels: they are some two of it across.

    Raises
    ------
    TypeError
        If a number is none, or `grow` is not a whole one.
    ValueError
        If a number is out of its range.
    """

    grow: int = 0
    ragged: float = 0.0
    lost: float = 0.0
    taken: float = 0.0
    patch: float = 1.5

    def __post_init__(self) -> None:
        check_integer("grow", self.grow, -_MOST, _MOST)
        for name in ("ragged", "patch"):
            pixels(name, getattr(self, name))
        for name in ("lost", "taken"):
            if check_nonnegative(name, getattr(self, name)) > 1:
                raise ValueError(f"{name}: expected a part from 0 to 1, got {getattr(self, name)}")

    def find(self, ropes: NDArray[np.bool_], rng: np.random.Generator) -> NDArray[np.bool_]:
        """(H, W) The mask that it makes of the ropes' pixels.

        Parameters
        ----------
        ropes : (H, W) ndarray of bool
            The pixels that show a rope.
        rng : numpy.random.Generator
            The source of chance.
        """
        found = spread(ropes, self.grow) if self.grow >= 0 else ~spread(~ropes, -self.grow)
        height, width = found.shape
        if self.ragged > 0:
            v, u = np.mgrid[:height, :width]
            down, right = (
                np.rint(self.ragged * field(found.shape, _RAGGED, rng)).astype(np.int64) for _ in range(2)
            )
            found = found[np.clip(v + down, 0, height - 1), np.clip(u + right, 0, width - 1)]
        count = int(ropes.sum())
        bits = field(ropes.shape, self.patch, rng)
        lost = _greatest(bits, found, self.lost * found.sum())
        beside = _greatest(bits, spread(found, _BESIDE) & ~found, 0.5 * self.taken * count)
        specks = _greatest(bits, ~found & ~beside, 0.5 * self.taken * count)
        return (found & ~lost) | beside | specks


def _greatest(values: NDArray[np.float64], among: NDArray[np.bool_], count: float) -> NDArray[np.bool_]:
    """(H, W) So many of some pixels: those with the greatest values."""
    chosen = np.zeros(among.shape, dtype=bool)
    where = np.flatnonzero(among)
    number = min(math.floor(count), len(where))
    if number > 0:
        order = np.argsort(-values.reshape(-1)[where], kind="stable")
        chosen.reshape(-1)[where[order[:number]]] = True
    return chosen
