"""The default method: tubes fitted to points and readings of images, compared by what they leave unexplained.

Tubes are better where depth is good, readings where its errors are wide or alike from pixel to pixel. The
likelier of the two is asked first, and the other only if that leaves something unexplained.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strand._core import NotEnoughDataError
from strand.config import Config
from strand.reconstruction import systematic
from strand.reconstruction.courses import have_same_courses
from strand.reconstruction.evidence.confidence import confidence
from strand.reconstruction.evidence.depth_errors import MIN_CORRELATION
from strand.reconstruction.images.above_table import add_masks, drop_unclear_views
from strand.reconstruction.images.comparison import Reading, fit_and_rank
from strand.reconstruction.images.depth_scatter import measure_depth_scatter
from strand.reconstruction.images.method import Interpretation, make_answer, read_images
from strand.reconstruction.images.noisy_depth import read_noisy_depth
from strand.reconstruction.mistakes.diagnosis import find_mistakes
from strand.reconstruction.stages import Found, Observed, Run
from strand.reconstruction.tubes.method import find_chains as find_tubes
from strand.reconstruction.tubes.view_bias import find_bias_doubts
from strand.reconstruction.wide_surfaces import describe_surface
from strand.ropes.doubt import ModelWarning
from strand.support.checks import Array

# an answer this sure is not compared
_SURE = 0.35
# where the noise is narrower than this, in radii, as tubes find it and neighbours show it, tubes are taken at
# their word
_WIDE = 0.3
# where depths scatter by more than this about their neighbours, in radii, points alone show no tubes
_SCATTERED = 0.55
# a reading that finds so much more noise than depths scatter by, in radii, is wrong
_MISREAD = 0.2
# where the noise is narrower than this, in radii, tubes are asked too; if it is independent from pixel to
# pixel, they follow the rope more closely
_NARROW = 0.25
# tubes of less confidence are compared with what images show, where neighbouring pixels share their errors
_HOPELESS = 0.1
# doubts of less are not mentioned; more makes an answer unsure, and is warned of
_LEAST, _WARNED = 1e-3, 0.1


def find_chains(observed: Observed, config: Config, run: Run) -> Found:
    """Find chains by tubes, by readings of images, or by both.

    Parameters
    ----------
    observed : Observed
    config : Config
    run : Run

    Returns
    -------
    Found

    Raises
    ------
    strand.NotEnoughDataError
        If neither finds a rope.
    """
    used = drop_unclear_views(observed) if _images_are_read(observed, config) else observed
    for number in sorted({*observed.numbers} - {*used.numbers}):
        message = (
            f"view {number} was not used: it has no mask, and errors of its neighbouring pixels are alike, "
            "so that what ropes lie on looks like ropes; give it a mask, or its ropes' points alone"
        )
        run.warnings.append(ModelWarning("unused view", message, view=number))
    found = _found(used, config, run)
    ropes = [whole if whole.image else own for whole, own in zip(used.whole, used.views, strict=True)]
    against = [
        *find_mistakes(used.extract, used.radius, ropes),
        *systematic.doubts(used, found, config),
        *find_bias_doubts(used, found),
    ]
    against = [doubt for doubt in against if doubt.amount > _LEAST]
    run.warnings.extend(
        ModelWarning(doubt.kind, str(doubt), doubt.place, doubt.amount)
        for doubt in against
        # a radius that the points contradict has its warning
        if doubt.amount > _WARNED and doubt.kind != "radius"
    )
    found = replace(found, doubts=(*(found.doubts or ()), *against))
    return _with_all_poses(found, used, observed)


def _images_are_read(observed: Observed, config: Config) -> bool:
    """Tell whether ropes are open and of one radius, as images are read for."""
    return len(observed.radii.values) == 1 and config.linking.rings != "always"


def _found(observed: Observed, config: Config, run: Run) -> Found:
    if not _images_are_read(observed, config):
        return _sought_tubes(observed, config, run)
    if any(observed.masked):
        return _images_first(add_masks(observed), config, run)
    return _tubes_first(observed, config, run)


def _with_all_poses(found: Found, used: Observed, observed: Observed) -> Found:
    """Return an answer of some of the views with poses of all; those of the others are as given."""
    if used is observed:
        return found
    known = dict(zip(used.numbers, zip(found.poses, found.pose_sd, strict=True), strict=True))
    unknown = np.full(6, np.nan)
    both = [
        known.get(number, (view.pose, unknown))
        for number, view in zip(observed.numbers, observed.views, strict=True)
    ]
    return replace(found, poses=[pose for pose, _ in both], pose_sd=[deviation for _, deviation in both])


def _tubes_first(observed: Observed, config: Config, run: Run) -> Found:
    radius = float(observed.radii.values[0])
    scatter = measure_depth_scatter(observed.whole, observed.views, _WIDE * radius) / radius
    if scatter > _SCATTERED:
        try:
            what = read_noisy_depth(observed, config, run, scatter * radius, find_tubes)
        except NotEnoughDataError:
            return find_tubes(observed, config, run)
        return make_answer(what, observed, config, run)
    pictured = all(view.image for view in observed.whole)
    # no tubes are sought in a table that images tell from the ropes on it
    wide = describe_surface(observed.views, radius) if scatter < _WIDE else None
    if wide and not pictured:
        raise NotEnoughDataError(f"views: {wide}")
    tubes, tubes_run = (None, run) if wide else _tubes(observed, config, run)
    narrow = tubes is not None and tubes.stages["fit"].sigma < _WIDE * radius
    if tubes is not None and narrow and (scatter < _WIDE or _certain(tubes)) and _settled(tubes, pictured):
        return _accepted(tubes, tubes_run, run)
    if tubes is not None and run.skips("readings of the images"):
        return _accepted(tubes, tubes_run, run)
    images_run = run.fork()
    if scatter > _WIDE:
        ropes = [] if tubes is None else [chain.points for chain in tubes.chains]
        try:
            what = read_noisy_depth(observed, config, images_run, scatter * radius, find_tubes, ropes)
        except NotEnoughDataError:
            if tubes is None:
                raise
            return _accepted(tubes, tubes_run, run)
        same = _alike(what.explanations[0].fit.nodes, ropes, radius)
        if tubes is not None and (same or _misread(what, scatter)):
            return _accepted(tubes, tubes_run, run)
        return _accepted(make_answer(what, observed, config, images_run), images_run, run)
    try:
        what = read_images(observed, config, images_run)
    except NotEnoughDataError as error:
        if wide:
            raise NotEnoughDataError(f"views: {wide}") from error
        if tubes is None:
            raise
        return _accepted(tubes, tubes_run, run)
    if tubes is not None:
        misread = what.neighbor_correlation <= MIN_CORRELATION and _misread(what, scatter)
        if misread or run.skips("the comparison with readings of the images"):
            return _accepted(tubes, tubes_run, run)
        return _better(what, tubes, tubes_run, observed, config, run)
    found = make_answer(what, observed, config, images_run)
    if not _certain(found):
        raise NotEnoughDataError(
            f"views: {wide or 'the points make no rope; is the radius right, in metres?'}"
        )
    return _accepted(found, images_run, run)


def _misread(what: Interpretation, scatter: float) -> bool:
    """Tell whether medians scatter more than single depths: then images are read wrong."""
    return what.explanations[0].fit.noise > scatter + _MISREAD


def _images_first(observed: Observed, config: Config, run: Run) -> Found:
    try:
        what = read_images(observed, config, run)
    except NotEnoughDataError:
        return find_tubes(observed, config, run)
    images_run = run.fork()
    found = make_answer(what, observed, config, images_run)
    wide = what.explanations[0].fit.noise > _NARROW
    if (
        what.neighbor_correlation > MIN_CORRELATION
        or (wide and _certain(found))
        or run.skips("tubes in the points")
    ):
        return _accepted(found, images_run, run)
    tubes, tubes_run = _tubes(observed, config, run)
    if tubes is not None and not wide and _plain(tubes) and _confidence(tubes) >= _confidence(found):
        return _accepted(tubes, tubes_run, run)
    if run.skips("the comparison with tubes in the points"):
        return _accepted(found, images_run, run)
    return _better(what, tubes, tubes_run, observed, config, run)


def _tubes(observed: Observed, config: Config, run: Run) -> tuple[Found | None, Run]:
    """Return the answer by tubes, and its warnings apart."""
    own = run.fork()
    try:
        return find_tubes(observed, config, own), own
    except NotEnoughDataError:
        return None, own


def _sought_tubes(observed: Observed, config: Config, run: Run) -> Found:
    """Find tubes, unless the points look like no ropes."""
    wide = describe_surface(observed.views, float(observed.radii.values.max()))
    if wide:
        raise NotEnoughDataError(f"views: {wide}")
    return find_tubes(observed, config, run)


def _accepted(found: Found, own: Run, run: Run) -> Found:
    run.warnings.extend(own.warnings)
    return found


def _plain(tubes: Found) -> bool:
    """Tell whether tubes find the errors of neighbouring pixels independent."""
    return tubes.sensor is None or not tubes.sensor.correlation


def _settled(tubes: Found, pictured: bool) -> bool:
    # where neighbours share their errors, depths scatter little, and yet tubes fall to pieces
    return not pictured or _plain(tubes) or _confidence(tubes) >= _HOPELESS


def _confidence(found: Found) -> float:
    return confidence(found.doubts or ())


def _certain(found: Found) -> bool:
    return _confidence(found) >= _SURE


def _better(
    what: Interpretation, tubes: Found | None, tubes_run: Run, observed: Observed, config: Config, run: Run
) -> Found:
    """Return the better of the answers, by what they leave unexplained."""
    if tubes is None:
        return make_answer(what, observed, config, run)
    radius = float(observed.radii.values[0])
    ropes = [chain.points for chain in tubes.chains[: observed.prior.ropes]]
    places = [what.taken[what.held].project(points) for points in ropes]
    rival = Reading(what.images.reading_cost(what.held, places), what.held, places)
    compared = fit_and_rank(
        what.images,
        [rival, *(other.reading for other in what.explanations)],
        what.table,
        what.held,
        what.errors,
        config,
        observed,
    )
    best = compared[0]
    same = best.reading is rival or _alike(best.fit.nodes, ropes, radius)
    ring = best.reading is rival and any(chain.closed for chain in tubes.chains)
    if ring or (same and _plain(tubes) and best.fit.noise <= _NARROW):
        return _accepted(tubes, tubes_run, run)
    return make_answer(replace(what, explanations=compared), observed, config, run)


def _alike(some: list[Array], others: list[Array], radius: float) -> bool:
    return have_same_courses([(nodes, False) for nodes in some], [(nodes, False) for nodes in others], radius)
