"""What speaks against an answer that was read from images, and how much."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand._core import ImageFit
from strand.evidence.confidence import SCALE
from strand.images.comparison import Explanation
from strand.model import Doubt


def doubts(explanations: Sequence[Explanation], fit: ImageFit, radius: float) -> tuple[Doubt, ...]:
    """Say what speaks against the best explanation."""
    found = []
    best = explanations[0]
    if len(explanations) > 1:
        more = explanations[1].cost - best.cost
        reason = f"another way to explain the images costs {more:.1f} more"
        found.append(Doubt("rival", float(np.exp(-more / SCALE)), "how the ropes run", reason))
    return tuple(found)
