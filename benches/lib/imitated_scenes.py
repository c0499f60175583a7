"""Scenes with masks through imitated cameras, from seeds."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from lib.collection import SHAPES
from strand.synthetic import Camera, Layout, Noise, Segmentation, SyntheticScene, random_ropes, scene
from strand.synthetic.camera import FOCAL_LENGTH

SIZE = (640, 480)  # pixels
PIXELS = {"d435": 4.1, "d405": 6.3, "zed": 3.3, "sgbm": 3.3, "tof": 4.3}  # of the ropes' radius, by camera


def make_imitated(called: str, name: str, camera: str, views: int, seed: int) -> SyntheticScene:
    """Return a shape or random ropes through an imitated camera, with imprecise masks."""
    rng = np.random.default_rng(seed)
    radius = float(rng.uniform(3.4e-3, 6e-3))
    common: dict[str, Any] = {
        "radius": radius,
        "seed": seed,
        "views": views,
        "camera": Camera(camera, size=SIZE),
        "noise": Noise(turn=math.radians(0.4)),
        "mask": Segmentation(grow=int(rng.integers(-1, 2))),
        "layout": Layout(
            distance=FOCAL_LENGTH * SIZE[0] * radius / PIXELS[camera],
            elevation=math.radians(rng.uniform(50.0, 87.0)),
        ),
    }
    if name not in SHAPES:
        common["chains"] = random_ropes(int(rng.integers(1, 6)), 1, radius, seed)
    made = scene(name, **common)
    return dataclasses.replace(made, name=called)
