"""Scenes as cameras and segmenters give them: ropes a few pixels wide, and masks that are not exact."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import Array, check_choice, check_integer
from strand.synthetic.camera import FOCAL_LENGTH, Camera, find_least_distance
from strand.synthetic.depth_camera import CAMERAS, DepthCamera
from strand.synthetic.layout import Layout
from strand.synthetic.noise import make_plane_rotation
from strand.synthetic.random_curves import random_ropes
from strand.synthetic.scenes import SyntheticScene, scene
from strand.synthetic.segmentation import Segmentation
from strand.synthetic.shapes import compute_arc_lengths

FRAMES = ("usual", "thin", "coarse", "fat", "ragged", "crossing", "touch", "mixed", "kinks")
"""The kinds of `frame_scene`."""

_SIZE = (640, 480)
_COARSE = replace(CAMERAS["sgbm"], name="coarse", baseline=0.05, step=0.5, sd=0.2)
_RADII = (0.0025, 0.006)  # metres: range of the ropes' radius
_ELEVATIONS = (math.radians(50.0), math.radians(85.0))  # radians: range of the camera's elevation
_THIN_PX = (1.5, 2.5)  # pixels: range of the radius in the image, of thin ropes
_USUAL_PX = (2.5, 6.0)  # pixels: the same, of others
_MAX_GROWN = 3  # pixels that a fat mask is too wide on each side
_FILLED_PX = (1.0, 4.5)  # pixels: range of the discs that fill corners
_MAX_CROSSINGS = 5  # crossings of random ropes
_MAX_ROPE_DRAWS = 200  # ropes drawn until some fit in the view
_ACUTE = (math.radians(12.0), math.radians(45.0))  # radians: angles at which two strands meet
_ANY_ANGLE = (math.radians(25.0), math.radians(85.0))  # radians: the same, of ropes of two radii
_THICKER = (1.25, 1.9)  # times as thick as the other rope
_HALF_LENGTH = 40.0  # radii: half the length of a rope that meets another
_APART = (2.0, 2.2)  # radii: distance of the axes of strands that touch
_RAMP = (10.0, 16.0)  # radii over which a strand rises to the crossing
_SWAY = 25.0  # radii: length of the slow bends of strands that meet
_KINKS = (math.radians(50.0), math.radians(110.0))  # radians: turn of a kink
_KINK_LENGTH = 2.5  # radii of rope in a kink
_LEG = (15.0, 30.0)  # radii: range of the length between kinks
_LEG_BEND = 0.02  # standard deviation of its curvature, 1 / radii
_STEP = 0.25  # radii between the nodes of a kinked rope
_COARSE_STEP = 2.0  # radii between those whose distances are measured
_MIN_APART = 4.0  # radii between strands of a kinked rope
_SAME_STRAND = 10.0  # radii of arc length within which nodes are of one strand


def frame_scene(kind: str, seed: int = 0) -> SyntheticScene:
    """Draw a single frame of ropes on a table, as cameras and segmenters give it.

    - `usual`: the mask is exact.
    - `thin`: the radius is 1.5 to 2.5 pixels.
    - `coarse`: the same, and one step of the stereo camera's disparity is deeper than the rope.
    - `fat`: the mask is 1 to 3 pixels too wide on each side.
    - `ragged`: the mask has a ragged edge, holes, and bits of the table.
    - `crossing`, `touch`: two ropes cross, or touch and part, at 12 to 45 degrees. The mask fills corners.
    - `mixed`: two ropes cross; one is 1.25 to 1.9 times as thick.
    - `kinks`: a rope with one to three sharp kinks.

    Radii are 2.5 to 6 pixels where no other are given. The depth cameras of `CAMERAS` take turns.

    Parameters
    ----------
    kind : str
        One of `FRAMES`.
    seed : int
        Seed of the random numbers, not negative.

    Returns
    -------
    SyntheticScene

    Raises
    ------
    TypeError
        If an argument has the wrong type.
    ValueError
        If there is no such kind, or `seed` is negative.
    """
    kind = check_choice("kind", kind, FRAMES)
    rng = np.random.default_rng([check_integer("seed", seed, 0), FRAMES.index(kind)])
    thin = kind in ("thin", "coarse")
    device: DepthCamera = _COARSE if kind == "coarse" else list(CAMERAS.values())[seed % len(CAMERAS)]
    radius = float(np.exp(rng.uniform(*np.log(_RADII))))
    distance = FOCAL_LENGTH * _SIZE[0] * radius / float(rng.uniform(*(_THIN_PX if thin else _USUAL_PX)))
    elevation = float(rng.uniform(*_ELEVATIONS))
    radii: float | tuple[float, ...] = radius
    if kind in ("crossing", "touch", "mixed"):
        thicker = float(rng.uniform(*_THICKER)) if kind == "mixed" else 1.0
        radii = (radius, thicker * radius)
        chains = _lay_pair(rng, radii, kind == "touch", _ANY_ANGLE if kind == "mixed" else _ACUTE)
    else:
        chains = _draw_ropes(rng, kind, radius, elevation, distance)
    least = find_least_distance(np.concatenate(chains), radius, np.zeros(1), elevation, _SIZE)
    return scene(
        f"{kind}{seed:02d}_{device.name}",
        chains=chains,
        radius=radii,
        seed=seed,
        views=1,
        camera=Camera(device, size=_SIZE),
        mask=_draw_mask(rng, kind),
        layout=Layout(max(distance, least), elevation),
    )


def _draw_mask(rng: np.random.Generator, kind: str) -> Segmentation:
    if kind == "fat":
        return Segmentation(grow=int(rng.integers(1, _MAX_GROWN + 1)))
    if kind == "ragged":
        return Segmentation(
            grow=int(rng.integers(0, 2)),
            ragged=float(rng.uniform(0.5, 1.5)),
            lost=float(rng.uniform(0.0, 0.06)),
            taken=float(rng.uniform(0.0, 0.06)),
            patch=2.0,
        )
    if kind in ("crossing", "touch"):
        return Segmentation(filled=float(rng.uniform(*_FILLED_PX)))
    return Segmentation(filled=1.0 if kind == "mixed" else 0.0)


def _draw_ropes(
    rng: np.random.Generator, kind: str, radius: float, elevation: float, distance: float
) -> tuple[Array, ...]:
    """Draw one or two ropes until some fit in the view of a camera."""
    for _ in range(_MAX_ROPE_DRAWS):
        if kind == "kinks":
            chains = _draw_kinked_rope(rng, radius)
        else:
            crossings, ropes = int(rng.integers(0, _MAX_CROSSINGS + 1)), int(rng.integers(1, 3))
            try:
                chains = random_ropes(crossings, ropes, radius, int(rng.integers(1 << 30)))
            except ValueError:
                continue  # too many crossings for this number of ropes
        least = find_least_distance(np.concatenate(chains), radius, np.zeros(1), elevation, _SIZE)
        if least <= distance:
            break
    return chains


def _lay_pair(
    rng: np.random.Generator, radii: tuple[float, float], touch: bool, angles: tuple[float, float]
) -> tuple[Array, ...]:
    """Return two ropes that meet in the middle: they touch and part, or the first crosses over the second."""
    radius, thicker = radii
    slope = math.tan(0.5 * float(rng.uniform(*angles)))
    x = np.linspace(-_HALF_LENGTH, _HALF_LENGTH, 400) * radius
    sway = float(rng.normal())
    base = 1.5 * radius * sway * np.sin(x / (_SWAY * radius) + sway)
    if touch:
        apart = 0.5 * float(rng.uniform(*_APART)) * radius
        y, rise = np.hypot(apart, slope * x), np.zeros_like(x)
    else:
        y = slope * x
        along = np.minimum(np.abs(x) / (float(rng.uniform(*_RAMP)) * radius), 1.0)
        rise = thicker * (1.0 + np.cos(np.pi * along))
    plane = make_plane_rotation(float(rng.uniform(0.0, 2.0 * math.pi)))
    ropes: list[Array] = []
    for side, height in ((y, radius + rise), (-y, np.full_like(x, thicker))):
        flat = np.column_stack([x, base + side]) @ plane.T
        nodes = np.column_stack([flat, height]).astype(np.float64)
        ropes.append(_space(nodes, radius))
    return tuple(ropes)


def _draw_kinked_rope(rng: np.random.Generator, radius: float) -> tuple[Array, ...]:
    """Return a rope with sharp kinks that does not come near itself."""
    while True:
        legs = int(rng.integers(2, 5))
        turn = 0.0
        headings: list[NDArray[np.floating[Any]]] = []
        for leg in range(legs):
            if leg:
                kink = float(rng.uniform(*_KINKS)) * float(rng.choice([-1.0, 1.0]))
                nodes = round(_KINK_LENGTH / _STEP)
                headings.append(turn + kink * (np.arange(nodes) + 0.5) / nodes)
                turn += kink
            nodes = round(float(rng.uniform(*_LEG)) / _STEP)
            bend = float(rng.normal(0.0, _LEG_BEND)) * _STEP * np.arange(nodes)
            headings.append(turn + bend)
            turn += float(bend[-1])
        heading = np.concatenate(headings)
        plan = np.cumsum(np.column_stack([np.cos(heading), np.sin(heading)]) * _STEP, axis=0)
        coarse = plan[:: round(_COARSE_STEP / _STEP)]
        gaps = np.linalg.norm(coarse[:, None] - coarse[None], axis=2)
        along = _COARSE_STEP * np.abs(np.subtract.outer(np.arange(len(coarse)), np.arange(len(coarse))))
        if (gaps[along > _SAME_STRAND] > _MIN_APART).all():
            plan -= plan.mean(axis=0)
            return (np.column_stack([plan * radius, np.full(len(plan), radius)]),)


def _space(nodes: Array, radius: float) -> Array:
    """Return the nodes of a polyline, half a radius apart."""
    s = compute_arc_lengths(nodes)
    places = np.linspace(0.0, s[-1], max(int(s[-1] / (0.5 * radius)), 2))
    return np.asarray(np.column_stack([np.interp(places, s, axis) for axis in nodes.T]))
