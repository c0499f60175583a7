"""Ropes as plain data for planners and simulators. `strand.Model` writes files."""

from strand.export.curobo import curobo
from strand.export.dismech import dismech
from strand.export.elastica import elastica

__all__ = ["curobo", "dismech", "elastica"]

__dir__ = __all__.copy
