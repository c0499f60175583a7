"""The joint fit of curves and poses, with what every fit of a run has in common."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import strand._core as _core
from strand._core import TubeFit
from strand.config import Config
from strand.reconstruction.tubes.clouds import Arcs, Clouds
from strand.support.checks import Array

# a fit that another follows ends after a step of less than this, in standard deviations of the unknowns
ROUGHLY = 0.3
# how far splines are carried on beyond their ropes, in radii, so that the points can say where the end is
ROPE_MARGIN = 2.0


def fitted(
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
        # a view alone has no pose to find
        reference=clouds.reference if len(clouds.points) > 1 else None,
        min_bend=config.tubes.min_bend,
        **{"noise": config.tubes.noise, **options},
    )


def splines(arcs: Arcs, radii: Array, config: Config, margin: float) -> list[Array]:
    """Control points of splines through arcs, carried on at both ends by a margin in radii."""
    return [
        _core.spline_through(nodes, config.tubes.spacing * radii[number], margin * radii[number])
        for nodes, number in zip(arcs.nodes, arcs.classes, strict=True)
    ]
