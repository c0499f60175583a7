"""List the doubts and warnings of a model, the heaviest first, each once."""

from __future__ import annotations

from dataclasses import dataclass

from strand.ropes.model import Model


@dataclass(frozen=True)
class Remark:
    """A doubt or a warning of a model as text.

    Attributes
    ----------
    text : str
    weight : float
        The doubt's amount; 0 for a warning without a doubt.
    warned : bool
        Whether the model has a warning; otherwise, only a doubt.
    """

    text: str
    weight: float
    warned: bool


def list_remarks(model: Model) -> tuple[Remark, ...]:
    """Return a model's doubts and warnings, the heaviest first; a doubt and its warning become one remark."""
    left = list(model.warnings)
    found = []
    for doubt in model.doubts:
        own = next((one for one in left if (one.kind, one.amount) == (doubt.kind, doubt.amount)), None)
        if own is not None:
            left.remove(own)
        found.append(Remark(str(doubt if own is None else own), doubt.amount, own is not None))
    found += [Remark(str(warning), 0.0, True) for warning in left]
    found.sort(key=lambda remark: (-remark.weight, not remark.warned))
    # drop repeated texts, keeping the first
    return tuple({remark.text: remark for remark in reversed(found)}.values())[::-1]
