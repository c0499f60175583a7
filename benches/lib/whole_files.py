"""Whole small files of every kind that strand reads, with all that they may hold."""

from __future__ import annotations

import io
import json
import struct
from collections.abc import Callable

import numpy as np
from PIL import Image

import strand
from strand.geometry.curve import Curve
from strand.ropes.chain import Chain
from strand.ropes.crossings import Crossing
from strand.ropes.doubt import Alternative, Doubt, Join, ModelWarning
from strand.ropes.harness import Harness, HarnessEdge, HarnessNode
from strand.ropes.model import Model, describe_model
from strand.support.files import convert_to_json
from strand.views.sensor import Sensor

DEPTH = np.random.default_rng(1).integers(300, 900, size=(6, 8)).astype(np.uint16)
LABELS = np.random.default_rng(2).integers(0, 3, size=DEPTH.shape).astype(np.uint8)
COLOURS = np.random.default_rng(3).integers(0, 256, size=(*DEPTH.shape, 3)).astype(np.uint8)
POINTS = np.random.default_rng(0).normal(size=(9, 3)) + np.array([0.0, 0.0, 5.0])
CAMERA = "[camera]\nfx = 10\nfy = 11.0\ncx = 3.5\ncy = 2.5\ndepth_scale = 0.001\n"
POSE = "pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n"
DESCRIPTION = f"""name = "knot"
radius = "4.2mm"
{CAMERA}
[extract]
low = [-0.2, -0.2, 0.002]
high = [0.2, 0.2, 0.1]
[turntable]
angles_deg = [-140, 0, 90]
origin = [0.4, 0.0, 0.45]
center = [0, 0, 0]
axis = [0, 0, 1]
[[view]]
file = "depth.png"
mask = "mask.png"
color = "color.png"
{POSE}
[[view]]
file = "points.ply"
angles_deg = [-140, 0, 90]
origin = [0.4, 0.0, 0.45]
[[view]]
file = "depth.npy"
turntable_deg = 30
"""
SETTINGS = """method = "default"
[tracing]
near = 0.75
[sensor]
sd = 0.001
correlation = 1.5
"""


def make_npy(array: np.ndarray) -> bytes:
    """Return an NPY file."""
    out = io.BytesIO()
    np.lib.format.write_array(out, array)
    return out.getvalue()


def make_ply(encoding: str, number: str, more: str = "", tail: bytes = b"") -> bytes:
    """Return a PLY file with the points."""
    kind = {"float": "f4", "double": "f8"}[number]
    header = f"ply\nformat {encoding} 1.0\ncomment made\nelement vertex {len(POINTS)}\n"
    header += "".join(f"property {number} {axis}\n" for axis in "xyz") + more + "end_header\n"
    if encoding == "ascii":
        body = "".join(
            " ".join(repr(float(x)) for x in point) + "\n" for point in POINTS.astype(kind)
        ).encode()
    else:
        body = POINTS.astype((">" if "big" in encoding else "<") + kind).tobytes()
    return header.encode() + body + tail


def compress_lzf(data: bytes) -> bytes:
    """Compress bytes by LZF: copies start where the same three bytes stood last."""
    out, last, at, start = bytearray(), {}, 0, 0

    def literally(end: int) -> None:
        for first in range(start, end, 32):
            run = data[first : min(first + 32, end)]
            out.extend((len(run) - 1, *run))

    while at < len(data):
        key = data[at : at + 3]
        before = last.get(key)
        last[key] = at
        if len(key) < 3 or before is None or at - before > 8192:
            at += 1
            continue
        length = 3
        while length < 264 and at + length < len(data) and data[at + length] == data[before + length]:
            length += 1
        literally(at)
        high, low = divmod(at - before - 1, 256)
        out.extend(((length - 2) << 5 | high, low) if length < 9 else (7 << 5 | high, length - 9, low))
        at += length
        start = at
    literally(len(data))
    return bytes(out)


