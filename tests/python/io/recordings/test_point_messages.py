"""Tests of points and colours in PointCloud2 messages, also with faults."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import strand
from strand.io.recordings.message_views import make_view
from strand.io.recordings.point_messages import decode_points

POINTS = np.random.default_rng(0).normal(size=(6, 3))
COLORS = np.random.default_rng(1).integers(0, 256, size=(6, 3)).astype(np.uint8)
CODES = {"<f4": 7, ">f4": 7, "<f8": 8, ">f8": 8, "<u4": 6, ">u4": 6, "<u2": 4}


def make_cloud(kind="<f4", names="xyz", offsets=(0, 4, 8), step=12, row_gap=0, width=6, rgb=None, **changes):
    """Return a message of points in rows of `width`."""
    size = len(POINTS)
    records = np.zeros((size, step), dtype=np.uint8)
    fields = []
    for axis, name, offset in zip(range(3), names, offsets, strict=True):
        item = np.dtype(kind).itemsize
        records[:, offset : offset + item] = POINTS[:, axis].astype(kind).reshape(-1, 1).view(np.uint8)
        fields.append(SimpleNamespace(name=name, offset=offset, datatype=CODES[kind], count=1))
    if rgb is not None:
        red, green, blue = COLORS.astype(np.uint32).T
        packed = (red << 16 | green << 8 | blue).astype(kind[0] + "u4")
        records[:, rgb : rgb + 4] = packed.reshape(-1, 1).view(np.uint8)
        fields.append(SimpleNamespace(name="rgb", offset=rgb, datatype=7, count=1))
    rows = records.reshape(size // width, width * step)
    rows = np.hstack([rows, np.full((len(rows), row_gap), 9, dtype=np.uint8)])
    message = {
        "height": size // width,
        "width": width,
        "fields": fields,
        "is_bigendian": kind[0] == ">",
        "point_step": step,
        "row_step": width * step + row_gap,
        "data": rows.tobytes(),
    }
    return SimpleNamespace(**(message | changes))


@pytest.mark.parametrize("kind", ["<f4", ">f4", "<f8", ">f8"])
def test_points_in_any_layout(kind):
    size = np.dtype(kind).itemsize
    for layout in (
        {"offsets": (0, size, 2 * size), "step": 3 * size},
        {"offsets": (2 * size + 3, 1, size + 2), "step": 40},
        {"offsets": (0, size, 2 * size), "step": 32, "width": 3, "row_gap": 5},
    ):
        points, colors = decode_points(make_cloud(kind, **layout))
        np.testing.assert_array_equal(points, POINTS.astype(kind))
        assert colors is None


@pytest.mark.parametrize("kind", ["<f4", ">f4"])
def test_colours_are_four_bytes(kind):
    points, colors = decode_points(make_cloud(kind, step=32, rgb=16))
    np.testing.assert_array_equal(points, POINTS.astype(np.float32))
    np.testing.assert_array_equal(colors, COLORS)


def test_points_without_a_return_are_counted():
    message = make_cloud(rgb=12, step=16)
    data = bytearray(message.data)
    data[16:20] = np.float32(np.nan).tobytes()
    data[40:44] = np.float32(np.inf).tobytes()
    message.data = bytes(data)
    view = make_view(message, None, None)
    assert (len(view.points), view.dropped) == (4, 2)
    np.testing.assert_array_equal(view.colors, COLORS[[0, 3, 4, 5]] / 255.0)


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (make_cloud(names="xyw"), "fields: expected x, y and z of FLOAT32 or FLOAT64, got x, y, w"),
        (make_cloud("<u2"), "fields: expected x, y and z of FLOAT32"),
        (make_cloud(fields=[]), "got none"),
        (make_cloud(point_step=11), "do not fit in 72 bytes"),
        (make_cloud(point_step=0), "do not fit in 72 bytes"),
        (make_cloud(row_step=1), "do not fit in 72 bytes"),
        (make_cloud(width=6, height=2), "do not fit in 72 bytes"),
        (make_cloud(data=b""), "do not fit in 0 bytes"),
        (make_cloud(height=0), "width, height: expected points, got 6 x 0"),
        (make_cloud(height=2**32 - 1, row_step=0), "do not fit in 72 bytes"),
    ],
)
def test_clouds_of_inconsistent_sizes_are_refused(message, reason):
    with pytest.raises(ValueError, match=reason):
        decode_points(message)


def test_clouds_of_strand_are_read_back():
    said = strand.msgs.make_point_cloud2(POINTS, "world", colors=COLORS)
    said["fields"] = [SimpleNamespace(**field) for field in said["fields"]]
    points, colors = decode_points(SimpleNamespace(**said))
    np.testing.assert_array_equal(points, POINTS.astype(np.float32))
    np.testing.assert_array_equal(colors, COLORS)
