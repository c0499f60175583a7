"""Ropes read from images, composed: read the masks, lift and fit, compare, say what is unsure."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strand._core import ImageFit, NotEnoughDataError, RopeImages
from strand.config import Config
from strand.reconstruction.evidence.answer_warnings import warn_about_answer
from strand.reconstruction.images.above_table import mask_above_table
from strand.reconstruction.images.beyond_mask import ends_that_go_on
from strand.reconstruction.images.comparison import Explanation, find_likely_readings, fit_and_rank, refit
from strand.reconstruction.images.image_doubts import distinct, doubts, ends_at_strands, wide_masks
from strand.reconstruction.images.image_ends import move_ends
from strand.reconstruction.images.image_nodes import correct_poses, make_chains
from strand.reconstruction.images.outlined import mean_noise
from strand.reconstruction.images.pixel_errors import (
    Errors,
    expected_errors,
    measured_errors,
    neighbours_alike,
    sensor_of,
)
from strand.reconstruction.images.prepare import prepare_images
from strand.reconstruction.images.table_plane import Plane, find_table_beside_ropes
from strand.reconstruction.stages import Found, Observed, Run
from strand.ropes.doubt import Alternative
from strand.support.lazy import lazy_property
from strand.views.depth_image import DepthImage
from strand.views.pose import moved
from strand.views.rope_images import rope_images
from strand.views.sensor import Sensor

PLAIN = 0.1
"""Errors of neighbouring pixels that are less alike count as independent."""

_NO_ROPE = "views: the images show no rope with depth; is the radius right, in metres?"


@dataclass(frozen=True, eq=False)
class Read:
    """What the images say.

    Attributes
    ----------
    images : RopeImages
    table : Plane or None
    held : int
        The view whose pose is held.
    explanations : list of Explanation
        The best first.
    taken : list of DepthImage
    errors : Errors
        The usual ones, or those of the sensor that is known.
    averaged : int
        So many pixels a side of the views are one of the images.
    scatter : float or None
        Standard deviation of single depths that are independent, metres; None if that was not measured.
    """

    images: RopeImages
    table: Plane | None
    held: int
    explanations: list[Explanation]
    taken: list[DepthImage]
    errors: Errors
    averaged: int = 1
    scatter: float | None = None

    @lazy_property
    def neighbours_alike(self) -> float:
        """How alike errors of neighbouring pixels are in flat surroundings; 0 if none are seen."""
        return neighbours_alike(self.taken)


def read(observed: Observed, config: Config, run: Run) -> Read:
    """Read the images and compare the readings.

    Views without masks are cut from their table by smoothed heights.

    Raises
    ------
    strand.NotEnoughDataError
        If the images show no rope with depth.
    """
    radius = float(observed.radii.values[0])
    held = observed.held
    with run.stage("images"):
        taken = rope_images(observed.views, observed.whole, observed.bounds, 2.0 * radius)
        table = find_table_beside_ropes(taken[held], radius)
        if not any(observed.masked):
            taken = mask_above_table(taken, table, observed.bounds, radius)
        try:
            images = prepare_images(taken, radius)
        except ValueError as error:
            raise NotEnoughDataError(_NO_ROPE) from error
    with run.stage("readings"):
        every = [held] if run.late("readings of all views but one") else range(len(taken))
        readings = find_likely_readings(images, observed.prior.ropes, every)
    errors = Errors()
    if isinstance(config.sensor, Sensor):
        errors = expected_errors(config.sensor, taken, images, radius)
    with run.stage("explain"):
        if run.late("the comparison of readings"):
            readings = readings[:1]
        found = fit_and_rank(images, readings, table, held, errors, config, observed)
    if not found:
        raise NotEnoughDataError(_NO_ROPE)
    return Read(images, table, held, found, taken, errors)


def answer(what: Read, observed: Observed, config: Config, run: Run) -> Found:
    """Make chains of the best explanation, and say what is unsure."""
    best = what.explanations[0]
    radius, radius_sd = float(observed.radii.values[0]), float(observed.radii.sd[0])
    with run.stage("fit images"):
        measured = measured_errors(best.fit, what.errors)
        errors = measured
        if isinstance(config.sensor, Sensor):
            lateral = config.sensor.lateral or measured.lateral
            errors = replace(what.errors, lateral=lateral)
        fit = refit(what.images, best.fit, what.table, what.held, errors, config)
        if (
            what.scatter is not None
            and what.table is not None
            and not run.late("the ropes' ends by the depths of all pixels")
        ):
            # masks do not show ends well there
            noise = mean_noise(what.scatter, what.averaged, radius)
            fit = move_ends(what.images, fit, what.table, noise, radius)
        chains = make_chains(what.images, fit, radius, radius_sd, config)
    rivals = distinct(what.explanations, radius)
    poses = correct_poses([view.pose for view in observed.views], fit.corrections)
    views = [replace(image, pose=pose) for image, pose in zip(what.taken, poses, strict=True)]
    others = [
        *ends_at_strands(fit.nodes, what.scatter or 0.0, radius),
        *wide_masks(what.taken, what.images, radius),
    ]
    if what.scatter is None:
        # where depths scatter, what is before its surroundings was made the mask
        others += ends_that_go_on(views, fit.nodes, fit.noise, radius)
    uncertain = doubts(rivals, fit, chains, views, radius, others)
    chains = sorted(chains, key=lambda chain: -chain.length)
    run.warnings.extend(warn_about_answer(chains, uncertain, None, observed.bounds, config.linking))
    return Found(
        chains,
        poses=poses,
        pose_sd=[np.full(6, np.nan) for _ in observed.views],
        stages={
            "registered": tuple(
                moved(view.points, pose) for view, pose in zip(observed.views, poses, strict=True)
            ),
            "readings": tuple(nodes for one in what.explanations for nodes in one.fit.nodes),
        },
        branch="images",
        doubts=uncertain,
        sensor=_sensor(what, measured, fit, radius),
        alternatives=tuple(
            Alternative(other.cost - best.cost, tuple(other.fit.nodes)) for other in rivals[1:4]
        ),
    )


def _sensor(what: Read, measured: Errors, fit: ImageFit, radius: float) -> Sensor:
    """Return the sensor's errors, those of single pixels."""
    sensor = sensor_of(measured, fit, _correlation(what), what.taken, what.images, radius)
    if what.scatter is None:
        return sensor
    # means of pixels have no step, and are as little alike as the pixels
    lateral = what.averaged * sensor.lateral
    return replace(sensor, sd=what.scatter, correlation=0.0, step=0.0, lateral=lateral)


def _correlation(what: Read) -> float | None:
    """Return `Sensor.correlation`, pixels, of which neighbours have exp(-1 / (4 c^2)); None if not seen."""
    alike = what.neighbours_alike
    if alike == 0.0:
        return None
    return float((-0.25 / np.log(alike)) ** 0.5) if alike > PLAIN else 0.0
