"""Hypotheses about the courses of ropes, fitted to images and compared by what they leave unexplained."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from strand._core import ImageFit, RopeImages
from strand.config import Config
from strand.geometry.lengths import measure_lengths, multiply_rows
from strand.geometry.plane import Plane
from strand.geometry.polyline import find_runs, path_length
from strand.reconstruction.courses import Course, are_same_courses
from strand.reconstruction.evidence.prior import LENGTH_COST, MAX_LENGTH_COST
from strand.reconstruction.evidence.visibility import Visibility, sort_rays
from strand.reconstruction.images.image_nodes import correct_poses
from strand.reconstruction.images.labels import count_label_changes
from strand.reconstruction.images.pixel_errors import Errors
from strand.reconstruction.stages import Observed
from strand.support.checks import Array
from strand.views.depth_image import DepthImage

# the cost of a hypothesis
_UNCOVERED_COST = 1.5  # per squared radius of mask that no rope covers
_OUTSIDE_COST = 1.0  # per squared radius of the tube's middle outside masks
_SPILLED_COST = 2.0  # per squared radius of the tube's sides that spill over the edge of masks
_DEPTH_COST = 0.4  # per squared residual of depth
_BEND_COST = 5.0  # per integral of squared curvature, 1 / radii
_BEND_CHANGE_COST = 20.0  # per integral of squared change of curvature, 1 / radii³
_READING_COST = 0.5  # per cost of the reading of the image
ROPE_COST = 6.0  # per rope
_FREE_COST = 2.0  # per radius of rope in free space
_MIN_FREE_NODES = 8  # nodes: shorter stretches in free space cost nothing
_LABEL_COST = 4.0  # per change from one label of a mask to another
_SHARP_COST = 10.0  # per radian of bend tighter than the rope's radius

NODE_SPACING = 0.5  # radii between the nodes of fits
_MAX_OUTSIDE = 2.0  # squared radii of tube outside masks: with more, ropes may bridge gaps
# an explanation leaves nothing open
_CLEAR_UNCOVERED = 0.1  # squared radii of mask that no rope covers in a view: less
_CLEAR_OUTSIDE = 1.5  # squared radii of the tube outside the mask in a view: less
_CLEAR_BEND_CHANGE = 0.5  # integral of its squared change of curvature, 1 / radii³: less
_CLEAR_LEAD = 4.0  # cost of the next one above the best: at least

MAX_READINGS = 6  # readings of each view
_MAX_MORE = 5.0  # cost above the best reading's: those that cost more are not fitted
_MIN_READINGS = 2  # readings that are fitted whatever they cost
_LOST = 7.0  # cost above the best explanation's: such a course has lost, seen from any view
_SAME = 1.5  # image radii: a reading that is nearer to a fit's course is the same course
_MAX_COMPARED = 24  # views by which readings are compared; all fit the best one
_MAX_FITTED = 10_000.0  # radii of rope in the readings that are fitted, for each view up to two
_MAX_LONGER = 4.0  # times the longest reading's length: ropes found otherwise that are longer are noise
_MAX_LENGTH = 5e4  # pixels: longer ropes, and those that are farther away, are in no image
_TINY = float(np.finfo(float).tiny)  # least positive float: keeps ratios finite
_STEPS = 4  # steps of fits that are compared: more hardly change which is best
LAST_STEPS = 4  # steps of the best one's last fit
NOISY_STEPS = 8  # steps of each fit where depths scatter: ends move longer in wide noise


@dataclass(frozen=True, eq=False)
class Reading:
    """One way of ropes through one view's mask.

    Attributes
    ----------
    cost : float
        Of bends, mask that no rope covers, ends and gaps.
    view : int
    chains : list of (M, 2) ndarray
        Columns and rows of each rope's nodes, pixels.
    rings : int
        How many of the ropes were rings.
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
        Of the fit, its reading, and what they leave unexplained in images and depth.
    reading_cost : float
        The part of it that the reading has, with its changes of labels.
    """

    reading: Reading
    fit: ImageFit
    cost: float
    reading_cost: float = 0.0


def find_likely_readings(
    images: RopeImages,
    ropes: int | None,
    views: Sequence[int],
    most: int = MAX_READINGS,
    more: float = _MAX_MORE,
    known: Sequence[Reading] = (),
) -> list[Reading]:
    """Return the readings of views that have ropes and are worth a fit, the best first.

    Parameters
    ----------
    images : RopeImages
    ropes : int or None
        The number of ropes, if it is known.
    views : sequence of int
        The views to read.
    most : int
        Readings of each view. At most twice as many are returned.
    more : float
        Cost above the best reading's: readings that cost more are dropped, but for the best two. Where ropes
        are very long, fewer are returned.
    known : sequence of Reading
        Likely readings of other views, which compete with those of `views`.
    """
    found = [*known, *(Reading(*each) for each in images.find_readings(ropes, most, list(views)))]
    found.sort(key=lambda reading: reading.cost)
    kept: list[Reading] = []
    left = _MAX_FITTED * min(len({reading.view for reading in found}), 2)
    for place, reading in enumerate(found[: 2 * most]):
        left -= _sum_lengths(reading.chains) / images.radii[reading.view]
        likely = place < _MIN_READINGS or reading.cost < found[0].cost + more
        if reading.chains and likely and (left > 0.0 or not kept):
            kept.append(reading)
    return kept


def are_worth_a_fit(chains: Sequence[Array], readings: Sequence[Reading]) -> bool:
    """Tell whether ropes that were found otherwise, (M, 2) pixels each, are hardly longer than the readings.

    Ropes that were found in noise are much longer, and their fits take many times as long.
    """
    read = max((_sum_lengths(reading.chains) for reading in readings), default=np.inf)
    return bool(chains) and _sum_lengths(chains) < _MAX_LONGER * read


def fit_into_images(chains: Sequence[Array]) -> bool:
    """Tell whether ropes, columns and rows of nodes, run where images are, not beside or behind a camera."""
    return _sum_lengths(chains) < _MAX_LENGTH and all(np.abs(nodes).max() < _MAX_LENGTH for nodes in chains)


def _sum_lengths(chains: Sequence[Array]) -> float:
    """Return the length of polylines together, in their unit."""
    steps = np.concatenate([np.empty((0, 2)), *(np.diff(nodes, axis=0) for nodes in chains)])
    return float(measure_lengths(steps).sum())


def choose_compared(count: int, held: int) -> list[int]:
    """Return the views that compare readings: all, or some of many with the first, last and held one."""
    if count <= _MAX_COMPARED:
        return list(range(count))
    return sorted({held, *np.linspace(0, count - 1, _MAX_COMPARED).round().astype(int).tolist()})


def fit_readings(
    images: RopeImages,
    readings: Sequence[Reading],
    table: Plane | None,
    held: int,
    errors: Errors,
    config: Config,
    known: Sequence[Explanation] = (),
    steps: int = _STEPS,
) -> list[tuple[Reading, ImageFit]]:
    """Fit readings to all views, but for those with known fits; drop those whose ropes have no depth."""
    poses = (config.poses.rotation_sd, config.poses.translation_sd)
    fits: dict[Reading, ImageFit | None] = {one.reading: one.fit for one in known}
    new = [reading for reading in readings if reading not in fits]
    hypotheses = [(reading.view, reading.chains) for reading in new]
    among = choose_compared(len(images.radii), held)
    fitted = images.fit(hypotheses, table, held, poses, errors.values, steps, False, among)
    fits.update(zip(new, fitted, strict=True))
    return [(reading, fit) for reading in readings if (fit := fits[reading]) is not None]


def fit_and_rank(
    images: RopeImages,
    readings: Sequence[Reading],
    table: Plane | None,
    held: int,
    errors: Errors,
    config: Config,
    observed: Observed,
    taken: Sequence[DepthImage],
    known: Sequence[Explanation] = (),
) -> list[Explanation]:
    """Fit readings to all views; return the explanations, the best first.

    `taken` are the images in whose pixels readings are. Explanations in `known` keep their fits. Readings of
    one view are fitted first. Other views mostly have the same readings, and those that lost are not fitted
    again.
    """

    def rank(some: Sequence[Reading], fitted: Sequence[Explanation]) -> list[Explanation]:
        pairs = fit_readings(images, some, table, held, errors, config, fitted)
        return _rank(pairs, observed, taken)

    fitted = {one.reading for one in known}
    first = [reading for reading in readings if reading.view == readings[0].view or reading in fitted]
    found = rank(first, known)
    others = [one for one in readings if one not in first and not _has_lost(one, found, images, taken)]
    return rank([*(one.reading for one in found), *others], found) if others else found


def leaves_nothing_open(found: Sequence[Explanation], observed: Observed) -> bool:
    """Tell whether the best explanation leaves nothing open in a compared view, and is well ahead of others.

    Then readings of more views would hardly be better. Strands that run side by side may be exchanged without
    a trace in the masks, but then their curvature changes much.
    """
    if not found or (len(found) > 1 and found[1].cost - found[0].cost < _CLEAR_LEAD):
        return False
    fit, ropes = found[0].fit, observed.prior.ropes
    if ropes not in (None, len(fit.nodes)) or penalize_lengths(fit, observed) > 0.0:
        return False
    uncovered, outside, spilled = fit.areas.T
    is_clear = uncovered.max() < _CLEAR_UNCOVERED and (outside + spilled).max() < _CLEAR_OUTSIDE
    return bool(is_clear and fit.misfit[-1] < _CLEAR_BEND_CHANGE)


def _has_lost(
    reading: Reading, found: Sequence[Explanation], images: RopeImages, taken: Sequence[DepthImage]
) -> bool:
    """Tell whether a reading's ropes run as those of an explanation and cost much more than the best."""
    image = taken[reading.view]
    course = _list_courses(reading.chains)
    for one in found:
        # bends and labels that another view shows are no cost of this one
        likely = one.cost - one.reading_cost + _READING_COST * reading.cost
        if likely > found[0].cost + _LOST:
            (pose,) = correct_poses([image.pose], one.fit.corrections[reading.view][None])
            seen = _list_courses([replace(image, pose=pose).project(nodes) for nodes in one.fit.nodes])
            if are_same_courses(course, seen, images.radii[reading.view], _SAME):
                return True
    return False


