"""Arcs: stretches of rope traced in the points of all views and fitted together with the poses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

import strand._core as _core
from strand._core import NotEnoughDataError, TubeFit
from strand.config import Config
from strand.reconstruction.radius import Radii, group_radii
from strand.reconstruction.stages import Run
from strand.reconstruction.tubes.clouds import Arcs, Clouds
from strand.reconstruction.tubes.fitting import ROUGH_TOLERANCE, fit_curves, make_splines
from strand.reconstruction.tubes.radius_choice import choose_arcs
from strand.reconstruction.tubes.second_look import trace_unexplained
from strand.reconstruction.tubes.tube_ends import find_extents
from strand.support.checks import Array
from strand.views.pose import moved, moved_by_each

_SETTLED = 0.15  # radii: arcs are not traced again if the fit moved all points by less
_MAX_ARCS = 1000  # of one radius: more are no ropes
_ARC_MARGIN = 1.0  # radii: splines extend beyond their arcs, so that the points show where the end is


def trace_arcs(clouds: Clouds, motions: Array, radii: Array, min_nodes: int, config: Config) -> Arcs:
    """Trace arcs of each radius through the points of all views at corrected poses."""
    points = [moved(cloud, motion) for cloud, motion in zip(clouds.points, motions, strict=True)]
    centers = moved_by_each(clouds.viewpoints[:, None], motions)[:, 0]
    cameras = np.repeat(centers, list(map(len, points)), axis=0)
    together = np.concatenate(points)
    nodes, classes = [], []
    for number, radius in enumerate(radii):
        arcs = _core.trace_tubes(together, cameras, radius, min_nodes=min_nodes)
        nodes += [arc for arc, _ in arcs]
        classes += [number] * len(arcs)
        if len(arcs) > _MAX_ARCS:
            raise NotEnoughDataError(
                f"views: {len(arcs)} pieces look like rope of radius {radius:.3g} m, at most {_MAX_ARCS} can "
                "be joined; is the radius right, and do bounds exclude everything else?"
            )
    if not nodes:
        raise NotEnoughDataError("views: the points make no tube; is the radius right, in metres?")
    return keep_explaining(clouds, motions, radii, Arcs(nodes, classes), config)


def keep_explaining(clouds: Clouds, motions: Array, radii: Array, arcs: Arcs, config: Config) -> Arcs:
    """Return the arcs that together explain the points best, if there are several radii."""
    if len(radii) == 1:
        return arcs

    def fit_some(numbers: list[int]) -> TubeFit:
        some = arcs.select([number in numbers for number in range(len(arcs.nodes))])
        curves = make_splines(some, radii, config, 0.0)
        still: dict[str, Any] = {"fit_curves": False, "iterations": 0, "uncertainty": False}
        return fit_curves(clouds, curves, some.classes, motions, radii, config, **still)

    return arcs.select(choose_arcs(arcs.classes, radii, fit_some))


def fit_arcs(
    clouds: Clouds,
    few: Clouds,
    motions: Array,
    radii: Radii,
    config: Config,
    run: Run,
    *,
    uncertainty: bool = False,
) -> tuple[TubeFit, Radii]:
    """Trace arcs and fit them with the poses, again if the poses were far off; free radii are fitted last.

    Parameters
    ----------
    clouds : Clouds
    few : Clouds
        The same, thinned for tracing.
    motions : (V, 4, 4) ndarray
        Corrections of the poses to start from.
    radii : Radii
    config : Config
    run : Run
        Past its deadline, the first fit is the last.
    uncertainty : bool
        Whether to compute standard deviations.

    Returns
    -------
    fit : TubeFit
    radii : Radii
        Those that some arc has.
    """
    # with several given radii, the points decide in the end which one an arc has
    several_given = len(radii.values) > 1 and not radii.free and not radii.held
    for _ in range(config.tubes.rounds):
        arcs = trace_arcs(few, motions, radii.values, 3, config)
        if not several_given:
            radii, arcs = _drop_unused_radii(radii, arcs)
        fit = fit_curves(
            clouds,
            make_splines(arcs, radii.values, config, _ARC_MARGIN),
            arcs.classes,
            motions,
            radii.values,
            config,
            iterations=12,
            tolerance=0.1 if uncertainty else ROUGH_TOLERANCE,
            bounds=clouds.hull if radii.free else None,
            uncertainty=uncertainty,
        )
        shift = _core.measure_shift(few.points, motions, fit.motions)
        motions = fit.motions
        if shift < _SETTLED * float(radii.values.min()) or run.skips("arcs traced again at better poses"):
            break
    if several_given:
        return _fit_classes(clouds, arcs, fit, radii, config, uncertainty)
    if not radii.free or run.skips("radii fitted to the points"):
        return fit, radii
    fit = _fit_radii(clouds, fit, arcs.classes, fit.radii, radii.prior, config)
    classes = group_radii(fit.radii, np.zeros(len(fit.radii)))
    if len(set(classes)) < len(classes):
        # strands side by side looked like a thicker rope
        first = [classes.index(number) for number in range(max(classes) + 1)]
        radii = radii.select(first)
        few = clouds.thin_for_tracing(float(radii.values.min()))
        return fit_arcs(clouds, few, fit.motions, radii, config, run, uncertainty=uncertainty)
    return fit, radii


def _fit_radii(
    clouds: Clouds, fit: TubeFit, classes: Sequence[int], start: Array, prior: Array | None, config: Config
) -> TubeFit:
    """Fit again with unknown radii, which only residuals along the rays do not bias."""
    return fit_curves(
        clouds,
        fit.curves,
        classes,
        fit.motions,
        start,
        config,
        radius_prior=prior,
        along_ray=True,
        band=(0.8, 0.5),
        iterations=30,
        bounds=clouds.hull,
        uncertainty=False,
    )


def _drop_unused_radii(radii: Radii, arcs: Arcs) -> tuple[Radii, Arcs]:
    """Drop the radii that no arc has."""
    present = sorted(set(arcs.classes))
    return radii.select(present), Arcs(arcs.nodes, [present.index(number) for number in arcs.classes])


def _fit_classes(
    clouds: Clouds, arcs: Arcs, fit: TubeFit, radii: Radii, config: Config, uncertainty: bool
) -> tuple[TubeFit, Radii]:
    """Fit each arc a radius of its own, then again with the given radius that is nearest to it."""
    own = radii.widen().select(arcs.classes)
    alone = _fit_radii(clouds, fit, list(range(len(arcs.nodes))), own.values, own.prior, config)
    radii, arcs = _drop_unused_radii(radii, Arcs(arcs.nodes, radii.find_nearest(alone.radii)))
    fit = fit_curves(
        clouds,
        alone.curves,
        arcs.classes,
        alone.motions,
        radii.values,
        config,
        iterations=12,
        uncertainty=uncertainty,
    )
    return fit, radii


def add_unexplained(clouds: Clouds, fit: TubeFit, config: Config) -> TubeFit:
    """Fit again with the arcs found in points that no arc explains yet, if there are any."""
    arcs = trace_unexplained(fit, range(len(fit.radii)))
    if not arcs.nodes:
        return fit
    return fit_curves(
        clouds,
        [*fit.curves, *make_splines(arcs, fit.radii, config, 0.5)],
        [*fit.radius_classes.tolist(), *arcs.classes],
        fit.motions,
        fit.radii,
        config,
        band=(0.5, 0.4),
        iterations=8,
        tolerance=ROUGH_TOLERANCE,
        uncertainty=False,
    )


def cut_to_seen(fit: TubeFit, config: Config) -> Arcs:
    """Cut fitted arcs to the stretches that points support, and drop those that are too short."""
    nodes, classes = [], []
    for number, part in enumerate(find_extents(fit, exclusive=False)):
        radius = fit.radius(number)
        if part is not None and part.length > config.tubes.min_arc * radius:
            nodes.append(part.at(part.spaced(0.5 * radius))[0])
            classes.append(int(fit.radius_classes[number]))
    return Arcs(nodes, classes)
