"""The uncertainty of an answer: doubts, warnings, joins, and other ways to join the segments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from strand.support.checks import (
    Array,
    check_choice,
    check_finite_array,
    check_fraction_or_nan,
    check_integer,
    check_nonnegative,
    check_number,
    check_sequence,
    check_small_array,
    check_text,
    freeze_array,
    round_to_millimeters,
)
from strand.support.copies import copy_with

DOUBTS = (
    "join",
    "rival",
    "end",
    "cut end",
    "hidden end",
    "gap",
    "left out",
    "noise",
    "prior",
    "points",
    "mask",
    "pose",
    "radius",
    "range",
    "residuals",
    "view",
    "depth",
    "intrinsics",
    "viewpoint",
    "beneath",
    "order",
    "uncovered",
    "count",
    "length",
    "ring",
    "deadline",
    "color",
    "junction",
    "wires",
)
"""Kinds of doubt.

- "join": the segments there may belong together in another way.
- "rival": another way to join all segments costs hardly more, or a look from another side shows it.
- "end": the rope may end elsewhere.
- "cut end": the rope leaves the images, or goes on beneath the table's edge.
- "hidden end": something in front of the rope hides its end.
- "gap": cameras saw through a gap that was bridged, or a rope goes on in line with an end.
- "left out": a segment, or a piece as large as a short branch, belongs to no rope.
- "noise": the noise is wide compared with the rope.
- "prior": an answer that ignores a prior explains the points better.
- "points": too few points lie on the ropes.
- "mask": masks are too wide, or the inside of one does not stand out from its surroundings. Or ropes are much
  wider in one part of a mask than in another.
- "pose": poses moved farther than their stated error.
- "radius": ropes or their masks look thicker or thinner than the given radius.
- "range": ropes leave the extraction range.
- "residuals": views disagree along stretches of rope, or about where it ends.
- "view": a view saw through the ropes, or all views look along the table.
- "depth", "intrinsics", "viewpoint": these look like a usual mistake.
- "beneath": by the poses, the cameras look at the ropes from beneath.
- "order": depth hardly decides which strand is on top at a crossing.
- "uncovered": ropes and masks do not cover each other.
- "count", "length", "ring": the ropes contradict what is known of them.
- "deadline": strand skipped work because the deadline had passed.
- "color": colour alone shows the ropes, because depth does not resolve their height.
- "junction": strands of a harness meet there, and it is unclear whether they are joined.
- "wires": the numbers of wires that meet at a junction do not add up.
"""

WARNINGS = (*DOUBTS, "branch", "kept pose", "no rope", "open pose", "thing", "unused view")
"""Kinds of warning: those of doubts, and the following.

