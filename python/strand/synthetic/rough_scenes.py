"""Scenes that are hard to see for one reason each, through an imitated camera."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import Array, check_choice, check_integer
from strand.synthetic.camera import (
    FOCAL_LENGTH,
    Camera,
    camera_pose,
    find_device,
    find_least_distance,
    spread_azimuths,
)
from strand.synthetic.depth_camera import CAMERAS, DepthCamera
from strand.synthetic.layout import Layout
from strand.synthetic.noise import Noise, make_plane_rotation
from strand.synthetic.random_curves import random_ropes
from strand.synthetic.scenes import SyntheticScene, scene
from strand.synthetic.segmentation import Segmentation
from strand.synthetic.shapes import lay_shape

ROUGH = ("thin", "thick", "missing", "ragged", "bar", "hanging")
"""The kinds of `rough_scene`."""

_SIZE = (640, 480)
_TURN = math.radians(0.4)  # radians: standard deviation of the poses' rotation
_ELEVATIONS = (math.radians(55.0), math.radians(85.0))  # radians: range of the cameras' elevation
_NOISE = (0.2, 0.4)  # radii: range of the depths' standard deviation on a surface
_MAX_ROPE_DRAWS = 400  # ropes drawn until some fit in the views
_MAX_CROSSINGS = 4  # crossings of the ropes
_TWO_ROPES = 0.2  # probability that there are two ropes
_SHORT_FROM = 12.0  # pixels: a rope with a larger radius in the image is short
_SHORT_SHAPES = (  # name, and least and greatest length in radii
    ("straight", 12.0, 20.0),
    ("arc", 14.0, 28.0),
    ("s", 21.0, 34.0),
    ("loop", 50.0, 55.0),
)
_MAX_SLOPE = 0.25  # slope of a hanging rope against the wall
_HIDDEN = (6.0, 15.0)  # radii: range of the length of rope behind a bar
_BAR_HEIGHT = (6.0, 12.0)  # radii: range between the rope's axis and the lower side of a bar
_HALF_BAR = 7.0  # radii: half the length of a bar
_MAX_SLANT = math.radians(35.0)  # radians: angle between a bar and the normal of the rope
_MAX_BARS = 200  # bars drawn until one hides as much as intended
_NODE_STEP = 0.5  # radii between the nodes that a bar may hide
_END_NODES = 6  # nodes, `_NODE_STEP` apart, that count as a rope's end
_HIDDEN_END_COST = 20.0  # radii: hiding an end is as bad as hiding this much too much


def rough_scene(
    kind: str, seed: int = 0, *, device: str | DepthCamera | None = None, views: int | None = None
) -> SyntheticScene:
    """Draw random ropes that are hard to see for one reason.

    - `thin`: the radius is 2.5 pixels.
    - `thick`: the radius is 8 pixels, or 20, where a few bends fill the image. Two seeds each take turns.
    - `missing`: a third of the ropes' pixels has no depth.
    - `ragged`: the mask has a ragged edge. It misses a tenth of the rope in patches, and holds as much of the
      table.
    - `bar`: a bar before the rope hides 6 to 15 radii of it.
    - `hanging`: the ropes hang 0.4 to 1 m before a wall.

    The ropes' radius is 4 to 6 pixels in the other kinds. They cross at most 4 times. The depths' standard
    deviation on a surface is 0.2 to 0.4 radii, and the camera adds its errors at edges. Masks are exact, or a
    pixel too wide or too narrow. Images have 640 x 480 pixels.

    Parameters
    ----------
    kind : str
        One of `ROUGH`.
    seed : int
        Seed of the random numbers, not negative.
    device : str or DepthCamera, optional
        As in `Camera`; by default, the `CAMERAS` take turns from seed to seed.
    views : int, optional
        Number of images; by default 1 for even seeds and 3 for odd ones.

    Returns
    -------
    SyntheticScene
        Its name holds the kind, the seed, the device and the number of views.

    Raises
    ------
    TypeError
        If an argument has the wrong type.
    ValueError
        If there is no such kind or device, `seed` is negative or `views` is not positive.
    """
    kind = check_choice("kind", kind, ROUGH)
    seed = check_integer("seed", seed)
    rng = np.random.default_rng([ROUGH.index(kind), seed])
    imitated = find_device(list(CAMERAS)[seed % len(CAMERAS)] if device is None else device)
    count = (1, 3)[seed % 2] if views is None else check_integer("views", views, 1)
    radius = float(np.exp(rng.uniform(math.log(0.0025), math.log(0.006))))
    pixels = {"thin": 2.5, "thick": (8.0, 20.0)[seed // 2 % 2]}.get(kind, float(rng.uniform(4.0, 6.0)))
    distance = FOCAL_LENGTH * _SIZE[0] * radius / pixels
    hangs = kind == "hanging"
    elevation = 0.0 if hangs else float(rng.uniform(*_ELEVATIONS))
    mask = Segmentation(grow=int(rng.integers(-1, 2)))
    noise = float(rng.uniform(*_NOISE)) * radius

    def fits(nodes: Array) -> bool:
        return find_least_distance(nodes, radius, spread_azimuths(count, hangs), elevation, _SIZE) <= distance

    chains = _draw_ropes(rng, radius, fits, pixels > _SHORT_FROM, hangs)
    bars: tuple[tuple[Array, float], ...] = ()
    if kind == "missing":
        # the patches grow with the rope
        imitated = replace(imitated, missing=1 / 3, missing_edge=1 / 3, patch=0.5 * pixels)
    elif kind == "ragged":
        mask = replace(mask, ragged=0.7, lost=0.1, taken=0.1, patch=0.4 * pixels)
    elif kind == "bar":
        viewpoints = np.stack(
            [camera_pose(azimuth, distance, elevation)[:3, 3] for azimuth in spread_azimuths(count)]
        )
        bars = (_draw_bar(chains, radius, viewpoints, rng),)
    return scene(
        f"{kind}{seed:02d}_{imitated.name}_{count}v",
        chains=chains,
        seed=seed,
        radius=radius,
        views=count,
        camera=Camera(imitated, size=_SIZE),
        noise=Noise(depth=noise, turn=_TURN),
        mask=mask,
        layout=Layout(distance, elevation, float(rng.uniform(0.4, 1.0)) if hangs else None, bars),
    )


def _draw_ropes(
    rng: np.random.Generator, radius: float, fits: Callable[[Array], bool], short: bool, hang: bool
) -> tuple[Array, ...]:
    """Draw ropes until some fit in the views; if none do, return a short straight one."""

    def place(chains: tuple[Array, ...]) -> tuple[Array, ...]:
        return _hang(chains, radius, rng) if hang else chains

    for _ in range(_MAX_ROPE_DRAWS):
        if short:
            name, least, most = _SHORT_SHAPES[int(rng.integers(len(_SHORT_SHAPES)))]
            plane = make_plane_rotation(float(rng.uniform(0.0, 2.0 * math.pi)))
            chains = place((lay_shape(name, radius, rng.uniform(least, most) * radius, plane),))
        else:
            crossings, ropes = int(rng.integers(0, _MAX_CROSSINGS + 1)), 1 + int(rng.random() < _TWO_ROPES)
            try:
                chains = place(random_ropes(crossings, ropes, radius, int(rng.integers(1 << 31))))
            except ValueError:
                continue  # too many crossings for this number of ropes
        if fits(np.concatenate(chains)):
            return chains
    return place((lay_shape("straight", radius, 12.0 * radius, np.eye(2)),))


def _hang(chains: tuple[Array, ...], radius: float, rng: np.random.Generator) -> tuple[Array, ...]:
    """Return ropes from the table, hung upright on a wavy surface before a wall."""
    length = float(rng.uniform(60.0, 120.0)) * radius
    heading, phase = rng.uniform(0.0, 2.0 * math.pi, size=2)
    hung = []
    for nodes in chains:
        along = nodes[:, 0] * math.cos(heading) + nodes[:, 1] * math.sin(heading)
        wave = _MAX_SLOPE * length / (2.0 * math.pi) * np.sin(2.0 * math.pi * along / length + phase)
        # the world's x axis points away from the wall
        hung.append(np.roll(nodes + np.outer(wave, (0.0, 0.0, 1.0)), 1, axis=1))
    return tuple(hung)


def _draw_bar(
    chains: tuple[Array, ...], radius: float, viewpoints: Array, rng: np.random.Generator
) -> tuple[Array, float]:
    """Return nodes and radius of a bar that hides a stretch of rope from the middle viewpoint.

    The bar is the best of several random ones in all views together: it should hide no end.
    """
    middle = viewpoints[len(viewpoints) // 2]
    spacing = max(1, round(_NODE_STEP * radius / float(np.linalg.norm(chains[0][1] - chains[0][0]))))
    ropes = [chain[::spacing] for chain in chains]
    best, least = None, math.inf
    for _ in range(_MAX_BARS):
        wide = float(rng.uniform(*_HIDDEN)) * radius
        rope = ropes[int(rng.integers(len(ropes)))]
        i = int(rng.integers(1, len(rope) - 1))
        tangent = rope[i + 1] - rope[i - 1]
        turn = math.atan2(tangent[0], -tangent[1]) + float(rng.uniform(-_MAX_SLANT, _MAX_SLANT))
        along = _HALF_BAR * radius * np.array([math.cos(turn), math.sin(turn), 0.0])
        height = 0.5 * wide + float(rng.uniform(*_BAR_HEIGHT)) * radius
        near = height / (middle[2] - rope[i, 2])  # fraction of the way to the camera
        place = rope[i] + near * (middle - rope[i])
        bar = (np.stack([place - along, place + along]), 0.5 * wide * (1.0 - near))
        costs = [
            _rate_hidden([_find_hidden(nodes, bar, viewpoint) for nodes in ropes]) for viewpoint in viewpoints
        ]
        cost = sum(costs)
        if cost < least:
            best, least = bar, cost
        if cost == 0:
            break
    assert best is not None
    return best


def _rate_hidden(hidden: list[NDArray[np.bool_]]) -> float:
    """Return how far the hidden stretch in a view is from the intended one, radii of rope."""
    amount = _NODE_STEP * sum(int(part.sum()) for part in hidden)
    ends = sum(int(part[:_END_NODES].any()) + int(part[-_END_NODES:].any()) for part in hidden)
    return max(_HIDDEN[0] - amount, amount - _HIDDEN[1], 0.0) + _HIDDEN_END_COST * ends


def _find_hidden(nodes: Array, bar: tuple[Array, float], viewpoint: Array) -> NDArray[np.bool_]:
    """Return an (N,) mask of the nodes that a bar hides from a viewpoint."""
    (start, end), radius = bar
    towards = viewpoint - nodes
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    off = (start + np.linspace(0.0, 1.0, 50)[:, None] * (end - start))[None] - nodes[:, None]
    ahead = (off * towards[:, None]).sum(axis=2)
    distance = np.sqrt(np.maximum((off**2).sum(axis=2) - ahead**2, 0.0))
    return np.asarray((distance < radius).any(axis=1))
