"""Ropes for other programs: planners and simulators of rods. Files are written by `strand.Model`."""

from strand.export.curobo import curobo
from strand.export.dismech import dismech
from strand.export.elastica import elastica

__all__ = ["curobo", "dismech", "elastica"]

__dir__ = __all__.copy
