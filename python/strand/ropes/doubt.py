"""What is uncertain about an answer: doubts, warnings, joins, and other ways to join the segments."""

from __future__ import annotations

from dataclasses import dataclass

from strand.support.checks import (
    Array,
    check_choice,
    check_finite_array,
    check_integer,
    check_nonnegative,
    check_number,
    check_sequence,
    check_small_array,
    check_text,
    freeze_array,
    round_to_millimeters,
)

DOUBTS = (
    "join",
    "rival",
    "end",
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
    "order",
    "uncovered",
    "count",
    "length",
    "ring",
    "deadline",
)
"""Kinds of doubt.

"join": the segments there may belong together otherwise; "rival": another way to join all of them costs
hardly more; "end": the rope may end elsewhere; "left out": a segment became part of no rope; "noise": it is
wide against the rope; "prior": the answer explains the points worse than one without what was known
beforehand; "points": too few of them lie on the ropes found; "mask": what is inside a mask does not stand out
from what is around it; "pose": poses moved farther than they are said to be wrong; "radius": ropes look
thicker or thinner than the radius that was given; "range": ropes leave the extraction range; "residuals":
they are alike along stretches of rope; "view": one saw through the ropes; "depth",
"intrinsics", "viewpoint": these look as a usual mistake would make them; "order": depth hardly tells which
strand is on top at a crossing; "uncovered": ropes and masks do not cover each other; "count", "length",
"ring": the ropes are not as they are known to be; "deadline": something was left out because the deadline had
passed.
"""


WARNINGS = (*DOUBTS, "branch", "cut end", "kept pose", "no rope", "open pose", "thing", "unused view")
"""Kinds of warning: those of doubts, and

"mask": beside the doubt, a mask has labels for more ropes than there are;
"radius": beside the doubt, the points contradict the radius that was given, or hardly fix one that was not;
"branch": a chain ends on another's side; "cut end": a chain runs out of the extraction range; "open pose":
the data leave a direction of a view's pose open; "thing": what stands on the table and is no rope was left
out; "unused view": a view saw nothing, or noise does
not tell its ropes from what they lie on and only other views have masks; "kept pose": a view could
not be registered and stays at its reported pose; "no rope": there is none, in tables of batches, as
`reconstruct` raises `NoRopeError`.
"""


@dataclass(frozen=True, eq=False)
class Doubt:
    """What speaks against an answer.

    Attributes
    ----------
    kind : str
        One of `DOUBTS`.
    amount : float
        The confidence is exp(-0.01 - d), where d adds up all doubts' amounts; 0 or above.
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
        if self.place is not None:
            object.__setattr__(self, "place", freeze_array(check_small_array("place", self.place, (3,))))

    def __str__(self) -> str:
        where = "" if self.place is None else f" at {round_to_millimeters(self.place)}"
        return f"unsure {self.about}{where}: {self.reason}"


@dataclass(frozen=True, eq=False)
class Join:
    """A place where two segments that were seen were joined to one rope.

    Attributes
    ----------
    place : (3,) ndarray
        The middle of the gap, world frame, metres.
    chains : tuple of int
        Numbers of the chains that run there.
    margin : float
        How much more the next best way to join the segments costs, in the unit of `Config.linking`, where a
        free end costs 5. Near 0 it is as good.
    alternative : (3,) ndarray or None
        Where the rope would go on instead, metres; None: it would end.
    """

    place: Array
    chains: tuple[int, ...]
    margin: float
    alternative: Array | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "place", freeze_array(check_small_array("place", self.place, (3,))))
        numbers = check_sequence("chains", self.chains, "whole numbers")
        object.__setattr__(self, "chains", tuple(check_integer("chains", chain) for chain in numbers))
        object.__setattr__(self, "margin", check_number("margin", self.margin))
        if self.alternative is not None:
            object.__setattr__(
                self, "alternative", freeze_array(check_small_array("alternative", self.alternative, (3,)))
            )


@dataclass(frozen=True, eq=False)
class ModelWarning:
    """What the caller should know about the data or the answer; `str()` of it is its message.

    Attributes
    ----------
    kind : str
        One of `WARNINGS`; a warning about a doubt is of the doubt's kind.
    message : str
        What is the matter, in words.
    place : (3,) ndarray or None
        Where, world frame, metres.
    amount : float or None
        How much: of a doubt its amount, of "branch" the distance between the end and the other chain's axis,
        metres, of "mask" beside the doubt how many labels there are, of "radius" by how much the points want
        a larger one, metres, of "noise" how many times what was given it is, of "open pose" the pose's
        standard deviation over that of the reported one.
    chains : tuple of int
        Numbers of the chains that it is about; of "branch" the chain that ends and the one that it ends on.
    view : int or None
        The number of the view that it is about.
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
        if self.place is not None:
            object.__setattr__(self, "place", freeze_array(check_small_array("place", self.place, (3,))))
        if self.amount is not None:
            object.__setattr__(self, "amount", check_number("amount", self.amount))
        numbers = check_sequence("chains", self.chains, "whole numbers")
        object.__setattr__(self, "chains", tuple(check_integer("chains", chain) for chain in numbers))
        if self.view is not None:
            object.__setattr__(self, "view", check_integer("view", self.view))

    def __str__(self) -> str:
        return self.message


@dataclass(frozen=True, eq=False)
class Alternative:
    """Another way to join the segments that were seen to ropes.

    Attributes
    ----------
    cost : float
        How much more it costs than the answer, in radii of rope: what else it leaves unexplained.
    chains : tuple of (K, 3) ndarray
        Nodes of each rope in order, world frame, metres, before the last fit.
    """

    cost: float
    chains: tuple[Array, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "cost", check_number("cost", self.cost))
        each = check_sequence("chains", self.chains, "arrays")
        nodes = tuple(
            freeze_array(check_finite_array(f"chains[{i}]", one, ("N", 3))) for i, one in enumerate(each)
        )
        object.__setattr__(self, "chains", nodes)
