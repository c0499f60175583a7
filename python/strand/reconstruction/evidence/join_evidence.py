"""The evidence for or against a join of two ends, in one value."""

from __future__ import annotations

from dataclasses import dataclass, replace

from strand.config import Linking
from strand.reconstruction.evidence.color import ArcColors
from strand.reconstruction.evidence.prior import NO_PRIOR, Prior
from strand.reconstruction.evidence.visibility import Visibility


@dataclass(frozen=True, eq=False)
class JoinEvidence:
    """The evidence for or against a join of two ends of arcs, and its weights.

    Attributes
    ----------
    radius : float
        The ropes' radius, metres.
    config : Linking
        The weights.
    visibility : Visibility or None
        The views' rays. Without them, free space costs nothing.
    prior : Prior
        The caller's knowledge of the ropes.
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
