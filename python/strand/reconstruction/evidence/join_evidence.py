"""What speaks for or against joining two ends, in one value."""

from __future__ import annotations

from dataclasses import dataclass, replace

from strand.config import Linking
from strand.reconstruction.evidence.color import ArcColors
from strand.reconstruction.evidence.prior import NO_PRIOR, Prior
from strand.reconstruction.evidence.visibility import Visibility


@dataclass(frozen=True, eq=False)
class JoinEvidence:
    """What speaks for or against joining two ends of arcs, and its weights.

    Attributes
    ----------
    radius : float
        The ropes' radius, metres.
    config : Linking
        The weights.
    visibility : Visibility or None
        What the views saw. Without it, free space costs nothing.
    prior : Prior
        What the caller knows of the ropes.
    colors : ArcColors or None
        The arcs' colours, if known.
    """

    radius: float
    config: Linking
    visibility: Visibility | None = None
    prior: Prior = NO_PRIOR
    colors: ArcColors | None = None

    def select_class(self, radius: float, classes: int) -> JoinEvidence:
        """Return the evidence for the ropes of one radius, metres, of `classes` different radii."""
        return replace(self, radius=radius, prior=self.prior if classes == 1 else self.prior.select_common())
