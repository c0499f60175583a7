"""Rough scenes: what makes ropes hard to see in practice, one thing at a time, through an imitated camera."""

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
from strand.synthetic.noise import Noise, rotation_in_plane
from strand.synthetic.random_curves import random_ropes
from strand.synthetic.scenes import SyntheticScene, scene
from strand.synthetic.segmentation import Segmentation
from strand.synthetic.shapes import lay

ROUGH = ("thin", "thick", "missing", "ragged", "bar", "hanging")
"""Kinds that `rough` knows."""

_SIZE = (640, 480)
_TURN = math.radians(0.4)  # standard deviation of the poses' turns
_ELEVATIONS = (math.radians(55.0), math.radians(85.0))
_NOISE = (0.2, 0.4)  # radii, standard deviation of the depths on a surface
_DRAWS = 400  # of ropes, until some are seen whole from as near as wanted
_CROSSINGS, _TWO = 4, 0.2  # most crossings, and how often there are two ropes
_WIDE = 12.0  # pixels of radius from which on ropes are short: with the lengths in radii
_SHORT = (("straight", 12.0, 20.0), ("arc", 14.0, 28.0), ("s", 21.0, 34.0), ("loop", 50.0, 55.0))
_SLOPE = 0.25  # of a hanging rope, towards the wall and away
_HIDDEN = (6.0, 15.0)  # radii of rope behind a bar
_ABOVE = (6.0, 12.0)  # radii between the rope's axis and the bar's lower side
_HALF_BAR = 7.0  # radii
_SLANT = math.radians(35.0)  # of a bar against a right angle to the rope
_BARS = 200  # that are drawn at most
_SAMPLED = 0.5  # radii between the nodes that a bar may hide
_END, _LOST_END = 6, 20.0  # of these nodes at a rope's end; as bad as so many radii too much


def rough_scene(
    kind: str, seed: int = 0, *, device: str | DepthCamera | None = None, views: int | None = None
) -> SyntheticScene:
    """Ropes at random, hard to see for one reason.

    - `thin`: 2.5 pixels of radius.
    - `thick`: 8 pixels of radius, or 20, where a few bends fill the image: two seeds each in turn.
    - `missing`: a third of the ropes' pixels has no depth.
    - `ragged`: a mask with a ragged edge, too wide or too narrow, that lost a tenth of the rope in bits and
      took as much of the table.
    - `bar`: a bar before the rope, which hides 6 to 15 radii of it.
    - `hanging`: no table: the rope hangs before a wall 0.4 to 1 m behind it.

    Ropes are some pixels wide and cross at most 4 times. Depths have a standard deviation of 0.2 to 0.4 radii
    on a surface, to which comes what the camera does at edges. All but the ragged masks are exact, or a pixel
    too wide or too narrow. Images are 640 x 480.

    Parameters
    ----------
    kind : str
        One of `ROUGH`.
    seed : int
        The source of chance, not negative.
    device : str or DepthCamera, optional
        As in `scene`; if not given, `CAMERAS` take turns from seed to seed.
    views : int, optional
        How many images; if not given, 1 and 3 take turns.

    Returns
    -------
    SyntheticScene
        Named after its kind, seed, camera and number of views.

    Raises
    ------
    TypeError
        If an argument is not of its type.
    ValueError
        If there is no such kind or camera, `seed` is negative or `views` is not positive.
    """
    kind = check_choice("kind", kind, ROUGH)
    seed = check_integer("seed", seed)
    rng = np.random.default_rng([ROUGH.index(kind), seed])
    used = find_device(list(CAMERAS)[seed % len(CAMERAS)] if device is None else device)
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

    chains = _ropes(rng, radius, fits, pixels > _WIDE, hangs)
    bars: tuple[tuple[Array, float], ...] = ()
    if kind == "missing":
        # thick ropes lose large patches as well
        used = replace(used, missing=1 / 3, missing_edge=1 / 3, patch=0.5 * pixels)
    elif kind == "ragged":
        mask = replace(mask, ragged=0.7, lost=0.1, taken=0.1, patch=0.4 * pixels)
    elif kind == "bar":
        viewpoints = np.stack(
            [camera_pose(azimuth, distance, elevation)[:3, 3] for azimuth in spread_azimuths(count)]
        )
        bars = (_bar(chains, radius, viewpoints, rng),)
    return scene(
        f"{kind}{seed:02d}_{used.name}_{count}v",
        chains=chains,
        seed=seed,
        radius=radius,
        views=count,
        camera=Camera(used, size=_SIZE),
        noise=Noise(depth=noise, turn=_TURN),
        mask=mask,
        layout=Layout(distance, elevation, float(rng.uniform(0.4, 1.0)) if hangs else None, bars),
    )


