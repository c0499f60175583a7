"""How near two strands come to each other around given places of both."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from strand.geometry.line import Line
from strand.support.checks import Array

# places to either side along each strand, and finer ones between those next to the nearest
_PLACES, _FINER = 12, 2
# pairs of strands at a time
_AT_ONCE = 2_000


def find_least_distances(
    chains: Sequence[Line], number: NDArray[np.intp], at: Array, back: Array, ahead: Array
) -> Array:
    """Return the least distance of axes near places of both.

    Parameters
    ----------
    chains : sequence of Line
    number : (2, K) ndarray of int
        Numbers of the chains of both strands.
    at : (2, K) ndarray
        Arc lengths on them, metres.
    back, ahead : (2, K) ndarray
        How far to look along both strands before and after these, metres. Open chains are looked at to their
        ends, closed ones round their seam.

    Returns
    -------
    (K,) ndarray
        Metres.
    """
    found = np.empty(at.shape[1])
    for start in range(0, at.shape[1], _AT_ONCE):
        some = np.s_[:, start : start + _AT_ONCE]
        found[some[1]] = _least(chains, number[some], at[some], back[some], ahead[some])
    return found


def _least(chains: Sequence[Line], number: NDArray[np.intp], at: Array, back: Array, ahead: Array) -> Array:
    """(K,) Least distances: between a few places, then between straight steps around the nearest of them."""
    share = np.linspace(-1.0, 1.0, 2 * _PLACES + 1)
    s = at[..., None] + share * np.where(share < 0, back[..., None], ahead[..., None])
    places = _places(chains, number, s)
    one, other = places
    lengths = np.einsum("skpi,skpi->skp", places, places)
    square = lengths[0, :, :, None] + lengths[1, :, None, :]
    square -= 2.0 * one @ other.transpose(0, 2, 1)
    nearest = np.stack(np.unravel_index(square.reshape(len(square), -1).argmin(axis=1), square.shape[1:]))
    low, high = (
        np.take_along_axis(s, np.clip(nearest + k, 0, 2 * _PLACES)[..., None], axis=2) for k in (-1, 1)
    )
    places = _places(chains, number, low + np.linspace(0.0, 1.0, 2 * _FINER + 1) * (high - low))
    (a, c), (b, d) = places[:, :, :-1], places[:, :, 1:]
    count = a.shape[1]
    one, other = (np.arange(count * count) // count, np.arange(count * count) % count)
    pairs = (part.reshape(-1, 3) for part in (a[:, one], b[:, one], c[:, other], d[:, other]))
    _, away = find_nearest_on_segments(*pairs)
    return np.asarray(away.reshape(-1, count * count).min(axis=1))


def _places(chains: Sequence[Line], number: NDArray[np.intp], s: Array) -> Array:
    """(2, K, P, 3) Places of chains at arc lengths, from the middle of both strands' places."""
    places = np.empty((*s.shape, 3))
    for i in np.unique(number):
        here = number == i
        places[here] = chains[i].at(s[here])
    # squares of what is far from the origin would lose digits
    return np.asarray(places - places.mean(axis=(0, 2), keepdims=True))


def find_nearest_on_segments(a: Array, b: Array, c: Array, d: Array) -> tuple[Array, Array]:
    """Closest places of segments a to b and c to d (Ericson 2005, section 5.1.9).

    Returns
    -------
    shares : (2, K) ndarray
        How far along both, from 0 to 1.
    away : (K,) ndarray
        Distance between them, metres.
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
