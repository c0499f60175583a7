"""Files of recorded scenes."""

from __future__ import annotations

import numpy as np
from PIL import Image

from strand import pose_from_angles

POINTS = np.random.default_rng(0).normal(size=(40, 3)) + np.array([0.0, 0.0, 5.0])
DEPTH = np.random.default_rng(1).integers(300, 900, size=(6, 8)).astype(np.uint16)
K = np.array([[10.0, 0, 3.5], [0, 11.0, 2.5], [0, 0, 1]])
LABELS = np.random.default_rng(2).integers(0, 3, size=DEPTH.shape).astype(np.uint8)
CAMERA = "[camera]\nfx = 10\nfy = 11.0\ncx = 3.5\ncy = 2.5\ndepth_scale = 0.001\n"
IDENTITY = "pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n"


def write_scene(folder, file, head=CAMERA, pose=IDENTITY):
    (folder / "scene.toml").write_text(f'{head}\n[[view]]\nfile = "{file}"\n{pose}')
    return folder


def save_png(path, depth=DEPTH):
    Image.fromarray(depth).save(path)


def save_npz(path, **changes):
    arrays = {
        "depth": np.stack([DEPTH, DEPTH[::-1]]),
        "depth_scale": np.float64(0.001),
        "K": K,
        "poses": np.stack([np.eye(4), pose_from_angles(0.1, 0.2, 0.3, np.array([0.1, 0.2, 0.3]))]),
        "box": np.array([[-1.0, -2, -3], [1, 2, 3]]),
        "radius": np.float64(0.004),
        "truth_0": POINTS[:5].astype(np.float32),
        "truth_10": POINTS[10:15].astype(np.float32),
        "truth_2": POINTS[5:10].astype(np.float32),
        "poses_true": np.zeros((2, 4, 4)),
        "name": np.array("knot"),
    } | changes
    np.savez_compressed(path, **{key: value for key, value in arrays.items() if value is not None})


def make_ply(encoding="ascii", points=POINTS, kind="double", more="", tail=b""):
    properties = "".join(f"property {kind} {axis}\n" for axis in "xyz")
    header = f"ply\nformat {encoding} 1.0\ncomment made\nelement vertex {len(points)}\n"
    header += f"{properties}{more}end_header\n"
    number = {"double": "f8", "float": "f4"}.get(kind, "i4")
    if encoding == "ascii":
        body = "".join(" ".join(repr(float(x)) for x in p) + "\n" for p in points.astype(number)).encode()
    else:
        body = points.astype(("<" if "little" in encoding else ">") + number).tobytes()
    return header.encode() + body + tail


def make_grid_cloud():
    """Return the organised cloud of 12 x 10 points in tests/data/clouds, row by row, and its colours."""
    v, u = np.mgrid[:10, :12]
    points = np.stack([(u - 6) / 64, (v - 5) / 64, make_grid_depth()], axis=-1)
    points[points[..., 2] == 0] = np.nan
    colors = np.stack([20 * u, 25 * v, np.full_like(u, 128)], axis=-1)
    return points.reshape(-1, 3), colors.reshape(-1, 3)


def make_grid_depth():
    """Return that cloud's depths (10, 12), metres; 0 for no return."""
    v, u = np.mgrid[:10, :12]
    return np.where((u + v) % 5 == 0, 0.0, 0.5 + ((7 * u + 3 * v) % 16) / 1024)
