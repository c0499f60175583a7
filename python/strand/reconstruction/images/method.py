"""Ropes read from images: read the masks, fit the readings, rank them, and say what is unsure."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strand._core import ImageFit, NotEnoughDataError, RopeImages
from strand.config import Config
from strand.geometry.plane import Plane
from strand.reconstruction.evidence.answer_warnings import warn_about_answer
from strand.reconstruction.evidence.depth_errors import MIN_CORRELATION
from strand.reconstruction.images.above_table import mask_above_table
from strand.reconstruction.images.beyond_mask import doubt_ends_beyond_masks
from strand.reconstruction.images.border_ends import straighten_border_ends
from strand.reconstruction.images.comparison import (
    LAST_STEPS,
    MAX_READINGS,
    NOISY_STEPS,
    Explanation,
    Reading,
    choose_compared,
    find_likely_readings,
    fit_and_rank,
    leaves_nothing_open,
    refit,
)
from strand.reconstruction.images.facing_ends import doubt_facing_ends
from strand.reconstruction.images.fat_masks import MIN_WIDER, measure_excess
from strand.reconstruction.images.image_doubts import (
    doubt_ends_at_strands,
    doubt_over_table,
    doubt_uneven_widths,
    doubt_wide_masks,
    drop_same_courses,
    find_doubts,
)
from strand.reconstruction.images.image_ends import cut_ends, move_ends
from strand.reconstruction.images.image_nodes import correct_poses, make_chains
from strand.reconstruction.images.lost_pieces import add_lost_pieces
from strand.reconstruction.images.outlines import estimate_mean_noise
from strand.reconstruction.images.pixel_errors import (
    Errors,
    convert_sensor,
    correlate_neighbors,
    describe_sensor,
    measure_errors,
)
from strand.reconstruction.images.prepare import prepare_views
from strand.reconstruction.images.ragged_masks import mend_ragged_masks
from strand.reconstruction.images.table_plane import find_table_beside_ropes
from strand.reconstruction.stages import Found, Observed, Run, SoughtTable
from strand.ropes.doubt import Alternative
from strand.support.lazy import lazy_property
from strand.views.depth_image import DepthImage
from strand.views.pose import moved
from strand.views.sensor import Sensor

_MAX_ALTERNATIVES = 3  # rivals in an answer
_OTHER_VIEWS = "readings of all views but one"
_NO_ROPE = "views: the images show no rope with depth; is the radius right, in metres?"


@dataclass(frozen=True, eq=False)
class Interpretation:
    """Images and their explanations.

    Attributes
    ----------
    images : RopeImages
        The images as kernels take them.
    table : Plane or None
    held : int
        The view whose pose is held.
    explanations : list of Explanation
        The best first.
    taken : list of DepthImage
        The images with the masks that were read. Their pixels are those of readings.
    given : list of DepthImage
        The same in pixels whose errors are measured.
    errors : Errors
        The usual ones, or those of the sensor that the caller gave.
    side : int
        Pixels of a view along each side of a pixel of the images.
    scatter : float or None
        Standard deviation of independent depths of single pixels, metres; None if it was not measured.
    factor : int
        Pixels of the images along each side of a pixel of a view, if thin ropes were magnified.
    wider : float
        Pixels of a view that its mask was wider on each side than the radius says.
    excess : float
        What is left of that after the mask was slimmed.
    sought : SoughtTable or None
        The table beside the ropes in one image, if it was sought.
    """

    images: RopeImages
    table: Plane | None
    held: int
    explanations: list[Explanation]
    taken: list[DepthImage]
    given: list[DepthImage]
    errors: Errors
    side: int = 1
    scatter: float | None = None
    factor: int = 1
    wider: float = 0.0
    excess: float = 0.0
    sought: SoughtTable | None = None

    @lazy_property
    def neighbor_correlation(self) -> float:
        """The correlation of neighbouring pixels' errors in flat surroundings; 0 without any."""
        return correlate_neighbors(self.given)


def read_images(observed: Observed, config: Config, run: Run) -> Interpretation:
    """Read the images and rank the readings.

    Ropes in views without masks are segmented from their table by smoothed heights.

    Raises
    ------
    strand.NotEnoughDataError
        If the images show no rope with depth.
    """
    radius = float(observed.radii.values[0])
    held = observed.held
    with run.stage("images"):
        given = observed.images
        table = find_table_beside_ropes(given[held], radius)
        sought = SoughtTable(given[held], radius, table)
        if table is None and observed.support is not None:
            table = Plane(*observed.support)
        if not any(observed.masked):
            given = mask_above_table(given, table, observed.bounds, radius)
        else:
            if not run.skips("outlines of ragged masks"):
                given = mend_ragged_masks(given, table, observed.bounds, radius)
            if not run.skips("pieces that masks lost"):
                given = add_lost_pieces(given, table, observed.bounds, radius)
        try:
            views = prepare_views(given, any(observed.masked), table, observed.bounds, radius)
        except NotEnoughDataError as error:
            raise NotEnoughDataError(_NO_ROPE) from error
    images, taken, factor = views.images, views.taken, views.factor
    errors = Errors(lateral=factor * Errors.lateral)
    if isinstance(config.sensor, Sensor):
        errors = convert_sensor(config.sensor, views.given, images, radius, factor)
    others = [view for view in choose_compared(len(taken), held) if view != held]
    late = run.skips(_OTHER_VIEWS)
    readings: list[Reading] = []
    found: list[Explanation] = []
    for seen in ([held], others):
        # one view mostly shows how the ropes run
        if not seen or leaves_nothing_open(found, observed) or (found and run.skips(_OTHER_VIEWS)):
            continue
        with run.stage("readings"):
            readings = find_likely_readings(
                images, observed.prior.ropes, seen, most=1 if late else MAX_READINGS, known=readings
            )
        with run.stage("explain"):
            if run.skips("the comparison of readings"):
                readings = readings[:1]
            found = fit_and_rank(images, readings, table, held, errors, config, observed, taken, found)
    if not found:
        raise NotEnoughDataError(_NO_ROPE)
    return Interpretation(
        images,
        table,
        held,
        found,
        taken,
        views.given,
        errors,
        factor=factor,
        wider=views.wider,
        excess=views.excess,
        sought=sought,
    )


