"""How often two ropes wind round each other."""

from __future__ import annotations

from numpy.typing import ArrayLike

from strand import _core
from strand.ropes.chain import Chain
from strand.support.checks import Array, check_bool, check_finite_array


def linking_number(a: Chain | ArrayLike, b: Chain | ArrayLike, closed: bool = True) -> float:
    """Tell how often two ropes wind round each other: Gauss's linking integral, exact for polylines.

    It is half the sum of the signs of the crossings between the two, averaged over all directions of view.
    Two closed ropes have the same sum from everywhere: their linking number. An open rope has an integral
    that changes as its ends move; no closure is made.

    Parameters
    ----------
    a, b : Chain or (N, 3) array_like of float
        Ropes, or their nodes in order, in one unit. At most 1e8 pairs of nodes.
    closed : bool
        Whether arrays are closed ropes; of a `Chain` its own `closed` counts.

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


def _nodes(name: str, rope: Chain | ArrayLike, closed: bool) -> tuple[Array, bool]:
    if isinstance(rope, Chain):
        return rope.points, rope.closed
    return check_finite_array(name, rope, ("N", 3)), closed
