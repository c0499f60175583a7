"""Colour images of ropes on a table: textures, light, shadows, highlights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

import strand._core as _core
from strand.geometry.polyline import path_length
from strand.support.checks import (
    Array,
    check_choice,
    check_instance,
    check_integer,
    check_nonnegative,
    check_sequence,
    check_small_array,
)
from strand.synthetic.rendering import check_size, render_depth
from strand.synthetic.scenes import SyntheticScene
from strand.synthetic.tabletops import TEXTURES, draw_texture, look_up
from strand.views.pinhole import Pinhole

_FINER = 2  # an image pixel is the mean of 2 x 2 rays
_AMBIENT = 0.45  # share of the light that comes from everywhere
_SHINE = 25.0  # exponent of highlights
_BRAID = 6.0  # radii: length of one turn of a rope's two colours
_ROUGHNESS = 0.06  # share of the light by which a rope's surface varies
_SLOPE = 0.12  # share of the light by which the image varies from one side to the other
_MAX_SHADOW = 8.0  # radii from a rope: softer shadows end there
_NOTHING = np.array([0.12, 0.12, 0.13])  # colour of pixels that show nothing, from 0 to 1

RGB = tuple[float, float, float]


@dataclass(frozen=True)
class Paint:
    """Colours and light of a scene.

    Attributes
    ----------
    ropes : sequence of sequence of (float, float, float)
        One or two colours of each rope, red, green and blue from 0 to 1; the last entry holds for the rest.
        Two colours wind around the rope.
    table : (float, float, float)
    texture : str
        One of `TEXTURES`.
    shadow : float
        Share of the light that ropes take from the table behind them, from 0 to 1.
    softness : float
        Width of the edge of shadows, radii.
    highlight : float
        Light of highlights on ropes, from 0 to 1.
    noise : float
        Standard deviation of a pixel's error, from 0 to 1.
    light : (float, float, float)
        Towards the light, world frame.

    Raises
    ------
    ValueError
        If there is no such texture, or a number is out of its range.
    """

    ropes: Sequence[Sequence[RGB]] = (((0.75, 0.1, 0.1),),)
    table: RGB = (0.6, 0.6, 0.58)
    texture: str = "plain"
    shadow: float = 0.4
    softness: float = 1.0
    highlight: float = 0.2
    noise: float = 0.008
    light: RGB = (0.4, 0.3, 1.0)

    def __post_init__(self) -> None:
        check_choice("texture", self.texture, TEXTURES)
        for name in ("shadow", "softness", "highlight", "noise"):
            check_nonnegative(name, getattr(self, name))
        for name in ("table", "light"):
            check_small_array(name, getattr(self, name), (3,))
        ropes = check_sequence("ropes", self.ropes, "colours of ropes")
        if not ropes:
            raise ValueError("ropes: expected the colours of at least one rope, got none")
        for i, rope in enumerate(ropes):
            for color in check_sequence(f"ropes[{i}]", rope, "colours"):
                check_small_array(f"ropes[{i}]", color, (3,))


@dataclass(frozen=True, eq=False)
class Thing:
    """An object that is no rope, seen by one camera.

    Attributes
    ----------
    depth : (H, W) ndarray
        On a grid twice as fine as the image, metres; 0 where it is not.
    color : (float, float, float)
    """

    depth: Array
    color: RGB


def paint_scene(
    scene: SyntheticScene, paint: Paint | None = None, seed: int = 0
) -> tuple[NDArray[np.uint8], NDArray[np.int32]]:
    """Return colour images of a scene whose table is the plane z = 0, and exact masks.

    Parameters
    ----------
    scene : SyntheticScene
        Made by `scene` without a wall or bars.
    paint : Paint, optional
        Its colours and its light; a red rope on a grey table by default.
    seed : int
        Seed of the texture and of the pixels' errors, not negative.

    Returns
    -------
    color : (V, H, W, 3) ndarray of uint8
    labels : (V, H, W) ndarray of int32
        0 for no rope, otherwise one more than the rope's number in `scene.truth`.

    Raises
    ------
    ValueError
        If the seed is negative.

    Examples
    --------
    >>> import strand
    >>> from strand.synthetic import Camera, paint_scene
    >>> scene = strand.synthetic.scene("s", views=1, camera=Camera(size=(64, 48)))
    >>> color, labels = paint_scene(scene)
    >>> color.shape, int(labels.max())
    ((1, 48, 64, 3), 1)
    """
    check_instance("scene", scene, SyntheticScene)
    paint = Paint() if paint is None else check_instance("paint", paint, Paint)
    rng = np.random.default_rng(check_integer("seed", seed, 0))
    texture = draw_texture(paint.texture, np.asarray(paint.table), rng)
    height, width = scene.depth.shape[1:]
    painted = [
        render_color(scene.truth, scene.radius, scene.intrinsics, pose, (width, height), paint, texture, rng)
        for pose in scene.poses_true
    ]
    return np.stack([color for color, _ in painted]), np.stack([labels for _, labels in painted])


def make_finer(intrinsics: Array, size: tuple[int, int]) -> tuple[Array, tuple[int, int]]:
    """Return the pinhole matrix and the size of the grid that colours are drawn on."""
    fine = intrinsics.copy()
    fine[:2] *= _FINER
    fine[:2, 2] += 0.5 * (_FINER - 1)
    return fine, (_FINER * size[0], _FINER * size[1])


def render_color(
    chains: Sequence[ArrayLike],
    radius: float,
    intrinsics: Array,
    pose: Array,
    size: tuple[int, int],
    paint: Paint,
    texture: Array,
    rng: np.random.Generator,
    things: Sequence[Thing] = (),
    table: float = 3.0,
    slope: tuple[float, float] | None = None,
) -> tuple[NDArray[np.uint8], NDArray[np.int32]]:
    """Return the (H, W, 3) colours and (H, W) labels of ropes on a table of a side in metres, and things.

    `slope` says how the light varies over the image, across and down. By default it is drawn.
    """
    ropes = [np.asarray(chain, dtype=np.float64) for chain in chains]
    fine, fine_size = make_finer(intrinsics, check_size(size))
    nearest = render_depth([], [], fine, pose, fine_size, table)
    owner = np.where(nearest > 0, 0, -1)
    layers = [render_depth([rope], radius, fine, pose, fine_size, 0.0) for rope in ropes]
    for number, depth in enumerate([*layers, *(thing.depth for thing in things)], 1):
        nearer = (depth > 0) & ((depth < nearest) | (nearest == 0))
        nearest[nearer], owner[nearer] = depth[nearer], number
    rows, columns = np.mgrid[: fine_size[1], : fine_size[0]]
    camera = Pinhole.from_matrix(fine)
    points = camera.lift(rows, columns, nearest) @ pose[:3, :3].T + pose[:3, 3]
    light = np.asarray(paint.light) / np.linalg.norm(paint.light)
    colors = np.broadcast_to(_NOTHING, (*nearest.shape, 3)).copy()
    ground = owner == 0
    colors[ground] = look_up(texture, points[ground, 0], points[ground, 1])
    colors[ground] *= _find_shade(points[ground], ropes, radius, light, paint)[:, None]
    for number, rope in enumerate(ropes, 1):
        own = owner == number
        shades = paint.ropes[min(number, len(paint.ropes)) - 1]
        colors[own] = _paint_rope(points[own], rope, radius, np.asarray(shades), pose[:3, 3], light, paint)
    for number, thing in enumerate(things, len(ropes) + 1):
        own = owner == number
        colors[own] = _light_surface(points, own, light)[:, None] * np.asarray(thing.color)
    right, down = (rng.normal(), rng.normal()) if slope is None else slope
    across = (columns * right / fine_size[0] + rows * down / fine_size[1])[..., None]
    colors *= 1.0 + _SLOPE * (across - across.mean())
    color = _average(np.clip(colors, 0.0, 1.0))
    color = np.clip(color + rng.normal(0.0, 1.0, color.shape) * paint.noise, 0.0, 1.0)
    return np.rint(255.0 * color).astype(np.uint8), _count_labels(owner, len(ropes))


def _average(values: Array) -> Array:
    """Return the means of squares of the fine grid."""
    height, width = values.shape[0] // _FINER, values.shape[1] // _FINER
    return np.asarray(values.reshape(height, _FINER, width, _FINER, -1).mean(axis=(1, 3)))


def _count_labels(owner: NDArray[np.int64], ropes: int) -> NDArray[np.int32]:
    """Return each pixel's rope: the one with most of its rays, if ropes have half of them."""
    shares = (
        _average(np.stack([owner == number for number in range(1, ropes + 1)], axis=-1)) if ropes else None
    )
    if shares is None:
        return np.zeros((owner.shape[0] // _FINER, owner.shape[1] // _FINER), dtype=np.int32)
    labels = 1 + shares.argmax(axis=-1)
    return np.where(shares.sum(axis=-1) >= 0.5, labels, 0).astype(np.int32)


def _find_shade(points: Array, ropes: list[Array], radius: float, light: Array, paint: Paint) -> Array:
    """Return the (N,) share of light that reaches places on the table."""
    if not ropes or paint.shadow == 0:
        return np.ones(len(points))
    # a rope's shadow is a band around its axis, moved along the light onto the table
    fallen = [
        np.column_stack([rope[:, :2] - rope[:, 2:] * light[:2] / light[2], np.zeros(len(rope))])
        for rope in ropes
    ]
    queries = _core.TubeQueries(fallen, [path_length(nodes) for nodes in fallen], [radius] * len(fallen))
    nodes = np.concatenate(fallen)[:, :2]
    reach = (_MAX_SHADOW + paint.softness) * radius
    low, high = nodes.min(axis=0) - reach, nodes.max(axis=0) + reach
    near = ((points[:, :2] > low) & (points[:, :2] < high)).all(axis=1)
    away = queries.signed_distances(points[near])
    deep = np.clip(0.5 - away / max(paint.softness * radius, 1e-9), 0.0, 1.0)
    shade = np.ones(len(points))
    shade[near] -= paint.shadow * deep * deep * (3.0 - 2.0 * deep)
    return shade


def _paint_rope(
    points: Array, rope: Array, radius: float, shades: Array, camera: Array, light: Array, paint: Paint
) -> Array:
    """Return the (N, 3) colours of places on a rope of one or two colours."""
    if not len(points):
        return np.empty((0, 3))
    along = path_length(rope)
    _, at, axis, _ = _core.TubeQueries([rope], [along], [radius]).nearest(points)
    normals = (points - axis) / np.linalg.norm(points - axis, axis=1, keepdims=True)
    tangents = np.stack([np.interp(at, along, np.gradient(rope[:, k], along)) for k in range(3)], axis=1)
    aside = np.cross(tangents, [0.0, 0.0, 1.0])
    angles = np.arctan2(normals[:, 2], (normals * aside).sum(axis=1))
    turns = at / (_BRAID * radius) + angles / (2.0 * np.pi)
    base = shades[(np.floor(len(shades) * turns) % len(shades)).astype(np.int64)]
    rough = 1.0 + _ROUGHNESS * np.sin(2.0 * np.pi * (at / (0.7 * radius) + angles))
    to_camera = camera - points
    to_camera /= np.linalg.norm(to_camera, axis=1, keepdims=True)
    half = to_camera + light
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    shine = paint.highlight * np.clip((normals * half).sum(axis=1), 0.0, 1.0) ** _SHINE
    bright = (_AMBIENT + (1.0 - _AMBIENT) * np.clip(normals @ light, 0.0, 1.0)) * rough
    return np.asarray(base * bright[:, None] + shine[:, None])


def _light_surface(points: Array, own: NDArray[np.bool_], light: Array) -> Array:
    """Return the light on a thing's pixels, from the slopes between neighbours."""
    down, right = np.gradient(points, axis=0), np.gradient(points, axis=1)
    normals = np.cross(right[own], down[own])
    lengths = np.linalg.norm(normals, axis=1)
    facing = np.abs(normals @ light) / np.maximum(lengths, 1e-15)
    return np.asarray(_AMBIENT + (1.0 - _AMBIENT) * np.clip(facing, 0.0, 1.0))
