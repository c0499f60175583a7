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
from strand.reconstruction.tubes.fitting import ROUGHLY, fitted, splines
from strand.reconstruction.tubes.radius_choice import best_explaining
from strand.reconstruction.tubes.second_look import unexplained_arcs
from strand.reconstruction.tubes.tube_ends import extents
from strand.support.checks import Array
from strand.views.pose import moved

# arcs traced where views were off by less than this, in radii, are not traced again
_SETTLED = 0.15
# more arcs of one radius than this are no ropes
_MOST = 1000
# how far splines are carried on beyond their arcs, in radii, so that the points can say where the end is
_ARC_MARGIN = 1.0


def trace(clouds: Clouds, motions: Array, radii: Array, min_nodes: int, config: Config) -> Arcs:
    """Trace arcs of each radius through the points of all views at corrected poses."""
    points = [moved(cloud, motion) for cloud, motion in zip(clouds.points, motions, strict=True)]
    centres = [moved(centre[None], motion) for centre, motion in zip(clouds.viewpoints, motions, strict=True)]
    cameras = np.repeat(np.concatenate(centres), list(map(len, points)), axis=0)
    together = np.concatenate(points)
    nodes, classes = [], []
    for number, radius in enumerate(radii):
        arcs = _core.trace_tubes(together, cameras, radius, min_nodes=min_nodes)
        nodes += [arc for arc, _ in arcs]
        classes += [number] * len(arcs)
        if len(arcs) > _MOST:
            raise NotEnoughDataError(
                f"views: {len(arcs)} pieces look like rope of radius {radius:.3g} m, more than can be put "
                "together; is the radius right, and does the extraction range (bounds) leave out all else?"
            )
    if not nodes:
        raise NotEnoughDataError("views: the points make no tube; is the radius right, in metres?")
    return explaining(clouds, motions, radii, Arcs(nodes, classes), config)


def explaining(clouds: Clouds, motions: Array, radii: Array, arcs: Arcs, config: Config) -> Arcs:
    """Return the arcs whose radius is that of the points about them, if there are several radii."""
    if len(radii) == 1:
        return arcs

    def held(numbers: list[int]) -> TubeFit:
        some = arcs.only([number in numbers for number in range(len(arcs.nodes))])
        curves = splines(some, radii, config, 0.0)
        still: dict[str, Any] = {"fit_curves": False, "iterations": 0, "uncertainty": False}
        return fitted(clouds, curves, some.classes, motions, radii, config, **still)

    return arcs.only(best_explaining(arcs.classes, radii, held))


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
    """Trace arcs and fit them with the poses, again if the poses were far off; radii that are free last.

    Parameters
    ----------
    clouds : Clouds
    few : Clouds
        The same thinned: arcs are traced in it.
    motions : (V, 4, 4) ndarray
        Corrections of the poses to start from.
    radii : Radii
    config : Config
    run : Run
        Its deadline leaves out fits after the first.
    uncertainty : bool
        Whether the fit says how sure it is.

    Returns
    -------
    fit : TubeFit
        The last fit.
    radii : Radii
        Those that some arc has.

    Raises
    ------
    strand.NotEnoughDataError
        If there is nothing like a tube of these radii in the points.
    """
    # of several given radii, the points decide in the end which one an arc has
    told_apart = len(radii.values) > 1 and not radii.free and not radii.held
    for _ in range(config.tubes.rounds):
        arcs = trace(few, motions, radii.values, 3, config)
        if not told_apart:
            radii, arcs = _with_arcs(radii, arcs)
        fit = fitted(
            clouds,
            splines(arcs, radii.values, config, _ARC_MARGIN),
            arcs.classes,
            motions,
            radii.values,
            config,
            iterations=12,
            tolerance=0.1 if uncertainty else ROUGHLY,
            bounds=clouds.hull if radii.free else None,
            uncertainty=uncertainty,
        )
        shift = _shift(few, motions, fit.motions)
        motions = fit.motions
        if shift < _SETTLED * float(radii.values.min()) or run.skips("arcs traced again at better poses"):
            break
    if told_apart:
        return _classes_from_points(clouds, arcs, fit, radii, config, uncertainty)
    if not radii.free or run.skips("radii fitted to the points"):
        return fit, radii
    fit = _with_radii(clouds, fit, arcs.classes, fit.radii, radii.prior, config)
    classes = group_radii(fit.radii, np.zeros(len(fit.radii)))
    if len(set(classes)) < len(classes):
        # strands side by side looked like a thicker rope
        first = [classes.index(number) for number in range(max(classes) + 1)]
        radii = radii.select(first)
        few = clouds.thinned(float(radii.values.min()))
        return fit_arcs(clouds, few, fit.motions, radii, config, run, uncertainty=uncertainty)
    return fit, radii


def _shift(clouds: Clouds, before: Array, after: Array) -> float:
    """How far corrections of the poses moved the farthest point, metres."""
    far = 0.0
    for cloud, some, other in zip(clouds.points, before, after, strict=True):
        apart = other[:3] - some[:3]
        far = max(far, float(np.linalg.norm(cloud @ apart[:, :3].T + apart[:, 3], axis=1).max()))
    return far


def _with_radii(
    clouds: Clouds, fit: TubeFit, classes: Sequence[int], start: Array, prior: Array | None, config: Config
) -> TubeFit:
    """Fit again with radii that are unknown too, which only residuals along the rays do not bias."""
    return fitted(
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


def _with_arcs(radii: Radii, arcs: Arcs) -> tuple[Radii, Arcs]:
    """Leave out the radii that no arc has."""
    present = sorted(set(arcs.classes))
    return radii.select(present), Arcs(arcs.nodes, [present.index(number) for number in arcs.classes])


def _classes_from_points(
    clouds: Clouds, arcs: Arcs, fit: TubeFit, radii: Radii, config: Config, uncertainty: bool
) -> tuple[TubeFit, Radii]:
    """Fit each arc a radius of its own, then again with that of the known radii which is nearest to it."""
    own = radii.widen().select(arcs.classes)
    alone = _with_radii(clouds, fit, list(range(len(arcs.nodes))), own.values, own.prior, config)
    radii, arcs = _with_arcs(radii, Arcs(arcs.nodes, radii.find_nearest(alone.radii)))
    fit = fitted(
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


def with_unexplained(clouds: Clouds, fit: TubeFit, config: Config) -> TubeFit:
    """Fit again with the arcs in points that no arc explains yet, if there are any."""
    arcs = unexplained_arcs(fit, range(len(fit.radii)))
    if not arcs.nodes:
        return fit
    return fitted(
        clouds,
        [*fit.curves, *splines(arcs, fit.radii, config, 0.5)],
        [*fit.radius_classes.tolist(), *arcs.classes],
        fit.motions,
        fit.radii,
        config,
        band=(0.5, 0.4),
        iterations=8,
        tolerance=ROUGHLY,
        uncertainty=False,
    )


def seen_arcs(fit: TubeFit, config: Config) -> Arcs:
    """Cut fitted arcs to what was seen, and leave out what is too short."""
    nodes, classes = [], []
    for number, part in enumerate(extents(fit, exclusive=False)):
        radius = fit.radius(number)
        if part is not None and part.length > config.tubes.min_arc * radius:
            nodes.append(part.at(part.spaced(0.5 * radius))[0])
            classes.append(int(fit.radius_classes[number]))
    return Arcs(nodes, classes)
