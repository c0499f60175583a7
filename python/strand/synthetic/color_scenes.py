"""Scenes with colour: ropes on tables of all kinds, hands and grippers, and tables without a rope."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import Array, check_bool, check_choice, check_integer
from strand.synthetic.camera import FOCAL_LENGTH, Camera, camera_pose, find_least_distance
from strand.synthetic.depth_camera import CAMERAS
from strand.synthetic.objects import Box, Object, add_objects
from strand.synthetic.painting import RGB, Paint, Thing, make_finer, render_color
from strand.synthetic.random_curves import random_ropes
from strand.synthetic.rendering import render_depth
from strand.synthetic.scenes import SyntheticScene
from strand.synthetic.tabletops import draw_texture
from strand.views.view import View

COLOR_KINDS = (
    "plain",
    "wood",
    "patterned",
    "two ropes",
    "two colors",
    "shadows",
    "highlights",
    "hand",
    "gripper",
    "table color",
)
"""The kinds of scenes with colour."""

_CAMERA = Camera(size=(640, 480))
# its disparity comes in steps that are coarser than a rope at half a metre
_COARSE = replace(CAMERAS["sgbm"], name="coarse", baseline=0.05, step=0.5, sd=0.2)
_DEVICES = (_COARSE, *CAMERAS.values())
_RADII = (0.002, 0.006)  # metres: range of the ropes' radius
_RADII_PX = (2.0, 6.0)  # pixels: range of the ropes' radius in the image
_ELEVATIONS = (math.radians(50.0), math.radians(85.0))  # radians: range of the camera's elevation
_SIDES = (1.2, 3.0)  # metres: side of the table; the edge of the smaller one may be in view
_FARTHER = 1.1  # factor of the camera's distance until all ropes are in view
_MARGIN = 10.0  # pixels between ropes and the image's border
_MIN_DIFFERENCE = 0.35  # least difference of a rope's colour from the table's, of colours from 0 to 1
_SKIN: RGB = (0.78, 0.56, 0.45)
_STEEL: RGB = (0.2, 0.2, 0.22)
_FINGER = 0.008  # metres: radius of a finger
_FOREARM = 0.03  # metres: radius of a forearm
_MAX_HIDDEN = 8.0  # radii: longest stretch of a rope that a thing hides
_MAX_DRAWS = 40  # things drawn until one hides little enough


@dataclass(frozen=True, eq=False)
class ColorScene:
    """A scene with colour images.

    Attributes
    ----------
    scene : SyntheticScene
        One image, without a mask.
    color : (V, H, W, 3) ndarray of uint8
    labels : (V, H, W) ndarray of int32
        The exact mask: 0 for no rope, otherwise one more than the rope's number in `scene.truth`.
    occluders : (V, H, W) ndarray of bool
        The pixels of a hand or a gripper, as `View.from_depth` takes them. `views` does not have them.
    """

    scene: SyntheticScene
    color: NDArray[np.uint8]
    labels: NDArray[np.int32]
    occluders: NDArray[np.bool_]

    @property
    def views(self) -> tuple[View, ...]:
        """The images as views with colours, and without a mask."""
        made = self.scene
        return tuple(
            View.from_depth(depth, made.intrinsics, pose, color, depth_scale=made.depth_scale)
            for depth, pose, color in zip(made.depth, made.poses, self.color, strict=True)
        )


def color_scene(kind: str = "plain", seed: int = 0, *, rope: bool = True) -> ColorScene:
    """Draw a scene with colour, of one camera that may not resolve the ropes' height.

    - "plain", "wood", "patterned": one or two ropes of one colour on a table of one colour, of wood, or
      printed.
    - "two ropes": two ropes of different colours on a plain table.
    - "two colors": each rope has two colours that wind around it.
    - "shadows", "highlights": soft and dark shadows, and glossy ropes.
    - "hand", "gripper": one beside or above a rope, which it hides at most 8 radii of.
    - "table color": ropes of the table's colour, which only height, light and shadow show.

    Parameters
    ----------
    kind : str
        One of `COLOR_KINDS`.
    seed : int
        Seed of the random numbers, not negative.
    rope : bool
        Whether there is a rope. Without one, the truth is empty.

    Returns
    -------
    ColorScene

    Raises
    ------
    TypeError
        If an argument has the wrong type.
    ValueError
        If there is no such kind, or the seed is negative.
    """
    kind, rope = check_choice("kind", kind, COLOR_KINDS), check_bool("rope", rope)
    rng = np.random.default_rng([check_integer("seed", seed, 0), COLOR_KINDS.index(kind)])
    radius, radius_px = float(rng.uniform(*_RADII)), float(rng.uniform(*_RADII_PX))
    ropes = _draw_ropes(rng, radius, 2 if kind == "two ropes" else int(rng.integers(1, 3)))
    elevation = float(rng.uniform(*_ELEVATIONS))
    least = find_least_distance(np.concatenate(ropes), radius, np.zeros(1), elevation, _CAMERA.size)
    distance = max(FOCAL_LENGTH * _CAMERA.size[0] * radius / radius_px, least)
    pose = camera_pose(float(rng.uniform(0.0, 2.0 * math.pi)), distance, elevation)
    if max(np.ptp(np.concatenate(ropes)[:, :2], axis=0)) > distance:
        pose = camera_pose(0.0, distance, elevation)
    turn = math.atan2(pose[1, 3], pose[0, 3])
    while not _shows_all(ropes, pose):
        distance *= _FARTHER
        pose = camera_pose(turn, distance, elevation)
    paint = _draw_paint(rng, kind, len(ropes))
    side = float(rng.choice(_SIDES))
    things = _draw_things(rng, kind, ropes, radius, pose)
    shown = ropes if rope else ()
    exact = render_depth(shown, radius, _CAMERA.intrinsics, pose, _CAMERA.size, side)
    occluders = np.zeros(exact.shape, dtype=bool)
    for thing in things:
        # the fine grid's first pixel of each square; the difference is below the noise
        depth = thing.depth[::2, ::2]
        before = (depth > 0) & ((depth < exact) | (exact == 0))
        exact = np.where(before, depth, exact)
        occluders |= before
    device = _DEVICES[int(rng.integers(len(_DEVICES)))]
    image = device.sense(exact, _CAMERA.intrinsics, depth_scale=_CAMERA.depth_scale, rng=rng)
    texture = draw_texture(paint.texture, np.asarray(paint.table), rng)
    color, labels = render_color(
        shown, radius, _CAMERA.intrinsics, pose, _CAMERA.size, paint, texture, rng, things, side
    )
    errors = np.abs(image * _CAMERA.depth_scale - exact)[(image > 0) & (exact > 0)]
    half = 0.5 * side
    made = SyntheticScene(
        name=f"{kind.replace(' ', '_')}{seed:02d}{'' if rope else '_without_rope'}",
        depth=image[None],
        depth_scale=_CAMERA.depth_scale,
        intrinsics=_CAMERA.intrinsics,
        poses=pose[None],
        poses_true=pose[None],
        bounds=(np.array([-half, -half, -half]), np.array([half, half, half])),
        radius=radius,
        truth=tuple(shown),
        noise=float(1.4826 * np.median(errors)) if len(errors) else 0.0,
    )
    return ColorScene(made, color[None], labels[None], occluders[None])


def _shows_all(ropes: tuple[Array, ...], pose: Array) -> bool:
    """Tell whether a camera has all of the ropes in view."""
    inside = (np.concatenate(ropes) - pose[:3, 3]) @ pose[:3, :3]
    places = (inside @ _CAMERA.intrinsics.T)[:, :2] / inside[:, 2:]
    return bool(((places > _MARGIN) & (places < np.asarray(_CAMERA.size) - _MARGIN)).all())


def _draw_ropes(rng: np.random.Generator, radius: float, count: int) -> tuple[Array, ...]:
    while True:
        try:
            return random_ropes(int(rng.integers(0, 5)), count, radius, int(rng.integers(1 << 30)))
        except ValueError:
            continue  # no ropes with this number of crossings were found


def _draw_color(rng: np.random.Generator, others: list[RGB]) -> RGB:
    """Return a colour that differs from others."""
    while True:
        color = tuple(float(v) for v in rng.uniform(0.03, 0.92, 3))
        if all(np.linalg.norm(np.subtract(color, other)) > _MIN_DIFFERENCE for other in others):
            return color[0], color[1], color[2]


def _draw_paint(rng: np.random.Generator, kind: str, ropes: int) -> Paint:
    gray = float(rng.uniform(0.1, 0.9))
    tint = rng.normal(0.0, 0.05, 3)
    table: RGB = (
        float(np.clip(gray + tint[0], 0.05, 0.95)),
        float(np.clip(gray + tint[1], 0.05, 0.95)),
        float(np.clip(gray + tint[2], 0.05, 0.95)),
    )
    texture = "plain"
    if kind == "wood" or (kind in ("hand", "shadows") and rng.random() < 0.3):
        texture, table = "wood", (0.62 * (gray + 0.4), 0.45 * (gray + 0.4), 0.3 * (gray + 0.4))
    elif kind == "patterned":
        texture = ("checks", "stripes", "strokes")[int(rng.integers(3))]
    colors: list[tuple[RGB, ...]] = []
    for number in range(ropes):
        if kind != "two ropes" and number:
            colors.append(colors[0])
            continue
        own: tuple[RGB, ...] = (_draw_color(rng, [table, *(c for pair in colors for c in pair)]),)
        if kind == "table color":
            own = (table,)
        if kind == "two colors":
            own = (own[0], _draw_color(rng, [table, own[0]]))
        colors.append(own)
    deep = kind in ("shadows", "table color")
    return Paint(
        tuple(colors),
        table,
        texture,
        shadow=float(rng.uniform(0.4, 0.7) if deep else rng.uniform(0.0, 0.4)),
        softness=float(rng.uniform(0.3, 4.0)),
        highlight=float(rng.uniform(0.4, 0.9) if kind == "highlights" else rng.uniform(0.0, 0.25)),
        noise=float(rng.uniform(0.004, 0.02)),
        light=(float(rng.normal(0.0, 0.4)), float(rng.normal(0.0, 0.4)), 1.0),
    )


def _draw_things(
    rng: np.random.Generator, kind: str, ropes: tuple[Array, ...], radius: float, pose: Array
) -> list[Thing]:
    """Draw a hand or a gripper that hides little of the ropes."""
    if kind not in ("hand", "gripper"):
        return []
    fine, size = make_finer(_CAMERA.intrinsics, _CAMERA.size)
    for _ in range(_MAX_DRAWS):
        rope = ropes[int(rng.integers(len(ropes)))]
        place = rope[int(rng.integers(len(rope)))]
        turn = float(rng.uniform(0.0, 2.0 * math.pi))
        if kind == "hand":
            tubes, radii = _make_hand(place, turn, radius)
            thing = Thing(render_depth(tubes, radii, fine, pose, size, 0.0), _SKIN)
        else:
            thing = Thing(
                add_objects(np.zeros(size[::-1]), _make_gripper(place, turn, radius), fine, pose), _STEEL
            )
        if _measure_hidden(ropes, radius, thing.depth, fine, pose) <= _MAX_HIDDEN:
            return [thing]
    return []


def _make_hand(place: Array, turn: float, radius: float) -> tuple[list[Array], list[float]]:
    """Return the tubes of a hand that points at a place: two fingers, a palm and a forearm."""
    out = np.array([math.cos(turn), math.sin(turn), 0.35])
    aside = np.array([-math.sin(turn), math.cos(turn), 0.0])
    tip = place + np.array([0.0, 0.0, 0.5 * radius + _FINGER]) + 0.2 * radius * out
    tubes, radii = [], []
    for spread in (-0.5, 0.5):
        knuckle = tip + 0.06 * out + 1.6 * spread * _FINGER * 2.0 * aside
        tubes.append(np.array([tip + spread * 0.9 * _FINGER * aside, knuckle]))
        radii.append(_FINGER)
    for spread in (-1.0, 1.0):
        start = tip + 0.035 * out + spread * 0.026 * aside
        tubes.append(np.array([start, tip + 0.08 * out + spread * 0.02 * aside]))
        radii.append(_FINGER)
    tubes.append(np.array([tip + 0.06 * out, tip + 0.13 * out]))
    radii.append(0.032)
    tubes.append(np.array([tip + 0.12 * out, tip + 0.9 * out]))
    radii.append(_FOREARM)
    return tubes, radii


def _make_gripper(place: Array, turn: float, radius: float) -> list[Object]:
    """Return two fingers on both sides of a place, and a palm above them."""
    across = np.array([math.cos(turn), math.sin(turn)])
    x, y = place[:2]
    half = 2.5 * radius + 0.006
    boxes: list[Object] = [
        Box((x + s * half * across[0], y + s * half * across[1], 0.035), (0.012, 0.02, 0.06), turn)
        for s in (-1.0, 1.0)
    ]
    return [*boxes, Box((float(x), float(y), 0.1), (0.09, 0.05, 0.07), turn)]


def _measure_hidden(
    ropes: tuple[Array, ...], radius: float, depth: Array, intrinsics: Array, pose: Array
) -> float:
    """Return the longest stretch of a rope that a thing hides, radii; infinite if it hides an end."""
    longest = 0.0
    for rope in ropes:
        inside = (rope - pose[:3, 3]) @ pose[:3, :3]
        columns, rows = np.rint((inside @ intrinsics.T)[:, :2] / inside[:, 2:]).astype(np.int64).T
        rows, columns = np.clip(rows, 0, depth.shape[0] - 1), np.clip(columns, 0, depth.shape[1] - 1)
        over = depth[rows, columns]
        hidden = (over > 0) & (over < inside[:, 2])
        if hidden[:5].any() or hidden[-5:].any():
            return math.inf
        edges = np.flatnonzero(np.diff(np.concatenate([[0], hidden, [0]]).astype(np.int64)))
        step = float(np.linalg.norm(rope[1] - rope[0])) / radius
        longest = max(longest, float((edges[1::2] - edges[::2]).max(initial=0)) * step)
    return longest