def _ropes(
    rng: np.random.Generator, radius: float, fits: Callable[[Array], bool], wide: bool, hang: bool
) -> tuple[Array, ...]:
    """Draw ropes until some fit in the views; if none do, a short straight one."""

    def posed(chains: tuple[Array, ...]) -> tuple[Array, ...]:
        return _hung(chains, radius, rng) if hang else chains

    for _ in range(_DRAWS):
        if wide:
            name, least, most = _SHORT[int(rng.integers(len(_SHORT)))]
            plane = rotation_in_plane(float(rng.uniform(0.0, 2.0 * math.pi)))
            chains = posed((lay(name, radius, rng.uniform(least, most) * radius, plane),))
        else:
            crossings, ropes = int(rng.integers(0, _CROSSINGS + 1)), 1 + int(rng.random() < _TWO)
            try:
                chains = posed(random_ropes(crossings, ropes, radius, int(rng.integers(1 << 31))))
            except ValueError:
                continue  # too many crossings for so few ropes
        if fits(np.concatenate(chains)):
            return chains
    return posed((lay("straight", radius, 12.0 * radius, np.eye(2)),))


def _hung(chains: tuple[Array, ...], radius: float, rng: np.random.Generator) -> tuple[Array, ...]:
    """Ropes that lay on the table, upright before a wall, on a wavy surface."""
    length = float(rng.uniform(60.0, 120.0)) * radius
    heading, phase = rng.uniform(0.0, 2.0 * math.pi, size=2)
    hung = []
    for nodes in chains:
        along = nodes[:, 0] * math.cos(heading) + nodes[:, 1] * math.sin(heading)
        wave = _SLOPE * length / (2.0 * math.pi) * np.sin(2.0 * math.pi * along / length + phase)
        # x of the world is away from the wall
        hung.append(np.roll(nodes + np.outer(wave, (0.0, 0.0, 1.0)), 1, axis=1))
    return tuple(hung)


def _bar(
    chains: tuple[Array, ...], radius: float, viewpoints: Array, rng: np.random.Generator
) -> tuple[Array, float]:
    """Nodes and radius of a bar that hides as much of a rope as wanted from the middle one of the viewpoints.

    It is the best of some that are drawn, by all views together: none should lose an end.
    """
    middle = viewpoints[len(viewpoints) // 2]
    spacing = max(1, round(_SAMPLED * radius / float(np.linalg.norm(chains[0][1] - chains[0][0]))))
    ropes = [chain[::spacing] for chain in chains]
    best, least = None, math.inf
    for _ in range(_BARS):
        wide = float(rng.uniform(*_HIDDEN)) * radius
        rope = ropes[int(rng.integers(len(ropes)))]
        i = int(rng.integers(1, len(rope) - 1))
        tangent = rope[i + 1] - rope[i - 1]
        turn = math.atan2(tangent[0], -tangent[1]) + float(rng.uniform(-_SLANT, _SLANT))
        along = _HALF_BAR * radius * np.array([math.cos(turn), math.sin(turn), 0.0])
        height = 0.5 * wide + float(rng.uniform(*_ABOVE)) * radius
        near = height / (middle[2] - rope[i, 2])  # on the way to the camera
        place = rope[i] + near * (middle - rope[i])
        bar = (np.stack([place - along, place + along]), 0.5 * wide * (1.0 - near))
        faults = [_fault([_behind(nodes, bar, seen_from) for nodes in ropes]) for seen_from in viewpoints]
        fault = sum(faults)
        if fault < least:
            best, least = bar, fault
        if fault == 0:
            break
    assert best is not None
    return best


def _fault(hidden: list[NDArray[np.bool_]]) -> float:
    """Return by how much what a bar hides in a view is not as wanted, in radii of rope."""
    amount = _SAMPLED * sum(int(part.sum()) for part in hidden)
    ends = sum(int(part[:_END].any()) + int(part[-_END:].any()) for part in hidden)
    return max(_HIDDEN[0] - amount, amount - _HIDDEN[1], 0.0) + _LOST_END * ends


def _behind(nodes: Array, bar: tuple[Array, float], viewpoint: Array) -> NDArray[np.bool_]:
    """(N,) Which nodes a bar hides from a viewpoint."""
    (start, end), radius = bar
    towards = viewpoint - nodes
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    off = (start + np.linspace(0.0, 1.0, 50)[:, None] * (end - start))[None] - nodes[:, None]
    ahead = (off * towards[:, None]).sum(axis=2)
    distance = np.sqrt(np.maximum((off**2).sum(axis=2) - ahead**2, 0.0))
    return np.asarray((distance < radius).any(axis=1))