def make_pcd(
    encoding: str,
    points: np.ndarray,
    colors: np.ndarray | None = None,
    color_type: str = "U",
    padded: bool = False,
) -> bytes:
    """Return a PCD file of points (N, 3), with colours (N, 3) of uint8; padded: z first, and other fields."""
    size = points.dtype.itemsize
    fields = [(axis, f"F {size} 1", f"<f{size}", points[:, i]) for i, axis in enumerate("xyz")]
    if colors is not None:
        red, green, blue = colors.astype(np.uint32).T
        packed = (red << 16 | green << 8 | blue).view({"F": "<f4", "U": "<u4", "I": "<i4"}[color_type])
        fields.append(("rgb", f"{color_type} 4 1", packed.dtype.str, packed))
    if padded:
        other = np.arange(3 * len(points), dtype=np.uint8).reshape(-1, 3)
        fields.insert(1, ("_", "U 1 3", "u1", other))
        fields.insert(3, ("intensity", "I 2 1", "<i2", other[:, 0].astype("<i2")))
        fields.insert(4, ("_", "U 1 3", "u1", other))
        fields = [*fields[:1:-1], *fields[1::-1]]
    kinds, sizes, counts = zip(*(kind.split() for _, kind, _, _ in fields), strict=True)
    header = [
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        "FIELDS " + " ".join(name for name, _, _, _ in fields),
        *(f"{key} {' '.join(words)}" for key, words in (("SIZE", sizes), ("TYPE", kinds), ("COUNT", counts))),
        f"WIDTH {len(points)}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {len(points)}",
        f"DATA {encoding}\n",
    ]
    columns = [
        np.ascontiguousarray(array, dtype=kind).reshape(len(points), array[:1].size or 1)
        for _, _, kind, array in fields
    ]
    if encoding == "ascii":
        rows = zip(*(column.tolist() for column in columns), strict=True)
        body = "".join(
            " ".join(repr(number) for part in row for number in part) + "\n" for row in rows
        ).encode()
    elif encoding == "binary":
        parts = [column.view(np.uint8) for column in columns]
        body = np.concatenate(parts, axis=1).tobytes()
    else:
        whole = b"".join(column.tobytes() for column in columns)
        small = compress_lzf(whole)
        body = struct.pack("<II", len(small), len(whole)) + small
    return "\n".join(header).encode() + body


def make_image(array: np.ndarray, kind: str = "PNG") -> bytes:
    """Return an image file."""
    out = io.BytesIO()
    Image.fromarray(array).save(out, kind)
    return out.getvalue()


def make_deflated_tiff(array: np.ndarray) -> bytes:
    """Return a TIFF file with compressed strips."""
    out = io.BytesIO()
    Image.fromarray(array).save(out, "TIFF", compression="tiff_adobe_deflate")
    return out.getvalue()


def make_archive(save: Callable[..., None], **more: np.ndarray) -> bytes:
    """Return a scene's archive."""
    out = io.BytesIO()
    poses = np.stack([np.eye(4), strand.pose_from_angles(0.1, 0.2, 0.3, np.array([0.1, 0.2, 0.3]))])
    arrays = {"depth": np.stack([DEPTH, DEPTH[::-1]]), "depth_scale": np.float64(0.001), "poses": poses}
    arrays["K"] = np.array([[10.0, 0, 3.5], [0, 11.0, 2.5], [0, 0, 1]])
    save(out, **arrays, **more)
    return out.getvalue()


def make_model() -> bytes:
    """Return the JSON of a model with one of everything."""
    nodes = np.column_stack([np.linspace(0, 0.1, 4), np.zeros(4), np.zeros(4)])
    control = np.column_stack([np.linspace(-0.02, 0.12, 7), np.zeros(7), np.zeros(7)])
    chain = Chain(
        points=nodes,
        radius=0.004,
        curve=Curve(control, 0.0, 4.0),
        covariance=np.tile(np.eye(3) * 1e-8, (4, 1, 1)),
        points_seen=np.arange(4),
        views_seen=np.arange(4),
        radius_sd=1e-5,
    )
    made = Model(
        chains=(chain,),
        poses=np.eye(4)[None],
        timings={"extract": 0.1},
        warnings=(ModelWarning("radius", "the radius is too small", np.zeros(3), 0.1, (0,), 0),),
        pose_sd=np.zeros((1, 6)),
        confidence=0.9,
        joins=(Join(np.zeros(3), (0, 0), 0.5, None),),
        doubts=(Doubt("join", 0.5, "chain 0", "another join is as good", np.zeros(3)),),
        alternatives=(Alternative(1.0, (nodes,)),),
        method="default",
        branch="tubes",
        sensor=Sensor(sd=0.001),
        up=(0.0, -0.6, -0.8),
        table=((0.0, -0.6, -0.8), -0.5),
        harness=Harness(
            [HarnessNode(i, nodes[-i], np.eye(3) * 1e-8, 1, 0.9) for i in (0, 1)],
            [HarnessEdge(0, 0, 1, chain, 2)],
        ),
    )
    crossing = Crossing((0, 0.05), (0, 0.01), np.ones(3), np.zeros(3), 0.009, 1e-4, 1e-3, 0.5, 1, 0.99)
    content = describe_model(made) | {"units": "metres", "crossings": [convert_to_json(crossing)]}
    return json.dumps(content).encode()
