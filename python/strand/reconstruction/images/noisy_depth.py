"""Ropes read from views without masks whose depths scatter widely, each pixel independently.

No single threshold separates the ropes there, but many pixels together do. strand makes masks in several
ways, and ranks what it reads from any of them by how well the depths of all pixels agree with it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strand._core import NotEnoughDataError, RopeImages
from strand.config import Config
from strand.geometry.plane import Plane
from strand.geometry.polyline import path_length
from strand.reconstruction.images.above_table import mask_above_table, measure_heights
from strand.reconstruction.images.along_ropes import average_along_ropes
from strand.reconstruction.images.comparison import (
    NODE_SPACING,
    NOISY_STEPS,
    ROPE_COST,
    Explanation,
    Reading,
    are_worth_a_fit,
    find_likely_readings,
    fit_readings,
    penalize_lengths,
    refit,
)
from strand.reconstruction.images.image_ends import move_ends
from strand.reconstruction.images.image_nodes import correct_poses, iterate_squared_distances
from strand.reconstruction.images.method import Interpretation
from strand.reconstruction.images.other_courses import cut_over_table, list_swapped, reach_tip
from strand.reconstruction.images.outlines import average_pixels, estimate_mean_noise, outline_ropes
from strand.reconstruction.images.pixel_errors import Errors
from strand.reconstruction.images.prepare import prepare_images
from strand.reconstruction.images.table_plane import find_table_beside_ropes
from strand.reconstruction.stages import Found, Observed, Run
from strand.support.checks import Array
from strand.views.depth_image import DepthImage
from strand.views.view import View, pictured

_OUTLINE_WEIGHTS = (0.5, 0.9, 1.4)  # cost of a pixel's length of outline, one mask for each
_MASK_OF_TUBES = 2  # number of the mask in which tubes are sought; 0 is that of smoothed heights
_MAX_VIEWS = 3  # views that are read
_MAX_READINGS = 8  # readings of each view
_MAX_MORE = 40.0  # cost above the best reading's: those that cost more are not fitted
_MIN_LENGTH = 5.0  # radii: shorter ropes are noise
_MAX_REFITS = 10  # explanations that are fitted again
_MAX_MOVED = 4  # explanations whose ends are moved
_ROUNDS = 2  # moves of the ends of one explanation, and searches for other courses
_MAX_LESS = 0.02  # of the best gain: other courses that gain less by more are dropped after their first fit
_OVERLAP_COST = 2.0  # per radius of rope that runs within another strand
_MIN_AXIS_DISTANCE = 1.3  # radii: a rope whose axis is nearer to another strand's runs within it
_OWN_NODES = 12  # nodes of a rope before and after one that are not another strand
_GAIN_UNIT = 0.002  # of the best gain: a gain that is less by as much costs one
_MIN_GAIN = 100.0  # of depth over a bare table; a radius of rope gains tens in noise of a radius
_NO_ROPE = "views: no rope stands out from the table; is the radius right, in metres?"

FindTubes = Callable[[Observed, Config, Run], Found]
"""Finds chains as tubes in points."""


@dataclass(frozen=True, eq=False)
class _Scene:
    """Arguments that all fits share."""

    table: Plane
    held: int
    noise: float
    radius: float
    errors: Errors
    config: Config

    def measure_gains(self, images: RopeImages, several: Sequence[Explanation]) -> list[float]:
        """Return how much better the depths of all pixels agree with explanations than with a bare table."""
        ropes = [(one.fit.nodes, one.fit.corrections) for one in several]
        return images.measure_depth_gains(ropes, self.table, self.noise)

    def fit(self, images: RopeImages, readings: Sequence[Reading]) -> list[Explanation]:
        pairs = fit_readings(
            images, readings, self.table, self.held, self.errors, self.config, steps=NOISY_STEPS
        )
        return [Explanation(reading, fit, 0.0) for reading, fit in pairs]

    def refit(self, images: RopeImages, one: Explanation) -> Explanation:
        fit = refit(images, one.fit, self.table, self.held, self.errors, self.config, NOISY_STEPS)
        return replace(one, fit=fit)

    def move_ends(self, images: RopeImages, one: Explanation) -> Explanation:
        return replace(one, fit=move_ends(images, one.fit, self.table, self.noise, self.radius))


@dataclass(frozen=True, eq=False)
class _Masks:
    """Images with masks that were made in one way, and as kernels take them."""

    images: RopeImages
    taken: list[DepthImage]


@dataclass(frozen=True, eq=False)
class _Candidate:
    """An explanation, the masks that it was read from, and how well depth agrees with it."""

    gain: float
    one: Explanation
    masks: _Masks


def read_noisy_depth(
    observed: Observed,
    config: Config,
    run: Run,
    scatter: float,
    find_tubes: FindTubes,
    others: Sequence[Array] = (),
) -> Interpretation:
    """Read images whose depths scatter, and rank the readings by the depths of all pixels.

    Parameters
    ----------
    observed : Observed
        Views with images and without masks.
    config : Config
    run : Run
    scatter : float
        Standard deviation of single depths, metres.
    find_tubes : callable
        Finds chains as tubes in points.
    others : sequence of (M, 3) ndarray
        Ropes that were found otherwise. They are ranked with the readings.

    Raises
    ------
    strand.NotEnoughDataError
        If the images show no table, or no rope with depth.
    """
    radius = float(observed.radii.values[0])
    held = observed.held
    with run.stage("images"):
        whole = observed.images
        table = find_table_beside_ropes(whole[held], radius)
        if table is None:
            raise NotEnoughDataError(
                "views: their depths scatter too widely to segment ropes where no table is seen"
            )
        coarse = [average_pixels(image, radius) for image in whole]
        side = float(np.median([side for _, side in coarse]))
        noise = estimate_mean_noise(scatter, round(side), radius)
        first = mask_above_table([image for image, _ in coarse], table, observed.bounds, radius)
        weights = () if run.skips("masks with short outlines") else _OUTLINE_WEIGHTS
        outlines = [
            outline_ropes(
                image, measure_heights(image, table, observed.bounds, radius), table, radius, noise, weights
            )
            for image in first
        ]
        ways = [first, *(list(taken) for taken in zip(*outlines, strict=True))]
        masks = [made for taken in ways if (made := _prepare_masks(taken, radius)) is not None]
    if not masks:
        raise NotEnoughDataError(_NO_ROPE)
    views = sorted({0, held, len(first) - 1}) if len(first) > _MAX_VIEWS else range(len(first))
    with run.stage("readings"):
        most = _MAX_READINGS
        if run.skips("readings of all views but one"):
            views, most = [held], 1
        readings = [
            find_likely_readings(each.images, observed.prior.ropes, views, most, _MAX_MORE) for each in masks
        ]
    with run.stage("arcs"):
        tubes: list[Array] = []
        if len(ways) > _MASK_OF_TUBES and not run.skips("tubes in averaged depths"):
            tubes = _find_ropes_as_tubes(observed, ways[_MASK_OF_TUBES], table, config, run, find_tubes)
    read = [reading for those in readings for reading in those]
    for ropes in (others, tubes):
        found = Reading(0.0, held, [first[held].project(points) for points in ropes])
        if are_worth_a_fit(found.chains, read):
            readings = [[*those, found] for those in readings]
    scene = _Scene(table, held, noise, radius, Errors(), config)
    with run.stage("explain"):
        best = _find_best(scene, masks, readings, run)
        if not best:
            raise NotEnoughDataError(_NO_ROPE)
        costs = _price(best, observed)
        for _ in range(_ROUNDS):
            likeliest = best[int(np.argmin(costs))]
            more = _try_other_courses(scene, likeliest, observed.prior.ropes, run)
            if not more:
                break
            best += more
            costs = _price(best, observed)
            if best[int(np.argmin(costs))] is likeliest:
                break
    order = np.argsort(costs, kind="stable")
    likeliest = best[order[0]]
    if likeliest.gain < _MIN_GAIN:
        raise NotEnoughDataError(_NO_ROPE)
    explanations = [replace(best[k].one, cost=float(costs[k])) for k in order]
    images, taken = likeliest.masks.images, likeliest.masks.taken
    return Interpretation(images, table, held, explanations, taken, taken, scene.errors, round(side), scatter)


def _prepare_masks(taken: list[DepthImage], radius: float) -> _Masks | None:
    """Return images with masks as kernels take them; None if no mask shows a rope."""
    try:
        return _Masks(prepare_images(taken, radius), taken)
    except NotEnoughDataError:
        return None


def _find_ropes_as_tubes(
    observed: Observed,
    taken: Sequence[DepthImage],
    table: Plane,
    config: Config,
    run: Run,
    find_tubes: FindTubes,
) -> list[Array]:
    """Return ropes that are found as tubes in means along them, if all are open."""
    radius = float(observed.radii.values[0])
    views = [View(average_along_ropes(image, table, observed.bounds, radius), image.pose) for image in taken]
    if not all(len(view.points) for view in views):
        return []
    bounds = None if observed.bounds is None else observed.bounds.grown(radius)
    # images show that nothing is where a join would lead over the table
    whole = [pictured(view, image) for view, image in zip(observed.whole, taken, strict=True)]
    smooth = replace(observed, views=tuple(views), whole=tuple(whole), bounds=bounds)
    # its stages are one step of this one
    quiet = replace(run, progress=None, timings={}, warnings=[])
    try:
        found = find_tubes(smooth, replace(config, sensor=None), quiet)
    except NotEnoughDataError:
        return []
    # images are read for open ropes
    return [] if any(chain.closed for chain in found.chains) else [chain.points for chain in found.chains]


def _find_best(
    scene: _Scene, masks: Sequence[_Masks], readings: Sequence[Sequence[Reading]], run: Run
) -> list[_Candidate]:
    """Fit readings of all masks; return those that depth agrees with most, fitted again, the best first."""
    found: list[_Candidate] = []
    for own, read in zip(masks, readings, strict=True):
        if run.skips("the comparison of readings"):
            if found:
                break
            read = read[:1]
        several = scene.fit(own.images, read)
        gains = scene.measure_gains(own.images, several)
        found += [_Candidate(gain, one, own) for gain, one in zip(gains, several, strict=True)]
    found = _drop_short(found, scene.radius)
    found.sort(key=lambda each: -each.gain)
    again = []
    for each in found[:_MAX_REFITS]:
        if run.skips("second fits of the best readings"):
            again.append(each)
            continue
        images = each.masks.images
        one = scene.refit(images, each.one)
        again.append(_Candidate(scene.measure_gains(images, [one])[0], one, each.masks))
    again.sort(key=lambda each: -each.gain)
    for place in range(min(_MAX_MOVED, len(again))):
        images = again[place].masks.images
        for _ in range(_ROUNDS):
            if run.skips("the ropes' ends by the depths of all pixels"):
                break
            one = scene.move_ends(images, again[place].one)
            several = [one, *_refit_in_own_view(scene, again[place].masks, one)]
            gains = scene.measure_gains(images, several)
            if max(gains) <= again[place].gain:
                break
            best = int(np.argmax(gains))
            again[place] = _Candidate(gains[best], several[best], again[place].masks)
    return sorted(_drop_short(again, scene.radius), key=lambda each: -each.gain)


def _price(found: Sequence[_Candidate], observed: Observed) -> list[float]:
    """Return the costs of candidates."""
    unit = _GAIN_UNIT * max(1.0, *(each.gain for each in found))
    radius = float(observed.radii.values[0])
    return [
        ROPE_COST * len(each.one.fit.nodes)
        + _OVERLAP_COST * _measure_overlap(each.one.fit.nodes, radius)
        + penalize_lengths(each.one.fit, observed)
        - each.gain / unit
        for each in found
    ]


def _try_other_courses(scene: _Scene, best: _Candidate, ropes: int | None, run: Run) -> list[_Candidate]:
    """Fit ropes that run otherwise where the best ones end on a strand, or without bridges over bare table.

    Return those that depth agrees with nearly as much, or more.
    """
    if run.skips("other courses where ropes end on strands"):
        return []
    images, chains, view = best.masks.images, best.one.fit.nodes, best.one.reading.view
    poses = correct_poses([image.pose for image in best.masks.taken], best.one.fit.corrections)
    taken = [image.placed(pose) for image, pose in zip(best.masks.taken, poses, strict=True)]
    ways = []
    for swapped in list_swapped(chains, scene.radius):
        ways.append(swapped)
        longer = reach_tip(taken[view], swapped, scene.table.normal, scene.radius)
        if longer is not None:
            ways.append(longer)
    kept, cut = cut_over_table(taken, chains, scene.radius)
    if cut and kept and (ropes is None or len(kept) <= ropes):
        ways.append(kept)
    readings = [
        replace(best.one.reading, chains=[taken[view].project(nodes) for nodes in way]) for way in ways
    ]
    found = []
    for one in scene.fit(images, readings):
        several = [one]
        gains = scene.measure_gains(images, several)
        if gains[0] < (1.0 - _MAX_LESS) * best.gain:
            continue
        several.append(scene.refit(images, one))
        gains += scene.measure_gains(images, several[1:])
        if gains[1] > best.gain:
            several.append(scene.move_ends(images, several[1]))
            gains += scene.measure_gains(images, several[2:])
        likeliest = int(np.argmax(gains))
        found.append(_Candidate(gains[likeliest], several[likeliest], best.masks))
    return found


def _drop_short(found: Sequence[_Candidate], radius: float) -> list[_Candidate]:
    """Drop candidates with ropes as short as those of noise, unless all are."""

    def shortest(each: _Candidate) -> float:
        return min(float(path_length(nodes)[-1]) for nodes in each.one.fit.nodes)

    return [each for each in found if shortest(each) > _MIN_LENGTH * radius] or list(found)


def _refit_in_own_view(scene: _Scene, masks: _Masks, one: Explanation) -> list[Explanation]:
    """Fit an explanation again from where its view sees the ropes, and move their ends."""
    view = one.reading.view
    poses = correct_poses([image.pose for image in masks.taken], one.fit.corrections)
    image = masks.taken[view].placed(poses[view])
    reading = replace(one.reading, chains=[image.project(nodes) for nodes in one.fit.nodes])
    again = [scene.refit(masks.images, each) for each in scene.fit(masks.images, [reading])]
    return [scene.move_ends(masks.images, each) for each in again]


def _measure_overlap(chains: Sequence[Array], radius: float) -> float:
    """Return the length of ropes that runs within other strands, radii."""
    nodes = np.vstack(chains)
    number = np.repeat(np.arange(len(chains)), [len(each) for each in chains])
    place = np.arange(len(nodes))
    within = 0
    for some, squares in iterate_squared_distances(nodes, nodes):
        other = (number[some, None] != number) | (np.abs(place[some, None] - place) > _OWN_NODES)
        near = squares < (_MIN_AXIS_DISTANCE * radius) ** 2
        within += int(np.count_nonzero((other & near).any(axis=1)))
    return NODE_SPACING * within
