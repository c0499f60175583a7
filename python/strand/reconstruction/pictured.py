"""Clouds as images: views of points get the image whose pixels their points are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from strand.reconstruction.images.image_nodes import iterate_squared_distances
from strand.reconstruction.stages import Found, Observed
from strand.support.checks import Array
from strand.support.robust import estimate_deviation
from strand.views.cloud_images import draw_ropes
from strand.views.view import View, seen_from, seen_in

_SAMPLES = 50  # points whose surroundings are looked at
_AROUND = 3.0  # radii of these surroundings
_MIN_ACROSS = 0.1  # radii: standard deviation of points across a rope that show its surface
_MAX_POINTS = 1000  # points that are compared with chains
_REACH = 3.0  # radii: points this near a chain's nodes are shown by it
_ASIDE = 1.5  # radii: answers run apart where nodes of one are this far from the other's
_MIN_REACH = 1.5  # radii: points this near lie on a rope whatever the noise
_ROUNDS = 4  # fits of a plane to ropes
_DEVIATIONS = 2.5  # standard deviations of the heights: farther points are not on the plane
_MIN_POINTS = 30  # points on the plane
_MAX_DEVIATION = 1.5  # radii: ropes that lie flat scatter less about a plane
_MIN_SPREAD = 4.0  # radii: standard deviation of flat ropes across their longest direction


def picture_clouds(observed: Observed) -> tuple[Observed, bool]:
    """Return views of points as views of images, and whether all images have the pixels of a camera.

    The views' frames become those of the cameras, see `turn_back`.
    """
    all_measured = True
    views, whole = list(observed.views), list(observed.whole)
    for k, (number, own, all_seen) in enumerate(zip(observed.numbers, views, whole, strict=True)):
        if all_seen.image is not None:
            continue
        image = observed.pictures.get(number)
        if image is None:
            image, measured = draw_ropes(own, all_seen)
            all_measured &= measured
        views[k], whole[k] = seen_from(own, image), seen_in(all_seen, image)
    support = None if observed.pictures else find_support(observed.views[observed.held], observed.radius)
    return replace(observed, views=views, whole=whole, support=support), all_measured


def measure_shown_share(observed: Observed, found: Found, deviations: float | None = None) -> float:
    """Return the share of the points that an answer shows.

    These lie near chains, or within so many standard deviations of the noise from the side of a rope.
    """
    nodes = np.vstack([chain.points for chain in found.chains])
    radius = max(chain.radius for chain in found.chains)
    reach = _REACH * radius
    if deviations is not None and found.sensor is not None:
        reach = max(radius + deviations * found.sensor.sd, _MIN_REACH * radius)
    return float(_lie_near(_select_points(observed), nodes, reach).mean())


def differ_in_gaps(observed: Observed, found: Found, other: Found) -> bool:
    """Tell whether two answers run apart mostly where there are no points."""
    radius = max(chain.radius for chain in found.chains)
    some, others = (np.vstack([chain.points for chain in one.chains]) for one in (found, other))
    aside = [~_lie_near(some, others, _ASIDE * radius), ~_lie_near(others, some, _ASIDE * radius)]
    nodes = np.vstack([some[aside[0]], others[aside[1]]])
    if not len(nodes):
        return False
    empty = ~_lie_near(nodes, _select_points(observed), _REACH * radius)
    return bool(empty.mean() > 0.5)


def _select_points(observed: Observed) -> Array:
    """Return (N, 3) some of the points of all views, world frame."""
    points = np.vstack([view.world_points for view in observed.views])
    return points[:: max(len(points) // _MAX_POINTS, 1)]


def _lie_near(points: Array, others: Array, reach: float) -> NDArray[np.bool_]:
    """Tell for each point (N, 3) whether one of the others (M, 3) is within reach, metres."""
    near = [squares.min(axis=1) < reach**2 for _, squares in iterate_squared_distances(points, others)]
    return np.concatenate(near)


def show_surface(views: Sequence[View], radius: float) -> bool:
    """Tell whether points spread across ropes of a radius, metres, as points on a surface do."""
    points = np.vstack([view.world_points for view in views])
    spreads = []
    for point in points[:: max(len(points) // _SAMPLES, 1)]:
        around = points[((points - point) ** 2).sum(axis=1) < (_AROUND * radius) ** 2]
        # of the three standard deviations, the second is across the rope
        spreads.append(np.linalg.svd(around - around.mean(axis=0), compute_uv=False)[1] ** 2 / len(around))
    return float(np.median(spreads)) > (_MIN_ACROSS * radius) ** 2


def find_support(view: View, radius: float) -> tuple[Array, float] | None:
    """Return the plane under ropes of a radius, metres, that lie flat: normal to the camera, offset."""
    points = view.world_points
    near = np.ones(len(points), dtype=bool)
    for _ in range(_ROUNDS):
        middle = points[near].mean(axis=0)
        squares, axes = np.linalg.eigh(np.cov((points[near] - middle).T))
        axis = axes[:, 0]
        heights = (points - middle) @ axis
        deviation = estimate_deviation(heights)
        near = np.abs(heights) < _DEVIATIONS * deviation
        if np.count_nonzero(near) < _MIN_POINTS:
            return None
    if deviation > _MAX_DEVIATION * radius or squares[1] < (_MIN_SPREAD * radius) ** 2:
        return None
    rays = view.viewpoint - middle
    normal = axis if axis @ rays > 0 else -axis
    # axes are one radius above the table, and what is seen of a rope lies nearer to the camera
    seen = 1.0 + 0.25 * np.pi * float(normal @ rays) / float(np.linalg.norm(rays))
    return normal, float(normal @ middle + np.median((points - middle) @ normal)) - seen * radius


def turn_back(found: Found, pictured: Observed, observed: Observed) -> Found:
    """Return an answer for pictured views with poses of the frames that the views had before."""
    poses = []
    for pose, view, given in zip(found.poses, pictured.whole, observed.whole, strict=True):
        if view is not given:
            pose = pose.copy()
            pose[:3, :3] = pose[:3, :3] @ (view.pose[:3, :3].T @ given.pose[:3, :3])
        poses.append(pose)
    return replace(found, poses=poses)
