"""Knots in ropes, by name, and how often two ropes wind around each other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

import strand._core as _core
from strand.geometry.frames import check_direction
from strand.geometry.line import Line
from strand.ropes.diagram import Diagram, make_diagram
from strand.support.checks import Array, check_bool, check_finite_array

UNKNOWN = "unknown"
"""Name of a knot that is not in the table."""

Chirality = Literal["right", "left"]


@dataclass(frozen=True)
class Knot:
    """The knot in a rope.

    Attributes
    ----------
    name : str
        Name in Rolfsen's table, to seven crossings: "0_1" for none, "3_1", "4_1", ... "7_7"; composite knots
        "3_1#3_1" and "3_1#4_1"; "unknown" for all others.
    chirality : {"right", "left"} or None
        Which of two mirror images it is. The alternating diagrams of "right" with the fewest crossings have a
        positive writhe. None if both are the same knot ("0_1", "4_1", "6_3"), or `name` is "unknown". A
        "3_1#3_1" is "right" or "left" as a granny knot and None as a square knot; a "3_1#4_1" has the
        chirality of its trefoil.
    probability : float
        Fraction of closures with this name, from 0 to 1; 1 for a closed rope. If the order at crossings is
        uncertain, it is multiplied by the probability that errors leave the knot unchanged.
    core : (float, float) or None
        Arc lengths, metres, between which the knot is tied, to a fiftieth of the rope's length: the shortest
        stretch found for which most closures have the same Alexander polynomial. None for "0_1", "unknown"
        and closed ropes, and if no more than half of the closures say `name`.
    ambiguous : tuple of str
        Other prime knots, to twelve crossings, with the same Alexander and Jones polynomials and no more
        crossings than the diagram. Empty if the diagram has fewer than ten.
    shares : tuple of (str, str or None, float)
        Results of all closures, the most frequent first: name, chirality and fraction.
    alexander : tuple of int or None
        Coefficients of the Alexander polynomial, from the lowest power up: a palindrome with the sum 1. None
        if the diagram has more than 48 crossings.
    jones : (int, tuple of int) or None
        Jones polynomial: the lowest exponent, and the coefficients from there up; t + t^3 - t^4 for the
        "right" trefoil. None if the diagram is too large.
    diagram : Diagram
        A diagram of a closure, simplified by Reidemeister's first and second move. It has no crossings for
        "0_1", or if the chain is too tangled.
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
        """Return the signed Gauss code of `diagram`."""
        return self.diagram.gauss_code()

    def pd_code(self) -> tuple[tuple[int, ...], ...]:
        """Return the planar diagram code of `diagram`."""
        return self.diagram.pd_code()

    def dt_code(self) -> tuple[int, ...]:
        """Return the Dowker-Thistlethwaite code of `diagram`."""
        return self.diagram.dt_code()

    def writhe(self) -> int:
        """Return the sum of the signs of the crossings of `diagram`."""
        return self.diagram.writhe()


def knot(
    points: ArrayLike,
    closed: bool = False,
    *,
    crossings: ArrayLike | None = None,
    direction: ArrayLike = (0.0, 0.0, 1.0),
) -> Knot:
    """Name the knot in a rope.

    An open rope is closed first: both ends are led straight to a far sphere in the same direction, and joined
    there. strand tries 50 evenly spread directions, always the same, and takes the most frequent name. It
    simplifies each closure (removal of nodes by Koniaris, Muthukumar and Taylor; Reidemeister's first and
    second move) and names it by its exact Alexander and Jones polynomials.

    Parameters
    ----------
    points : (N, 3) array_like of float
        Nodes in order, metres, N >= 2 (3 if closed), no two in a row equal.
    closed : bool
        Whether the last node joins the first, as in a ring.
    crossings : (K, 3) array_like of float, optional
        How sure the order at crossings is: two arc lengths, metres, and the probability that the order in the
        nodes is right. Each row belongs to the nearest crossing seen from `direction`; other crossings are
        sure. Crossings that only twist a strand do not matter. strand tries the ten least sure of the others
        both ways and takes the rest as right, so `probability` is a lower bound.
    direction : (3,) array_like of float
        From the rope to the viewer of `crossings`; unused without them. Nodes alone do not say where up is,
        so z is the default; `Chain.knot` takes the chain's `up`.

    Returns
    -------
    Knot

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If `points` has a wrong shape, is not finite, or has too few nodes or equal ones in a row; if the
        first node of a closed rope is repeated at the end; if `crossings` holds wrong values or more rows
        than there are crossings; if `direction` is zero.
    strand.NotEnoughDataError
        If the curve meets itself where that decides the knot.

    Examples
    --------
    >>> import strand
    >>> knot = strand.knot(strand.synthetic.shape("overhand"))
    >>> knot.name, knot.chirality, knot.probability
    ('3_1', 'left', 0.98)
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
    """Name a knot as `knot` does, with given arc lengths at the nodes, and at the end of a closed rope.

    If not `strict`, crossings that the nodes do not show count as right.
    """
    answers, core, twin, alexander, jones, codes = _core.identify_knot(nodes, closed)
    shares = tuple((name or UNKNOWN, chirality, share) for name, chirality, share in answers)
    name, chirality, probability = shares[0]
    towards = check_direction("direction", direction)
    given = np.empty((0, 3))
    if crossings is not None and not (isinstance(crossings, (list, tuple)) and not crossings):
        given = check_finite_array("crossings", crossings, ("K", 3))
    if len(given):
        path = np.vstack([nodes, nodes[:1]]) if closed else nodes
        if not (given[:, :2].min() >= 0 and given[:, :2].max() <= arc[-1] * (1 + 1e-9)):
            raise ValueError(f"crossings: expected arc lengths from 0 to {arc[-1]:g} m")
        places = np.interp(given[:, :2], arc, _core.path_length(path))
        rows = np.column_stack([places, given[:, 2]])
        probability *= _core.find_order_probability(nodes, closed, towards, rows, strict)
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
    """Return how often two ropes wind around each other: Gauss's linking integral, exact for polylines.

    It is half the sum of the signs of their mutual crossings, averaged over all directions of view. For two
    closed ropes the sum is the same from everywhere: their linking number. For an open rope the integral
    changes as its ends move; no closure is made.

    Parameters
    ----------
    a, b : Line or (N, 3) array_like of float
        Ropes, or their nodes in order, in one unit. At most 1e8 pairs of nodes.
    closed : bool
        Whether arrays are closed ropes; a `Line` says it itself.

    Returns
    -------
    float
        A whole number if both ropes are closed. Positive if one winds around the other like a right-handed
        screw, both in the order of their nodes.

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If nodes have a wrong shape, are not finite, too few (two; three if closed), too many, or equal in a
        row.
    """
    arrays_closed = check_bool("closed", closed)
    (first, first_closed), (second, second_closed) = (
        _read_nodes(name, rope, arrays_closed) for name, rope in (("a", a), ("b", b))
    )
    return _core.find_linking_number(first, second, [first_closed, second_closed])


def _read_nodes(name: str, rope: Line | ArrayLike, closed: bool) -> tuple[Array, bool]:
    if isinstance(rope, Line):
        return rope.points, rope.closed
    return check_finite_array(name, rope, ("N", 3)), closed
