"""The ropes' points of all views in one frame: levelled by the table, and registered with the held view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand._core import NotEnoughDataError
from strand.geometry.plane import Plane
from strand.reconstruction.evidence.depth_errors import MIN_CORRELATION
from strand.reconstruction.finding.table_edge import find_depth
from strand.reconstruction.images.pixel_errors import correlate_neighbors
from strand.reconstruction.images.table_plane import find_table, find_table_beside_ropes
from strand.reconstruction.stages import Observed
from strand.support.checks import Array
from strand.views.pose import moved
from strand.views.view import cropped

_MAX_POINTS = 20_000  # of a cloud in which a table is sought
_FLOOR_HEIGHT = 0.5  # of points of the table at most, least radii
_LOWEST = 0.5  # height of points of ropes over the table at least, least radii
_MIN_POINTS = 10  # beyond the table's edge: fewer are outliers
_BESIDE_BELOW = 3.0  # distance from these of a rope's other points there at most, greatest radii
_BESIDE = 12  # pixels around the ropes in which points of the table are taken
_FEW = 8  # neighbours within the least radius of points of a strand in the air at least
_SPARE_REACH = 2.0  # radii in which spare points have as many neighbours, least radii
_SAME = 1e-6  # distance of places of one point at most, metres
_REGISTERED = 4000  # points of a view that are registered
_REACH = 2.0  # distance of corresponding points at most, greatest radii
_NEIGHBORS = 14  # that tell a normal
_ITERATIONS = 25


@dataclass(frozen=True, eq=False)
class Ground:
    """Points of ropes and of the table.

    Attributes
    ----------
    motions : (V, 4, 4) ndarray
        Correction of each view's pose, in the world frame.
    given, clouds : list of (N, 3) ndarray
        The ropes' points of each view at reported and at corrected poses, metres.
    spare : list of (N, 3) ndarray
        Points of each view at its corrected pose that were dropped as outliers, but may be sparse points of
        ropes, metres.
    viewpoints : (V, 3) ndarray
        The cameras' centres at corrected poses, metres.
    floor : (M, 3) ndarray
        Points of the table near the ropes; none without a table.
    up : (3,) ndarray
        The table's normal, or the way to the held camera.
    table : Plane or None
        In the held view.
    tables : list of (Plane or None)
        That of each view at its reported pose.
    correlated : bool
        Whether errors of neighbouring pixels are alike, so that points make strands too thick.
    """

    motions: Array
    given: list[Array]
    clouds: list[Array]
    spare: list[Array]
    viewpoints: Array
    floor: Array
    up: Array
    table: Plane | None
    tables: list[Plane | None]
    correlated: bool

    def add(self, chosen: Sequence[NDArray[np.bool_]]) -> Ground:
        """Return ground whose ropes have some of the spare points, too."""
        more = [points[own] for points, own in zip(self.spare, chosen, strict=True)]
        clouds = [np.concatenate(pair) for pair in zip(self.clouds, more, strict=True)]
        back = [np.linalg.inv(motion) for motion in self.motions]
        given = [
            np.concatenate([cloud, moved(points, motion)])
            for cloud, points, motion in zip(self.given, more, back, strict=True)
        ]
        return replace(self, given=given, clouds=clouds)

    @property
    def ways(self) -> Array:
        """(V, 3) Unit vectors from the middle of the ropes' points to each camera."""
        ways = self.viewpoints - np.concatenate(self.clouds).mean(axis=0)
        return np.asarray(ways / np.linalg.norm(ways, axis=1, keepdims=True))


def find_ground(observed: Observed, radii: tuple[float, float]) -> Ground:
    """Bring the views' points into one frame; `radii` are the least and the greatest, metres."""
    held = observed.held
    tables = [_find_table(observed, place, radii[0]) for place in range(len(observed.views))]
    table = tables[held]
    clouds = [view.world_points for view in observed.views]
    if table is None and not (observed.radii.free or observed.radii.held):
        # strands along the rays are too sparse for the outlier filter, but sparse views lose more here
        supported = [_drop_lonely(view.world_points, radii[0]) for view in observed.whole]
        clouds = [max(pair, key=len) for pair in zip(clouds, supported, strict=True)]
    viewpoints = np.array([view.viewpoint for view in observed.views])
    middle = clouds[held].mean(axis=0)
    up = table.normal if table is not None else viewpoints[held] - middle
    up = np.asarray(up / np.linalg.norm(up))
    motions = np.tile(np.eye(4), (len(clouds), 1, 1))
    for place, own in enumerate(tables):
        if place != held and own is not None and table is not None:
            motions[place] = _level(own, table, middle)
    if table is not None:
        # errors of the poses had let points of the table into the extraction range
        around = [_collect_points(observed, place) for place in range(len(clouds))]
        depth = find_depth(table.measure_heights(around[held]), radii[1])
        standing = [
            _find_standing(moved(cloud, motion), table, radii, depth)
            for cloud, motion in zip(clouds, motions, strict=True)
        ]
        clouds = [cloud[chosen] for cloud, chosen in zip(clouds, standing, strict=True)]
        if any(not len(cloud) for cloud in clouds):
            raise NotEnoughDataError(
                f"views: no points are {_LOWEST:g} radii over the table, as ropes are; is the radius right?"
            )
    given = clouds
    clouds = [moved(cloud, motion) for cloud, motion in zip(clouds, motions, strict=True)]
    motions = _register(clouds, moved(viewpoints[held][None], motions[held])[0], held, radii[1]) @ motions
    clouds = [moved(cloud, motion) for cloud, motion in zip(given, motions, strict=True)]
    viewpoints = np.array(
        [moved(center[None], motion)[0] for center, motion in zip(viewpoints, motions, strict=True)]
    )
    spare = [np.zeros((0, 3))] * len(clouds)
    if table is not None:
        spare = [
            moved(_find_spare(observed, place, given[place], table, motion, radii[0]), motion)
            for place, motion in enumerate(motions)
        ]
    floor = np.zeros((0, 3))
    if table is not None:
        low, high = (
            np.min([cloud.min(axis=0) for cloud in clouds], axis=0),
            np.max([cloud.max(axis=0) for cloud in clouds], axis=0),
        )
        seen = []
        for place, motion in enumerate(motions):
            points = moved(around[place], motion)
            near = ((points > low - radii[1]) & (points < high + radii[1])).sum(axis=1) >= 2
            points = points[near]
            seen.append(points[np.abs(table.measure_heights(points)) < _FLOOR_HEIGHT * radii[0]])
        floor = np.concatenate(seen)
    images = observed.images if all(view.image is not None for view in observed.whole) else []
    correlated = correlate_neighbors(images) > MIN_CORRELATION
    return Ground(motions, given, clouds, spare, viewpoints, floor, up, table, tables, correlated)


