"""Random scenes, each from its seed: 0 to 8 crossings, 1 to 3 ropes, several kinds of noise and cameras."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from strand.synthetic import (
    CAMERAS,
    Camera,
    DepthCamera,
    Layout,
    Noise,
    Segmentation,
    SyntheticScene,
    random_ropes,
    scene,
)
from strand.synthetic.camera import FOCAL_LENGTH

CROSSINGS = {"loop": 1, "figure8": 2, "overhand": 3, "paper": 3, "coil": 0}  # of the shapes that are drawn
SIZES = ((320, 240), (640, 480), (1280, 720))  # pixels
KINDS = ("plain", "correlated")  # of noise
RELATIVE = (0.05, 1.0)  # radii: range of the noise


def draw_scene(
    seed: int, noise: str = "both", relative: tuple[float, float] = RELATIVE
) -> tuple[SyntheticScene, dict[str, Any]]:
    """Draw the scene of a seed with a kind of noise and its range in radii. Return its parameters too."""
    rng = np.random.default_rng(seed)
    radius = float(np.exp(rng.uniform(math.log(2e-3), math.log(10e-3))))
    if noise == "small":
        kind, error = "plain", float(rng.uniform(0.3e-3, 1.5e-3))
    else:
        kind, error = KINDS[int(rng.integers(2))], float(rng.uniform(*relative)) * radius
        kind = kind if noise == "both" else noise
    drawn = {"radius": radius, "noise": error, "seed": seed}
    drawn |= {"kind": kind, "relative": error / radius, "correlation": 0.0}
    common: dict[str, Any] = {"radius": radius, "noise": Noise(depth=error), "seed": seed}
    if kind == "plain":
        views = int(rng.choice([1, 2, 3, 5, 7]))
        size = SIZES[int(rng.choice(3, p=[0.7, 0.22, 0.08]))]
        if size == SIZES[-1]:
            views = min(views, 2)
        common["camera"] = Camera(size=size)
    else:
        name, stretch = (
            str(rng.choice(list(CAMERAS))),
            float(np.exp(rng.uniform(math.log(0.5), math.log(2.0)))),
        )
        device = _stretch(CAMERAS[name], stretch)
        views, size = int(rng.choice([1, 3])), SIZES[1]
        common["camera"] = Camera(device, size=size)
        common["mask"] = Segmentation(grow=int(rng.integers(-1, 2)))
        common["layout"] = Layout(distance=FOCAL_LENGTH * size[0] * radius / float(rng.uniform(3.0, 8.0)))
        drawn |= {"camera": name, "correlation": device.correlation_length}
    common["views"] = views
    drawn |= {"views": views, "size": size}
    ropes, crossings = int(rng.choice([1, 2, 3], p=[0.5, 0.3, 0.2])), int(rng.integers(0, 9))
    drawn |= {"ropes": ropes, "crossings": crossings}
    if rng.random() < 0.2:
        name = str(rng.choice(list(CROSSINGS)))
        drawn |= {"ropes": 1, "shape": name}
        drawn["crossings"] = CROSSINGS[name]
        return scene(name, **common), drawn
    while True:
        try:
            chains = random_ropes(crossings, ropes, radius, seed)
        except ValueError:
            # few ropes rarely have many crossings
            ropes, crossings = min(ropes + 1, 3), crossings - (ropes == 3)
            drawn |= {"ropes": ropes, "crossings": crossings}
            continue
        return scene(chains=chains, **common), drawn


def _stretch(camera: DepthCamera, stretch: float) -> DepthCamera:
    """Return a camera whose errors reach farther by a factor."""
    grain = tuple((stretch * smoothness, share) for smoothness, share in camera.grain)
    return dataclasses.replace(camera, grain=grain, window=stretch * camera.window)