def make_answer(read: Interpretation, observed: Observed, config: Config, run: Run) -> Found:
    """Return the chains of the best explanation with their doubts; add warnings to the run."""
    best = read.explanations[0]
    radius, radius_sd = float(observed.radii.values[0]), float(observed.radii.sd[0])
    with run.stage("fit images"):
        measured = measure_errors(best.fit, read.errors, read.factor)
        errors = measured
        if isinstance(config.sensor, Sensor):
            errors = replace(read.errors, lateral=read.factor * config.sensor.lateral or measured.lateral)
        steps = LAST_STEPS if read.scatter is None else NOISY_STEPS
        fit = refit(read.images, best.fit, read.table, read.held, errors, config, steps)
        if (
            read.scatter is not None
            and read.table is not None
            and not run.skips("the ropes' ends by the depths of all pixels")
        ):
            # masks locate ends badly where depths scatter
            noise = estimate_mean_noise(read.scatter, read.side, radius)
            fit = move_ends(read.images, fit, read.table, noise, radius)
        if read.excess > MIN_WIDER:
            # ends of masks lie beyond those of ropes by as much as their sides do
            fit = cut_ends(read.images, fit, read.excess * _measure_pixel(read), radius)
        poses = correct_poses([view.pose for view in observed.views], fit.corrections)
        shown = [
            view.image.placed(pose)
            for view, pose in zip(observed.whole, poses, strict=True)
            if view.image is not None
        ]
        fit = straighten_border_ends(read.images, fit, shown, radius)
        chains = make_chains(read.images, fit, radius, radius_sd, config)
    rivals = drop_same_courses(read.explanations, radius)
    views = [image.placed(pose) for image, pose in zip(read.taken, poses, strict=True)]
    wider = read.wider
    if read.scatter is not None:
        wider = measure_excess(read.taken, read.images.radii, radius)
    others = [
        *doubt_ends_at_strands(fit.nodes, read.scatter or 0.0, radius),
        *doubt_wide_masks(wider, slimmed=wider > read.excess + MIN_WIDER),
        *doubt_uneven_widths(views, fit.nodes),
    ]
    if read.scatter is None:
        # where depths scatter, masks were made of what stands out
        others += doubt_ends_beyond_masks(views, fit.nodes, fit.noise, radius)
        others += doubt_facing_ends(fit.nodes, radius)
    else:
        others += doubt_over_table(views, fit.nodes, radius)
    resting = read.table is not None and all(observed.masked)
    doubts = find_doubts(rivals, fit, chains, views, radius, others, resting)
    chains = sorted(chains, key=lambda chain: -chain.length)
    run.warnings.extend(warn_about_answer(chains, doubts, None, observed.bounds, config.linking))
    return Found(
        chains,
        poses=poses,
        pose_sd=[np.full(6, np.nan) for _ in observed.views],
        stages={
            "registered": tuple(
                moved(view.points, pose) for view, pose in zip(observed.views, poses, strict=True)
            ),
            "readings": tuple(nodes for one in read.explanations for nodes in one.fit.nodes),
        },
        branch="images",
        doubts=doubts,
        sensor=_describe_pixels(read, measured, fit, radius),
        sought=read.sought,
        alternatives=tuple(
            Alternative(other.cost - best.cost, tuple(other.fit.nodes))
            for other in rivals[1 : 1 + _MAX_ALTERNATIVES]
        ),
    )


def _measure_pixel(read: Interpretation) -> float:
    """Return the side of a view's pixel at the ropes' distance, metres."""
    image = read.given[read.held]
    return image.distance / image.camera.focal[0]


def _describe_pixels(read: Interpretation, measured: Errors, fit: ImageFit, radius: float) -> Sensor:
    """Return the sensor with the errors of single pixels."""
    sensor = describe_sensor(
        measured, fit, _find_correlation(read), read.given, read.images, radius, read.factor
    )
    if read.scatter is None:
        return sensor
    # means of pixels have no step, and are as independent as the pixels
    return replace(sensor, sd=read.scatter, correlation=0.0, step=0.0, lateral=read.side * sensor.lateral)


def _find_correlation(read: Interpretation) -> float | None:
    """Return c of `Sensor.correlation`, pixels, where neighbours' errors correlate by exp(-1 / (4 c²))."""
    found = read.neighbor_correlation
    if found == 0.0:
        return None
    return float((-0.25 / np.log(found)) ** 0.5) if found > MIN_CORRELATION else 0.0
