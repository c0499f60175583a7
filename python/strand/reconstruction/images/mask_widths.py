"""Widths of masks and heights of ropes that contradict the radius that the caller gave."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import strand._core as _core
from strand.geometry.lengths import measure_lengths
from strand.geometry.plane import Plane
from strand.reconstruction.images.table_plane import recall_table
from strand.reconstruction.stages import Found, Observed
from strand.ropes.chain import Chain
from strand.ropes.doubt import Doubt
from strand.views.depth_image import DepthImage

_NARROW = 0.85  # of the width that the radius says: narrower masks contradict it
_MIN_NARROWER = 1.45  # pixels on each side: masks that are eroded by less are usual
_WIDE = 1.3  # of that width: wider masks contradict it, if the ropes' height does
_LOW = 0.8  # of the height that the radius says: higher ropes confirm it against narrow masks
_HIGH = 1.3  # of that height: lower ropes confirm it against wide masks
_DOUBT = 0.6  # amount of doubt of a radius that masks contradict
_LEAST = 0.3  # share of it at these limits
_FULL = 0.4  # by which the logarithm of the width may exceed a limit until the doubt is whole


def doubt_given_radius(observed: Observed, found: Found) -> list[Doubt]:
    """Doubt a radius that the caller gave if the masks of the ropes found show another one.

    Depth may confirm the radius: ropes on a table are as high as they are wide.
    """
    radii = observed.radii
    if radii.free or radii.held or len(radii.values) > 1 or not any(observed.masked):
        return []
    images = [
        image.placed(pose)
        for image, pose, masked in zip(observed.images, found.poses, observed.masked, strict=True)
        if masked and image.mask.any()
    ]
    if not images:
        return []
    radius = observed.radius
    width = _core.find_median([measure_width(image, found.chains, radius) for image in images])
    if not (width < _NARROW or width > _WIDE):
        return []
    pixels = float(abs(1.0 - width) * radius * images[0].camera.focal[0] / images[0].distance)
    if width < _NARROW and pixels < _MIN_NARROWER:
        return []
    table = recall_table(images[0], radius, found.sought)
    height = None if table is None else measure_height(images[0], found.chains, table, radius)
    if width < _NARROW:
        if height is not None and _LOW < height < _HIGH:
            return []
        share, other, question = np.log(_NARROW / width), "narrower", "is it a diameter"
    else:
        if height is None or height < _HIGH:
            return []
        share, other, question = np.log(width / _WIDE), "wider", "is it right"
    reason = (
        f"masks are {pixels:.1f} pixels {other} on each side than the given radius of {1e3 * radius:.1f} mm "
        f"says, as of ropes of {1e3 * width * radius:.1f} mm; {question}, and is it in metres?"
    )
    amount = _DOUBT * min(_LEAST + float(share) / _FULL, 1.0)
    return [Doubt("radius", amount, "of the ropes found", reason)]


def measure_width(image: DepthImage, chains: Sequence[Chain], radius: float) -> float:
    """Return the width of an image's mask along ropes over that of ropes of a radius, metres."""
    mask = image.mask
    shown = 0.0
    for chain in chains:
        nodes = np.vstack([chain.points, chain.points[:1]]) if chain.closed else chain.points
        places = image.project(nodes)
        middles = 0.5 * (nodes[1:] + nodes[:-1])
        rows, columns, inside = image.find_pixels(middles)
        inside[inside] = mask[rows[inside], columns[inside]]
        z = (middles - image.pose[:3, 3]) @ image.pose[:3, 2]
        steps = measure_lengths(np.diff(places, axis=0))
        shown += float(np.sum((2.0 * radius * image.camera.focal[0] / z * steps)[inside]))
    return np.count_nonzero(mask) / shown if shown > 0.0 else 1.0


def measure_height(image: DepthImage, chains: Sequence[Chain], table: Plane, radius: float) -> float | None:
    """Return the height of ropes above their table over that of ropes of a radius, metres; None if unseen."""
    nodes = np.vstack([chain.points for chain in chains])
    rows, columns, inside = image.find_pixels(nodes)
    rows, columns, nodes = rows[inside], columns[inside], nodes[inside]
    z = image.depth[rows, columns]
    seen = (z > 0) & image.mask[rows, columns]
    if not seen.any():
        return None
    places = image.lift(rows[seen], columns[seen], z[seen])
    rays = image.pose[:3, 3] - places
    facing = rays @ table.normal / measure_lengths(rays)
    return _core.find_median(table.measure_heights(places) / (radius * (1.0 + facing)))