def _list_courses(chains: Sequence[Array]) -> list[Course]:
    """Return the courses of chains, (M, 2) columns and rows each, pixels."""
    return [Course(np.column_stack([nodes, np.zeros(len(nodes))]), False) for nodes in chains]


def _rank(
    pairs: Sequence[tuple[Reading, ImageFit]], observed: Observed, taken: Sequence[DepthImage]
) -> list[Explanation]:
    """Return readings with their fits by cost, the best first.

    Depth counts less where even the best hypothesis fits it worse than its noise allows. Then images count
    more.
    """
    if not pairs:
        return []
    misfits = np.array([fit.misfit for _, fit in pairs])
    uncovered, outside, spilled, depth, depths, bend, change = misfits.T
    trust = min(1.0, float((depths / np.maximum(depth, 1e-9)).min()))
    costs = _UNCOVERED_COST * uncovered + _OUTSIDE_COST * outside + _SPILLED_COST * spilled
    costs += trust * (_DEPTH_COST * depth + _BEND_COST * bend + _BEND_CHANGE_COST * change)
    reading_costs = (_READING_COST + 1.0 - trust) * np.array([reading.cost for reading, _ in pairs])
    costs += ROPE_COST * np.array([len(reading.chains) for reading, _ in pairs])
    costs += [penalize_lengths(fit, observed) for _, fit in pairs]
    costs += _SHARP_COST * _measure_sharp_bends([fit for _, fit in pairs], float(observed.radii.values[0]))
    changes = np.array([_count_label_changes(reading, observed, taken) for reading, _ in pairs])
    if not changes.min():
        # else each label is a piece of a rope, or labels are wrong
        reading_costs += _LABEL_COST * changes
    costs += reading_costs
    if outside[costs.argmin()] > _MAX_OUTSIDE:
        visibility = sort_rays(observed.whole, [view.pose for view in observed.whole], observed.views)
        costs += [_penalize_free_space(fit, visibility, observed) for _, fit in pairs]
    order = np.argsort(costs, kind="stable")
    return [Explanation(pairs[k][0], pairs[k][1], float(costs[k]), float(reading_costs[k])) for k in order]


