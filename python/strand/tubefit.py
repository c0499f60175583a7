"""Joint fit of tubes and poses: a typed face of the kernel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from strand import _core
from strand.view import Array, extraction_range, moved


@dataclass(frozen=True, eq=False)
class TubeFit:
    """The outcome of a joint fit.

    Attributes
    ----------
    curves : list of (n, 3) ndarray
        Control points of uniform cubic B-splines, metres.
    motions : (V, 4, 4) ndarray
        For each view the rigid motion of the world frame that corrects its reported pose.
    radius, radius_sd : float
        The radius and its standard deviation (0 if it was held, or not asked for), metres.
    sigma : float
        Robust standard deviation of the residuals, metres.
    band : float
        The limit beyond which residuals did not count, metres.
    points, to_camera : (N, 3) ndarray
        All views' points where the corrected poses place them, metres, and the unit vectors to their
        cameras.
    view, curve : (N,) ndarray of int64
        Which view saw each point, and which curve explains it best.
    parameter : (N,) ndarray
        The parameter of the curve at its foot.
    residual : (N,) ndarray
        Distance from the surface, metres.
    facing : (N,) ndarray
        Cosine between the surface normal and the direction to the camera.
    weight : (N,) ndarray
        Its weight in the fit.
    explained : (N,) ndarray of bool
        Whether it is where the tube could have been seen.
    pose_sd : (V, 6) ndarray
        Standard deviations of each correction: rotation vector, radians, and translation, metres; 0 for a
        view that was held; (0, 6) if not asked for.
    covariances : list of (n, 4, 3, 3) ndarray
        Covariance of each control point with itself and the next three, m^2; empty if curves were held
        or it was not asked for.
    """

    curves: list[Array]
    motions: Array
    radius: float
    radius_sd: float
    sigma: float
    band: float
    points: Array
    to_camera: Array
    view: NDArray[np.int64]
    curve: NDArray[np.int64]
    parameter: Array
    residual: Array
    facing: Array
    weight: Array
    explained: NDArray[np.bool_]
    pose_sd: Array
    covariances: list[Array]


def fit_tubes(
    points: Sequence[Array],
    viewpoints: Array,
    curves: Sequence[Array],
    motions: Array,
    radius: float,
    *,
    pose_sd: tuple[float, float],
    reference: int | None,
    fit_curves: bool = True,
    fit_radius: bool = False,
    along_ray: bool = False,
    band: tuple[float, float] = (0.6, 0.4),
    iterations: int = 12,
    bounds: tuple[Array, Array] | None = None,
    uncertainty: bool = True,
) -> TubeFit:
    """Fit tubes around curves to the points of all views, together with the views' poses.

    Gauss-Newton on each point's distance from the tube's surface with Tukey's loss. Opposite half-shells of a
    tube, which pull into each other when points are matched with points, are told apart by construction; what
    the data do not fix (sliding along a straight string) stays at the reported poses.

    Parameters
    ----------
    points : sequence of (N_v, 3) ndarray
        What each view saw, in the world frame of the reported poses, metres.
    viewpoints : (V, 3) ndarray
        The cameras' centres as reported, metres.
    curves : sequence of (n, 3) ndarray
        Control points to start from, metres, n >= 4.
    motions : (V, 4, 4) ndarray
        Corrections of the poses to start from.
    radius : float
        The strings' radius, metres; the start, if it is fitted.
    pose_sd : (float, float)
        Standard deviations of the reported poses: rotation, radians, and translation, metres.
    reference : int or None
        The view that stays where it is; None if all stay.
    fit_curves, fit_radius : bool
        Whether curves and radius change.
    along_ray : bool
        Measure residuals along the viewing rays, times the cosine of the angle of incidence: without bias
        under noise along the ray, but only near the solution.
    band : (float, float)
        Tukey's limit at the first and the last iteration, in radii; never under three standard deviations.
    iterations : int
        Most Gauss-Newton steps.
    bounds : pair of (3,) ndarray, optional
        The extraction range, metres: noise carries points out of it but none in, so points whose place on the
        tube lies within two standard deviations of its faces have no part.
    uncertainty : bool
        Work out standard deviations and covariances.

    Returns
    -------
    TubeFit

    Raises
    ------
    ValueError
        If an array has a wrong shape or is not finite, or a number is out of range.
    strand.NotEnoughDataError
        If the points do not fix the tubes.
    """
    if reference is not None and not 0 <= reference < len(points):
        raise ValueError(f"reference: expected the number of one of {len(points)} views, got {reference}")
    if iterations < 0:
        raise ValueError(f"iterations: expected at least 0, got {iterations}")
    for name, pair in (("pose_sd", pose_sd), ("band", band)):
        if len(pair) != 2:
            raise ValueError(f"{name}: expected two numbers, got {len(pair)}")
    box = None if bounds is None else extraction_range(bounds)
    found = _core.fit_tubes(
        list(points),
        viewpoints,
        list(curves),
        list(motions),
        radius,
        fit_curves=fit_curves,
        fit_radius=fit_radius,
        reference=reference,
        pose_sd=list(pose_sd),
        along_ray=along_ray,
        band=list(band),
        iterations=iterations,
        bounds=None if box is None else [corner.tolist() for corner in box],
        uncertainty=uncertainty,
    )
    placed, directions = [], []
    for cloud, centre, motion in zip(points, viewpoints, found["motions"], strict=True):
        placed.append(moved(cloud, motion))
        to_camera = moved(centre[None], motion) - placed[-1]
        distance = np.linalg.norm(to_camera, axis=1, keepdims=True)
        directions.append(to_camera / np.maximum(distance, np.finfo(np.float64).tiny))
    return TubeFit(
        points=np.concatenate(placed),
        to_camera=np.concatenate(directions),
        view=np.repeat(np.arange(len(points)), [len(cloud) for cloud in points]),
        **found,
    )
