"""Doubts: what speaks against an answer."""

from __future__ import annotations

from dataclasses import dataclass

from strand.support.checks import (
    Array,
    check_choice,
    check_nonnegative,
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
