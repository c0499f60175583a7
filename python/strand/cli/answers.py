"""What is printed of an answer: the model as JSON, and what is to be said against it."""

from __future__ import annotations

import json
import sys
from contextlib import suppress

from strand.cli.outcome import say
from strand.report.remarks import list_remarks
from strand.ropes.model import Model, describe_model

# doubts that are not warned of are printed among the first so many remarks, and from this weight on: less
# changes no digit of the confidence
_MOST, _LEAST = 10, 0.005


def print_json(model: Model) -> None:
    """Print a model as its file has it, in one line."""
    print(json.dumps(describe_model(model), allow_nan=False))


def warn(model: Model, about: str = "", doubts: bool = False) -> None:
    """Print a model's warnings to stderr, and its other doubts if they are wanted, the heaviest first."""
    # what was printed before stands before it; that it cannot be printed is said at the end
    with suppress(OSError):
        sys.stdout.flush()
    found = [one for one in list_remarks(model) if one.warned or one.weight >= _LEAST]
    shown = [one for i, one in enumerate(found) if one.warned or (doubts and i < _MOST)]
    for one in shown:
        weight = f", weight {one.weight:.2g}" if one.weight else ""
        say(f"strand: {'warning' if one.warned else 'doubt'}: {about}{one.text}{weight}")
    if doubts and len(found) > len(shown):
        say(f"strand: and {len(found) - len(shown)} doubts of less weight, which the model's file has")
