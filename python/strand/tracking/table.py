"""The table beside tracked ropes."""

from __future__ import annotations

from strand.geometry.plane import Plane
from strand.reconstruction.images.table_plane import find_table_beside_ropes
from strand.tracking.frame import Frame

_SAME_TABLE = 0.01  # metres: a table that is found again is no farther off
_SAME_NORMAL = 0.999  # cosine of the angle to its last normal


def find_table(frame: Frame, radius: float, last: Plane | None) -> Plane | None:
    """Return the table of a frame with ropes of a radius, metres; it stays where it was, or nearly."""
    for _, image, mask in frame.images:
        if image.labels is None or not mask.any():
            continue
        table = find_table_beside_ropes(image, radius)
        if table is None:
            continue
        near = last is None or abs(last.offset - table.offset) < _SAME_TABLE
        return table if near and (last is None or last.normal @ table.normal > _SAME_NORMAL) else last
    return last
