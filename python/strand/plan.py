"""Where lines cross in a plan: all places, exactly, in time that grows with the lines and crossings."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from strand.checks import Array
from strand.meeting import meeting, pieces

Whole = NDArray[np.int64]

# nodes are moved to a lattice with so many steps across: products of differences fit in 64 bits, so that
# every comparison is exact
_STEPS = 1 << 30
# cells are at least so many steps wide
_LEAST_CELL = 8


def crossed(nodes: Array, segments: NDArray[np.intp]) -> tuple[NDArray[np.intp], Array, NDArray[np.int8]]:
    """Find all pairs of segments that cross.

    Nodes are moved by up to 2^-31 of the plan's extent, to a lattice. Where a node then lies on another
    segment, or segments lie on each other, each node counts as moved by an amount of its own, too small to
    see (Edelsbrunner and Mücke 1990, "Simulation of simplicity"). So lines cross as if they were in general
    position: one that goes through a node of another crosses it once; one that touches it crosses it twice at
    the same place, or never.

    Parameters
    ----------
    nodes : (N, 2) ndarray
        Places in the plan.
    segments : (S, 2) ndarray of int
        The nodes from which and to which each goes. Segments that share a node do not cross.

    Returns
    -------
    pairs : (K, 2) ndarray of int
        Numbers of the segments, the less first, sorted.
    shares : (K, 2) ndarray
        How far along each segment they cross, from 0 to 1.
    turns : (K,) ndarray of int
        1 where the second crosses the first from its right to its left, else -1.
    """
    extent = float(np.ptp(nodes, axis=0).max()) if len(nodes) else 0.0
    if extent == 0.0:
        return np.empty((0, 2), dtype=np.intp), np.empty((0, 2)), np.empty(0, dtype=np.int8)
    places = np.rint((nodes - nodes.min(axis=0)) * (_STEPS / extent)).astype(np.int64)
    found = list(_near(places, segments))
    pairs = np.unique(np.concatenate([np.empty((0, 2), dtype=np.intp), *found]), axis=0)
    a, b = segments[pairs[:, 0]].T
    c, d = segments[pairs[:, 1]].T
    of_a, of_b, of_c, of_d = (
        _side(places, *triple) for triple in ((c, d, a), (c, d, b), (a, b, c), (a, b, d))
    )
    met = (of_a[1] != of_b[1]) & (of_c[1] != of_d[1])
    shares = np.stack([_share(of_a[0][met], of_b[0][met]), _share(of_c[0][met], of_d[0][met])], axis=1)
    return pairs[met], shares, of_d[1][met]


def _share(start: Whole, stop: Whole) -> Array:
    """(K,) Where a line's distance from another goes through zero; its middle, if all of it lies on that."""
    whole = start.astype(np.float64) - stop
    on = whole == 0
    return np.asarray(np.where(on, 0.5, start / np.where(on, 1.0, whole)))


def _side(
    places: Whole, a: NDArray[np.intp], b: NDArray[np.intp], c: NDArray[np.intp]
) -> tuple[Whole, NDArray[np.int8]]:
    """(K,), (K,) Twice the areas of triangles of nodes, and on which side of a to b node c is: 1 is left."""
    p, q, r = places[a], places[b] - places[a], places[c] - places[a]
    area = q[:, 0] * r[:, 1] - q[:, 1] * r[:, 0]
    side = np.sign(area).astype(np.int8)
    flat = np.flatnonzero(area == 0)
    if len(flat):
        triples = np.stack([a[flat], b[flat], c[flat]])
        odd = (triples[0] > triples[1]) ^ (triples[0] > triples[2]) ^ (triples[1] > triples[2])
        p, q, r = places[np.sort(triples, axis=0)]
        # the area's terms in the nodes' small moves, the largest first; the last is never zero
        terms = [r[:, 0] - q[:, 0], q[:, 1] - r[:, 1], p[:, 0] - r[:, 0]]
        sign = np.ones(len(flat), dtype=np.int64)
        for term in reversed(terms):
            sign = np.where(term != 0, np.sign(term), sign)
        side[flat] = np.where(odd, -sign, sign)
    return area, side


def _near(places: Whole, segments: NDArray[np.intp]) -> Iterator[NDArray[np.intp]]:
    """Yield pairs of segments that may cross, the less first: boxes around pieces of them meet."""
    start, step = places[segments[:, 0]], places[segments[:, 1]] - places[segments[:, 0]]
    size = np.abs(step).max(axis=1)
    cell = max(2 * int(size.mean()), _LEAST_CELL)
    owner, shares = pieces(size, cell)
    ends = [start[owner] + step[owner] * share[:, None] for share in shares.T]
    # pieces begin and end between steps of the lattice
    low = np.floor(np.minimum(*ends)).astype(np.int64) - 1
    high = np.ceil(np.maximum(*ends)).astype(np.int64) + 1
    for i, j in meeting(low, high, cell):
        pairs = np.sort(np.stack([owner[i], owner[j]], axis=1), axis=1)
        joined = (segments[pairs[:, 0]][:, :, None] == segments[pairs[:, 1]][:, None, :]).any(axis=(1, 2))
        yield pairs[~joined & (pairs[:, 0] != pairs[:, 1])]