def _measure_sharp_bends(fits: Sequence[ImageFit], radius: float) -> Array:
    """(F,) Return the bend of each fit's ropes, radians, beyond that of a curve of one radius."""
    chains = [(number, nodes) for number, fit in enumerate(fits) for nodes in fit.nodes if len(nodes) > 2]
    if not chains:
        return np.zeros(len(fits))
    steps = np.diff(np.concatenate([nodes for _, nodes in chains]), axis=0)
    lengths = measure_lengths(steps)
    # a step from one chain to the next may be none
    cosines = multiply_rows(steps[:-1], steps[1:]) / np.maximum(lengths[:-1] * lengths[1:], _TINY)
    turns = np.arccos(np.clip(cosines, -1.0, 1.0))
    excess = np.maximum(turns - 0.5 * (lengths[:-1] + lengths[1:]) / radius, 0.0)
    found = np.zeros(len(fits))
    last = 0
    for number, nodes in chains:
        first, last = last, last + len(nodes)
        found[number] += excess[first : last - 2].sum()
    return found


def _count_label_changes(reading: Reading, observed: Observed, taken: Sequence[DepthImage]) -> int:
    image = observed.whole[reading.view].image
    if image is None or image.labels is None or image.labels.dtype == np.bool_:
        return 0
    camera = taken[reading.view].camera
    chains = [image.camera.convert(nodes, camera) for nodes in reading.chains]
    return count_label_changes(image.labels, chains)


