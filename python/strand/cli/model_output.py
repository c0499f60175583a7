"""The printed form of a model: JSON on stdout, warnings and doubts on stderr."""

from __future__ import annotations

import json

from strand.cli.terminal import flush_before_message, print_message
from strand.report.remarks import list_remarks
from strand.ropes.model import Model, describe_model

_MAX_REMARKS = 10  # remarks among which doubts are printed; warnings are printed always
_MIN_WEIGHT = 0.005  # weight of a printed doubt; a lighter one hardly changes the confidence


def print_json(model: Model) -> None:
    """Print a model as one line of JSON, with the keys of its file."""
    print(json.dumps(describe_model(model), allow_nan=False))


def print_remarks(model: Model, about: str = "", doubts: bool = False) -> None:
    """Print a model's warnings to stderr, on request also its doubts, the heaviest first."""
    flush_before_message()
    remarks = [remark for remark in list_remarks(model) if remark.warned or remark.weight >= _MIN_WEIGHT]
    shown = [one for i, one in enumerate(remarks) if one.warned or (doubts and i < _MAX_REMARKS)]
    for remark in shown:
        weight = f", weight {remark.weight:.2g}" if remark.weight else ""
        print_message(f"strand: {'warning' if remark.warned else 'doubt'}: {about}{remark.text}{weight}")
    if doubts and len(remarks) > len(shown):
        print_message(f"strand: and {len(remarks) - len(shown)} lighter doubts, which the model's JSON holds")
