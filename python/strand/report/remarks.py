"""What is to be said against an answer, the heaviest first: its doubts and warnings, each once."""

from __future__ import annotations

from dataclasses import dataclass

from strand.ropes.model import Model


@dataclass(frozen=True)
class Remark:
    """A doubt or a warning of a model, in words.

    Attributes
    ----------
    text : str
    weight : float
        The doubt's amount: the confidence is exp(-0.01 - d), where d adds up all of them. 0 of a warning that
        is about no doubt.
    warned : bool
        Whether the model warns of it; else it is a doubt alone.
    """

    text: str
    weight: float
    warned: bool


def list_remarks(model: Model) -> tuple[Remark, ...]:
    """Return a model's doubts and warnings, the heaviest first; a warning about a doubt is one with it."""
    left = list(model.warnings)
    found = []
    for doubt in model.doubts:
        own = next((one for one in left if (one.kind, one.amount) == (doubt.kind, doubt.amount)), None)
        if own is not None:
            left.remove(own)
        found.append(Remark(str(doubt if own is None else own), doubt.amount, own is not None))
    found += [Remark(str(warning), 0.0, True) for warning in left]
    found.sort(key=lambda remark: (-remark.weight, not remark.warned))
    # the same words twice say nothing more
    return tuple({remark.text: remark for remark in reversed(found)}.values())[::-1]
