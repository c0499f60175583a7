"""Ropes as the text of DisMech's geometry files."""

from __future__ import annotations

from collections.abc import Sequence

from strand.export.segments import cut_segments
from strand.geometry.line import Line
from strand.support.checks import check_instances


def dismech(chains: Sequence[Line], spacing: float | None = None) -> str:
    """Return the text of a geometry file of DisMech, for Python or MATLAB: nodes and edges.

    Parameters
    ----------
    chains : sequence of Line
        For example `Model.chains`.
    spacing : float, optional
        Length of edges, metres; three radii of each rope by default.

    Returns
    -------
    str
        A section `*Nodes` with a line "x,y,z" for each node, world frame, metres, and a section `*Edges` with
        a line "i,j" for each edge. Nodes count from 1, through all ropes. The radius is not in the file:
        DisMech takes it as `GeomParams.rod_r0`.

    Raises
    ------
    TypeError
        If `chains` holds another type, or `spacing` is not a number.
    ValueError
        If `spacing` is not positive, or so small that a rope has more than 100,000 edges.
    """
    nodes: list[str] = []
    edges: list[str] = []
    for chain in check_instances("chains", chains, Line):
        places = cut_segments(chain, spacing)
        first, last = len(nodes) + 1, len(nodes) + len(places)
        nodes += [",".join(f"{value:.12g}" for value in place) for place in places.tolist()]
        edges += [f"{i},{i + 1}" for i in range(first, last)]
        if chain.closed:
            edges.append(f"{last},{first}")
    return "\n".join(["*Nodes", *nodes, "*Edges", *edges]) + "\n"
