"""The joint fit of curves and poses, with the options that all fits of a run share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import strand._core as _core
from strand._core import TubeFit
from strand.config import Config
from strand.reconstruction.tubes.clouds import Arcs, Clouds
from strand.support.checks import Array

ROUGH_TOLERANCE = 0.3  # standard deviations of the unknowns: a smaller step ends a fit that another follows
EXPLAINED_SIGMAS = 2.5  # standard deviations of the residuals: a curve explains points up to here,
EXPLAINED_RADII = 0.15  # radii: or up to here, if that is more
ROPE_MARGIN = 2.0  # radii: splines extend beyond their ropes, so that the points show where the end is


def fit_curves(
    clouds: Clouds,
    curves: Sequence[Array],
    classes: Sequence[int],
    motions: Array,
    radii: Array,
    config: Config,
    **options: Any,
) -> TubeFit:
    """Fit curves and poses to clouds; `options` are those of `strand.fit_tubes`."""
    return _core.fit_tubes(
        clouds.points,
        clouds.viewpoints,
        curves,
        motions,
        radii,
        radius_classes=classes,
        pose_sd=(config.poses.rotation_sd, config.poses.translation_sd),
        # the pose of a single view is not unknown
        reference=clouds.reference if len(clouds.points) > 1 else None,
        min_bend=config.tubes.min_bend,
        **{"noise": config.tubes.noise, **options},
    )


def make_splines(arcs: Arcs, radii: Array, config: Config, margin: float) -> list[Array]:
    """Return control points of splines through arcs, extended at both ends by a margin in radii."""
    return [
        _core.fit_spline(nodes, config.tubes.spacing * radii[number], margin * radii[number])
        for nodes, number in zip(arcs.nodes, arcs.classes, strict=True)
    ]
