"""A chain: the centreline of one reconstructed rope, with its support and uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from strand.geometry.line import Line
from strand.ropes.crossings import Crossing, find_crossings, list_crossings
from strand.ropes.diagram import Diagram, knot_diagram
from strand.ropes.doubt import Doubt
from strand.ropes.knots import Knot, name_knot
from strand.ropes.notebook import make_html
from strand.ropes.seen_side import USUAL_UP, check_up
from strand.ropes.shape import ShapeError, compare_shapes
from strand.support.checks import (
    Array,
    check_bool,
    check_colors,
    check_finite_array,
    check_fraction_or_nan,
    check_instances,
    check_integer,
    check_sequence,
    freeze_array,
    to_array,
)
from strand.support.copies import copy_with

if TYPE_CHECKING:
    from typing_extensions import Self


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
    up : (3,) array_like of float
        The default direction of `crossings`, `knot` and `diagram`, world frame, of any length but zero: z
        unless given. The chains of a model have the model's `up`.
    label : int, optional
        The label that the rope has in the views' masks, given or found by colour. None without labels.
    color : (3,) array_like of float, optional
        The rope's median colour in the views: red, green and blue from 0 to 1. None without colours.
    hidden_ends : (bool, bool)
        Whether an occluder of a view, such as a gripper, hides where the rope begins and where it ends.

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
    >>> position, rotation = chain.frames_at(0.7)
    >>> rotation[:, 0].round(3).tolist()  # x runs along the rope
    [0.0, 1.0, 0.0]
    >>> chain.nearest(np.array([[0.1, 0.02, 0.0]])).s.round(3).tolist()
    [0.1]
    """

    confidence: float = float("nan")
    doubts: tuple[Doubt, ...] = ()
    up: Array = field(default_factory=lambda: USUAL_UP)
    label: int | None = None
    color: Array | None = None
    hidden_ends: tuple[bool, bool] = (False, False)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_remarks(_REMARKS)

    def _check_remarks(self, names: Iterable[str]) -> None:
        """Check some of the fields that are not about nodes."""
        for name in names:
            object.__setattr__(self, name, _REMARKS[name](name, getattr(self, name)))

    def reversed(self) -> Self:
        """Return the same rope with its nodes in the other order."""
        turned, ends = super().reversed(), self.hidden_ends[::-1]
        return turned if ends == turned.hidden_ends else copy_with(turned, hidden_ends=ends)

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: a small plot of the chain, and its numbers."""
        return make_html([self], [repr(self)], self.up)

    def crossings(self, direction: ArrayLike | None = None) -> tuple[Crossing, ...]:
        """Find where the rope crosses itself as seen from a direction, see `Model.crossings`.

        The number of the chain is 0 in the result. The default direction is `up`.
        """
        towards = self.up if direction is None else direction
        return find_crossings([self], towards, self.doubts, self.confidence)

    def diagram(self, direction: ArrayLike | None = None) -> Diagram:
        """Return all crossings of the rope in the codes of knot theory, see `strand.knot_diagram`.

        The default direction is `up`.
        """
        return knot_diagram(self.points, self.closed, direction=self.up if direction is None else direction)

    def knot(self, *, crossings: ArrayLike | None = None, direction: ArrayLike | None = None) -> Knot:
        """Name the knot in the rope, along the straight segments between its nodes.

        Parameters
        ----------
        crossings : (K, 3) array_like of float, optional
            How sure the order at crossings is, as in `strand.knot`: two arc lengths along this chain, metres,
            and a probability each. An empty list means that all are sure. By default they are those of
            `crossings(direction)`. A chain counts as exact without covariances, or with over 8,000 nodes or
            10,000 crossings.
        direction : (3,) array_like of float, optional
            From the rope to the viewer of the crossings; `up` by default.

        Returns
        -------
        Knot
            Its core is in arc lengths of this chain, metres.
        """
        direction = self.up if direction is None else direction
        arc = self._path_arcs if self.closed else self.arc_length
        if crossings is not None or self.covariance is None:
            return name_knot(self.points, self.closed, arc, crossings, direction)
        own = list_crossings([self], direction, self.doubts, self.confidence)
        rows = [(one.over[1], one.under[1], one.probability) for one in own or ()]
        return name_knot(self.points, self.closed, arc, rows, direction, strict=False)

    def shape_error(self, target: Line | ArrayLike) -> ShapeError:
        """Compare the rope with a target shape, without moving or turning either.

        Places at equal fractions of both lengths are compared, in the direction that fits better; on a ring
        from the start that fits best.

        Parameters
        ----------
        target : Line or (N, 3) array_like
            The shape, or its nodes in order, N >= 2, world frame, metres. Nodes are closed if the chain is.

        Returns
        -------
        ShapeError
        """
        if not isinstance(target, Line):
            nodes = check_finite_array("target", target, ("N", 3))
            if len(nodes) < 2 or not np.diff(nodes, axis=0).any(axis=1).all():
                raise ValueError("target: expected at least two nodes, no two equal in a row")
            target = Line(nodes, self.radius, self.closed)
        if target.closed != self.closed:
            wanted, got = ("a closed", "an open") if self.closed else ("an open", "a closed")
            raise ValueError(f"target: expected {wanted} line, as the chain, got {got} one")
        return compare_shapes(self, target)


def _check_doubts(name: str, value: Iterable[Any]) -> tuple[Doubt, ...]:
    return check_instances(name, value, Doubt)


def _check_label(name: str, value: Any) -> int | None:
    return None if value is None else check_integer(name, value)


def _check_color(name: str, value: ArrayLike | None) -> Array | None:
    if value is None:
        return None
    (color,) = check_colors(name, to_array(name, value)[None], (1, 3))
    return freeze_array(color)


def _check_hidden_ends(name: str, value: Iterable[Any]) -> tuple[bool, ...]:
    ends = check_sequence(name, value, "two bools")
    if len(ends) != 2:
        raise ValueError(f"{name}: expected two bools, got {len(ends)}")
    return tuple(check_bool(name, one) for one in ends)


_REMARKS: dict[str, Callable[[str, Any], Any]] = {
    "confidence": check_fraction_or_nan,
    "doubts": _check_doubts,
    "up": check_up,
    "label": _check_label,
    "color": _check_color,
    "hidden_ends": _check_hidden_ends,
}
"""The fields that are not about nodes, and their checks."""


def remarked(chain: Chain, **remarks: Any) -> Chain:
    """Return a chain with other remarks; the rest stays, and is not checked again.

    Parameters
    ----------
    chain : Chain
    **remarks
        Any of `confidence`, `doubts`, `up`, `label`, `color` and `hidden_ends`.
    """
    made = copy_with(chain, **remarks)
    made._check_remarks(remarks)
    return made
