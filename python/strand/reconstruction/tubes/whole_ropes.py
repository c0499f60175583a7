"""Whole ropes: fitted with the poses along the viewing rays, and cut to where they end."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from strand._core import EndObservation, TubeFit
from strand.config import Config
from strand.geometry.curve import Curve
from strand.reconstruction.evidence.prior import Prior
from strand.reconstruction.radius import Radii, group_radii
from strand.reconstruction.stages import Run
from strand.reconstruction.tubes.clouds import Arcs, Clouds
from strand.reconstruction.tubes.end_observations import observed_ends
from strand.reconstruction.tubes.fitting import ROPE_MARGIN, ROUGHLY, fitted, splines
from strand.reconstruction.tubes.known_length import as_long
from strand.reconstruction.tubes.noise import Noise, measured_noise
from strand.reconstruction.tubes.pixels import Cameras
from strand.reconstruction.tubes.tube_ends import extents


def fit_ropes(
    clouds: Clouds,
    cameras: Cameras,
    ropes: Arcs,
    closed: Sequence[bool],
    before: TubeFit,
    radii: Radii,
    given: Noise | None,
    config: Config,
    run: Run,
) -> tuple[TubeFit, Noise, list[EndObservation]]:
    """Fit whole ropes with the poses along the rays, then again to where views see them end.

    Radii that are free are first each rope's own; ropes whose radii agree then share one.

    Parameters
    ----------
    clouds : Clouds
    cameras : Cameras
        What took their points.
    ropes : Arcs
    closed : sequence of bool
        Which of them are rings.
    before : TubeFit
        The fit of the arcs that they were made of.
    radii : Radii
    given : Noise or None
        What the sensor's errors are known to be.
    config : Config
    run : Run
        Its deadline leaves out the second fit, and radii that are free stay each rope's own.

    Returns
    -------
    TubeFit
    Noise
        As measured on the first of the fits. The deviations of the second are for it if none is given.
    list of EndObservation
        Where views saw the ropes of the first end.
    """
    classes, start = ropes.classes, before.radii
    if radii.free:
        classes, start, radii = list(range(len(classes))), start[classes], radii.select(classes)
    curves, motions = splines(ropes, before.radii, config, ROPE_MARGIN), before.motions
    ends: list[EndObservation] = []
    fit: TubeFit | None = None

    def fit_again(uncertainty: bool, noise: Noise | None = None) -> TubeFit:
        known: dict[str, Any] = {}
        if noise is not None and noise.correlation > 0.0:
            known = {"noise": config.tubes.noise or noise.sd, "shared": noise.shared}
        return fitted(
            clouds,
            curves,
            classes,
            motions,
            start,
            config,
            radius_prior=radii.prior,
            along_ray=True,
            band=(0.5, 0.5),
            iterations=30 if radii.free else 20,
            tolerance=0.1 if uncertainty else ROUGHLY,
            bounds=clouds.hull if radii.free else None,
            end_observations=ends,
            previous=fit,
            uncertainty=uncertainty,
            **known,
        )

    once = run.skips("the last fit of the ropes")
    fit = fit_again(uncertainty=radii.free or once, noise=given if once else None)
    measured = measured_noise(fit, cameras, config.tubes.spacing)
    if once:
        return fit, measured, ends
    ends = observed_ends(
        fit,
        extents(fit, exclusive=True),
        closed,
        clouds.viewpoints,
        clouds.bounds,
        config.poses.translation_sd,
    )
    curves, motions, start = fit.curves, fit.motions, fit.radii
    if radii.free:
        classes = group_radii(fit.radii, fit.radii_sd)
        first = [classes.index(number) for number in range(max(classes) + 1)]
        start, radii = start[first], radii.select(first)
    return fit_again(uncertainty=True, noise=given or measured), measured, ends


def rope_parts(
    fit: TubeFit, ropes: Arcs, closed: Sequence[bool], before: TubeFit, prior: Prior, config: Config
) -> list[Curve | None]:
    """Cut fitted ropes to where their points end, rings to once round; bow those of known length.

    Parameters
    ----------
    fit : TubeFit
        Of `fit_ropes`.
    ropes, closed, before, config
        What it was fitted from.
    prior : Prior

    Returns
    -------
    list of (Curve or None)
        The stretch of each curve that is rope; None for one that hardly any point supports.
    """
    parts = extents(fit, exclusive=True)
    for i, control in enumerate(fit.curves):
        if closed[i]:
            parts[i] = _once_round(Curve.whole(control), ROPE_MARGIN * fit.radius(i))
    if not prior.lengths:
        return parts
    return as_long(fit, splines(ropes, before.radii, config, ROPE_MARGIN), parts, prior)


def _once_round(curve: Curve, margin: float) -> Curve:
    """Return the stretch of a closed rope's curve from `margin`, metres, to where it is there again."""
    start = curve.at([margin])[0]
    late = np.linspace(curve.length - 3.0 * margin, curve.length, 400)
    stop = late[np.linalg.norm(curve.at(late)[0] - start, axis=1).argmin()]
    return curve.trimmed(margin, float(stop))
