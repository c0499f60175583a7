"""Knots: what is tied in a rope, by name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from strand import _core
from strand.geometry.frames import check_direction
from strand.geometry.line import Line
from strand.ropes.diagram import Diagram, make_diagram
from strand.support.checks import Array, check_bool, check_finite_array

UNKNOWN = "unknown"
"""The name of a knot that is not in the table."""

Chirality = Literal["right", "left"]


@dataclass(frozen=True)
class Knot:
    """What is tied in a rope.

    Attributes
    ----------
    name : str
        The knot's name in Rolfsen's table, to seven crossings: "0_1" for none, "3_1", "4_1", ... "7_7"; the
        composite knots "3_1#3_1" and "3_1#4_1"; "unknown" for all others.
    chirality : {"right", "left"} or None
        Which of two mirror images it is. "right" is the one whose alternating diagrams with the fewest
        crossings have a positive writhe: more crossings are right-handed. None where both are the same knot
        ("0_1", "4_1", "6_3"), and where `name` is "unknown". Of "3_1#3_1", the granny knots are "right" or
        "left" as their two trefoils are, the square knot is None; "3_1#4_1" has the chirality of its trefoil.
    probability : float
        The share of closures that say so, from 0 to 1; 1 for a closed rope. Times the probability that
        errors in the order of crossings leave the knot what it is, if crossings were given, or a
        reconstructed chain has its own.
    core : (float, float) or None
        Arc lengths, metres, between which the knot is tied: the shortest stretch found of which most closures
        have the same Alexander polynomial, to a fiftieth of the rope's length. None for "0_1", "unknown" and
        closed ropes, and where no more than half of the closures say `name`.
    ambiguous : tuple of str
        Other prime knots to twelve crossings with the same Alexander and Jones polynomials that the diagram
        has enough crossings for. Empty wherever the diagram has fewer than ten.
    shares : tuple of (str, str or None, float)
        What all closures say: name, chirality and share, the most frequent first.
    alexander : tuple of int or None
        Coefficients of the Alexander polynomial from the lowest to the highest power: a palindrome with the
        sum 1. None if the diagram has more than 48 crossings.
    jones : (int, tuple of int) or None
        The Jones polynomial: its lowest exponent, and the coefficients from there up. t + t^3 - t^4 for the
        trefoil "right". None if the diagram is too large.
    diagram : Diagram
        One with few crossings, as closures gave it: simplified by Reidemeister's first and second move.
        Without crossings for "0_1", and where a chain is too tangled.
    """

    name: str
    chirality: Chirality | None
    probability: float
    core: tuple[float, float] | None
    ambiguous: tuple[str, ...]
    shares: tuple[tuple[str, Chirality | None, float], ...]
    alexander: tuple[int, ...] | None
    jones: tuple[int, tuple[int, ...]] | None
    diagram: Diagram

    def gauss_code(self) -> tuple[int, ...]:
        """Signed Gauss code of `diagram`."""
        return self.diagram.gauss_code()

    def pd_code(self) -> tuple[tuple[int, ...], ...]:
        """Planar diagram code of `diagram`."""
        return self.diagram.pd_code()

    def dt_code(self) -> tuple[int, ...]:
        """Dowker-Thistlethwaite code of `diagram`."""
        return self.diagram.dt_code()

    def writhe(self) -> int:
        """Sum of the signs of the crossings of `diagram`."""
        return self.diagram.writhe()


def knot(
    points: ArrayLike,
    closed: bool = False,
    *,
    crossings: ArrayLike | None = None,
    direction: ArrayLike = (0.0, 0.0, 1.0),
) -> Knot:
    """Name the knot that is tied in a rope.

    An open rope is no knot until it is closed: both ends are led straight to a far sphere in the same
    direction, and joined there. This is done in 50 directions, spread evenly and always the same. The name
    is what most of them say. Each closure is simplified (Koniaris, Muthukumar and Taylor's removal of
    nodes; Reidemeister's first and second move) and named by its Alexander and its Jones polynomial, both
    exact.

    Parameters
    ----------
    points : (N, 3) array_like of float
        Nodes in order, metres, N >= 2 (closed: 3), no two in a row equal.
    closed : bool
        Whether the last node joins the first, as in a ring.
    crossings : (K, 3) array_like of float, optional
        How sure the order at crossings is: arc lengths of the two strands, metres, and the probability that
        the nodes have them in the right order. Each belongs to the nearest crossing that is seen from
        `direction`; crossings that are not given are sure. Those that only twist a strand do not matter. Of
        the others the ten least sure are tried both ways, and all further ones must be right: `probability`
        is then a lower bound.
    direction : (3,) array_like of float
        From where `crossings` were seen: a vector from the rope to the viewer. It is not used without them.

    Returns
    -------
    Knot

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If `points` is not (N, 3), not finite, has too few nodes or equal ones in a row, or if the curve
        meets itself where that decides the knot; if `closed` and the first node is there again at the end;
        if `crossings` are not arc lengths and probabilities, or more than are seen; if `direction` is zero.
    """
    nodes, closed = check_finite_array("points", points, ("N", 3)), check_bool("closed", closed)
    path = np.vstack([nodes, nodes[:1]]) if closed and len(nodes) else nodes
    return name_knot(nodes, closed, _core.path_length(path), crossings, direction)


def name_knot(
    nodes: Array,
    closed: bool,
    arc: Array,
    crossings: ArrayLike | None,
    direction: ArrayLike,
    strict: bool = True,
) -> Knot:
    """Return what `knot` does, with the arc lengths at the nodes; of a closed rope also once around.

    If not `strict`, crossings need not be seen in the nodes: those that are not must be right.
    """
    answers, core, twin, alexander, jones, codes = _core.knot(nodes, closed)
    shares = tuple((name or UNKNOWN, chirality, share) for name, chirality, share in answers)
    name, chirality, probability = shares[0]
    if crossings is not None and np.size(crossings):
        given = check_finite_array("crossings", crossings, ("K", 3))
        path = np.vstack([nodes, nodes[:1]]) if closed else nodes
        if not (given[:, :2].min() >= 0 and given[:, :2].max() <= arc[-1] * (1 + 1e-9)):
            raise ValueError(f"crossings: expected arc lengths from 0 to {arc[-1]:g} m")
        places = np.interp(given[:, :2], arc, _core.path_length(path))
        rows = np.column_stack([places, given[:, 2]])
        towards = check_direction("direction", direction)
        probability *= _core.order_probability(nodes, closed, towards, rows, strict)
    return Knot(
        name=name,
        chirality=chirality,
        probability=probability,
        core=None if core is None else (float(arc[core[0]]), float(arc[core[1]])),
        ambiguous=() if twin is None else (twin,),
        shares=shares,
        alexander=None if alexander is None else tuple(alexander),
        jones=None if jones is None else (jones[0], tuple(jones[1])),
        diagram=make_diagram(codes),
    )


def linking_number(a: Line | ArrayLike, b: Line | ArrayLike, closed: bool = True) -> float:
    """Tell how often two ropes wind round each other: Gauss's linking integral, exact for polylines.

    It is half the sum of the signs of the crossings between the two, averaged over all directions of view.
    Two closed ropes have the same sum from everywhere: their linking number. An open rope has an integral
    that changes as its ends move; no closure is made.

    Parameters
    ----------
    a, b : Line or (N, 3) array_like of float
        Ropes, or their nodes in order, in one unit. At most 1e8 pairs of nodes.
    closed : bool
        Whether arrays are closed ropes; of a `Line` its own `closed` counts.

    Returns
    -------
    float
        A whole number if both ropes are closed. Positive where one winds round the other as a right-handed
        screw does, both taken in the order of their nodes.

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If nodes are not (N, 3), not finite, too few (two; three of a closed rope), equal in a row, or too
        many.
    """
    arrays_closed = check_bool("closed", closed)
    (first, first_closed), (second, second_closed) = (
        _nodes(name, rope, arrays_closed) for name, rope in (("a", a), ("b", b))
    )
    return _core.linking_number(first, second, [first_closed, second_closed])


def _nodes(name: str, rope: Line | ArrayLike, closed: bool) -> tuple[Array, bool]:
    if isinstance(rope, Line):
        return rope.points, rope.closed
    return check_finite_array(name, rope, ("N", 3)), closed
