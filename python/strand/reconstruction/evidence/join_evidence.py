"""What speaks for or against joining two ends, in one value."""

from __future__ import annotations

from dataclasses import dataclass, replace

from strand.config import Linking
from strand.reconstruction.evidence.color import ArcColors
from strand.reconstruction.evidence.prior import NO_PRIOR, Prior
from strand.reconstruction.evidence.visibility import Visibility


@dataclass(frozen=True, eq=False)
class JoinEvidence:
    """What speaks for or against joining two ends of arcs, and how it is weighed.

    Attributes
    ----------
    radius : float
        The ropes' radius, metres.
    config : Linking
        The weights.
    visibility : Visibility or None
        What the views saw; without it free space costs nothing.
    prior : Prior
        What is known of the ropes beforehand.
    colors : ArcColors or None
        The arcs' colours, if they are known.
    """

    radius: float
    config: Linking
    visibility: Visibility | None = None
    prior: Prior = NO_PRIOR
    colors: ArcColors | None = None

    def of_class(self, radius: float, classes: int) -> JoinEvidence:
        """Return what speaks of the ropes of one radius, metres, of so many classes of radius."""
        return replace(self, radius=radius, prior=self.prior if classes == 1 else self.prior.of_some())
