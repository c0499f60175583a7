"""Joint fit of tubes and poses: a typed face of the kernel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strand import _core
from strand.arguments import as_array, flag, positive, positive_array, several, whole
from strand.view import Array, extraction_range, finite_array, float_array, rigid_motion


@dataclass(frozen=True, eq=False)
class EndSighting:
    """Where one view sees a string end.

    Attributes
    ----------
    view : int
    end : int
        Which end; a view sees an end once.
    place : (3,) ndarray
        In the world frame as the reported pose places it, metres.
    outward : (3,) ndarray
        Unit vector along the string, out of it. Across it the place says nothing.
    sd : float
        Standard deviation of the place in that direction, metres.

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If a number is negative, `outward` is not of unit length, or `sd` is not positive.
    """

    view: int
    end: int
    place: Array
    outward: Array
    sd: float

    def __post_init__(self) -> None:
        for name in ("view", "end"):
            object.__setattr__(self, name, whole(name, getattr(self, name)))
        for name in ("place", "outward"):
            object.__setattr__(self, name, finite_array(name, getattr(self, name), (3,)))
        length = float(np.linalg.norm(self.outward))
        if abs(length - 1.0) > 1e-6:
            raise ValueError(f"outward: expected a vector of unit length, got one of length {length}")
        object.__setattr__(self, "sd", positive("sd", self.sd))


@dataclass(frozen=True, eq=False)
class TubeFit:
    """The outcome of a joint fit.

    Attributes
    ----------
    curves : list of (n, 3) ndarray
        Control points of uniform cubic B-splines, metres.
    motions : (V, 4, 4) ndarray
        For each view the rigid motion of the world frame that corrects its reported pose.
    ropes : (C,) ndarray of int64
        For each curve, the number of the rope that it is a piece of.
    radii : (K,) ndarray
        The ropes' radii, metres.
    radii_sd : (K,) ndarray
        Their standard deviations, 0 if they were held, metres; empty if not asked for.
    sigma : float
        Robust standard deviation of the residuals, metres.
    bands : (K,) ndarray
        For each rope, the limit beyond which residuals did not count, metres.
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
    inlier : (N,) ndarray of bool
        Whether it is explained, with a residual within the limit beyond which residuals did not count.
    pose_covariance : (V, 6, 6) ndarray
        Covariance of each correction: rotation vector, radians, and translation of the points' centroid,
        metres; 0 for a view that was held; (0, 6, 6) if not asked for.
    covariances : list of (n, 4, 3, 3) ndarray
        Covariance of each control point with itself and the next three, m^2; empty if curves were held
        or it was not asked for.
    """

    curves: list[Array]
    motions: Array
    ropes: NDArray[np.int64]
    radii: Array
    radii_sd: Array
    sigma: float
    bands: Array
    points: Array
    to_camera: Array
    view: NDArray[np.int64]
    curve: NDArray[np.int64]
    parameter: Array
    residual: Array
    facing: Array
    weight: Array
    explained: NDArray[np.bool_]
    inlier: NDArray[np.bool_]
    pose_covariance: Array
    covariances: list[Array]

    @property
    def pose_sd(self) -> Array:
        """(V, 6) Standard deviations of the corrections."""
        return np.asarray(np.sqrt(self.pose_covariance.diagonal(axis1=1, axis2=2)))

    def radius(self, curve: int) -> float:
        """Radius of a curve's rope, metres."""
        return float(self.radii[self.ropes[curve]])

    def band(self, curve: int) -> float:
        """Limit beyond which residuals from a curve did not count, metres."""
        return float(self.bands[self.ropes[curve]])


