"""A netlist as evidence: which of several layouts of a harness it speaks for, and where an answer differs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand.geometry.polyline import path_length
from strand.reconstruction.harness.strands import Strand, list_pairs
from strand.ropes.doubt import Doubt
from strand.ropes.harness import Harness
from strand.ropes.net_matching import match_netlist
from strand.ropes.netlist import Netlist
from strand.support.checks import Array

_TOLERANCE = 0.05  # relative standard deviation of lengths before the fit, and of the harness's own
_MAX_EVIDENCE = 4.0  # costs that a netlist adds at most: clear heights weigh more
_UNMATCHED = 100.0  # cost of a layout that matches nowhere
_DIFFERS = 0.35  # doubt of an answer that lacks branches of the netlist, or has more


def weigh_layouts(net: Netlist, layouts: Sequence[tuple[list[Strand], int]]) -> Array:
    """Return the cost (K,) that a netlist adds to layouts.

    Parameters
    ----------
    net : Netlist
    layouts : sequence of (list of Strand, int)
        The strands, and the number of junctions.
    """
    costs = []
    for strands, junctions in layouts:
        pairs = list_pairs(strands, junctions)
        found = [
            (*pair, float(path_length(strand.nodes)[-1]), strand.half_width, None)
            for pair, strand in zip(pairs, strands, strict=True)
        ]
        match = match_netlist(net, found, _TOLERANCE)
        named = any(node is not None for node in match.nodes.values())
        costs.append(match.cost if named else _UNMATCHED)
    return np.minimum(np.array(costs) - min(costs), _MAX_EVIDENCE)


def doubt_differences(net: Netlist, harness: Harness) -> list[Doubt]:
    """Doubt a harness that lacks branches of a netlist, or has more."""
    match = harness.match(net)
    named = [node for node in match.nodes.values() if node is not None]
    own = {*named, *(edge.stop for node in named for edge in harness.tree(node))}
    missing = [f"{edge.start} to {edge.stop} is missing" for edge in match.missing]
    # what hangs not together with it is another rope
    extra = [f"edge {number} is too many" for number in match.extra if harness.edges[number].start in own]
    if not missing and not extra:
        return []
    reason = f"it differs from the netlist: {', '.join([*missing, *extra])}"
    return [Doubt("rival", _DIFFERS, "which harness it is", reason)]
