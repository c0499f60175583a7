"""Fit whole ropes with the poses along the viewing rays, and cut them to where they end."""

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
from strand.reconstruction.tubes.end_observations import observe_ends
from strand.reconstruction.tubes.fitting import ROPE_MARGIN, ROUGH_TOLERANCE, fit_curves, make_splines
from strand.reconstruction.tubes.known_length import lengthen
from strand.reconstruction.tubes.noise import Noise, measure_noise
from strand.reconstruction.tubes.pixels import Cameras
from strand.reconstruction.tubes.tube_ends import find_extents

_ROUGH_STEPS = 10  # steps of the first fit, with given radii
_STEPS = 20  # steps of the last one
_STEPS_OF_RADII = 30  # steps of both with free radii


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

    Free radii are first each rope's own. Ropes whose radii agree then share one.

    Parameters
    ----------
    clouds : Clouds
    cameras : Cameras
        The cameras that took their points.
    ropes : Arcs
    closed : sequence of bool
        Which of them are rings.
    before : TubeFit
        The fit of the arcs that the ropes were made of.
    radii : Radii
    given : Noise or None
        The noise of a known sensor.
    config : Config
    run : Run
        Past its deadline, the first fit is the last, and free radii stay each rope's own.

    Returns
    -------
    fit : TubeFit
    noise : Noise
        Measured on the first fit. Without a known sensor, the last fit's deviations count it.
    ends : list of EndObservation
        Where views see the ropes of the first fit end.
    """
    classes, start = ropes.classes, before.radii
    if radii.free:
        classes, start, radii = list(range(len(classes))), start[classes], radii.select(classes)
    curves, motions = make_splines(ropes, before.radii, config, ROPE_MARGIN), before.motions
    ends: list[EndObservation] = []
    fit: TubeFit | None = None

    def fit_again(uncertainty: bool, noise: Noise | None = None) -> TubeFit:
        known: dict[str, Any] = {}
        if noise is not None and noise.correlation > 0.0:
            known = {"noise": config.tubes.noise or noise.sd, "shared": noise.shared}
        return fit_curves(
            clouds,
            curves,
            classes,
            motions,
            start,
            config,
            radius_prior=radii.prior,
            along_ray=True,
            band=(0.5, 0.5),
            iterations=_STEPS_OF_RADII if radii.free else _STEPS if uncertainty else _ROUGH_STEPS,
            tolerance=0.1 if uncertainty else ROUGH_TOLERANCE,
            bounds=clouds.hull if radii.free else None,
            end_observations=ends,
            previous=fit,
            uncertainty=uncertainty,
            **known,
        )

    once = run.skips("the last fit of the ropes")
    fit = fit_again(uncertainty=radii.free or once, noise=given if once else None)
    measured = measure_noise(fit, cameras, config.tubes.spacing)
    if once:
        return fit, measured, ends
    ends = observe_ends(
        fit,
        find_extents(fit, exclusive=True),
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


def cut_to_ropes(
    fit: TubeFit, ropes: Arcs, closed: Sequence[bool], before: TubeFit, prior: Prior, config: Config
) -> list[Curve | None]:
    """Cut the curves of `fit_ropes` to where their points end, and raise the bows of known lengths.

    A ring is cut to one turn. The result is None for a curve that hardly any point supports.
    """
    parts = find_extents(fit, exclusive=True)
    for i, control in enumerate(fit.curves):
        if closed[i]:
            parts[i] = cut_to_one_turn(Curve.whole(control), ROPE_MARGIN * fit.radius(i))
    if not prior.lengths:
        return parts
    return lengthen(fit, make_splines(ropes, before.radii, config, ROPE_MARGIN), parts, prior)


def cut_to_one_turn(curve: Curve, margin: float) -> Curve:
    """Return the stretch of a closed rope's curve from `margin`, metres, to where it returns there."""
    start = curve.at([margin])[0]
    late = np.linspace(curve.length - 3.0 * margin, curve.length, 400)
    stop = late[np.linalg.norm(curve.at(late)[0] - start, axis=1).argmin()]
    return curve.trimmed(margin, float(stop))
