"""Register all views together with the curves, by the distances of points from tubes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand._core import NotEnoughDataError
from strand.config import Config
from strand.reconstruction.radius import Radii
from strand.reconstruction.stages import Run
from strand.reconstruction.tubes.arcs import fit_arcs, trace_arcs
from strand.reconstruction.tubes.clouds import Clouds
from strand.reconstruction.tubes.fitting import ROUGH_TOLERANCE, fit_curves, make_splines
from strand.support.checks import Array, check_instance, check_radius, check_rigid_motion
from strand.views.box import Bounds, make_box
from strand.views.view import View, check_views

_REFERENCE_NODES = 8  # arcs of the reference view with fewer are dropped, if longer ones remain
_POSE_POINTS = 250  # of each view: enough to register it for tracing


def register_roughly(clouds: Clouds, radii: Array, config: Config) -> Array:
    """Return (V, 4, 4) motions that put all views, best thinned, on the tubes of the reference view."""
    still = np.tile(np.eye(4), (len(clouds.points), 1, 1))
    if len(clouds.points) == 1:
        return still
    alone = Clouds(
        [clouds.points[clouds.reference]], clouds.viewpoints[clouds.reference][None], 0, clouds.bounds
    )
    try:
        arcs = trace_arcs(alone, still[:1], radii, 4, config)
    except NotEnoughDataError:
        return still
    is_long = [len(nodes) >= _REFERENCE_NODES for nodes in arcs.nodes]
    if any(is_long):
        arcs = arcs.select(is_long)
    fit = fit_curves(
        clouds.thin(max(sum(map(len, clouds.points)) // (_POSE_POINTS * len(clouds.points)), 1)),
        make_splines(arcs, radii, config, 0.0),
        arcs.classes,
        still,
        radii,
        config,
        fit_curves=False,
        band=(1.0, 0.5),
        iterations=10,
        tolerance=ROUGH_TOLERANCE,
        uncertainty=False,
    )
    return fit.motions


def register_views(
    views: Sequence[View],
    radius: float,
    bounds: Bounds | None = None,
    config: Config | None = None,
) -> tuple[Array, Array]:
    """Register all views of ropes together.

    The points of every view are fitted to tubes around shared curves, together with the poses. So views from
    opposite sides do not pull into each other. A direction that the points do not fix stays as reported.

    Parameters
    ----------
    views : sequence of View
        Views that show ropes only, without outliers. The pose of the middle one stays as reported.
    radius : float
        The ropes' radius, metres.
    bounds : pair of (3,) array_like, or Box, optional
        The extraction range to which views are cropped: low and high corner of a box along the axes of the
        world frame, metres, or a `strand.Box`, which may be turned.
    config : Config, optional
        Its `poses` say how exact the reported poses are.

    Returns
    -------
    poses : (V, 4, 4) ndarray
        Camera-to-world poses.
    pose_sd : (V, 6) ndarray
        Standard deviations of the corrections in the world frame: rotation vector, radians, and translation
        of the points' centroid, metres; 0 for the middle view. They are near those of the reported poses
        where the points leave a direction open.

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If there are no views, or `radius` or `bounds` are out of range.
    strand.NotEnoughDataError
        If the points show no tube of this radius.
    """
    config = Config() if config is None else config
    views, radius = check_views(views), check_radius(radius)
    check_instance("config", config, Config)
    if bounds is not None:
        views = [view.crop(bounds) for view in views]
    clouds = Clouds.from_views(views, None if bounds is None else make_box(bounds))
    radii = Radii.from_caller(radius, config.known)
    few = clouds.thin_for_tracing(radius)
    motions = register_roughly(few, radii.values, config)
    fit, _ = fit_arcs(clouds, few, motions, radii, config, Run(None), uncertainty=True)
    poses = [
        check_rigid_motion("pose", motion @ view.pose)
        for motion, view in zip(fit.motions, views, strict=True)
    ]
    return np.array(poses), fit.pose_sd
