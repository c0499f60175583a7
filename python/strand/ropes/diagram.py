"""Diagrams of knots: the crossings of a rope as it is seen, in the codes that knot theory writes them in."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from strand import _core
from strand.geometry.frames import check_direction
from strand.support.checks import check_bool, check_finite_array


@dataclass(frozen=True)
class Diagram:
    """The crossings of one closed curve, in the order in which it passes them.

    Crossings, edges and passages are counted from 1. An edge runs from one passage to the next; edge 1
    leads to the first passage.

    Attributes
    ----------
    gauss : tuple of int
        Two for each crossing, along the curve: the crossing's number, positive where the curve passes above.
    signs : tuple of int
        By crossing: 1 where the lower strand crosses the upper one from right to left, seen along the upper
        one (right-handed), else -1.
    planar : tuple of tuple of int
        By crossing: its four edges, anticlockwise from where the lower strand comes in.
    dowker_thistlethwaite : tuple of int
        The even passages that share their crossings with passages 1, 3, 5 and so on, negative where the even
        one is above.
    """

    gauss: tuple[int, ...]
    signs: tuple[int, ...]
    planar: tuple[tuple[int, ...], ...]
    dowker_thistlethwaite: tuple[int, ...]

    def gauss_code(self) -> tuple[int, ...]:
        """Signed Gauss code: `gauss`."""
        return self.gauss

    def pd_code(self) -> tuple[tuple[int, ...], ...]:
        """Planar diagram code, as KnotTheory, SnapPy and Topoly read it: `planar`."""
        return self.planar

    def dt_code(self) -> tuple[int, ...]:
        """Dowker-Thistlethwaite code; it does not tell mirror images from each other."""
        return self.dowker_thistlethwaite

    def writhe(self) -> int:
        """Sum of the crossings' signs."""
        return sum(self.signs)


def knot_diagram(
    points: ArrayLike, closed: bool = False, *, direction: ArrayLike = (0.0, 0.0, 1.0)
) -> Diagram:
    """Crossings of a rope as they are seen from a direction, none left out.

    An open rope is closed by an arc from its last to its first node that lies above everything: both ends
    are led to the viewer and joined there. Where a strand lies exactly above a node, the direction is
    turned by up to 0.3 mrad.

    Parameters
    ----------
    points : (N, 3) array_like of float
        Nodes in order, any unit.
    closed : bool
        Whether the last node joins the first.
    direction : (3,) array_like of float
        From the rope to the viewer, of any length.

    Returns
    -------
    Diagram

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If `points` is no polyline, as in `strand.knot`; if it has more than 20,000 crossings; if
        `direction` is zero, or strands lie along each other from there.
    """
    nodes = check_finite_array("points", points, ("N", 3))
    codes = _core.knot_diagram(nodes, check_bool("closed", closed), check_direction("direction", direction))
    return make_diagram(codes)


def make_diagram(codes: tuple[list[int], list[int], list[list[int]], list[int]]) -> Diagram:
    """Return a diagram of codes as the kernel gives them."""
    gauss, signs, planar, even = codes
    return Diagram(tuple(gauss), tuple(signs), tuple(map(tuple, planar)), tuple(even))
