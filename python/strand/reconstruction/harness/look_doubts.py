"""Doubts of a look at a harness: another look, views along the table, hidden ends, and dropped points."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

import strand._core as _core
from strand.reconstruction.harness.graph import Graph
from strand.reconstruction.harness.ground import Ground
from strand.reconstruction.harness.rises import measure_offsets
from strand.reconstruction.stages import Observed
from strand.ropes.chain import Chain
from strand.ropes.doubt import Doubt
from strand.support.checks import Array

_GRAZING = 0.35  # cosine of the angle between up and the steepest view below which it tells little
_GRAZING_DOUBT = 0.8  # doubt of views along the table
_FAR = 2.0  # distance of points that no strand covers, greatest radii
_DROPPED = 0.004  # share of such points that raises no doubt
_DROPPED_DOUBT = 20.0  # doubt for all points
_ABOVE = 0.5  # height of a strand over an end that it hides at least, sums of their radii
_HIDDEN_DOUBT = 0.09  # doubt of each such end


def is_same_graph(some: Graph, other: Graph, reach: float) -> bool:
    """Tell whether two graphs have the same nodes, within a reach, metres, and the same edges.

    A ring without a junction has its node anywhere, so that only the number of such rings counts.
    """
    if len(some.places) != len(other.places) or len(some.pairs) != len(other.pairs):
        return False
    own, others = (_list_nodes_off_rings(graph) for graph in (some, other))
    if len(own) != len(others):
        return False
    names: dict[int, int] = {}
    for node in own:
        away = np.linalg.norm(other.places[others] - some.places[node], axis=1)
        names[node] = others[int(away.argmin())]
        if away.min() > reach:
            return False
    if len(set(names.values())) < len(names):
        return False
    edges = [
        sorted(tuple(sorted(pair)) for pair in pairs)
        for pairs in (
            [(names[a], names[b]) for a, b in some.pairs if a in names],
            [pair for pair in other.pairs if pair[0] in others],
        )
    ]
    return edges[0] == edges[1]


def _list_nodes_off_rings(graph: Graph) -> list[int]:
    """Return the nodes but those of rings without a junction."""
    rings = {start for start, stop in graph.pairs if start == stop and graph.degrees[start] == 2}
    return [node for node in range(len(graph.places)) if node not in rings]


def doubt_by_rival(sure: float, rival: float) -> Doubt:
    """Doubt a graph because a look from another side shows another one.

    At most one of both is right. Their confidences are taken as independent.

    Parameters
    ----------
    sure, rival : float
        The confidences of both, from 0 to 1; `sure` is not the smaller one.
    """
    alone = sure * (1.0 - rival)
    either = alone + rival * (1.0 - sure) + (1.0 - sure) * (1.0 - rival)
    amount = math.log(max(sure, 1e-9) / max(alone / max(either, 1e-9), 1e-9))
    reason = "a look from another side shows another graph"
    return Doubt("rival", max(amount, 0.0), "which graph it is", reason)


def doubt_grazing_views(ground: Ground) -> Iterator[Doubt]:
    """Doubt a harness that all views see along the table."""
    steepest = float((ground.ways @ ground.up).max())
    if steepest < _GRAZING:
        degrees = math.degrees(math.asin(max(steepest, 0.0)))
        reason = f"all views look along the table, the steepest at {degrees:.0f} degrees"
        yield Doubt("view", _GRAZING_DOUBT * (1.0 - steepest / _GRAZING), "how strands meet", reason)


def doubt_hidden_ends(graph: Graph, chains: Sequence[Chain], up: Array) -> Iterator[Doubt]:
    """Doubt free ends that lie under another strand: there a strand may go on."""
    reason = "an end lies under another strand: below it, the strand may go on"
    for number, late in graph.list_free_ends():
        chain = chains[number]
        tip = chain.points[-late]
        others = [other for k, other in enumerate(chains) if k != number]
        if any(_lies_above(other, tip, chain.radius + other.radius, up) for other in others):
            yield Doubt("end", _HIDDEN_DOUBT, "whether a strand ends", reason, tip)


def _lies_above(chain: Chain, place: Array, reach: float, up: Array) -> bool:
    """Tell whether a chain lies above a place (3,), within a reach in the plan, metres."""
    rise, aside = measure_offsets(chain.points, place, up)
    return bool(((aside < reach) & (rise > _ABOVE * reach)).any())


def doubt_dropped(observed: Observed, ground: Ground, chains: Sequence[Chain]) -> Iterator[Doubt]:
    """Doubt a harness if points that were dropped as outliers lie far from all strands.

    Where a strand runs along the rays, its points are as sparse as outliers. Those of a table do not count.
    """
    lines = np.concatenate([chain.points for chain in chains])
    reach = _FAR * max(chain.radius for chain in chains)
    counted = ground.clouds
    points = np.concatenate(ground.spare)
    if ground.table is None:
        counted = [view.world_points for view in observed.whole]
        points = np.concatenate(counted)
    far = np.count_nonzero(_core.find_squared_distances(points, lines) > reach**2)
    share = far / sum(len(cloud) for cloud in counted)
    if share > _DROPPED:
        reason = f"{100.0 * share:.1f} % of the points lie far from all strands, dropped as outliers"
        yield Doubt("left out", _DROPPED_DOUBT * share, "where strands end", reason)