def fit_tubes(
    points: Sequence[Array],
    viewpoints: Array,
    curves: Sequence[Array],
    motions: Array,
    radius: ArrayLike,
    *,
    ropes: ArrayLike | None = None,
    pose_sd: tuple[float, float],
    reference: int | None,
    fit_curves: bool = True,
    radius_prior: ArrayLike | None = None,
    along_ray: bool = False,
    band: tuple[float, float] = (0.6, 0.4),
    iterations: int = 12,
    tolerance: float = 0.1,
    min_bend: float = 1.5,
    noise: float | None = None,
    bounds: tuple[Array, Array] | None = None,
    ends: Sequence[EndSighting] = (),
    previous: TubeFit | None = None,
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
    radius : float or (K,) array_like of float
        The strings' radius, or each rope's, metres; the start, if it is fitted.
    ropes : (C,) array_like of int, optional
        For each curve the number of the rope that it is a piece of; all of the first if not given.
    pose_sd : (float, float)
        Standard deviations of the reported poses: rotation, radians, and translation, metres.
    reference : int or None
        The view that stays where it is; None if all stay.
    fit_curves : bool
        Whether curves change.
    radius_prior : (2,) or (K, 2) array_like of float, optional
        What is known of each radius beforehand: mean and standard deviation, metres. Radii are held if it is
        if not given.
    along_ray : bool
        Measure residuals along the viewing rays, times the cosine of the angle of incidence: without bias
        under noise along the ray, but only near the solution.
    band : (float, float)
        Tukey's limit at the first and the last iteration, in radii; never under 4.685 standard deviations
        of the noise, which keep 95 % of the efficiency of least squares.
    iterations : int
        Most Gauss-Newton steps.
    tolerance : float
        After a step of less than this, in standard deviations of the unknowns, there is no other; after one
        of less than 0.1, another changes nothing that the data tell.
    min_bend : float
        The tightest bend of a curve: its radius of curvature, in radii.
    noise : float, optional
        Standard deviation of the sensor's noise along the viewing rays, metres; estimated from the residuals
        if not given.
    bounds : pair of (3,) ndarray, optional
        The extraction range, metres: noise carries points out of it but none in, so points whose place on the
        tube lies within two standard deviations of its faces have no part.
    ends : sequence of EndSighting
        Where views see strings end: fixes them along straight strings.
    previous : TubeFit, optional
        An earlier fit to the same points, from whose curves this one goes on: points start at the feet that
        it found for them.
    uncertainty : bool
        Work out standard deviations and covariances, and hold views at the reported poses in directions that
        the data leave open: where a correction's standard deviation is over 0.71 times the reported pose's.

    Returns
    -------
    TubeFit

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If an array has a wrong shape or is not finite, or a number is out of range.
    strand.NotEnoughDataError
        If the points do not fix the tubes.
    """
    clouds = [
        float_array(f"points[{i}]", cloud, (None, 3))
        for i, cloud in enumerate(several("points", points, "arrays"))
    ]
    centres = float_array("viewpoints", viewpoints, (len(clouds), 3))
    started = [
        float_array(f"curves[{i}]", control, (None, 3))
        for i, control in enumerate(several("curves", curves, "arrays"))
    ]
    corrections = [
        rigid_motion(f"motions[{i}]", motion)
        for i, motion in enumerate(several("motions", motions, "rigid motions"))
    ]
    if reference is not None:
        reference = whole("reference", reference)
        if reference >= len(clouds):
            raise ValueError(f"reference: expected the number of one of {len(clouds)} views, got {reference}")
    pairs = {"pose_sd": positive_array("pose_sd", pose_sd), "band": positive_array("band", band)}
    for name, pair in pairs.items():
        if pair.shape != (2,):
            raise ValueError(f"{name}: expected two numbers, got shape {pair.shape}")
    radii = np.atleast_1d(positive_array("radius", radius))
    if radii.ndim != 1 or not len(radii):
        raise ValueError(f"radius: expected one number or one for each rope, got {radius!r}")
    numbers = np.zeros(len(started), dtype=np.int64) if ropes is None else as_array("ropes", ropes)
    if numbers.shape != (len(started),) or numbers.dtype.kind not in "iu":
        raise ValueError(f"ropes: expected one whole number for each of {len(started)} curves, got {ropes!r}")
    if ((numbers < 0) | (numbers >= len(radii))).any():
        raise ValueError(f"ropes: expected numbers of {len(radii)} ropes, got {ropes!r}")
    prior = None
    if radius_prior is not None:
        prior = np.atleast_2d(positive_array("radius_prior", radius_prior))
        if prior.shape != (len(radii), 2):
            raise ValueError(f"radius_prior: expected shape ({len(radii)}, 2), got {prior.shape}")
    sightings = several("ends", ends, "EndSighting")
    for i, seen in enumerate(sightings):
        if not isinstance(seen, EndSighting):
            raise TypeError(f"ends[{i}]: expected an EndSighting, got {type(seen).__name__}")
        if seen.view >= len(clouds):
            raise ValueError(f"ends[{i}]: expected the number of one of {len(clouds)} views, got {seen.view}")
    if previous is not None:
        if not isinstance(previous, TubeFit):
            raise TypeError(f"previous: expected a TubeFit or None, got {type(previous).__name__}")
        sizes = [len(control) for control in previous.curves]
        if len(previous.points) != sum(map(len, clouds)) or sizes != list(map(len, started)):
            raise ValueError(
                f"previous: expected a fit of {len(started)} curves of as many control points as these to "
                f"{sum(map(len, clouds))} points, got one of {len(sizes)} to {len(previous.points)}"
            )
    return unchecked_fit(
        clouds,
        centres,
        started,
        corrections,
        radii,
        numbers,
        fit_curves=flag("fit_curves", fit_curves),
        radius_prior=prior,
        reference=reference,
        pose_sd=pairs["pose_sd"],
        along_ray=flag("along_ray", along_ray),
        band=pairs["band"],
        iterations=whole("iterations", iterations, 0, 2**63 - 1),
        tolerance=positive("tolerance", tolerance),
        min_bend=positive("min_bend", min_bend),
        noise=None if noise is None else positive("noise", noise),
        bounds=None if bounds is None else extraction_range(bounds),
        ends=sightings,
        previous=previous,
        uncertainty=flag("uncertainty", uncertainty),
    )


def unchecked_fit(
    points: Sequence[Array],
    viewpoints: Array,
    curves: Sequence[Array],
    motions: Sequence[Array] | Array,
    radii: Array,
    ropes: Sequence[int] | NDArray[np.int64],
    *,
    ends: Sequence[EndSighting] = (),
    previous: TubeFit | None = None,
    **how: Any,
) -> TubeFit:
    """Fit as `fit_tubes` does, whose arguments these are, arrays that need no more checks."""
    feet = None
    if previous is not None:
        feet = np.where(np.isfinite(previous.residual), previous.curve, -1), previous.parameter
    found = _core.fit_tubes(
        points,
        viewpoints,
        curves,
        ropes,
        motions,
        radii,
        ends=[(seen.view, seen.end, seen.place, seen.outward, seen.sd) for seen in ends],
        feet=feet,
        **how,
    )
    return TubeFit(ropes=np.asarray(ropes, dtype=np.int64), **found)
