"""Tubes traced through oriented points and fitted together with the poses: the default method."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from strand import _core
from strand._core import NotEnoughDataError
from strand.config import Config, Poses
from strand.curve import Curve
from strand.ends import string_parts
from strand.linking import link, part_at_contacts
from strand.stages import Found, Run
from strand.support import described
from strand.topology import path_length
from strand.tubefit import TubeFit, fit_tubes
from strand.view import Array, View, checked_radius, checked_views, extraction_range, moved, rigid_motion

# arcs of the reference view with fewer nodes are too short to register other views to, if there are others
_REFERENCE_NODES = 8
# mean number of points in a cube of two radii that is enough to trace arcs; strings are fitted to all points
_ENOUGH = 20
# how far splines are carried on beyond their arcs, in radii, so that the points can say where the end is
_ARC_MARGIN, _STRING_MARGIN = 1.0, 2.0

# share of the points on strings under which something is amiss
_USUAL_SHARE = 0.92

Bounds = tuple[Array, Array] | None


@dataclass(frozen=True, eq=False)
class Clouds:
    """What the fit works on: every view's points in the world frame as reported.

    Attributes
    ----------
    points : list of (N_v, 3) ndarray
        Metres.
    viewpoints : (V, 3) ndarray
        The cameras' centres, metres.
    reference : int
        The view that stays where it is.
    bounds : pair of (3,) ndarray or None
        The extraction range that the points were cut to, metres.
    """

    points: list[Array]
    viewpoints: Array
    reference: int
    bounds: Bounds

    @classmethod
    def of(cls, views: Sequence[View], bounds: Bounds) -> Clouds:
        """Return the views' points; the middle view is the reference."""
        viewpoints = np.array([view.viewpoint for view in views])
        return cls([view.world_points for view in views], viewpoints, len(views) // 2, bounds)

    def thinned(self, radius: float) -> Clouds:
        """Return every n-th point of each view, n as large as tracing allows."""
        cells = np.floor(np.concatenate(self.points) / (2.0 * radius)).astype(np.int64)
        # cells far apart may share a number, which hardly changes how many there are
        occupied = len(np.unique(cells @ np.array([1, 1 << 20, 1 << 40])))
        step = max(round(len(cells) / (_ENOUGH * occupied)), 1)
        return replace(self, points=[cloud[::step] for cloud in self.points])


def trace(clouds: Clouds, motions: Array, radius: float, min_nodes: int) -> list[Array]:
    """Trace arcs through the points of all views at corrected poses."""
    points = [moved(cloud, motion) for cloud, motion in zip(clouds.points, motions, strict=True)]
    cameras = [
        np.tile(moved(centre[None], motion), (len(cloud), 1))
        for centre, motion, cloud in zip(clouds.viewpoints, motions, clouds.points, strict=True)
    ]
    arcs = _core.trace_tubes(np.concatenate(points), np.concatenate(cameras), radius, min_nodes=min_nodes)
    return [nodes for nodes, _ in arcs]


def registered_roughly(clouds: Clouds, radius: float, config: Config) -> Array:
    """Corrections of the poses that put all views on the tubes of the reference view."""
    still = np.tile(np.eye(4), (len(clouds.points), 1, 1))
    if len(clouds.points) == 1:
        return still
    clouds = clouds.thinned(radius)
    alone = Clouds(
        [clouds.points[clouds.reference]], clouds.viewpoints[clouds.reference][None], 0, clouds.bounds
    )
    arcs = trace(alone, still[:1], radius, min_nodes=4)
    arcs = [arc for arc in arcs if len(arc) >= _REFERENCE_NODES] or arcs
    if not arcs:
        return still
    curves = [_core.spline_through(arc, config.tubes.spacing * radius, 0.0) for arc in arcs]
    fit = fit_tubes(
        clouds.points,
        clouds.viewpoints,
        curves,
        still,
        radius,
        pose_sd=_pose_sd(config),
        reference=clouds.reference,
        fit_curves=False,
        band=(1.0, 0.5),
        iterations=10,
        uncertainty=False,
    )
    return fit.motions


def fit_arcs(
    clouds: Clouds,
    motions: Array,
    radius: float,
    config: Config,
    *,
    fit_radius: bool = False,
    uncertainty: bool = False,
) -> TubeFit:
    """Trace arcs and fit them with the poses, more than once.

    Raises
    ------
    strand.NotEnoughDataError
        If there is nothing like a tube of this radius in the points.
    """
    fit, few = None, clouds.thinned(radius)
    for last in (False,) * (config.tubes.rounds - 1) + (True,):
        arcs = trace(few, motions, radius, min_nodes=3)
        if not arcs:
            raise NotEnoughDataError("views: the points make no tube; is the radius right, in metres?")
        margin, spacing = _ARC_MARGIN * radius, config.tubes.spacing * radius
        used = clouds if last else few
        fit = fit_tubes(
            used.points,
            clouds.viewpoints,
            [_core.spline_through(arc, spacing, margin) for arc in arcs],
            motions,
            radius,
            pose_sd=_pose_sd(config),
            reference=_free(clouds),
            fit_radius=fit_radius and last,
            iterations=12 if last else 8,
            bounds=clouds.bounds if fit_radius else None,
            uncertainty=uncertainty and last,
        )
        motions, radius = fit.motions, fit.radius
    assert fit is not None
    return fit


def fit_strings(
    clouds: Clouds, chains: Sequence[Array], motions: Array, radius: float, config: Config, fit_radius: bool
) -> TubeFit:
    """Fit whole strings with the poses, along the rays."""
    margin, spacing = _STRING_MARGIN * radius, config.tubes.spacing * radius
    return fit_tubes(
        clouds.points,
        clouds.viewpoints,
        [_core.spline_through(nodes, spacing, margin) for nodes in chains],
        motions,
        radius,
        pose_sd=_pose_sd(config),
        reference=_free(clouds),
        fit_radius=fit_radius,
        along_ray=True,
        band=(0.5, 0.5),
        iterations=20,
        bounds=clouds.bounds if fit_radius else None,
    )


def find_strings(
    views: Sequence[View],
    numbers: Sequence[int],
    bounds: Bounds,
    radius: float,
    config: Config,
    run: Run,
    fit_radius: bool,
) -> Found:
    """Trace, register, fit and link on filtered views that all see something.

    Parameters
    ----------
    views : sequence of View
    numbers : sequence of int
        What each is called in warnings.
    bounds : pair of (3,) ndarray or None
        The extraction range that they were cut to, metres.
    radius : float
        Metres; the start, if it is fitted.
    config : Config
    run : Run
    fit_radius : bool
        Whether the radius is fitted too.

    Returns
    -------
    Found
        Its stages are "registered" (points at the corrected poses), "arcs" (what was seen of the strings
        before they were linked) and "fit" (the last `TubeFit`).

    Raises
    ------
    strand.NotEnoughDataError
        If there is nothing like a tube of this radius in the points.
    """
    clouds = Clouds.of(views, bounds)
    with run.stage("register"):
        motions = registered_roughly(clouds, radius, config)
    with run.stage("arcs"):
        fit = fit_arcs(clouds, motions, radius, config, fit_radius=fit_radius)
        radius = fit.radius
        parts = [part for part in string_parts(fit, exclusive=False) if part is not None]
        arcs = [
            part.at(part.nodes(0.5 * radius))[0]
            for part in parts
            if part.length > config.tubes.min_arc * radius
        ]
    with run.stage("link"):
        linked = link(part_at_contacts(arcs, radius, config.linking), radius, config.linking)
        linked = [pair for pair in linked if path_length(pair[0])[-1] > config.linking.min_length * radius]
        if not linked:
            raise NotEnoughDataError("views: the points make no string; is the radius right, in metres?")
    with run.stage("fit"):
        fit = fit_strings(clouds, [nodes for nodes, _ in linked], fit.motions, radius, config, fit_radius)
    with run.stage("ends"):
        closed = [ring for _, ring in linked]
        found = string_parts(fit, exclusive=True)
        for i, control in enumerate(fit.curves):
            if closed[i]:
                found[i] = _once_round(Curve.whole(control), _STRING_MARGIN * radius)
        chains = described(fit, found, closed, config)
    share = float((fit.explained & (np.abs(fit.residual) < fit.band)).mean())
    if share < _USUAL_SHARE:
        run.warnings.append(
            f"only {share:.0%} of the points lie on the strings found: is the radius right, and does the "
            "extraction range leave out everything else?"
        )
    _warn_of_open_poses(fit, numbers, config.poses, run)
    ends = np.cumsum([len(cloud) for cloud in clouds.points])[:-1]
    stages = {"registered": tuple(np.split(fit.points, ends)), "arcs": tuple(arcs), "fit": fit}
    poses = [motion @ view.pose for motion, view in zip(fit.motions, views, strict=True)]
    return Found(chains, poses, list(fit.pose_sd), stages)


def register_views(
    views: Sequence[View],
    radius: float,
    bounds: tuple[ArrayLike, ArrayLike] | None = None,
    config: Config | None = None,
) -> tuple[Array, Array]:
    """Register all views of strings together.

    Every view's points are matched with tubes around shared curves, whose shape is found with the poses; so
    views from opposite sides do not pull into each other, and directions that the data do not fix stay at the
    reported poses.

    Parameters
    ----------
    views : sequence of View
        Views of strings alone, outliers removed. The middle one stays where it is.
    radius : float
        The strings' radius, metres.
    bounds : pair of (3,) array_like, optional
        The extraction range: low and high corner of an axis-aligned box in the world frame, metres; views are
        cropped to it.
    config : Config, optional
        Its `poses` say how well the reported poses are known.

    Returns
    -------
    poses : (V, 4, 4) ndarray
        Camera-to-world poses.
    pose_sd : (V, 6) ndarray
        Standard deviations of the corrections in the world frame: rotation vector, radians, and translation,
        metres, of the points' centroid; 0 for the middle view. Near the reported poses' own where the data
        leave a direction open.

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If there are no views, or `radius` or `bounds` are out of range.
    strand.NotEnoughDataError
        If there is nothing like a tube of this radius in the points.
    """
    config = Config() if config is None else config
    views, radius = checked_views(views), checked_radius(radius)
    if not isinstance(config, Config):
        raise TypeError(f"config: expected a Config, got {config!r}")
    if bounds is not None:
        views = [view.crop(bounds) for view in views]
    clouds = Clouds.of(views, None if bounds is None else extraction_range(bounds))
    motions = registered_roughly(clouds, radius, config)
    fit = fit_arcs(clouds, motions, radius, config, uncertainty=True)
    poses = [
        rigid_motion("pose", motion @ view.pose) for motion, view in zip(fit.motions, views, strict=True)
    ]
    return np.array(poses), fit.pose_sd


def _once_round(curve: Curve, margin: float) -> Curve:
    """Return the stretch of a closed string's curve from `margin`, metres, to where it is there again."""
    start = curve.at([margin])[0]
    late = np.linspace(curve.length - 3.0 * margin, curve.length, 400)
    stop = late[np.linalg.norm(curve.at(late)[0] - start, axis=1).argmin()]
    return curve.part(margin, float(stop))


def _pose_sd(config: Config) -> tuple[float, float]:
    return config.poses.rotation_sd, config.poses.translation_sd


def _free(clouds: Clouds) -> int | None:
    """Return the reference view, or None where it is the only one: then no pose is free."""
    return clouds.reference if len(clouds.points) > 1 else None


def _warn_of_open_poses(fit: TubeFit, numbers: Sequence[int], poses: Poses, run: Run) -> None:
    """Name the views with a direction that the data hardly fix."""
    limits = np.repeat([poses.rotation_sd, poses.translation_sd], 3)
    for number, sd in zip(numbers, fit.pose_sd, strict=True):
        if (sd > 0.8 * limits).any():
            kinds = [
                ("rotation", (sd[:3] > 0.8 * limits[:3]).any()),
                ("translation", (sd[3:] > 0.8 * limits[3:]).any()),
            ]
            what = " and ".join(name for name, is_open in kinds if is_open)
            run.warnings.append(
                f"view {number}: the data leave a direction of its {what} open; it stays as reported there"
            )
