"""Wires that lie side by side under ties: wide and low, where a round bundle is as high as wide."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from strand.geometry.plane import Plane
from strand.reconstruction.harness.strands import Strand
from strand.reconstruction.harness.surface_map import SurfaceMap

_FLAT = 0.65  # height of the surface over the table at most, widths: two wires side by side have a half
_INSIDE = (0.125, 0.875)  # stretch of a strand that tells, of its nodes


def find_flat_bundles(strands: Sequence[Strand], drawn: SurfaceMap, table: Plane | None) -> NDArray[np.bool_]:
    """Tell which strands (K,) are wires side by side; without a table, none.

    Parameters
    ----------
    strands : sequence of Strand
    drawn : SurfaceMap
    table : Plane or None
    """
    flat = np.zeros(len(strands), dtype=bool)
    if table is None:
        return flat
    for number, strand in enumerate(strands):
        low, high = (round(share * len(strand.nodes)) for share in _INSIDE)
        places, _ = drawn.flatten(strand.nodes[low:high])
        surface = drawn.lift(places, drawn.sample_heights(places))
        height = float(np.median(table.measure_heights(surface)))
        flat[number] = height < _FLAT * (1.0 + drawn.ridge) * strand.half_width
    return flat
