"""Scenes of harnesses: random trees, cycles and ropes, with the graph as the truth."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from strand.support.checks import Array, check_choice, check_instance, check_integer
from strand.support.robust import estimate_deviation
from strand.synthetic.camera import (
    TABLE_ELEVATION,
    Camera,
    camera_pose,
    find_device,
    find_least_distance,
    spread_azimuths,
)
from strand.synthetic.harness_plans import (
    Meeting,
    Piece,
    add_rope,
    find_meetings,
    fit_in_square,
    grow_cycle,
    grow_tree,
    keep_apart_in_plan,
    lay,
)
from strand.synthetic.harness_wires import Tube, lay_wires, tie_loop
from strand.synthetic.noise import DEFAULT_FLYING, Noise, sense
from strand.synthetic.objects import Ball, add_objects
from strand.synthetic.random_curves import random_ropes
from strand.synthetic.rendering import render_depth
from strand.synthetic.scenes import SyntheticScene
from strand.synthetic.segmentation import Segmentation

HARNESSES = ("tree", "equal", "four", "tang", "cross", "near", "cycle", "tied", "loop", "laid", "rope", "air")
"""Kinds of harnesses that `harness` draws."""

_RADII = (0.0025, 0.0035)  # metres: range of a wire's radius
_EQUAL = (0.003, 0.0045)  # metres: range of the radius where all edges have the same
_PARTING = (math.radians(22.0), math.radians(34.0))  # radians: angles of branches that part slowly
_WIDE_TURNS = math.radians(130.0)  # radians: most that half an edge turns, so that branches cross
_DEPTH_SD = 0.0005  # metres: default noise of the depths
_MAX_DRAWS = 2000  # plans drawn until one fits
_SPACING = 0.001  # metres between the nodes of the truth
_MAX_WIRES = 2  # at a leaf of a bundle whose wires lie side by side
_WAVE = (0.02, 0.04)  # metres: range of the height of a harness's waves in the air
_MAX_TILT = math.radians(30.0)  # radians, of a harness in the air


@dataclass(frozen=True, eq=False)
class HarnessScene(SyntheticScene):
    """Depth images of a harness, and its graph. `truth` has the line of each edge, from `start` to `stop`.

    Attributes
    ----------
    kind : str
        One of `HARNESSES`.
    nodes : (N, 3) ndarray
        Junctions and ends, world frame, metres.
    edges : tuple of (int, int)
        The nodes where each edge starts and stops.
    wires : tuple of int or None
        Number of wires in each edge; None where all edges have the same radius, as in a moulded harness.
    crossings : (K, 3) ndarray
        Places where strands cross or a strand ends on another, half way between both axes, metres.
    """

    kind: str = ""
    nodes: Array = None  # type: ignore[assignment]
    edges: tuple[tuple[int, int], ...] = ()
    wires: tuple[int | None, ...] = ()
    crossings: Array = None  # type: ignore[assignment]


def harness(
    kind: str = "tree",
    *,
    seed: int = 0,
    views: int = 3,
    camera: Camera | None = None,
    noise: Noise | None = None,
    mask: Segmentation | None = None,
) -> HarnessScene:
    """Draw a harness on a table, seen by a depth camera from several sides.

    A bundle of k wires has the radius of a wire times the root of k. The thickest branch at a junction goes
    straight on. Strands that cross lie on each other; none cuts through another.

    =========  ============================================================================================
    kind       what it shows
    =========  ============================================================================================
    tree       1 to 4 junctions of bundles
    equal      a tree whose edges have one radius
    four       a tree with a junction of four edges
    tang       a tree whose branches leave at 22 to 34 degrees
    cross      a tree with strands that cross away from junctions
    near       a tree and a loose rope that crosses near a junction, or at a small angle
    cycle      two branches that part and meet again
    tied       a tree of wires that lie side by side under ties
    loop       a wire that one tie holds to itself
    laid       a rope that ends on another one, or on a tree
    rope       one or two ropes that may cross: no junction
    air        a tree in the air, without a table
    =========  ============================================================================================

    Parameters
    ----------
    kind : str
        One of `HARNESSES`.
    seed : int
        Seed of the random numbers, not negative.
    views : int
        Number of images.
    camera : Camera, optional
        The image's size and unit, and the depth camera to imitate; by default 640 x 480 pixels, no device.
    noise : Noise, optional
        The errors of the depths, 0.5 mm by default, and of the poses.
    mask : Segmentation, optional
        The errors of the masks. By default a scene has exact masks if its camera imitates a device, and none
        otherwise.

    Returns
    -------
    HarnessScene

    Raises
    ------
    TypeError
        If an argument has the wrong type.
    ValueError
        If there is no such kind, or a number is out of its range.

    Examples
    --------
    >>> from strand.synthetic import Camera, harness
    >>> made = harness("tree", views=1, camera=Camera(size=(64, 48)))
    >>> len(made.edges) == len(made.truth) == len(made.radii)
    True
    """
    kind = check_choice("kind", kind, HARNESSES)
    views = check_integer("views", views, 1, 1000)
    camera = Camera(size=(640, 480)) if camera is None else check_instance("camera", camera, Camera)
    noise = Noise() if noise is None else check_instance("noise", noise, Noise)
    device = None if camera.device is None else find_device(camera.device)
    if device is not None and noise.flying is not None:
        raise ValueError("noise: expected no `flying` with a device, which mixes depths its own way")
    masked = device is not None or mask is not None
    mask = Segmentation() if mask is None else check_instance("mask", mask, Segmentation)
    rngs = np.random.SeedSequence([check_integer("seed", seed), HARNESSES.index(kind)]).spawn(4)
    drawing, stage, sensor, segmenter = (np.random.default_rng(child) for child in rngs)
    pieces, meetings, tubes, balls = _draw(kind, drawing)
    lines = [_resample(piece.line) for piece in pieces]
    places = np.concatenate(lines)
    thick = max(piece.radius for piece in pieces)

    azimuths, elevation = spread_azimuths(views), TABLE_ELEVATION + float(stage.uniform(0.0, 0.4))
    distance = find_least_distance(places, 2.0 * thick, azimuths, elevation, camera.size)
    poses = np.stack([camera_pose(azimuth, distance, elevation) for azimuth in azimuths])
    if device is not None and noise.depth is not None:
        device = device.with_noise(noise.depth, camera.focal_length, distance)
    depth_sd = _DEPTH_SD if noise.depth is None else noise.depth
    side = 0.0 if kind == "air" else max(1.0, 3.0 * distance)
    images, masks, errors = [], [], []
    for pose in poses:
        seen_from = (camera.intrinsics, pose, camera.size, side)
        exact = render_depth([nodes for nodes, _ in tubes], [radius for _, radius in tubes], *seen_from)
        exact = add_objects(exact, [*balls], camera.intrinsics, pose)
        if device is None:
            image = sense(
                exact,
                noise=depth_sd,
                flying=DEFAULT_FLYING if noise.flying is None else noise.flying,
                step=min(piece.radius for piece in pieces),
                depth_scale=camera.depth_scale,
                rng=sensor,
            )
        else:
            image = device.sense(exact, camera.intrinsics, depth_scale=camera.depth_scale, rng=sensor)
        images.append(image)
        if masked:
            empty = render_depth([], [], *seen_from)
            on_rope = (exact > 0) & ((exact < empty) | (empty == 0))
            masks.append(mask.make_mask(on_rope, segmenter))
            errors.append(np.abs(image * camera.depth_scale - exact)[on_rope & (image > 0)])
    if device is not None:
        depth_sd = estimate_deviation(np.concatenate(errors))
    radii = tuple(piece.radius for piece in pieces)
    low, high = places.min(axis=0) - 6.0 * thick, places.max(axis=0) + 6.0 * thick
    if kind != "air" and not masked:
        low[2], high[2] = 0.6 * min(radii), places[:, 2].max() + 3.0 * thick
    nodes = np.zeros((1 + max(max(piece.start, piece.stop) for piece in pieces), 3))
    for piece, line in zip(pieces, lines, strict=True):
        nodes[piece.start], nodes[piece.stop] = line[0], line[-1]
    crossings = [
        0.5 * (pieces[one.upper].line[one.at_upper] + pieces[one.lower].line[one.at_lower])
        for one in meetings
    ]
    return HarnessScene(
        name=f"{kind}{seed:03d}_{views}v",
        depth=np.stack(images),
        depth_scale=camera.depth_scale,
        intrinsics=camera.intrinsics,
        poses=noise.misplace(poses, stage),
        poses_true=poses,
        bounds=(low, high),
        radius=float(np.mean(radii)),
        truth=tuple(lines),
        noise=depth_sd,
        mask=np.stack(masks) if masks else None,
        radii=radii,
        kind=kind,
        nodes=nodes,
        edges=tuple((piece.start, piece.stop) for piece in pieces),
        wires=tuple(piece.wires for piece in pieces),
        crossings=np.reshape(crossings, (-1, 3)),
    )


def _draw(kind: str, rng: np.random.Generator) -> tuple[list[Piece], list[Meeting], list[Tube], list[Ball]]:
    """Return the edges of a harness, its crossings, and its tubes and balls as they are rendered."""
    radius = float(rng.uniform(*(_EQUAL if kind in ("equal", "rope", "laid") else _RADII)))
    if kind == "loop":
        pieces, tubes = tie_loop(rng, radius)
        return [_flatten(piece, radius) for piece in pieces], [], tubes, []
    if kind == "rope":
        return _draw_ropes(rng, radius)
    for _ in range(_MAX_DRAWS):
        fitting = fit_in_square(_grow(kind, rng, radius))
        if fitting is None:
            continue
        meetings = find_meetings(rng, fitting, kind == "laid")
        wanted = {"cross": range(1, 3), "near": range(1, 3), "laid": range(1, 2)}.get(kind, range(1))
        if len(meetings) not in wanted or not keep_apart_in_plan(fitting, meetings):
            continue
        if kind == "tied":
            tubes = lay_wires(rng, fitting, radius)
            slim = [replace(piece, radius=radius * math.sqrt(piece.wires or 1)) for piece in fitting]
            return [_flatten(piece, radius) for piece in slim], [], tubes, []
        laid = lay(fitting, meetings, kind != "air")
        if laid is None:
            continue
        if kind == "air":
            laid = _hang(rng, laid)
        return laid, meetings, *_make_tubes(laid)
    raise RuntimeError(f"no harness of kind {kind} was found")  # pragma: no cover


def _grow(kind: str, rng: np.random.Generator, radius: float) -> list[Piece]:
    """Return the edges of a harness in plan, some of which may cross."""

    def pack(wires: int) -> float:
        return radius * math.sqrt(wires)

    def count(most: int) -> int:
        return int(rng.integers(1, most + 1))

    if kind == "equal":
        return grow_tree(rng, count(4), lambda _: radius, counted=False)
    if kind == "four":
        return grow_tree(rng, count(2), pack, most=2, four=True)
    if kind == "tang":
        return grow_tree(rng, count(3), pack, angles=_PARTING)
    if kind == "cycle":
        return grow_cycle(rng, radius)
    if kind == "tied":
        return grow_tree(rng, count(2), lambda wires: wires * radius, most=_MAX_WIRES)
    if kind == "cross" and rng.random() < 0.5:
        return grow_tree(rng, 1 + count(2), pack, turns=_WIDE_TURNS)
    if kind in ("cross", "near"):
        return add_rope(rng, grow_tree(rng, count(2), pack), radius, near=kind == "near")
    if kind == "laid":
        if rng.random() < 0.5:
            trunk = grow_tree(rng, 0, lambda _: radius, counted=False)
        else:
            trunk = grow_tree(rng, 1, lambda _: radius, counted=False)
        return add_rope(rng, trunk, radius, laid=True)
    return grow_tree(rng, count(4), pack)


def _draw_ropes(
    rng: np.random.Generator, radius: float
) -> tuple[list[Piece], list[Meeting], list[Tube], list[Ball]]:
    """Return ropes that may cross each other or themselves."""
    while True:
        try:
            chains = random_ropes(
                int(rng.integers(0, 4)), int(rng.integers(1, 3)), radius, int(rng.integers(1 << 31))
            )
        except ValueError:
            continue
        pieces = [Piece(2 * k, 2 * k + 1, chain, radius, None) for k, chain in enumerate(chains)]
        meetings = find_meetings(rng, [replace(piece, line=piece.line[:, :2]) for piece in pieces], False)
        return pieces, meetings, [(chain, radius) for chain in chains], []


def _flatten(piece: Piece, height: float) -> Piece:
    return replace(piece, line=np.column_stack([piece.line, np.full(len(piece.line), height)]))


def _hang(rng: np.random.Generator, pieces: list[Piece]) -> list[Piece]:
    """Return a flat harness in the air: bent along waves, and tilted about the origin."""
    turn, phase = rng.uniform(0.0, 2.0 * math.pi, 2)
    height, tilt, about = rng.uniform(*_WAVE), rng.uniform(0.0, _MAX_TILT), rng.uniform(0.0, 2.0 * math.pi)
    along = np.array([math.cos(turn), math.sin(turn)])
    axis = np.array([math.cos(about), math.sin(about), 0.0])

    def move(line: Array) -> Array:
        waves = height * np.sin(2.0 * math.pi * (line[:, :2] @ along) / 0.4 + phase)
        bent = line + np.outer(waves, [0.0, 0.0, 1.0])
        across = np.cross(axis, bent)
        return np.asarray(
            bent * math.cos(tilt)
            + across * math.sin(tilt)
            + np.outer(bent @ axis, axis) * (1.0 - math.cos(tilt))
        )

    return [replace(piece, line=move(piece.line)) for piece in pieces]


def _make_tubes(pieces: list[Piece]) -> tuple[list[Tube], list[Ball]]:
    """Return the tubes of edges, and a ball at each junction, as thick as its trunk."""
    balls: dict[int, Ball] = {}
    ends = [end for piece in pieces for end in (piece.start, piece.stop)]
    for piece in pieces:
        for end, place in ((piece.start, piece.line[0]), (piece.stop, piece.line[-1])):
            if ends.count(end) > 2 and (end not in balls or balls[end].radius < piece.radius):
                x, y, z = (float(value) for value in place)
                balls[end] = Ball((x, y, z), piece.radius)
    return [(_resample(piece.line), piece.radius) for piece in pieces], list(balls.values())


def _resample(line: Array) -> Array:
    """Return a line with evenly spaced nodes, about 1 mm apart."""
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    even = np.linspace(0.0, s[-1], max(math.ceil(s[-1] / _SPACING), 1) + 1)
    return np.stack([np.interp(even, s, line[:, k]) for k in range(3)], axis=1)
