"""Clouds as images: views of points get the image whose pixels their points are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from strand.reconstruction.images.image_nodes import iterate_squared_distances
from strand.reconstruction.stages import Found, Observed
from strand.ropes.chain import Chain
from strand.views.cloud_images import draw_ropes
from strand.views.view import seen_from, seen_in

_MAX_POINTS = 1000  # points that are compared with chains
_REACH = 3.0  # radii: points this near a chain's nodes are shown by it


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
    return replace(observed, views=views, whole=whole), all_measured


def measure_shown_share(observed: Observed, chains: Sequence[Chain]) -> float:
    """Return the share of the points that lie near chains."""
    points = np.vstack([view.world_points for view in observed.views])
    points = points[:: max(len(points) // _MAX_POINTS, 1)]
    nodes = np.vstack([chain.points for chain in chains])
    reach = _REACH * max(chain.radius for chain in chains)
    near = [squares.min(axis=1) < reach**2 for _, squares in iterate_squared_distances(points, nodes)]
    return float(np.concatenate(near).mean())


def turn_back(found: Found, pictured: Observed, observed: Observed) -> Found:
    """Return an answer for pictured views with poses of the frames that the views had before."""
    poses = []
    for pose, view, given in zip(found.poses, pictured.whole, observed.whole, strict=True):
        if view is not given:
            pose = pose.copy()
            pose[:3, :3] = pose[:3, :3] @ (view.pose[:3, :3].T @ given.pose[:3, :3])
        poses.append(pose)
    return replace(found, poses=poses)
