"""The real depth frames: one rope between two grippers, seen by one camera (tests/data/README.md)."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

import strand

Array = NDArray[np.float64]

FOLDER = Path(__file__).resolve().parents[2] / "tests" / "data" / "mp2cdlo"


def list_frames() -> list[str]:
    """Return the frames' numbers, as in the names of their files."""
    return sorted(path.stem.removeprefix("depth_") for path in FOLDER.glob("depth_*.png"))


def load_depth(name: str) -> Array:
    """Return (H, W) the depth along the camera's z axis, metres; 0 for no return."""
    return np.asarray(Image.open(FOLDER / f"depth_{name}.png")) * 1e-3


def load_intrinsics() -> Array:
    """Return (3, 3) the camera's pinhole matrix, pixels."""
    camera = json.loads((FOLDER / "intrinsics.json").read_text())
    return np.array([[camera["fx"], 0.0, camera["cx"]], [0.0, camera["fy"], camera["cy"]], [0.0, 0.0, 1.0]])


def load_view(name: str, masked: bool = False) -> strand.View:
    """Return a frame's view, turned so that y is up and z towards the camera: its plan stands upright.

    All pixels with depth are rope. `masked` gives them as a mask too.
    """
    pose = strand.pose_from_angles(np.pi, 0.0, 0.0, [0.0, 0.0, 0.0])
    seen = load_depth(name)
    return strand.View.from_depth(seen, load_intrinsics(), pose, mask=seen > 0 if masked else None)


def load_gray(name: str) -> NDArray[np.uint8] | None:
    """Return (H, W) the colour image in grey; None if the frame has none."""
    path = FOLDER / f"color_image_{name}.png"
    return np.asarray(Image.open(path).convert("L")) if path.exists() else None
