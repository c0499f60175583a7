"""A gripper with two parallel jaws, and what it may do."""

from __future__ import annotations

from dataclasses import dataclass

from strand.support.checks import check_nonnegative, check_positive


@dataclass(frozen=True)
class Gripper:
    """Two fingers that close towards each other, below a palm. All in metres.

    Parameters
    ----------
    opening : float
        How far apart the fingers' inner faces can be.
    width : float
        Of a finger, along the rope.
    thickness : float
        Of a finger, from its inner to its outer face.
    depth : float
        From the palm to the fingers' tips.
    clearance : float
        How near anything may come to what it must not touch.

    Raises
    ------
    TypeError
        If one is no number.
    ValueError
        If one is not positive, or `clearance` is negative.
    """

    opening: float
    width: float
    thickness: float
    depth: float
    clearance: float = 0.001

    def __post_init__(self) -> None:
        for name in ("opening", "width", "thickness", "depth"):
            object.__setattr__(self, name, check_positive(name, getattr(self, name)))
        object.__setattr__(self, "clearance", check_nonnegative("clearance", self.clearance))