def penalize_lengths(fit: ImageFit, observed: Observed) -> float:
    """Return the cost of ropes whose length is not the one that the caller gave."""
    prior = observed.prior
    if not prior.lengths:
        return 0.0
    radius = float(observed.radii.values[0])
    lengths = [float(path_length(nodes)[-1]) for nodes in fit.nodes]
    return sum(
        min(LENGTH_COST * prior.measure_excess(length, true, radius), MAX_LENGTH_COST)
        for length, true in zip(lengths, prior.match_lengths(lengths), strict=True)
    )


def _penalize_free_space(fit: ImageFit, visibility: Visibility, observed: Observed) -> float:
    """Return the cost of stretches of rope where cameras saw something behind them."""
    radius = float(observed.radii.values[0])
    cost = 0.0
    for nodes in fit.nodes:
        for start, stop in find_runs(visibility.free(nodes, radius)):
            if stop - start >= _MIN_FREE_NODES:
                cost += _FREE_COST * NODE_SPACING * (stop - start)
    return cost


def refit(
    images: RopeImages,
    fit: ImageFit,
    table: Plane | None,
    held: int,
    errors: Errors,
    config: Config,
    steps: int,
) -> ImageFit:
    """Fit a hypothesis again from where its fit ended, with covariances; return the old fit if that fails."""
    poses = (config.poses.rotation_sd, config.poses.translation_sd)
    again = images.refit(fit, table, held, poses, errors.values, steps)
    return fit if again is None else again
