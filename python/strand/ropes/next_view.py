"""Camera poses for the next view: how much each would show of doubtful places of ropes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strand._core import NotEnoughDataError, TubeQueries
from strand.geometry.line import Line
from strand.ropes.doubt import Doubt, Join
from strand.support.checks import Array, check_integer, check_nonnegative, freeze_array, round_to_millimeters
from strand.views.box import Box

Workspace = Box | Callable[[Array], ArrayLike]
"""Where a camera may be: a box, or a function from places (N, 3) to N bools."""

_DIRECTIONS = 144  # tried directions from the ropes to the camera
_MIN_ELEVATION = np.radians(25.0)  # radians: of tried directions above the plane across `up`
_REACHES = (1.0, 1.25, 0.8, 1.6, 0.6)  # tried distances over the usual one, the best first
_MAX_CAMERAS = 16  # old cameras that are compared
_MAX_DOUBTS = 12  # that are looked at, the greatest
_STRETCH = 4.0  # radii of rope to see on each side of a doubtful place
_STRETCH_PLACES = 5  # of it that are looked at
_ROPE_PLACES = 40  # of all ropes that are looked at
_OWN_SURFACE = 2.0  # radii before a place of the axis: a ray that comes so near meets the rope itself
_NEW_TURN = np.radians(40.0)  # radians between directions from which a place shows two sides
_THING = 6.0  # radii: half the length across the rope of a thing that hides it
_PAST_TURN = np.radians(30.0)  # radians between directions past such a thing
_APART = np.radians(25.0)  # radians: least turn between proposed views
_FAR = 2.0  # of the old cameras' distance: from farther away ropes are too thin to show all
_SETTLED = 0.5  # share of a doubt's places that a view must show anew to settle it
_MAX_CONE = 0.7  # tangent of half the angle that a usual camera sees
_ROPE_AMOUNT = 0.05  # of doubt, of all ropes alike
_ROOM = 1.01  # for rounding, and for segments between nodes
_MIN_LEVEL = 1e-4  # sine of an angle to `up`, from which a direction has a side
_KEPT = (
    *("mask", "prior", "pose", "radius", "range", "view", "depth", "intrinsics", "viewpoint", "beneath"),
    "deadline",
)
"""Kinds of doubt about the input, which another view does not settle."""
_HIDDEN = ("hidden end", "gap")
"""Kinds of doubt about places that something other than a rope may hide."""


@dataclass(frozen=True, eq=False)
class NextView:
    """A camera pose, and the doubts that a view from there would settle.

    Attributes
    ----------
    pose : (4, 4) ndarray
        Camera-to-world pose, metres: x right, y down, z forward.
    look_at : (3,) ndarray
        Middle of the ropes, on the camera's z axis, world frame, metres.
    settles : tuple of Doubt
        Doubts whose places it would mostly show, from new directions; the greatest first.
    gain : float
        Share of all doubts, weighed by their amounts, that it would settle, from 0 to 1. All ropes count
        like a small doubt, so it is not 0 where there are no doubts.
    """

    pose: Array
    look_at: Array
    settles: tuple[Doubt, ...]
    gain: float

    @property
    def position(self) -> Array:
        """(3,) Place of the camera, world frame, metres."""
        return self.pose[:3, 3]

    @property
    def up(self) -> Array:
        """(3,) Unit vector up in the image, world frame."""
        return -self.pose[:3, 1]

    def __repr__(self) -> str:
        return f"NextView({self})"

    def __str__(self) -> str:
        place, middle = round_to_millimeters(self.position), round_to_millimeters(self.look_at)
        doubts = "doubt" if len(self.settles) == 1 else "doubts"
        settled = f"settles {len(self.settles)} {doubts}, gain {self.gain:.2f}"
        return f"camera at {place}, looks at {middle}, {settled}"


@dataclass(frozen=True, eq=False)
class _Targets:
    """Places to see.

    Attributes
    ----------
    places, tangents : (T, 3) ndarray
        Places of ropes, metres, and unit tangents there.
    hidden : (T,) ndarray of bool
        Whether something that is no rope hides the place from the old cameras.
    weights : (D, T) ndarray
        How much each place counts for each doubt, and in the last row for the ropes. Rows add up to 1.
    amounts : (D,) ndarray
        Weights of the rows.
    doubts : tuple of Doubt
        Those of the first rows.
    """

    places: Array
    tangents: Array
    hidden: NDArray[np.bool_]
    weights: Array
    amounts: Array
    doubts: tuple[Doubt, ...]


@dataclass(frozen=True, eq=False)
class _Stand:
    """Where cameras stand around the ropes.

    Attributes
    ----------
    middle, up : (3,) ndarray
        Middle of the ropes, metres, and the unit vector to the open side; world frame.
    cameras : (V, 3) ndarray
        Places of old cameras, metres.
    image_axes : (2, 3) ndarray
        Up and right in the image of one of them.
    distance : float
        From the middle to the median camera, metres.
    cone : float
        Tangent of the angle about the middle within which the cameras saw the ropes.
    """

    middle: Array
    up: Array
    cameras: Array
    image_axes: Array
    distance: float
    cone: float


def propose_views(
    lines: Sequence[Line],
    queries: TubeQueries,
    poses: Array,
    up: Array,
    doubts: Sequence[Doubt],
    joins: Sequence[Join],
    workspace: Workspace | None,
    min_distance: float,
    count: int,
) -> tuple[NextView, ...]:
    """Propose the poses of the next view, the best first, see `Model.next_view`."""
    least = check_nonnegative("min_distance", min_distance)
    count = check_integer("count", count, 1)
    if workspace is not None and not (isinstance(workspace, Box) or callable(workspace)):
        raise TypeError(
            f"workspace: expected a strand.Box or a function of places, got {type(workspace).__name__}"
        )
    nodes = np.concatenate([line.points for line in lines])
    radius = float(np.median([line.radius for line in lines]))
    stand = _find_stand(queries, _sample_ropes(lines), nodes, poses, up)
    targets = _choose_targets(lines, nodes, radius, doubts, joins)
    positions = _place_cameras(queries, stand, nodes, radius, workspace, least)
    if not len(positions):
        return ()
    shown = _show_anew(queries, stand, positions, targets, radius)
    shares = shown @ targets.weights.T
    gains = shares @ (targets.amounts / targets.amounts.sum())
    settled = shares[:, : len(targets.doubts)] >= _SETTLED
    return tuple(
        NextView(
            freeze_array(_point_camera(stand, positions[k])),
            freeze_array(stand.middle),
            tuple(doubt for doubt, is_settled in zip(targets.doubts, settled[k], strict=True) if is_settled),
            float(gains[k]),
        )
        for k in _choose_apart(positions - stand.middle, gains, count)
    )


def _sample_ropes(lines: Sequence[Line]) -> Array:
    """Return (N, 3) places of all ropes, evenly along them."""
    lengths = np.array([line.length for line in lines])
    counts = np.maximum(np.rint(_ROPE_PLACES * lengths / lengths.sum()), 2).astype(int)
    ways = ((np.arange(n) + 0.5) / n * line.length for line, n in zip(lines, counts, strict=True))
    return np.concatenate([line.at(way) for line, way in zip(lines, ways, strict=True)])


def _find_stand(queries: TubeQueries, ropes: Array, nodes: Array, poses: Array, up: Array) -> _Stand:
    """Find from how far the cameras looked at the ropes, and how wide they saw them."""
    middle = ropes.mean(axis=0)
    cameras = poses[:, :3, 3]
    offsets = cameras - middle
    distances = np.linalg.norm(offsets, axis=1)
    # skip cameras in the ropes: they have no direction
    reach = float(np.linalg.norm(nodes - middle, axis=1).max())
    kept = np.flatnonzero((queries.signed_distances(cameras) > 0.0) & (distances > _MIN_LEVEL * reach))
    if not len(kept):
        raise NotEnoughDataError("poses: expected some with cameras away from the ropes")
    kept = kept[np.linspace(0, len(kept) - 1, min(len(kept), _MAX_CAMERAS)).round().astype(int)]
    towards = offsets[kept] / distances[kept, None]
    mean = towards.mean(axis=0)
    # cameras beneath the ropes show which side is open
    is_beneath = up @ mean < 0.0 and np.linalg.norm(mean) > _MIN_LEVEL
    in_front = distances[kept] - (nodes - middle) @ towards.T
    aside = np.linalg.norm(np.cross((nodes - middle)[:, None], towards), axis=2)
    seen = np.where(in_front > 0.0, aside / np.maximum(in_front, 1e-300), np.inf)
    return _Stand(
        middle=middle,
        up=mean / np.linalg.norm(mean) if is_beneath else up,
        cameras=cameras[kept],
        image_axes=np.stack([-poses[kept[0], :3, 1], poses[kept[0], :3, 0]]),
        distance=float(np.median(distances[kept])),
        cone=min(float(seen.max()), _MAX_CONE),
    )


def _choose_targets(
    lines: Sequence[Line], nodes: Array, radius: float, doubts: Sequence[Doubt], joins: Sequence[Join]
) -> _Targets:
    """Choose what to see: a stretch around each doubtful place, and all ropes for doubts without one."""
    tangents = np.concatenate([line.tangents for line in lines])
    bare = np.concatenate([_find_bare_nodes(line) for line in lines])
    open_doubts = [doubt for doubt in doubts if doubt.kind not in _KEPT and doubt.amount > 0][:_MAX_DOUBTS]
    doubted = [(doubt.place, doubt.amount, doubt.kind in _HIDDEN) for doubt in open_doubts]
    if not any(place is not None for place, _, _ in doubted):
        doubted += [(join.place, _ROPE_AMOUNT, False) for join in joins[:_MAX_DOUBTS]]
    doubted.append((None, _ROPE_AMOUNT, False))
    ropes = np.linspace(0, len(nodes) - 1, min(len(nodes), _ROPE_PLACES)).round().astype(int)
    stretches = [ropes if place is None else _find_stretch(nodes, place, radius) for place, _, _ in doubted]
    picked = np.concatenate(stretches)
    places, hidden = nodes[picked], bare[picked]
    weights = np.zeros((len(doubted), len(picked)))
    stop = 0
    for row, stretch, (place, _, is_hidden) in zip(weights, stretches, doubted, strict=True):
        start, stop = stop, stop + len(stretch)
        row[start:stop] = 1.0 / len(stretch)
        hidden[start:stop] |= is_hidden
        if place is not None:
            places[start] = place
    amounts = np.array([amount for _, amount, _ in doubted])
    return _Targets(places, tangents[picked], hidden, weights, amounts, tuple(open_doubts))


def _find_bare_nodes(line: Line) -> NDArray[np.bool_]:
    return np.zeros(len(line.points), bool) if line.points_seen is None else line.points_seen == 0


def _find_stretch(nodes: Array, place: Array, radius: float) -> NDArray[np.intp]:
    """Return the number of the node nearest to a place, and those of some nodes around it."""
    square = ((nodes - place) ** 2).sum(axis=1)
    near = np.flatnonzero(square < (_STRETCH * radius) ** 2)
    picked = near[np.linspace(0, len(near) - 1, min(len(near), _STRETCH_PLACES)).round().astype(int)]
    return np.concatenate([[square.argmin()], picked])


def _place_cameras(
    queries: TubeQueries,
    stand: _Stand,
    nodes: Array,
    radius: float,
    workspace: Workspace | None,
    least: float,
) -> Array:
    """Return (K, 3) places to try: in the workspace, far enough, and where the ropes fit in the image."""
    directions = _spread_directions(stand)
    offsets = nodes - stand.middle
    ahead = offsets @ directions.T
    square = np.maximum((offsets**2).sum(axis=1)[:, None] - ahead**2, 0.0)
    usual = np.maximum((ahead + np.sqrt(square) / stand.cone).max(axis=0), stand.distance)
    # beyond the last place at which a node is too near
    room = (_ROOM * (least + radius)) ** 2 - square
    free = np.where(room > 0.0, ahead + np.sqrt(np.maximum(room, 0.0)), 0.0).max(axis=0)
    reaches = np.array(_REACHES if callable(workspace) else (1.0,))
    distances = np.maximum(reaches[:, None] * usual, free)
    tried = stand.middle + distances[..., None] * directions
    if isinstance(workspace, Box):
        tried = workspace.move_inside(tried)
    flat = tried.reshape(-1, 3)
    allowed = ((flat - stand.middle) @ stand.up > 0.0) & (queries.signed_distances(flat) >= least)
    if callable(workspace):
        allowed &= _ask_workspace(workspace, flat)
    allowed = allowed.reshape(tried.shape[:2])
    first, kept = allowed.argmax(axis=0), np.flatnonzero(allowed.any(axis=0))
    return np.asarray(tried[first[kept], kept])


def _ask_workspace(workspace: Callable[[Array], ArrayLike], places: Array) -> NDArray[np.bool_]:
    answer = np.asarray(workspace(places.copy()))
    if answer.dtype != np.bool_ or answer.shape != (len(places),):
        raise ValueError(
            f"workspace: expected the function to return {len(places)} bools, "
            f"got dtype {answer.dtype} and shape {answer.shape}"
        )
    return answer


def _spread_directions(stand: _Stand) -> Array:
    """Return (K, 3) unit vectors of a spiral, evenly over the sky above the ropes."""
    k = np.arange(_DIRECTIONS) + 0.5
    height = 1.0 - k / _DIRECTIONS * (1.0 - np.sin(_MIN_ELEVATION))
    turn = np.pi * (1.0 + 5.0**0.5) * k
    level = np.sqrt(1.0 - height**2)
    side = _find_level(stand, stand.cameras[0] - stand.middle)
    other = np.cross(stand.up, side)
    return np.asarray(
        (level * np.cos(turn))[:, None] * side
        + (level * np.sin(turn))[:, None] * other
        + height[:, None] * stand.up
    )


def _find_level(stand: _Stand, direction: Array) -> Array:
    """Return the unit vector across `up` nearest to a direction, or to an image axis if it is along `up`."""
    for way in (direction, *stand.image_axes):
        level = way - (way @ stand.up) * stand.up
        length = float(np.linalg.norm(level))
        if length > _MIN_LEVEL * float(np.linalg.norm(way)):
            break
    return np.asarray(level / length)


def _show_anew(
    queries: TubeQueries, stand: _Stand, positions: Array, targets: _Targets, radius: float
) -> Array:
    """Return (K, T) how far each camera shows each place from a direction that is new, from 0 to 1."""
    sees, towards = _look(queries, positions, targets.places, radius)
    seen, seen_from = _look(queries, stand.cameras, targets.places, radius)
    cosine = np.einsum("ktc,vtc->vkt", towards, seen_from)
    turn = (1.0 - cosine) / (1.0 - np.cos(_NEW_TURN))
    ways = _find_ways_past(targets, seen_from, radius)
    past = np.abs(np.einsum("ktc,vc->vkt", towards, ways)) / np.sin(_PAST_TURN)
    new = np.where(targets.hidden, past, turn)
    # an old camera that other strands hid the place from is no reason to stay away
    new = np.where(seen[:, None], new, 1.0).min(axis=0)
    axes = positions - stand.middle
    distances = np.linalg.norm(axes, axis=1, keepdims=True)
    axes /= distances
    near = np.minimum(_FAR * stand.distance / distances, 1.0)
    ahead = np.einsum("kc,ktc->kt", axes, towards)
    fits = ahead * np.sqrt(1.0 + (_ROOM * stand.cone) ** 2) >= 1.0
    # a rope shows more of itself from its side
    across = np.linalg.norm(np.cross(towards, targets.tangents), axis=2)
    return np.where(sees & fits, near * across * np.clip(new, 0.0, 1.0), 0.0)


def _find_ways_past(targets: _Targets, seen_from: Array, radius: float) -> Array:
    """Return (V, 3) for each old camera the unit vector along which another one sees hidden places.

    The thing that hid them is long where it hid several, and across the rope where it hid one.
    """
    hidden = targets.hidden
    if not hidden.any():
        return np.zeros((len(seen_from), 3))
    sight = seen_from[:, hidden].mean(axis=1)
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    flat = np.eye(3) - sight[:, :, None] * sight[:, None]
    offsets = (targets.places[hidden] - targets.places[hidden].mean(axis=0)) @ flat
    tangents = targets.tangents[hidden]
    along = np.einsum("tc,td->cd", tangents, tangents) / len(tangents)
    spread = np.einsum("vtc,vtd->vcd", offsets, offsets) / len(tangents)
    spread += (_THING * radius) ** 2 * (flat - flat @ along @ flat)
    longest = np.linalg.eigh(spread)[1][:, :, -1]
    return np.asarray(np.cross(sight, longest))


def _look(
    queries: TubeQueries, cameras: Array, places: Array, radius: float
) -> tuple[NDArray[np.bool_], Array]:
    """Return (K, T) whether no rope blocks the sight of each place, and (K, T, 3) directions to cameras."""
    offsets = cameras[:, None] - places
    distances = np.linalg.norm(offsets, axis=2)
    towards = offsets / np.maximum(distances, 1e-300)[..., None]
    origins = np.broadcast_to(cameras[:, None], offsets.shape).reshape(-1, 3)
    met = queries.ray_hits(origins, -towards.reshape(-1, 3))[0].reshape(distances.shape)
    return met > distances - _OWN_SURFACE * radius, towards


def _point_camera(stand: _Stand, position: Array) -> Array:
    """Return the (4, 4) pose of an upright camera at a place that looks at the middle of the ropes."""
    ahead = stand.middle - position
    ahead /= np.linalg.norm(ahead)
    is_above = np.linalg.norm(np.cross(ahead, stand.up)) < _MIN_LEVEL
    upright = _find_level(stand, stand.image_axes[0]) if is_above else stand.up
    right = np.cross(ahead, upright)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(ahead, right), ahead], axis=1)
    pose[:3, 3] = position
    return pose


def _choose_apart(offsets: Array, gains: Array, count: int) -> list[int]:
    """Return the numbers of the best cameras, the best first, each in a direction of its own.

    Gains are rounded, so that the order of equal ones does not depend on how the scene is turned.
    """
    towards = offsets / np.linalg.norm(offsets, axis=1, keepdims=True)
    chosen: list[int] = []
    for k in np.argsort(np.round(-gains, 9), kind="stable"):
        if len(chosen) < count and (towards[chosen] @ towards[k] < np.cos(_APART)).all():
            chosen.append(int(k))
    return chosen
