"""Diagrams of knots: the crossings of a rope in one view, in the codes of knot theory."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

import strand._core as _core
from strand.geometry.frames import check_direction
from strand.support.checks import check_bool, check_finite_array


@dataclass(frozen=True)
class Diagram:
    """The crossings of one closed curve, in the order of its passages.

    Crossings, edges and passages are counted from 1. An edge runs from one passage to the next; edge 1 leads
    to the first passage.

    Attributes
    ----------
    gauss : tuple of int
        For each passage the number of its crossing, positive where the curve passes above.
    signs : tuple of int
        For each crossing 1 if it is right-handed, else -1. Right-handed means that the lower strand crosses
        from right to left, seen along the upper one.
    planar : tuple of tuple of int
        For each crossing its four edges, anticlockwise from the edge on which the lower strand comes in.
    dowker_thistlethwaite : tuple of int
        For passages 1, 3, 5 and so on the even passage of the same crossing, negative if that one is above.
    """

    gauss: tuple[int, ...]
    signs: tuple[int, ...]
    planar: tuple[tuple[int, ...], ...]
    dowker_thistlethwaite: tuple[int, ...]

    def gauss_code(self) -> tuple[int, ...]:
        """Return the signed Gauss code: `gauss`."""
        return self.gauss

    def pd_code(self) -> tuple[tuple[int, ...], ...]:
        """Return the planar diagram code that KnotTheory, SnapPy and Topoly read: `planar`."""
        return self.planar

    def dt_code(self) -> tuple[int, ...]:
        """Return the Dowker-Thistlethwaite code, which is the same for mirror images."""
        return self.dowker_thistlethwaite

    def writhe(self) -> int:
        """Return the sum of the crossings' signs."""
        return sum(self.signs)


def knot_diagram(
    points: ArrayLike, closed: bool = False, *, direction: ArrayLike = (0.0, 0.0, 1.0)
) -> Diagram:
    """Return all crossings of a rope as seen from a direction.

    An open rope is closed by an arc above everything: both ends are led to the viewer and joined there. If a
    strand lies exactly above a node, the direction is turned by up to 0.3 mrad.

    Parameters
    ----------
    points : (N, 3) array_like of float
        Nodes in order, any unit.
    closed : bool
        Whether the last node joins the first.
    direction : (3,) array_like of float
        From the rope to the viewer, of any length. Nodes alone do not say where up is, so z is the default;
        `Chain.diagram` takes the chain's `up`.

    Returns
    -------
    Diagram

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If `points` is not a polyline, as in `strand.knot`, or has more than 20,000 crossings; if `direction`
        is zero, or strands lie along each other from there.
    strand.NotEnoughDataError
        If the curve meets itself.
    """
    nodes = check_finite_array("points", points, ("N", 3))
    codes = _core.draw_knot(nodes, check_bool("closed", closed), check_direction("direction", direction))
    return make_diagram(codes)


def make_diagram(codes: tuple[list[int], list[int], list[list[int]], list[int]]) -> Diagram:
    """Return the diagram of a kernel's codes."""
    gauss, signs, planar, even = codes
    return Diagram(tuple(gauss), tuple(signs), tuple(map(tuple, planar)), tuple(even))
