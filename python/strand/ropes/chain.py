"""A chain: the centreline of one reconstructed rope, and what is known of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from strand.geometry.line import Line
from strand.ropes.crossings import Crossing, find_crossings, list_crossings
from strand.ropes.doubt import Doubt
from strand.ropes.knots import Knot, name_knot
from strand.ropes.notebook import make_html
from strand.ropes.shape import ShapeError, compare_shapes
from strand.support.checks import check_finite_array, check_fraction_or_nan, check_instances


@dataclass(frozen=True, eq=False, repr=False)
class Chain(Line):
    """One rope: its centreline as ordered nodes, end to end. Its arrays are read-only.

    Parameters
    ----------
    points : (M, 3) array_like of float
        Nodes in the world frame, metres, M >= 2. No two in a row are equal.
    radius : float
        Radius of the rope, metres. The default method fits it to the points even if it was given: a given
        radius counts as known to 0.3 %, as if measured with a calliper.
    closed : bool
        Whether the last node joins the first, as in a ring.
    curve : Curve, optional
        Smooth curve through the nodes. With it, `at` and `tangents` follow the curve; without it they follow
        the straight segments between nodes.
    covariance : (M, 3, 3) ndarray, optional
        Covariance of each node, m^2. With it, curvature is that of a window, see `curvature_vector_at`.
    points_seen, views_seen : (M,) ndarray of int, optional
        Numbers of points and of views that support each node; 0 where the chain only bridges a gap.
    radius_sd : float
        Standard deviation of the radius, metres; 0 if it is not known.
    confidence : float
        Probability that this rope runs as the chain says, from 0 to 1; NaN if the method does not say.
    doubts : tuple of Doubt
        Those of the model's doubts that are about this chain, the greatest first.

    Raises
    ------
    TypeError
        If an argument is of the wrong kind; of methods too.
    ValueError
        If an array has a wrong shape or is not finite, or a number is out of range; of methods too. Also if
        `points` has equal neighbours or coordinates above 1e75 m.

    Examples
    --------
    >>> import numpy as np
    >>> import strand
    >>> chain = strand.Chain(np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.3, 0.4, 0.0]]), radius=0.004)
    >>> chain
    Chain(700.0 mm, radius 4.00 mm, open, 3 nodes)
    >>> chain.at(0.5).round(3).tolist()
    [0.3, 0.2, 0.0]
    """

    confidence: float = float("nan")
    doubts: tuple[Doubt, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "confidence", check_fraction_or_nan("confidence", self.confidence))
        object.__setattr__(self, "doubts", check_instances("doubts", self.doubts, Doubt))

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the chain in a small plot, and its numbers."""
        return make_html([self], [repr(self)])

    def knot(self, *, crossings: ArrayLike | None = None, direction: ArrayLike = (0.0, 0.0, 1.0)) -> Knot:
        """Name the knot that is tied in the rope, by the straight segments between its nodes.

        Parameters
        ----------
        crossings : (K, 3) array_like of float, optional
            How sure the order at crossings is: arc lengths along this chain, metres, and a probability
            each, as `strand.knot` takes them; an empty list for all sure. If not given they are those of
            `crossings(direction)`. A chain without covariances, as one that was made by hand, says nothing
            of its errors: its nodes then count as they are. So do those of chains of over 8,000 nodes.
        direction : (3,) array_like of float
            From where the crossings are seen: a vector from the rope to the viewer.

        Returns
        -------
        Knot
            Its core is in arc lengths of this chain, metres.

        Raises
        ------
        TypeError, ValueError
            As `strand.knot`.
        """
        arc = self._path_arcs if self.closed else self.arc_length
        if crossings is not None or self.covariance is None:
            return name_knot(self.points, self.closed, arc, crossings, direction)
        own = list_crossings([self], direction, self.doubts)
        rows = [(one.over[1], one.under[1], one.probability) for one in own]
        return name_knot(self.points, self.closed, arc, rows, direction, strict=False)

    def crossings(self, direction: ArrayLike = (0, 0, 1)) -> tuple[Crossing, ...]:
        """Find where the rope crosses itself as seen from one side, see `Model.crossings`.

        Parameters
        ----------
        direction : (3,) array_like
            Towards who looks, world frame, of any length but zero.

        Returns
        -------
        tuple of Crossing
            Along the chain, whose number is 0 here.

        Raises
        ------
        TypeError
            If `direction` does not hold real numbers.
        ValueError
            If it is not of shape (3,), not finite, or zero.
        """
        return find_crossings([self], direction, self.doubts)

    def shape_error(self, target: Line | ArrayLike) -> ShapeError:
        """Compare the rope with the shape that it should have.

        Places at equal shares of both lengths belong to each other: from the end that fits better, of a ring
        from the start that fits best, either way round. Nothing is moved or turned to fit.

        Parameters
        ----------
        target : Line or (N, 3) array_like
            The shape, or its nodes in order, N >= 2, world frame, metres; closed if the chain is.

        Returns
        -------
        ShapeError

        Raises
        ------
        TypeError
            If `target` is neither.
        ValueError
            If it has a wrong shape, equal neighbours or NaN, or only one of the two is closed.
        """
        if not isinstance(target, Line):
            nodes = check_finite_array("target", target, ("N", 3))
            if len(nodes) < 2 or not np.diff(nodes, axis=0).any(axis=1).all():
                raise ValueError("target: expected at least two nodes, no two equal in a row")
            target = Line(nodes, self.radius, self.closed)
        if target.closed != self.closed:
            wanted, got = ("closed", "open") if self.closed else ("open", "closed")
            raise ValueError(f"target: expected one that is {wanted}, as the chain, got one that is {got}")
        return compare_shapes(self, target)
