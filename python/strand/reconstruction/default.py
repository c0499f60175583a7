"""The default method: tubes fitted to points and readings of images, compared by what they leave unexplained.

Tubes are better where depth is exact, readings where its errors are large or correlated from pixel to
pixel. The likelier of the two is tried first, the other only if the first leaves something unexplained.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strand._core import NotEnoughDataError
from strand.config import Config
from strand.reconstruction.courses import have_same_courses
from strand.reconstruction.evidence.confidence import MIN_DOUBT, compute_trust
from strand.reconstruction.evidence.depth_errors import MIN_CORRELATION
from strand.reconstruction.gaps import doubt_gaps
from strand.reconstruction.images.above_table import add_masks, drop_unclear_views
from strand.reconstruction.images.comparison import Reading, fit_and_rank, fit_into_images
from strand.reconstruction.images.depth_scatter import SMALL_SCATTER, measure_depth_scatter
from strand.reconstruction.images.mask_widths import doubt_given_radius
from strand.reconstruction.images.method import Interpretation, make_answer, read_images
from strand.reconstruction.images.noisy_depth import read_noisy_depth
from strand.reconstruction.mistakes.diagnosis import find_mistakes
from strand.reconstruction.pictured import (
    differ_in_gaps,
    measure_shown_share,
    picture_clouds,
    show_surface,
    turn_back,
)
from strand.reconstruction.stages import Found, Observed, Run
from strand.reconstruction.systematic import doubt_shared_errors
from strand.reconstruction.tubes.method import find_chains as find_tubes
from strand.reconstruction.tubes.tube_doubts import doubt_stray_points
from strand.reconstruction.tubes.view_bias import find_bias_doubts
from strand.reconstruction.wide_surfaces import describe_surface
from strand.ropes.doubt import Doubt
from strand.support.checks import Array
from strand.views.view import View

_SURE_TRUST = 0.35  # more trusted answers are not compared with others
_MIN_TRUST = 0.1  # less trusted tubes are compared with readings
_MAX_SCATTER = 0.55  # radii: where depths scatter more, points alone show no tubes
_MISREAD_EXCESS = 0.2  # radii: readings with this much more noise than depths scatter are wrong
_MAX_UNCOVERED = 1.0  # squared radii of mask that no rope covers: with more, tubes are tried as a reading too
_SMALL_NOISE = 0.25  # radii: with less noise than this in a reading, tubes are tried too
_MIN_WARNED = 0.1  # smaller doubts have no warning
_MAX_LOST = 0.05  # share of the points that tubes show and readings may not
_DEVIATIONS = 2.0  # standard deviations of the noise: points on a rope are this near its side
_NOTHING_AROUND = Doubt(
    "end",
    0.2,
    "where the ropes end",
    "the points show nothing around the ropes, which may go on unseen",
)


@dataclass(frozen=True, eq=False)
class _Attempt:
    """An answer that may be taken, and the run that has the warnings of it alone."""

    found: Found
    run: Run

    @property
    def trust(self) -> float:
        return compute_trust(self.found.doubts or ())

    @property
    def sure(self) -> bool:
        return self.trust >= _SURE_TRUST

    @property
    def independent(self) -> bool:
        """Whether the errors of neighboring pixels seem independent."""
        return self.found.sensor is None or not self.found.sensor.correlation

    @property
    def branched(self) -> bool:
        return any(warning.kind == "branch" for warning in self.run.warnings)

    def take(self, run: Run) -> Found:
        """Return the answer, and add its warnings to a run."""
        run.warnings.extend(self.run.warnings)
        return self.found


def find_chains(observed: Observed, config: Config, run: Run) -> Found:
    """Find chains by tubes, by readings of images, or by both.

    Raises
    ------
    strand.NotEnoughDataError
        If neither finds a rope.
    """
    used = drop_unclear_views(observed) if _can_read_images(observed, config) else observed
    for number in sorted({*observed.numbers} - {*used.numbers}):
        message = (
            f"view {number} was not used: it has no mask, and the errors of its pixels are correlated, so "
            "that parts of the table look like ropes; give it a mask, or its ropes' points alone"
        )
        run.warn("unused view", message, view=number)
    found = _find_in_used_views(used, config, run)
    ropes = [whole if whole.image else own for whole, own in zip(used.whole, used.views, strict=True)]
    doubts = [
        *find_mistakes(used.extract, used.radius, ropes),
        *doubt_shared_errors(used, found, config),
        *find_bias_doubts(used, found),
        *doubt_gaps(used, found),
    ]
    by_masks = doubt_given_radius(used, found)
    for doubt in by_masks:
        run.warn(doubt.kind, str(doubt), amount=doubt.amount)
    doubts = [doubt for doubt in doubts if doubt.amount > MIN_DOUBT]
    for doubt in doubts:
        # a radius that the points contradict has its warning
        if doubt.amount > _MIN_WARNED and doubt.kind != "radius":
            run.warn(doubt.kind, str(doubt), doubt.place, doubt.amount)
    found = replace(found, doubts=(*(found.doubts or ()), *doubts, *by_masks))
    return found if used is observed else _add_poses(found, used, observed)


def _can_read_images(observed: Observed, config: Config) -> bool:
    """Tell whether ropes are open and of one radius, as readings of images need."""
    return len(observed.radii.values) == 1 and config.linking.rings != "always"


def _find_in_used_views(observed: Observed, config: Config, run: Run) -> Found:
    if not _can_read_images(observed, config):
        surface = describe_surface(observed.views, float(observed.radii.values.max()))
        if surface:
            raise NotEnoughDataError(f"views: {surface}")
        given = not (observed.radii.free or observed.radii.held)
        if given or config.linking.rings == "always":
            return find_tubes(observed, config, run)
        return _try_radii_alone(observed, config, run)
    if any(observed.masked):
        return _try_images_first(add_masks(observed), config, run)
    if not any(view.image for view in observed.whole):
        return _find_in_clouds(observed, config, run)
    return _try_tubes_first(observed, config, run)


def _find_in_clouds(observed: Observed, config: Config, run: Run) -> Found:
    """Find chains in views of points alone: by tubes, then in images made of the points."""
    tubes = None
    if not observed.pictures:
        surface = describe_surface(observed.views, observed.radius)
        if surface:
            raise NotEnoughDataError(f"views: {surface}")
        tubes = _try_tubes(observed, config, run)
        if tubes is not None and tubes.sure and tubes.independent:
            return tubes.take(run)
        if tubes is not None and run.skips("readings of images made of points"):
            return tubes.take(run)
    pictured, measured = picture_clouds(observed)
    if tubes is not None and not measured and (tubes.trust >= _MIN_TRUST or tubes.branched):
        return tubes.take(run)
    if tubes is not None and _are_joined_by_colors(tubes, observed, config, run):
        return tubes.take(run)
    own = run.fork()
    try:
        found = _try_images_first(pictured, config, own, tubes)
    except NotEnoughDataError:
        if tubes is None:
            raise
        return tubes.take(run)
    images = _Attempt(found, own)
    if tubes is not None:
        if found is not tubes.found and _are_better_than_images(tubes, images, measured, observed, pictured):
            return tubes.take(run)
    elif not (
        measured or observed.pictures or (images.sure and show_surface(observed.views, observed.radius))
    ):
        raise NotEnoughDataError("views: the points make no rope; is the radius right, in metres?")
    if tubes is None or found is not tubes.found:
        found = turn_back(found, pictured, observed)
    if found.branch == "images" and not observed.pictures:
        stray = doubt_stray_points(measure_shown_share(observed, found, _DEVIATIONS))
        if stray.amount > _MIN_WARNED:
            own.warn(stray.kind, str(stray), amount=stray.amount)
        doubts = [doubt for doubt in (_NOTHING_AROUND, stray) if doubt.amount > MIN_DOUBT]
        found = replace(found, doubts=(*(found.doubts or ()), *doubts))
    return _Attempt(found, own).take(run)


def _are_joined_by_colors(tubes: _Attempt, observed: Observed, config: Config, run: Run) -> bool:
    """Tell whether tubes run otherwise without the colours of points, which images do not show."""
    if all(view.colors is None for view in observed.views):
        return False
    views = [View(view.points, view.pose) for view in observed.views]
    plain = _try_tubes(replace(observed, views=views), config, run)
    return plain is None or not _have_same_chains(tubes.found, plain.found, observed.radius)


def _are_better_than_images(
    tubes: _Attempt, images: _Attempt, measured: bool, observed: Observed, pictured: Observed
) -> bool:
    """Tell whether tubes are better than images made of points, in the pixels of a camera or in others."""
    # tubes follow ropes more closely where both agree
    if tubes.trust > images.trust and (
        not measured or _have_same_chains(tubes.found, images.found, observed.radius)
    ):
        return True
    # without surroundings, images do not show whether a gap hides rope
    if tubes.independent and differ_in_gaps(observed, tubes.found, images.found):
        return True
    lost = measure_shown_share(observed, tubes.found) - measure_shown_share(pictured, images.found)
    return lost > _MAX_LOST


def _try_radii_alone(observed: Observed, config: Config, run: Run) -> Found:
    """Return the tubes of several estimated radii, or if these are unsure, the surest answer of one radius.

    Noise makes estimates of one radius several.
    """
    tubes = _try_tubes(observed, config, run)
    if tubes is not None and (tubes.trust >= _MIN_TRUST or run.skips("readings at each radius alone")):
        return tubes.take(run)
    attempts = [] if tubes is None else [tubes]
    for number in range(len(observed.radii.values)):
        own = run.fork()
        alone = replace(observed, radii=replace(observed.radii.select([number]), free=False, held=True))
        try:
            attempts.append(_Attempt(_find_in_used_views(alone, config, own), own))
        except NotEnoughDataError:
            continue
    if not attempts:
        raise NotEnoughDataError("views: the points make no rope; is the radius right, in metres?")
    return max(attempts, key=lambda attempt: attempt.trust).take(run)


def _add_poses(found: Found, used: Observed, observed: Observed) -> Found:
    """Return an answer with the given poses of the views that were not used."""
    known = dict(zip(used.numbers, zip(found.poses, found.pose_sd, strict=True), strict=True))
    unknown = np.full(6, np.nan)
    both = [
        known.get(number, (view.pose, unknown))
        for number, view in zip(observed.numbers, observed.views, strict=True)
    ]
    return replace(found, poses=[pose for pose, _ in both], pose_sd=[deviation for _, deviation in both])


def _try_tubes_first(observed: Observed, config: Config, run: Run) -> Found:
    radius = observed.radius
    scatter = measure_depth_scatter(observed.whole, observed.views, SMALL_SCATTER * radius) / radius
    if scatter > _MAX_SCATTER:
        try:
            reading = read_noisy_depth(observed, config, run, scatter * radius, find_tubes)
        except NotEnoughDataError:
            return find_tubes(observed, config, run)
        return make_answer(reading, observed, config, run)
    has_images = all(view.image for view in observed.whole)
    # images show ropes on a table, in which no tubes are sought
    surface = describe_surface(observed.views, radius) if scatter < SMALL_SCATTER else None
    if surface and not has_images:
        raise NotEnoughDataError(f"views: {surface}")
    tubes = None if surface else _try_tubes(observed, config, run)
    if tubes is not None and _suffice(tubes, scatter, radius, has_images):
        return tubes.take(run)
    if tubes is not None and run.skips("readings of the images"):
        return tubes.take(run)
    own = run.fork()
    if scatter > SMALL_SCATTER:
        return _compare_with_noisy_depth(tubes, scatter, observed, config, run)
    try:
        reading = read_images(observed, config, own)
    except NotEnoughDataError as error:
        if surface:
            raise NotEnoughDataError(f"views: {surface}") from error
        if tubes is None:
            raise
        return tubes.take(run)
    if tubes is not None:
        misread = reading.neighbor_correlation <= MIN_CORRELATION and _is_misread(reading, scatter)
        misread = misread and tubes.trust >= _MIN_TRUST
        if misread or run.skips("the comparison with readings of the images"):
            return tubes.take(run)
        return _take_better(reading, tubes, observed, config, run)
    images = _Attempt(make_answer(reading, observed, config, own), own)
    if not images.sure:
        raise NotEnoughDataError(
            f"views: {surface or 'the points make no rope; is the radius right, in metres?'}"
        )
    return images.take(run)


def _suffice(tubes: _Attempt, scatter: float, radius: float, has_images: bool) -> bool:
    """Tell whether tubes need no comparison with readings of images."""
    if not tubes.found.stages["fit"].sigma < SMALL_SCATTER * radius:
        return False
    if not (scatter < SMALL_SCATTER or tubes.sure):
        return False
    # correlated errors scatter little, and tubes fall to pieces
    return (has_images and tubes.independent) or tubes.trust >= _MIN_TRUST


def _compare_with_noisy_depth(
    tubes: _Attempt | None, scatter: float, observed: Observed, config: Config, run: Run
) -> Found:
    """Return the answer of readings of noisy depth, or tubes if these agree with them or they are wrong."""
    own, radius = run.fork(), observed.radius
    ropes = [] if tubes is None else [chain.points for chain in tubes.found.chains]
    try:
        reading = read_noisy_depth(observed, config, own, scatter * radius, find_tubes, ropes)
    except NotEnoughDataError:
        if tubes is None:
            raise
        return tubes.take(run)
    same = _have_same_courses(reading.explanations[0].fit.nodes, ropes, radius)
    if tubes is not None and (same or _is_misread(reading, scatter)):
        return tubes.take(run)
    return _Attempt(make_answer(reading, observed, config, own), own).take(run)


def _is_misread(reading: Interpretation, scatter: float) -> bool:
    """Tell whether medians scatter more than single depths: then images are read wrong."""
    return reading.explanations[0].fit.noise > scatter + _MISREAD_EXCESS


def _try_images_first(observed: Observed, config: Config, run: Run, tubes: _Attempt | None = None) -> Found:
    """Return the answer of readings of masked images or of tubes, which may be known."""
    try:
        reading = read_images(observed, config, run)
    except NotEnoughDataError:
        return find_tubes(observed, config, run) if tubes is None else tubes.take(run)
    found = _choose_by_images(reading, observed, config, run, tubes)
    # tubes that were known stay the same object
    return replace(found, sought=reading.sought) if tubes is None else found


def _choose_by_images(
    reading: Interpretation, observed: Observed, config: Config, run: Run, tubes: _Attempt | None
) -> Found:
    """Return the answer of readings of masked images or of tubes, whichever is likelier."""
    own = run.fork()
    images = _Attempt(make_answer(reading, observed, config, own), own)
    best = reading.explanations[0].fit
    noisy = best.noise > _SMALL_NOISE and _is_noisy(observed)
    # readings may have missed a rope where a caller's mask is left
    left = best.misfit[0] >= _MAX_UNCOVERED and not observed.masks_found
    if (
        (reading.neighbor_correlation > MIN_CORRELATION and not left)
        or (noisy and images.sure)
        or run.skips("tubes in the points")
    ):
        return images.take(run)
    tubes = _try_tubes(observed, config, run) if tubes is None else tubes
    if tubes is not None and not noisy and tubes.independent and tubes.trust >= images.trust:
        return tubes.take(run)
    if run.skips("the comparison with tubes in the points"):
        return images.take(run)
    return _take_better(reading, tubes, observed, config, run)


def _is_noisy(observed: Observed) -> bool:
    """Tell whether single depths scatter so much that tubes are not tried; a wrong fit seems noisy too."""
    radius = observed.radius
    scatter = measure_depth_scatter(observed.whole, observed.views, SMALL_SCATTER * radius)
    return scatter > _SMALL_NOISE * radius


def _try_tubes(observed: Observed, config: Config, run: Run) -> _Attempt | None:
    own = run.fork()
    try:
        return _Attempt(find_tubes(observed, config, own), own)
    except NotEnoughDataError:
        return None


def _take_better(
    reading: Interpretation, tubes: _Attempt | None, observed: Observed, config: Config, run: Run
) -> Found:
    """Return the answer of readings or of tubes, by what each leaves unexplained in the images."""
    if tubes is None:
        return make_answer(reading, observed, config, run)
    chains = tubes.found.chains
    ropes = [chain.points for chain in chains[: observed.prior.ropes]]
    places = [reading.taken[reading.held].project(points) for points in ropes]
    if not fit_into_images(places):
        return make_answer(reading, observed, config, run)
    rival = Reading(reading.images.price_reading(reading.held, places), reading.held, places)
    explanations = fit_and_rank(
        reading.images,
        [rival, *(other.reading for other in reading.explanations)],
        reading.table,
        reading.held,
        reading.errors,
        config,
        observed,
        reading.taken,
        reading.explanations,
    )
    best = explanations[0]
    same = best.reading is rival or _have_same_courses(best.fit.nodes, ropes, observed.radius)
    # readings are of open ropes
    ring = best.reading is rival and any(chain.closed for chain in chains)
    if ring or (same and tubes.independent and best.fit.noise <= _SMALL_NOISE):
        return tubes.take(run)
    return make_answer(replace(reading, explanations=explanations), observed, config, run)


def _have_same_courses(some: list[Array], others: list[Array], radius: float) -> bool:
    return have_same_courses([(nodes, False) for nodes in some], [(nodes, False) for nodes in others], radius)


def _have_same_chains(some: Found, others: Found, radius: float) -> bool:
    courses = [[(chain.points, chain.closed) for chain in found.chains] for found in (some, others)]
    return have_same_courses(courses[0], courses[1], radius)
