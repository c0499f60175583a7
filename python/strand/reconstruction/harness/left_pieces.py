"""Doubts of a harness at pieces of rope that lie on no strand, as a short branch does."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.reconstruction.harness.graph import Graph
from strand.reconstruction.harness.method import FoundHarness
from strand.ropes.chain import Chain
from strand.ropes.doubt import Doubt
from strand.support.checks import Array

_GAP = 0.8  # distance of such points from the strands' surfaces at least, least radii
_SIGMAS = 3.0  # the same, standard deviations of residuals
_STANDING = 1.0  # their distance from the plane of the table at least, least radii
_CORNERS = 1.6  # reach of wires side by side, whose ends have corners, half widths
_STEP = 0.2  # distance of the places of a strand, its radii
_BLOCK = 0.5  # side of the blocks of the plan in which they lie beside each other, least radii
_PER_BLOCK = 2.0  # points of a block of rope at least: with fewer, blocks are larger
_AREA = 1.0  # area of a piece at least, squared least radii
_DOUBT = 0.15  # doubt for each such area
_MOST = 0.6  # doubt of a piece at most
_AT_JUNCTION = 5.0  # distance from a junction where strands may cut corners, radii


def doubt_left_pieces(found: FoundHarness, graph: Graph, chains: Sequence[Chain]) -> Iterator[Doubt]:
    """Doubt a harness at pieces of rope that no strand explains: a short branch, or the end of a strand.

    Beside a junction that was found, a piece is hardly another branch, so that one doubt is for all.

    Parameters
    ----------
    found : FoundHarness
    graph : Graph
    chains : sequence of Chain
        The edges.
    """
    reason = "a piece beside the strands is as large as a short branch"
    at_junctions: set[int] = set()
    for area, place in _list_pieces(found, chains):
        amount, junction = min(_DOUBT * area, _MOST), _find_junction(place, graph, chains)
        if junction is not None:
            if junction in at_junctions:
                continue
            at_junctions.add(junction)
            amount = _DOUBT
        yield Doubt("left out", amount, "whether there is a branch", reason, place)


def _find_junction(place: Array, graph: Graph, chains: Sequence[Chain]) -> int | None:
    """Return the junction near a place; None if there is none."""
    for node in np.flatnonzero(np.array(graph.degrees) > 2).tolist():
        radius = max(chain.radius for pair, chain in zip(graph.pairs, chains, strict=True) if node in pair)
        if np.linalg.norm(graph.places[node] - place) < _AT_JUNCTION * radius:
            return int(node)
    return None


def _list_pieces(found: FoundHarness, chains: Sequence[Chain]) -> Iterator[tuple[float, Array]]:
    """Yield the area, squared least radii, and the middle (3,) of each piece of rope on no strand."""
    fit, drawn = found.fitted.fit, found.drawn
    least = min(chain.radius for chain in chains)
    gaps = _measure_gaps(found, chains)
    left = gaps > max(_GAP * least, _SIGMAS * fit.sigma)
    if found.ground.table is not None:
        left &= np.abs(found.ground.table.measure_heights(fit.points)) > _STANDING * least
    around = _core.count_neighbors(fit.points, least)[gaps < _GAP * least]
    if not left.any() or not len(around):
        return
    dense = max(float(np.median(around)), 1.0) / math.pi
    places, _ = drawn.flatten(fit.points[left])
    side = max(_BLOCK, math.sqrt(_PER_BLOCK / dense)) * least / drawn.cell
    numbers = _number_pieces(np.floor((places - places.min(axis=0)) / side).astype(np.int64))
    areas = np.bincount(numbers) / dense
    for number in np.flatnonzero(areas > _AREA):
        yield float(areas[number]), fit.points[left][numbers == number].mean(axis=0)


def _measure_gaps(found: FoundHarness, chains: Sequence[Chain]) -> Array:
    """Return the distance (N,) of the fit's points from the surface of the nearest strand, metres."""
    gaps = np.full(len(found.fitted.fit.points), np.inf)
    for chain, strand, is_flat in zip(chains, found.strands, found.beside.flat, strict=True):
        radius = max(chain.radius, _CORNERS * strand.half_width) if is_flat else chain.radius
        line = chain.at(np.linspace(0.0, chain.length, max(int(chain.length / (_STEP * chain.radius)), 2)))
        away = np.sqrt(_core.find_squared_distances(found.fitted.fit.points, line))
        gaps = np.minimum(gaps, away - radius)
    return gaps


def _number_pieces(blocks: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the number of the piece of each block (N, 2); blocks that touch are one piece."""
    taken = np.zeros(blocks.max(axis=0) + 1, dtype=bool)
    taken[blocks[:, 0], blocks[:, 1]] = True
    return np.asarray(_core.number_blobs(taken)[blocks[:, 0], blocks[:, 1]])
