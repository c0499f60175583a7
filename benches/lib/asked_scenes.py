"""Scenes of all kinds, each from its seed, with what a caller knows of them drawn at random."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import strand
from lib.collection import SHAPES
from lib.imitated_scenes import PIXELS, make_imitated
from lib.perturbations import KINDS as PERTURBATIONS
from lib.random_scenes import draw_scene
from severity import perturb_scene
from strand.synthetic import (
    COLOR_KINDS,
    FRAMES,
    ROUGH,
    Noise,
    SyntheticScene,
    cluttered_scene,
    color_scene,
    frame_scene,
    rough_scene,
    scene,
)
from witnesses import SITUATIONS

Array = NDArray[np.float64]

GIVEN_RADIUS = 0.6  # probability that the caller knows the radius
GIVEN_ROPES = 0.5  # probability that the caller knows the number of ropes
GIVEN_LENGTH = 0.1  # probability that the caller knows the ropes' lengths
GIVEN_MASK = 0.8  # probability that the caller has masks, of scenes that have them
GIVEN_BOUNDS = 0.8  # probability that the caller has bounds, of scenes that have them
GIVEN_COLORS = 0.8  # probability that the caller has colours, of scenes that have them

PERTURBED = 0.6  # probability that a mistake is a perturbation, and not a situation of benches/witnesses.py
UNSEEN = ("depth off", "depth scaled", "focal length off", "principal point off", "nothing")
"""How names of perturbations begin that the data of one view do not contradict, and of none."""


@dataclass(frozen=True, eq=False)
class Asked:
    """A scene, and what the caller gives of it.

    Attributes
    ----------
    kind, part : str
        One of `KINDS`, and a kind within it.
    views : tuple of View
    truth : tuple of (N, 3) ndarray
        Centrelines, world frame, metres.
    radius : float
        The least of the ropes, metres.
    known : dict
        Keyword arguments of `strand.reconstruct`.
    """

    kind: str
    part: str
    views: tuple[strand.View, ...]
    truth: tuple[Array, ...]
    radius: float
    known: dict[str, Any]


def _draw_plain(seed: int, rng: np.random.Generator) -> tuple[str, SyntheticScene]:
    return "plain", draw_scene(seed, "plain")[0]


def _draw_correlated(seed: int, rng: np.random.Generator) -> tuple[str, SyntheticScene]:
    return "correlated", draw_scene(seed, "correlated")[0]


def _draw_shape(seed: int, rng: np.random.Generator) -> tuple[str, SyntheticScene]:
    name, radius = str(rng.choice(SHAPES)), float(np.exp(rng.uniform(*np.log((2.5e-3, 7e-3)))))
    noise = Noise(depth=float(rng.uniform(0.02, 0.4)) * radius)
    views = int(rng.choice([1, 3, 7]))
    return name, scene(name, radius=radius, seed=seed, noise=noise, views=views)


def _draw_imitated(seed: int, rng: np.random.Generator) -> tuple[str, SyntheticScene]:
    camera = str(rng.choice(list(PIXELS)))
    name = str(rng.choice([*SHAPES, "random", "random", "random"]))
    views, called = int(rng.choice([1, 3])), f"imitated{seed}"
    try:
        return camera, make_imitated(called, name, camera, views, seed)
    except ValueError:
        # no random rope with that many crossings
        return camera, make_imitated(called, "figure8", camera, views, seed)


def _draw_rough(seed: int, rng: np.random.Generator) -> tuple[str, SyntheticScene]:
    kind = str(rng.choice(ROUGH))
    return kind, rough_scene(kind, seed)


def _draw_cluttered(seed: int, rng: np.random.Generator) -> tuple[str, SyntheticScene]:
    return "cluttered", cluttered_scene(seed)


def _draw_frame(seed: int, rng: np.random.Generator) -> tuple[str, SyntheticScene]:
    kind = str(rng.choice(FRAMES))
    return kind, frame_scene(kind, seed)


def _draw_mistake(seed: int, rng: np.random.Generator) -> Asked:
    """Draw a scene and a mistake, with what the caller believes."""
    if rng.random() < PERTURBED:
        name = str(rng.choice([one for one in PERTURBATIONS if not one.startswith(UNSEEN)]))
        given = perturb_scene(seed, name, float(rng.choice(PERTURBATIONS[name].strengths)))
        made = given.scene
        return Asked("mistakes", name, tuple(given.make_views()), made.truth, made.radius, given.arguments)
    name = str(rng.choice(list(SITUATIONS)))
    situation = SITUATIONS[name](seed)
    views = tuple(situation.views)
    return Asked("mistakes", name, views, situation.truth, situation.made.radius, situation.arguments)


# kinds of scenes by name; mistakes and colours are drawn otherwise, points are frames without their images
KINDS: dict[str, Callable[[int, np.random.Generator], tuple[str, SyntheticScene]]] = {
    "plain": _draw_plain,
    "correlated": _draw_correlated,
    "shapes": _draw_shape,
    "imitated": _draw_imitated,
    "rough": _draw_rough,
    "cluttered": _draw_cluttered,
    "frames": _draw_frame,
    "points": _draw_frame,
    "color": _draw_frame,
    "mistakes": _draw_frame,
}


def draw_asked(seed: int) -> Asked:
    """Draw the scene of a seed, and what is known of it. Kinds take turns."""
    kind = list(KINDS)[seed % len(KINDS)]
    rng = np.random.default_rng([seed, 32])
    known: dict[str, Any] = {}
    radius_is_known, count_is_known = rng.random() < GIVEN_RADIUS, rng.random() < GIVEN_ROPES
    lengths_are_known, masks_are_given = rng.random() < GIVEN_LENGTH, rng.random() < GIVEN_MASK
    bounds_are_given, colors_are_given = rng.random() < GIVEN_BOUNDS, rng.random() < GIVEN_COLORS
    if kind == "mistakes":
        return _draw_mistake(seed, rng)
    if kind == "color":
        part = str(rng.choice(COLOR_KINDS))
        colored = color_scene(part, seed)
        made, views = colored.scene, colored.views if colors_are_given else colored.scene.views
    else:
        part, made = KINDS[kind](seed, rng)
        if made.mask is not None and not masks_are_given:
            made = dataclasses.replace(made, mask=None)
        views = made.views
        if kind == "points":
            views = tuple(strand.View(view.points, view.pose) for view in views)
        if made.bounds is not None and bounds_are_given and kind != "cluttered":
            known["bounds"] = made.bounds
    equal = len({round(one, 9) for one in np.atleast_1d(made.radii)}) == 1
    if radius_is_known and equal and kind != "cluttered":
        known["radius"] = made.radius
    if count_is_known:
        known["ropes"] = len(made.truth)
    if lengths_are_known:
        known["length"] = [
            float(np.linalg.norm(np.diff(nodes, axis=0), axis=1).sum()) for nodes in made.truth
        ]
    return Asked(kind, part, views, made.truth, float(made.radius), known)