- "mask", also without a doubt: a mask has more labels than there are ropes.
- "radius", also without a doubt: the points contradict the given radius, or hardly fix the estimated one.
- "branch": a chain ends on the side of another one.
- "cut end", also without a doubt: a chain leaves the extraction range.
- "kept pose": strand could not register a view, which keeps its reported pose.
- "no rope": there is none. Only tables of batches have it; `reconstruct` raises `NoRopeError`.
- "open pose": the data do not fix a direction of a view's pose.
- "thing": strand dropped objects on the table.
- "unused view": a view saw nothing, or shows no rope above the noise while other views have masks.
"""


def _freeze_place(name: str, place: Array | None) -> Array | None:
    return None if place is None else freeze_array(check_small_array(name, place, (3,)))


def _check_chains(chains: Sequence[int]) -> tuple[int, ...]:
    numbers = check_sequence("chains", chains, "whole numbers")
    return tuple(check_integer("chains", chain) for chain in numbers)


@dataclass(frozen=True, eq=False)
class Doubt:
    """A reason why an answer may be wrong.

    Attributes
    ----------
    kind : str
        One of `DOUBTS`.
    amount : float
        How grave it is, 0 or above. `Model.confidence` weighs the amounts of each kind together.
    about : str
        What is uncertain, in words.
    reason : str
        Why, in words.
    place : (3,) ndarray or None
        Where, world frame, metres; None if it is about the ropes as a whole.
    """

    kind: str
    amount: float
    about: str
    reason: str
    place: Array | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "kind", check_choice("kind", self.kind, DOUBTS))
        object.__setattr__(self, "amount", check_nonnegative("amount", self.amount))
        object.__setattr__(self, "about", check_text("about", self.about))
        object.__setattr__(self, "reason", check_text("reason", self.reason))
        object.__setattr__(self, "place", _freeze_place("place", self.place))

    def __str__(self) -> str:
        where = "" if self.place is None else f" at {round_to_millimeters(self.place)}"
        return f"unsure {self.about}{where}: {self.reason}"


@dataclass(frozen=True, eq=False)
class Join:
    """A place where strand joined two segments to one rope.

    Attributes
    ----------
    place : (3,) ndarray
        Middle of the gap, world frame, metres.
    chains : tuple of int
        Numbers of the chains that run there.
    margin : float
        How much more the next best way to join the segments costs, in units of `Config.linking`, where a free
        end costs 5. Near 0 both ways are equally good.
    alternative : (3,) ndarray or None
        Where the rope would go on in that way, metres; None if it would end.
    """

    place: Array
    chains: tuple[int, ...]
    margin: float
    alternative: Array | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "place", freeze_array(check_small_array("place", self.place, (3,))))
        object.__setattr__(self, "chains", _check_chains(self.chains))
        object.__setattr__(self, "margin", check_number("margin", self.margin))
        object.__setattr__(self, "alternative", _freeze_place("alternative", self.alternative))


@dataclass(frozen=True, eq=False)
class ModelWarning:
    """A remark about the data or the answer; `str()` gives its message.

    Attributes
    ----------
    kind : str
        One of `WARNINGS`. A warning about a doubt has the doubt's kind.
    message : str
        The remark, in words.
    place : (3,) ndarray or None
        Where, world frame, metres.
    amount : float or None
        A number that depends on the kind. Doubts: their amount. "branch": distance from the end to the other
        chain's axis, metres. "mask" without a doubt: number of labels. "radius" without a doubt: how much
        larger a radius the points want, metres. "noise": the noise over the given one. "open pose": the
        pose's standard deviation over that of the reported pose.
    chains : tuple of int
        Numbers of the chains that it is about. "branch": the chain that ends, and the one that it ends on.
    view : int or None
        Number of the view that it is about.
    """

    kind: str
    message: str
    place: Array | None = None
    amount: float | None = None
    chains: tuple[int, ...] = ()
    view: int | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "kind", check_choice("kind", self.kind, WARNINGS))
        object.__setattr__(self, "message", check_text("message", self.message))
        object.__setattr__(self, "place", _freeze_place("place", self.place))
        if self.amount is not None:
            object.__setattr__(self, "amount", check_number("amount", self.amount))
        object.__setattr__(self, "chains", _check_chains(self.chains))
        if self.view is not None:
            object.__setattr__(self, "view", check_integer("view", self.view))

    def __str__(self) -> str:
        return self.message


@dataclass(frozen=True, eq=False)
class Alternative:
    """Another way to join the segments to ropes.

    Attributes
    ----------
    cost : float
        How much more than the answer it leaves unexplained, in radii of rope.
    chains : tuple of (K, 3) ndarray
        Nodes of each rope in order, world frame, metres, before the last fit.
    probability : float
        Probability that the ropes run this way, from 0 to 1. With `Model.confidence` and those of the other
        alternatives it adds up to at most 1. NaN if unknown.
    """

    cost: float
    chains: tuple[Array, ...]
    probability: float = float("nan")

    def __post_init__(self) -> None:
        object.__setattr__(self, "cost", check_number("cost", self.cost))
        object.__setattr__(self, "probability", check_fraction_or_nan("probability", self.probability))
        each = check_sequence("chains", self.chains, "arrays")
        nodes = tuple(
            freeze_array(check_finite_array(f"chains[{i}]", one, ("N", 3))) for i, one in enumerate(each)
        )
        object.__setattr__(self, "chains", nodes)


def rated(alternative: Alternative, probability: float) -> Alternative:
    """Return an alternative with its probability; its chains stay, and are not checked again."""
    return copy_with(alternative, probability=check_fraction_or_nan("probability", probability))
