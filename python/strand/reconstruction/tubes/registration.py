"""Registration of the views: point to tube, all views and the curves together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand._core import NotEnoughDataError
from strand.config import Config
from strand.reconstruction.radius import Radii
from strand.reconstruction.stages import Run
from strand.reconstruction.tubes.arcs import fit_arcs, trace
from strand.reconstruction.tubes.clouds import Clouds
from strand.reconstruction.tubes.fitting import ROUGHLY, fitted, splines
from strand.support.checks import Array, check_radius, check_rigid_motion
from strand.views.box import Bounds, extraction_range
from strand.views.view import View, check_views

# arcs of the reference view with fewer nodes are too short to register other views to, if there are others
_REFERENCE_NODES = 8
# so many points of each view tell its pose well enough to trace arcs
_POSED = 250


def registered_roughly(clouds: Clouds, radii: Array, config: Config) -> Array:
    """Corrections of the poses that put all views, best thinned, on the tubes of the reference view."""
    still = np.tile(np.eye(4), (len(clouds.points), 1, 1))
    if len(clouds.points) == 1:
        return still
    alone = Clouds(
        [clouds.points[clouds.reference]], clouds.viewpoints[clouds.reference][None], 0, clouds.bounds
    )
    try:
        arcs = trace(alone, still[:1], radii, 4, config)
    except NotEnoughDataError:
        return still
    long = [len(nodes) >= _REFERENCE_NODES for nodes in arcs.nodes]
    if any(long):
        arcs = arcs.only(long)
    fit = fitted(
        clouds.every(max(sum(map(len, clouds.points)) // (_POSED * len(clouds.points)), 1)),
        splines(arcs, radii, config, 0.0),
        arcs.classes,
        still,
        radii,
        config,
        fit_curves=False,
        band=(1.0, 0.5),
        iterations=10,
        tolerance=ROUGHLY,
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

    Every view's points are matched with tubes around shared curves, whose shape is found with the poses; so
    views from opposite sides do not pull into each other, and directions that the data do not fix stay at the
    reported poses.

    Parameters
    ----------
    views : sequence of View
        Views of ropes alone, outliers removed. The middle one stays where it is.
    radius : float
        The ropes' radius, metres.
    bounds : pair of (3,) array_like, or Box, optional
        The extraction range, metres: low and high corner of a box along the axes of the world frame, or a
        `strand.Box`, which may be turned; views are
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
    views, radius = check_views(views), check_radius(radius)
    if not isinstance(config, Config):
        raise TypeError(f"config: expected a Config, got {config!r}")
    if bounds is not None:
        views = [view.crop(bounds) for view in views]
    clouds = Clouds.of(views, None if bounds is None else extraction_range(bounds))
    radii = Radii.from_caller(radius, config.known)
    few = clouds.thinned(radius)
    motions = registered_roughly(few, radii.values, config)
    fit, _ = fit_arcs(clouds, few, motions, radii, config, Run(None), uncertainty=True)
    poses = [
        check_rigid_motion("pose", motion @ view.pose)
        for motion, view in zip(fit.motions, views, strict=True)
    ]
    return np.array(poses), fit.pose_sd
