"""Least distances of two strands around given places of both."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from strand.geometry.line import Line
from strand.support.checks import Array

_PLACES = 12  # on either side of a place along each strand
_REFINEMENT = 2  # steps between neighbouring places, around the nearest ones
_BATCH = 2_000  # pairs of strands at a time


def find_least_distances(
    chains: Sequence[Line], number: NDArray[np.intp], at: Array, back: Array, ahead: Array
) -> Array:
    """Return the least distances (K,) of axes near places of both, metres.

    The places are arc lengths `at` (2, K) on the lines with the numbers `number`. The search goes `back` and
    `ahead` (2, K) along both: to the ends of open lines, around closed ones.
    """
    found = np.empty(at.shape[1])
    for start in range(0, at.shape[1], _BATCH):
        some = np.s_[:, start : start + _BATCH]
        found[some[1]] = _search(chains, number[some], at[some], back[some], ahead[some])
    return found


def _search(chains: Sequence[Line], number: NDArray[np.intp], at: Array, back: Array, ahead: Array) -> Array:
    """Compare a few places of both strands, then straight steps around the nearest ones."""
    share = np.linspace(-1.0, 1.0, 2 * _PLACES + 1)
    s = at[..., None] + share * np.where(share < 0, back[..., None], ahead[..., None])
    places = _sample(chains, number, s)
    one, other = places
    lengths = np.einsum("skpi,skpi->skp", places, places)
    square = lengths[0, :, :, None] + lengths[1, :, None, :]
    square -= 2.0 * one @ other.transpose(0, 2, 1)
    nearest = np.stack(np.unravel_index(square.reshape(len(square), -1).argmin(axis=1), square.shape[1:]))
    low, high = (
        np.take_along_axis(s, np.clip(nearest + k, 0, 2 * _PLACES)[..., None], axis=2) for k in (-1, 1)
    )
    places = _sample(chains, number, low + np.linspace(0.0, 1.0, 2 * _REFINEMENT + 1) * (high - low))
    (a, c), (b, d) = places[:, :, :-1], places[:, :, 1:]
    count = a.shape[1]
    one, other = (np.arange(count * count) // count, np.arange(count * count) % count)
    pairs = (part.reshape(-1, 3) for part in (a[:, one], b[:, one], c[:, other], d[:, other]))
    _, away = find_nearest_on_segments(*pairs)
    return np.asarray(away.reshape(-1, count * count).min(axis=1))


def _sample(chains: Sequence[Line], number: NDArray[np.intp], s: Array) -> Array:
    """Return places (2, K, P, 3) of lines at arc lengths, relative to their mean over both strands."""
    places = np.empty((*s.shape, 3))
    for i in np.unique(number):
        here = number == i
        places[here] = chains[i].at(s[here])
    # far from the origin squares would lose digits
    return np.asarray(places - places.mean(axis=(0, 2), keepdims=True))


def find_nearest_on_segments(a: Array, b: Array, c: Array, d: Array) -> tuple[Array, Array]:
    """Find the closest places of segments a to b and c to d (Ericson 2005, section 5.1.9).

    Returns fractions (2, K) along both segments, and distances (K,), metres.
    """
    u, v, w = b - a, d - c, a - c
    # a segment may be one point
    uu, vv = (np.maximum(np.einsum("ki,ki->k", p, p), 1e-300) for p in (u, v))
    uv, uw, vw = (np.einsum("ki,ki->k", p, q) for p, q in ((u, v), (u, w), (v, w)))
    square = uu * vv - uv * uv
    parallel = square <= 1e-12 * uu * vv
    s = np.where(parallel, 0.5, np.clip((uv * vw - uw * vv) / np.where(parallel, 1.0, square), 0.0, 1.0))
    t = np.clip((uv * s + vw) / vv, 0.0, 1.0)
    s = np.clip((uv * t - uw) / uu, 0.0, 1.0)
    return np.stack([s, t]), np.linalg.norm(w + s[:, None] * u - t[:, None] * v, axis=1)
