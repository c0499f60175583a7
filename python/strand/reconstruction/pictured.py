"""Clouds as images: views of points get the image whose pixels their points are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from strand.reconstruction.images.image_nodes import iterate_squared_distances
from strand.reconstruction.stages import Found, Observed
from strand.ropes.chain import Chain
from strand.support.checks import Array
from strand.support.robust import estimate_deviation
from strand.views.cloud_images import draw_ropes
from strand.views.view import View, seen_from, seen_in

_MAX_POINTS = 1000  # points that are compared with chains
_REACH = 3.0  # radii: points this near a chain's nodes are shown by it
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


def measure_shown_share(observed: Observed, chains: Sequence[Chain]) -> float:
    """Return the share of the points that lie near chains."""
    points = np.vstack([view.world_points for view in observed.views])
    points = points[:: max(len(points) // _MAX_POINTS, 1)]
    nodes = np.vstack([chain.points for chain in chains])
    reach = _REACH * max(chain.radius for chain in chains)
    near = [squares.min(axis=1) < reach**2 for _, squares in iterate_squared_distances(points, nodes)]
    return float(np.concatenate(near).mean())


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
