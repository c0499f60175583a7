"""Whole small files of every kind that strand reads, with something of all that they may hold."""

from __future__ import annotations

import io
import json
from collections.abc import Callable

import numpy as np
from PIL import Image

import strand
from strand.chain import Chain
from strand.curve import Curve
from strand.files import plain
from strand.model import Alternative, Doubt, Join, Model, ModelWarning
from strand.sensor import Sensor

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
centre = [0, 0, 0]
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
SETTINGS = """method = "tubes"
[tracing]
near = 0.75
[sensor]
sd = 0.001
correlation = 1.5
"""


def npy(array: np.ndarray) -> bytes:
    """An NPY file."""
    out = io.BytesIO()
    np.lib.format.write_array(out, array)
    return out.getvalue()


def ply(encoding: str, number: str, more: str = "", tail: bytes = b"") -> bytes:
    """A PLY file with the points."""
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


def image(array: np.ndarray, kind: str = "PNG") -> bytes:
    """An image file."""
    out = io.BytesIO()
    Image.fromarray(array).save(out, kind)
    return out.getvalue()


def archive(save: Callable[..., None], **more: np.ndarray) -> bytes:
    """A scene's archive."""
    out = io.BytesIO()
    poses = np.stack([np.eye(4), strand.pose_from_angles(0.1, 0.2, 0.3, np.array([0.1, 0.2, 0.3]))])
    arrays = {"depth": np.stack([DEPTH, DEPTH[::-1]]), "depth_scale": np.float64(0.001), "poses": poses}
    arrays["K"] = np.array([[10.0, 0, 3.5], [0, 11.0, 2.5], [0, 0, 1]])
    save(out, **arrays, **more)
    return out.getvalue()


def model() -> bytes:
    """A model with one of everything."""
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
        method="tubes",
        sensor=Sensor(sd=0.001),
    )
    content = plain(made)
    del content["stages"]
    return json.dumps({"format": "strand model", "version": 2, "units": "metres", **content}).encode()
