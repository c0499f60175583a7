"""Decode points and colours from sensor_msgs/PointCloud2."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import Array

_FLOATS = {7: "f4", 8: "f8"}  # NumPy's type of PointField's FLOAT32 and FLOAT64
_PACKED = (6, 7)  # PointField's UINT32 and FLOAT32, which hold a packed colour: bytes blue, green, red
_ORDER = {True: ">", False: "<"}  # NumPy's mark of the byte order, by is_bigendian


def decode_points(message: Any) -> tuple[Array, NDArray[np.uint8] | None]:
    """Return (N, 3) points, metres, with NaN without a return, and their (N, 3) colours or None."""
    fields = {field.name: field for field in message.fields}
    missing = [axis for axis in "xyz" if axis not in fields or fields[axis].datatype not in _FLOATS]
    if missing:
        raise ValueError(
            f"fields: expected x, y and z of FLOAT32 or FLOAT64, got {', '.join(fields)[:200] or 'none'}"
        )
    order = _ORDER[bool(message.is_bigendian)]
    layout = {axis: (int(fields[axis].offset), order + _FLOATS[fields[axis].datatype]) for axis in "xyz"}
    packed = next((fields[name] for name in ("rgb", "rgba") if name in fields), None)
    if packed is not None and packed.datatype in _PACKED:
        layout["rgb"] = (int(packed.offset), order + "u4")
    step, row = int(message.point_step), int(message.row_step)
    height, width = int(message.height), int(message.width)
    end = max(offset + np.dtype(kind).itemsize for offset, kind in layout.values())
    data = np.frombuffer(message.data, dtype=np.uint8)
    if height < 1 or width < 1:
        raise ValueError(f"width, height: expected points, got {width} x {height}")
    if step < end or row < width * step or len(data) < row * (height - 1) + width * step:
        raise ValueError(
            f"data: {width} x {height} points of {step} bytes with rows of {row} bytes and fields up to byte "
            f"{end} do not fit in {len(data)} bytes"
        )
    rows = np.lib.stride_tricks.as_strided(data, (height, width * step), (row, 1))
    kinds = np.dtype(
        {
            "names": list(layout),
            "formats": [kind for _, kind in layout.values()],
            "offsets": [offset for offset, _ in layout.values()],
            "itemsize": step,
        }
    )
    cloud = np.ascontiguousarray(rows).reshape(-1).view(kinds)
    with np.errstate(invalid="ignore"):
        points = np.stack([cloud[axis].astype(np.float64) for axis in "xyz"], axis=1)
    if "rgb" not in layout:
        return points, None
    bytes_of = cloud["rgb"].astype("<u4").reshape(-1, 1).view(np.uint8)
    return points, bytes_of[:, 2::-1]
