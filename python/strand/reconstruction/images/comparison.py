"""Hypotheses about how ropes run, fitted to images and compared by what they leave unexplained."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from strand._core import ImageFit, RopeImages
from strand.config import Config
from strand.geometry.polyline import path_length, runs
from strand.reconstruction.evidence.visibility import Visibility, visibility_from
from strand.reconstruction.images.labels import label_changes
from strand.reconstruction.images.pixel_errors import Errors
from strand.reconstruction.images.table_plane import Plane
from strand.reconstruction.stages import Observed
from strand.support.checks import Array

# what a hypothesis costs: mask that nothing covers, tube outside masks, squares of depth's residuals, bending
# and its change, and what its reading of the image costs
_UNCOVERED, _OUTSIDE, _DEPTH, _BEND, _CHANGE, _READING = 3.0, 1.0, 0.4, 5.0, 20.0, 0.1
# and each rope
ROPE = 6.0
# each radius that a known length is missed by, at most a rope; each radius of rope that cameras saw through,
# in stretches of so many nodes
_LENGTH, _MOST, _FREE, _STRETCH = 2.0, 30.0, 2.0, 8
# and each change from one label of a mask to another
_LABEL = 4.0
# and each radian that a rope turns more than a tube can that does not lie in itself
_TIGHT = 10.0
# nodes of fits are so far apart, in radii
_STEP = 0.5
# tube outside of masks from which on ropes may bridge gaps
_BRIDGED = 2.0
# readings of each view, and how much more than the best a reading may cost to be fitted; two always are
READINGS, _MORE = 6, 12.0
# ropes that were found otherwise are not so many times as long as what is read, or they are noise
_LONGER = 4.0
# steps of a fit
_STEPS = 8


@dataclass(frozen=True, eq=False)
class Reading:
    """One way of ropes through one view's mask.

    Attributes
    ----------
    cost : float
        What it takes: bending, mask that it leaves uncovered, ends and gaps.
    view : int
    chains : list of (M, 2) ndarray
        Columns and rows of each rope's nodes, pixels.
    rings : int
        How many of them were rings.
    """

    cost: float
    view: int
    chains: list[Array]
    rings: int = 0


@dataclass(frozen=True, eq=False)
class Explanation:
    """A reading that was fitted to all views.

    Attributes
    ----------
    reading : Reading
    fit : ImageFit
    cost : float
        What it leaves unexplained in image and depth, and what it takes to explain the rest.
    """

    reading: Reading
    fit: ImageFit
    cost: float


def likely_readings(
    images: RopeImages,
    ropes: int | None,
    views: Sequence[int],
    most: int = READINGS,
    more: float = _MORE,
) -> list[Reading]:
    """Return the readings of views that are worth a fit, the best first.

    Parameters
    ----------
    images : RopeImages
    ropes : int or None
        How many there are.
    views : sequence of int
        Which are read.
    most : int
        Readings of each view; twice as many are returned at most.
    more : float
        How much more than the best a reading may cost; two are always returned.

    Returns
    -------
    list of Reading
    """
    found = [Reading(*each) for each in images.readings(ropes, most, list(views))]
    found.sort(key=lambda reading: reading.cost)
    return [
        reading
        for place, reading in enumerate(found[: 2 * most])
        if place < 2 or reading.cost < found[0].cost + more
    ]


def may_be_ropes(chains: Sequence[Array], readings: Sequence[Reading]) -> bool:
    """Tell whether ropes that were found otherwise are worth a fit.

    A fit of all that was found in noise would take many times as long as the others.

    Parameters
    ----------
    chains : sequence of (M, 2) ndarray
        Columns and rows of the ropes' nodes, pixels.
    readings : sequence of Reading

    Returns
    -------
    bool
        Whether there are any, and they are not much longer than what is read.
    """
    read = max((_length(reading.chains) for reading in readings), default=np.inf)
    return bool(chains) and _length(chains) < _LONGER * read


def _length(chains: Sequence[Array]) -> float:
    """Length of polylines together, in their unit."""
    return float(sum(np.linalg.norm(np.diff(nodes, axis=0), axis=1).sum() for nodes in chains))


def fitted(
    images: RopeImages,
    readings: Sequence[Reading],
    table: Plane | None,
    held: int,
    errors: Errors,
    config: Config,
) -> list[tuple[Reading, ImageFit]]:
    """Fit readings to all views; those that show no depth are left out."""
    poses = (config.poses.rotation_sd, config.poses.translation_sd)
    hypotheses = [(reading.view, reading.chains) for reading in readings]
    fits = images.fit(hypotheses, table, held, poses, errors.values, _STEPS, False)
    return [(reading, fit) for reading, fit in zip(readings, fits, strict=True) if fit is not None]


def explained(
    images: RopeImages,
    readings: Sequence[Reading],
    table: Plane | None,
    held: int,
    errors: Errors,
    config: Config,
    observed: Observed,
) -> list[Explanation]:
    """Fit readings to all views and compare them.

    Depth counts less where even the best hypothesis fits it worse than its noise allows: then something
    about it is not understood, and what the image says counts more.

    Returns
    -------
    list of Explanation
        The best first.
    """
    pairs = fitted(images, readings, table, held, errors, config)
    if not pairs:
        return []
    misfits = np.array([fit.misfit for _, fit in pairs])
    uncovered, outside, depth, depths, bend, change = misfits.T
    trust = min(1.0, float((depths / np.maximum(depth, 1e-9)).min()))
    costs = _UNCOVERED * uncovered + _OUTSIDE * outside
    costs += trust * (_DEPTH * depth + _BEND * bend + _CHANGE * change)
    costs += (_READING + 1.0 - trust) * np.array([reading.cost for reading, _ in pairs])
    costs += ROPE * np.array([len(reading.chains) for reading, _ in pairs])
    costs += [contradiction_of(fit, observed) for _, fit in pairs]
    costs += [_TIGHT * _too_sharp(fit, float(observed.radii.values[0])) for _, fit in pairs]
    changes = np.array([_label_changes(reading, observed) for reading, _ in pairs])
    if not changes.min():
        # else labels are of pieces, or wrong
        costs += _LABEL * changes
    if outside[costs.argmin()] > _BRIDGED:
        visibility = visibility_from(observed.whole, [view.pose for view in observed.whole], observed.views)
        costs += [_seen_through(fit, visibility, observed) for _, fit in pairs]
    order = np.argsort(costs, kind="stable")
    return [Explanation(pairs[k][0], pairs[k][1], float(costs[k])) for k in order]


def _too_sharp(fit: ImageFit, radius: float) -> float:
    """Return by how much ropes turn more than with a bend of one radius, radians."""
    excess = 0.0
    for nodes in fit.nodes:
        steps = np.diff(nodes, axis=0)
        lengths = np.linalg.norm(steps, axis=1)
        cosines = (steps[:-1] * steps[1:]).sum(axis=1) / (lengths[:-1] * lengths[1:])
        turns = np.arccos(np.clip(cosines, -1.0, 1.0))
        excess += float(np.maximum(turns - 0.5 * (lengths[:-1] + lengths[1:]) / radius, 0.0).sum())
    return excess


def _label_changes(reading: Reading, observed: Observed) -> int:
    image = observed.whole[reading.view].image
    if image is None or image.labels is None:
        return 0
    return label_changes(image.labels, reading.chains)


def contradiction_of(fit: ImageFit, observed: Observed) -> float:
    """Return what ropes cost that are not as long as they are known to be."""
    prior = observed.prior
    if not prior.lengths:
        return 0.0
    radius = float(observed.radii.values[0])
    lengths = [float(path_length(nodes)[-1]) for nodes in fit.nodes]
    return sum(
        min(_LENGTH * prior.length_excess(length, true, radius), _MOST)
        for length, true in zip(lengths, prior.expected(lengths), strict=True)
    )


def _seen_through(fit: ImageFit, visibility: Visibility, observed: Observed) -> float:
    """Return what stretches of rope cost that cameras saw through."""
    radius = float(observed.radii.values[0])
    cost = 0.0
    for nodes in fit.nodes:
        for start, stop in runs(visibility.free(nodes, radius)):
            if stop - start >= _STRETCH:
                cost += _FREE * _STEP * (stop - start)
    return cost


def refitted(
    images: RopeImages, fit: ImageFit, table: Plane | None, held: int, errors: Errors, config: Config
) -> ImageFit:
    """Fit a hypothesis once more from where its fit ended, with covariances; the same fit if that fails."""
    poses = (config.poses.rotation_sd, config.poses.translation_sd)
    again = images.refit(fit, table, held, poses, errors.values, _STEPS)
    return fit if again is None else again
