"""Pieces of strips in a colour image, and where their pixels are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.support.checks import Array

_MAX_WIDTH = 1.0 / 10.0  # of the image's shorter side: width of the widest strip sought
_MIN_CONTRAST = 7.0  # Lab: least response of a strip
_NOISE = 4.0  # median responses of the surroundings: least response of a strip
_ASIDE = 0.3  # share of the difference of a strip's sides that lowers its response
_MAX_CONTRAST = 40.0  # Lab: pieces that contrast more are no better
_MAX_RESPONSE = 6.0  # pieces that respond more are no better
_MIN_KNOWN_CONTRAST = 8.0  # of likelihoods: least response of a strip
_KNOWN_NOISE = 3.0  # the same as _NOISE, of likelihoods
_MAX_SAMPLES = 500  # pixels of a piece that give its depth and height

Slices = tuple[slice, slice]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Piece:
    """A connected piece of a strip.

    Attributes
    ----------
    half_width, length, extent, widest : float
        Pixels. The extent is the diagonal of the bounding box; `widest` is the largest half width.
    even : float
        Share of its middle that has about its half width.
    color, background : (3,) ndarray
        Mean colours, Lab.
    contrast : float
        Median difference of its colours from the background, Lab.
    response : float
        How much it stands out as a strip; 1 is the least.
    aside : float
        Difference of both sides, over the difference from them.
    scatter : float
        Standard deviation of its colours, Lab.
    soft : float
        Width of its edge, pixels.
    pure : float
        Share of its middle that differs from the background.
    band_half_width : float
        The half width of the strips that it was sought among, pixels.
    """

    half_width: float
    length: float
    extent: float
    widest: float
    even: float
    color: Array
    background: Array
    contrast: float
    response: float
    aside: float
    scatter: float
    soft: float
    pure: float
    band_half_width: float
    _labels: NDArray[np.int32]
    _number: int
    _factor: int
    _bounds: tuple[int, int, int, int]

    @property
    def half_widths(self) -> float:
        """Its length in half widths."""
        return self.length / self.half_width

    @property
    def score(self) -> float:
        """How much of a rope it seems."""
        # strips within ropes, such as highlights, have sides that differ
        likeness = max(1.0 - self.aside, 0.0)
        shown = min(self.contrast, _MAX_CONTRAST) * self.pure**2 * likeness**2
        return self.half_widths * shown * self.even * min(self.response, _MAX_RESPONSE)

    @property
    def slices(self) -> Slices:
        """Rows and columns of its bounding box in the image."""
        top, bottom, left, right = (self._factor * side for side in self._bounds)
        return slice(top, bottom), slice(left, right)

    @cached_property
    def pixels(self) -> Mask:
        """Its pixels in the bounding box."""
        top, bottom, left, right = self._bounds
        own: Mask = self._labels[top:bottom, left:right] == self._number
        factor = self._factor
        if factor == 1:
            return own
        cells: NDArray[np.int32] = np.pad(own, 1).astype(np.int32)
        cells = cells.repeat(factor, axis=0).repeat(factor, axis=1)
        rows: NDArray[np.int32] = np.pad(cells, ((factor, 0), (0, 0))).cumsum(axis=0, dtype=np.int32)
        rows = np.pad(rows[factor:] - rows[:-factor], ((0, 0), (factor, 0)))
        columns = rows.cumsum(axis=1, dtype=np.int32)
        sums = columns[:, factor:] - columns[:, :-factor]
        # the window ends at each pixel; half of it lies before
        first = factor + factor // 2
        height, width = own.shape[0] * factor, own.shape[1] * factor
        return np.asarray(sums[first : first + height, first : first + width] > 0.5 * factor * factor)

    @cached_property
    def places(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Rows and columns of its pixels in the image."""
        rows, columns = np.nonzero(self.pixels)
        top, left = (span.start for span in self.slices)
        return rows + top, columns + left

    @cached_property
    def samples(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Rows and columns of some of its pixels, spread evenly."""
        rows, columns = self.places
        step = max(len(rows) // _MAX_SAMPLES, 1)
        return rows[::step], columns[::step]

    def overlap(self, taken: Mask) -> float:
        """Return the share of its pixels in an (H, W) mask."""
        return float(np.mean(taken[self.places])) if len(self.places[0]) else 1.0

    def add_to(self, mask: Mask) -> None:
        """Add its pixels to an (H, W) mask."""
        mask[self.places] = True

    def make_mask(self, shape: tuple[int, int]) -> Mask:
        """Return an (H, W) mask of its pixels."""
        mask = np.zeros(shape, dtype=bool)
        self.add_to(mask)
        return mask


def find_pieces(lab: NDArray[np.float32], near: Mask | None) -> list[Piece]:
    """Find pieces of strips in a (3, H, W) image in Lab, at pixels that may show ropes."""
    return _search(lab, None, near, _MIN_CONTRAST, _NOISE, _ASIDE, signed=False)


def find_known_pieces(
    likelihood: NDArray[np.float32], lab: NDArray[np.float32], near: Mask | None
) -> list[Piece]:
    """Find pieces of strips that are brighter than both sides in an (H, W) image, with their colours."""
    planes = np.zeros_like(lab)
    planes[0] = likelihood
    return _search(planes, lab, near, _MIN_KNOWN_CONTRAST, _KNOWN_NOISE, 0.0, signed=True)


def _search(
    planes: NDArray[np.float32],
    lab: NDArray[np.float32] | None,
    near: Mask | None,
    min_contrast: float,
    noise: float,
    aside: float,
    signed: bool,
) -> list[Piece]:
    """Find pieces of strips in (3, H, W) planes, with the colours of another image if one is given."""
    bands = _core.find_color_pieces(
        planes,
        lab,
        None if near is None else np.ascontiguousarray(near),
        max_width=_MAX_WIDTH * min(planes.shape[1:]),
        min_contrast=min_contrast,
        noise=noise,
        aside=aside,
        signed=signed,
    )
    return _collect(bands)


def _collect(bands: Sequence[tuple[int, float, NDArray[np.int32], Array]]) -> list[Piece]:
    found = []
    for factor, half_width, labels, table in bands:
        for number, row in enumerate(table, 1):
            top, bottom, left, right = (int(side) for side in row[17:])
            found.append(
                Piece(
                    half_width=float(row[0]),
                    length=float(row[1]),
                    extent=float(row[2]),
                    widest=float(row[3]),
                    even=float(row[4]),
                    color=row[5:8],
                    background=row[8:11],
                    contrast=float(row[11]),
                    response=float(row[12]),
                    aside=float(row[13]),
                    scatter=float(row[14]),
                    soft=float(row[15]),
                    pure=float(row[16]),
                    band_half_width=half_width,
                    _labels=labels,
                    _number=number,
                    _factor=factor,
                    _bounds=(top, bottom, left, right),
                )
            )
    return found
