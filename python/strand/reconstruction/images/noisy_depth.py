"""Ropes read from views without masks whose depths scatter widely, each pixel for itself.

No single cut shows where the ropes are there, but many pixels together do: masks are made in several ways,
and what is read from any of them is compared by how well the depths of all pixels agree with it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strand._core import NotEnoughDataError, RopeImages
from strand.config import Config
from strand.geometry.polyline import path_length
from strand.reconstruction.images.above_table import mask_above_table
from strand.reconstruction.images.comparison import (
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
from strand.reconstruction.images.image_nodes import correct_poses
from strand.reconstruction.images.lengthwise import points_along
from strand.reconstruction.images.method import Read
from strand.reconstruction.images.outlined import averaged, mean_noise, outlined
from strand.reconstruction.images.pixel_errors import Errors
from strand.reconstruction.images.prepare import prepare_images
from strand.reconstruction.images.table_plane import Plane, find_table_beside_ropes
from strand.reconstruction.stages import Found, Observed, Run
from strand.support.checks import Array
from strand.views.depth_image import DepthImage
from strand.views.rope_images import rope_images
from strand.views.view import View

# weights of the outline's length, one for each mask
_OUTLINES = 0.5, 0.9, 1.4
# which of the masks is looked at as tubes; the first is that of smoothed heights
_TUBES = 2
# views that are read, readings of each, and how much more than the best one may cost
_VIEWS, _READINGS, _MORE = 3, 8, 40.0
# ropes are longer than so many radii
_SHORTEST = 5.0
# explanations that are fitted once more, and of those the ones whose ends are looked for
_AGAIN, _ENDS, _ROUNDS = 10, 4, 2
# each radius of rope that runs within another strand, whose axis is nearer than this, and nodes of a rope
# that are no other strand's; they are half a radius apart
_THROUGH, _INSIDE, _OWN = 2.0, 1.3, 12
# nodes that are compared with all others at a time
_ROWS = 512
# a gain that is less by this part of the best one costs one; with less than the other depth does not tell a
# rope from the bare table: one radius of rope gains tens in noise of a radius
_GAIN, _LEAST_GAIN = 0.002, 100.0
FindTubes = Callable[[Observed, Config, Run], Found]

_NO_ROPE = "views: no rope stands out from the table; is the radius right, in metres?"


@dataclass(frozen=True, eq=False)
class _Scene:
    """The views and what their fits need to know."""

    table: Plane
    held: int
    noise: float
    radius: float
    errors: Errors
    config: Config

    def gains(self, images: RopeImages, several: Sequence[Explanation]) -> list[float]:
        """How much better the depths of all pixels agree with explanations than with a bare table."""
        ropes = [(one.fit.nodes, one.fit.corrections) for one in several]
        return images.depth_gains(ropes, self.table, self.noise)

    def fitted(self, images: RopeImages, readings: Sequence[Reading]) -> list[Explanation]:
        pairs = fit_readings(images, readings, self.table, self.held, self.errors, self.config)
        return [Explanation(reading, fit, 0.0) for reading, fit in pairs]

    def again(self, images: RopeImages, one: Explanation) -> Explanation:
        fit = refit(images, one.fit, self.table, self.held, self.errors, self.config)
        return replace(one, fit=fit)

    def with_ends(self, images: RopeImages, one: Explanation) -> Explanation:
        return replace(one, fit=move_ends(images, one.fit, self.table, self.noise, self.radius))


@dataclass(frozen=True, eq=False)
class _Candidate:
    """An explanation, the masks that it was read from, and how well depth agrees with it."""

    gain: float
    one: Explanation
    masks: int


def read_scattered(
    observed: Observed,
    config: Config,
    run: Run,
    scatter: float,
    find_tubes: FindTubes,
    others: Sequence[Array] = (),
) -> Read:
    """Read images of depths that scatter, and compare the readings by the depths of all pixels.

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
        Ropes that were found otherwise, to be compared with what is read.

    Returns
    -------
    Read

    Raises
    ------
    strand.NotEnoughDataError
        If the images show no table, or no rope with depth.
    """
    radius = float(observed.radii.values[0])
    held = observed.held
    with run.stage("images"):
        whole = rope_images(observed.views, observed.whole, observed.bounds, 2.0 * radius)
        table = find_table_beside_ropes(whole[held], radius)
        if table is None:
            raise NotEnoughDataError("views: their depths scatter too widely to tell a rope without a table")
        coarse = [averaged(image, radius) for image in whole]
        side = float(np.median([side for _, side in coarse]))
        noise = mean_noise(scatter, round(side), radius)
        first = mask_above_table([image for image, _ in coarse], table, observed.bounds, radius)
        weights = () if run.late("masks with short outlines") else _OUTLINES
        outlines = [outlined(image, table, observed.bounds, radius, noise, weights) for image in first]
        masked = [first, *(list(taken) for taken in zip(*outlines, strict=True))]
        known = [(images, taken) for taken in masked if (images := _prepared(taken, radius)) is not None]
    if not known:
        raise NotEnoughDataError(_NO_ROPE)
    views = sorted({0, held, len(first) - 1}) if len(first) > _VIEWS else range(len(first))
    with run.stage("readings"):
        if run.late("readings of all views but one"):
            views = [held]
        readings = [
            find_likely_readings(images, observed.prior.ropes, views, _READINGS, _MORE) for images, _ in known
        ]
    with run.stage("arcs"):
        tubes: list[Array] = []
        if len(masked) > _TUBES and not run.late("tubes in averaged depths"):
            tubes = _tubes(observed, masked[_TUBES], table, config, run, find_tubes)
    read = [reading for those in readings for reading in those]
    for ropes in (others, tubes):
        found = Reading(0.0, held, [first[held].project(points) for points in ropes])
        if are_worth_a_fit(found.chains, read):
            readings = [[*those, found] for those in readings]
    scene = _Scene(table, held, noise, radius, Errors(), config)
    with run.stage("explain"):
        best = _best(scene, known, readings, run)
    if not best:
        raise NotEnoughDataError(_NO_ROPE)
    unit = _GAIN * max(best[0].gain, 1.0)
    costs = [
        ROPE_COST * len(each.one.fit.nodes)
        + _THROUGH * _within(each.one.fit.nodes, radius)
        + penalize_lengths(each.one.fit, observed)
        - each.gain / unit
        for each in best
    ]
    order = np.argsort(costs, kind="stable")
    if best[order[0]].gain < _LEAST_GAIN:
        raise NotEnoughDataError(_NO_ROPE)
    images, taken = known[best[order[0]].masks]
    explanations = [replace(best[k].one, cost=float(costs[k])) for k in order]
    return Read(images, table, held, explanations, taken, scene.errors, round(side), scatter)


def _without_bits(found: Sequence[_Candidate], radius: float) -> list[_Candidate]:
    """Leave out what has ropes too short for any, which noise makes too, unless there is nothing else."""

    def shortest(each: _Candidate) -> float:
        return min(float(path_length(nodes)[-1]) for nodes in each.one.fit.nodes)

    return [each for each in found if shortest(each) > _SHORTEST * radius] or list(found)


def _tubes(
    observed: Observed,
    taken: Sequence[DepthImage],
    table: Plane,
    config: Config,
    run: Run,
    find_tubes: FindTubes,
) -> list[Array]:
    """Return ropes found as tubes in means along them, none if there are none."""
    radius = float(observed.radii.values[0])
    views = [View(points_along(image, table, observed.bounds, radius), image.pose) for image in taken]
    if not all(len(view.points) for view in views):
        return []
    bounds = None if observed.bounds is None else observed.bounds.grown(radius)
    smooth = replace(observed, views=tuple(views), whole=tuple(views), bounds=bounds)
    # its stages are one step of this one
    quiet = replace(run, progress=None, timings={}, warnings=[])
    try:
        found = find_tubes(smooth, replace(config, sensor=None), quiet)
    except NotEnoughDataError:
        return []
    # images are read for open ropes
    return [] if any(chain.closed for chain in found.chains) else [chain.points for chain in found.chains]


def _best(
    scene: _Scene,
    known: list[tuple[RopeImages, list[DepthImage]]],
    readings: Sequence[Sequence[Reading]],
    run: Run,
) -> list[_Candidate]:
    """Fit readings of all masks; return those that depth agrees with most, fitted once more, best first."""
    found: list[_Candidate] = []
    for masks, ((images, _), read) in enumerate(zip(known, readings, strict=True)):
        if run.late("the comparison of readings"):
            if found:
                break
            read = read[:1]
        several = scene.fitted(images, read)
        gains = scene.gains(images, several)
        found += [_Candidate(gain, one, masks) for gain, one in zip(gains, several, strict=True)]
    found = _without_bits(found, scene.radius)
    found.sort(key=lambda each: -each.gain)
    again = []
    for each in found[:_AGAIN]:
        if run.late("second fits of the best readings"):
            again.append(each)
            continue
        images, _ = known[each.masks]
        one = scene.again(images, each.one)
        again.append(_Candidate(scene.gains(images, [one])[0], one, each.masks))
    again.sort(key=lambda each: -each.gain)
    for place in range(min(_ENDS, len(again))):
        images, taken = known[again[place].masks]
        for _ in range(_ROUNDS):
            if run.late("the ropes' ends by the depths of all pixels"):
                break
            one = scene.with_ends(images, again[place].one)
            several = [one, *_fitted_again(scene, images, taken, one)]
            gains = scene.gains(images, several)
            if max(gains) <= again[place].gain:
                break
            best = int(np.argmax(gains))
            again[place] = _Candidate(gains[best], several[best], again[place].masks)
    return sorted(_without_bits(again, scene.radius), key=lambda each: -each.gain)


def _fitted_again(
    scene: _Scene, images: RopeImages, taken: Sequence[DepthImage], one: Explanation
) -> list[Explanation]:
    """Fit an explanation once more from where its view sees the ropes, and look for their ends."""
    view = one.reading.view
    poses = correct_poses([image.pose for image in taken], one.fit.corrections)
    image = replace(taken[view], pose=poses[view])
    reading = replace(one.reading, chains=[image.project(nodes) for nodes in one.fit.nodes])
    again = [scene.again(images, each) for each in scene.fitted(images, [reading])]
    return [scene.with_ends(images, each) for each in again]


def _within(chains: Sequence[Array], radius: float) -> float:
    """Return how much of ropes runs within other strands, radii."""
    nodes = np.vstack(chains)
    number = np.repeat(np.arange(len(chains)), [len(each) for each in chains])
    place = np.arange(len(nodes))
    within = 0
    for first in range(0, len(nodes), _ROWS):
        some = slice(first, first + _ROWS)
        squares = np.zeros((len(nodes[some]), len(nodes)))
        for k in range(3):
            squares += (nodes[some, k, None] - nodes[:, k]) ** 2
        other = (number[some, None] != number) | (np.abs(place[some, None] - place) > _OWN)
        within += int(np.count_nonzero((other & (squares < (_INSIDE * radius) ** 2)).any(axis=1)))
    return 0.5 * within


def _prepared(taken: Sequence[DepthImage], radius: float) -> RopeImages | None:
    try:
        return prepare_images(taken, radius)
    except ValueError:
        return None