def _drop_lonely(points: Array, radius: float) -> Array:
    """Return the points with a few others within a radius, metres."""
    return points[_core.count_neighbors(points, radius) >= _FEW]


def _find_spare(
    observed: Observed, place: int, given: Array, table: Plane, motion: Array, radius: float
) -> Array:
    """Return points of a view that are no outliers by their height and neighbours, but not among some."""
    if observed.bounds is None:
        return np.zeros((0, 3))
    points = cropped([observed.whole[place]], observed.bounds)[0].world_points
    points = points[table.measure_heights(moved(points, motion)) > radius]
    points = points[_core.find_squared_distances(points, given) > _SAME**2]
    return points[_core.count_neighbors(points, _SPARE_REACH * radius) >= _FEW]


def _find_standing(
    points: Array, table: Plane, radii: tuple[float, float], depth: float
) -> NDArray[np.bool_]:
    """Tell which points (N, 3) are no table's: those over it, and those of ropes beyond its edge."""
    heights = table.measure_heights(points)
    standing, below = heights > _LOWEST * radii[0], heights < -depth
    if np.count_nonzero(below) < _MIN_POINTS:
        return np.asarray(standing)
    # ropes pass the plane of the table on their way down
    beside = _core.find_squared_distances(points, points[below]) < (_BESIDE_BELOW * radii[1]) ** 2
    return np.asarray(standing | beside)


def _find_table(observed: Observed, place: int, radius: float) -> Plane | None:
    """Return the table that a view shows, at its reported pose; None without one."""
    whole = observed.whole[place]
    if whole.image is not None:
        return find_table_beside_ropes(observed.images[place], radius)
    points = whole.world_points
    found = find_table(points[:: max(len(points) // _MAX_POINTS, 1)])
    return found


def _collect_points(observed: Observed, place: int) -> Array:
    """Return the points that a view shows in its ropes' window, also beside them, world frame, metres."""
    if observed.whole[place].image is None:
        return observed.whole[place].world_points
    image = observed.images[place]
    image = image.cropped(image.frame_mask(_BESIDE))
    rows, columns = np.nonzero(image.depth > 0.0)
    return image.lift(rows, columns, image.depth[rows, columns])


def _level(own: Plane, table: Plane, middle: Array) -> Array:
    """Return the motion that turns and lifts a view so that its table is the held view's."""
    axis, cosine = np.cross(own.normal, table.normal), float(own.normal @ table.normal)
    motion = np.eye(4)
    if cosine <= 0.0:
        return motion
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    motion[:3, :3] += cross + cross @ cross / (1.0 + cosine)
    on_own = middle - own.normal * float(own.measure_heights(middle))
    on_table = middle - table.normal * float(table.measure_heights(middle))
    motion[:3, 3] = on_table - motion[:3, :3] @ on_own
    return motion


def _register(clouds: Sequence[Array], viewpoint: Array, held: int, radius: float) -> Array:
    """Return the motion (V, 4, 4) of each cloud onto the held one, by ICP to planes."""
    motions = np.tile(np.eye(4), (len(clouds), 1, 1))
    if len(clouds) == 1:
        return motions
    target = clouds[held]
    normals = _core.estimate_normals(target, k=min(_NEIGHBORS, len(target)), viewpoint=viewpoint)
    for place, cloud in enumerate(clouds):
        if place == held:
            continue
        some = cloud[:: max(len(cloud) // _REGISTERED, 1)]
        try:
            found = _core.icp(
                some, target, _REACH * radius, target_normals=normals, max_iterations=_ITERATIONS
            ).transformation
        except NotEnoughDataError:
            continue
        if np.linalg.norm((moved(cloud, found) - cloud).mean(axis=0)) < _REACH * radius:
            motions[place] = found
    return motions
