"""Look again: find arcs in points that no curve explains, and stretches of curves that cannot be rope."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

import strand._core as _core
from strand._core import TubeFit
from strand.geometry.curve import Curve
from strand.geometry.polyline import find_runs
from strand.reconstruction.evidence.visibility import Visibility
from strand.reconstruction.tubes.clouds import Arcs
from strand.reconstruction.tubes.fitting import EXPLAINED_RADII, EXPLAINED_SIGMAS
from strand.support.checks import Array

_MIN_POINTS = 20  # unexplained points that may be an arc
_MIN_DENSITY = 0.2  # share of the other ropes' points per length that an arc needs
_MIN_NODES = 2  # of an arc
_MIN_CLEARANCE = 1.0  # radii: median distance of an arc's nodes from the known axes
_REACH = 1.4  # radii: points nearer to an axis belong to a tube there
_MIN_NEIGHBORS = 0.12  # share of the typical number: points with fewer are noise
_PHANTOM = 1.0  # radii: a stretch this long that cameras saw through is no rope


def find_unexplained(fit: TubeFit) -> np.ndarray:
    """Return (N,) which points no curve explains: they lie off all surfaces, or where none could be seen."""
    radii = fit.radii[fit.radius_classes]
    tolerance = np.maximum(EXPLAINED_SIGMAS * fit.sigma, EXPLAINED_RADII * radii)[fit.curve]
    return np.asarray(~(fit.explained & (np.abs(fit.residual) < tolerance)))


def measure_density(fit: TubeFit, curves: Sequence[Curve]) -> float:
    """Return the number of points per metre of rope."""
    length = sum(curve.length for curve in curves)
    return float(fit.inlier.sum() / max(length, float(fit.radii.min())))


def trace_unexplained(fit: TubeFit, classes: Iterable[int]) -> Arcs:
    """Trace arcs of some classes of radius through the points that no curve explains.

    A first trace takes a strand together with another that touches it or passes close above it. The arcs
    here have enough points of their own, away from all curves.
    """
    found = [(nodes, number) for number in classes for nodes in _trace_radius(fit, float(fit.radii[number]))]
    return Arcs([nodes for nodes, _ in found], [number for _, number in found])


def _trace_radius(fit: TubeFit, r: float) -> list[Array]:
    """Return (M, 3) nodes of the unexplained arcs of one radius."""
    lost = find_unexplained(fit)
    if lost.sum() < _MIN_POINTS:
        return []
    typical = _core.count_typical_neighbors(fit.points, r)
    points, to_camera = fit.points[lost], fit.to_camera[lost]
    crowded = _core.count_neighbors(points, r) >= _MIN_NEIGHBORS * typical
    points, to_camera = points[crowded], to_camera[crowded]
    if len(points) < _MIN_POINTS:
        return []
    curves = [Curve.whole(control) for control in fit.curves]
    known = np.concatenate([curve.place_at(curve.spaced(0.5 * r)) for curve in curves])
    enough = _MIN_DENSITY * measure_density(fit, curves)
    # tracing uses only the direction to the camera
    arcs = _core.trace_tubes(points, points + 100.0 * r * to_camera, r, min_nodes=_MIN_NODES)
    found = []
    for nodes, _ in arcs:
        clear = np.sqrt(_core.find_squared_distances(nodes, known))
        near = _core.find_squared_distances(points, nodes) < (_REACH * r) ** 2
        length = float(np.linalg.norm(np.diff(nodes, axis=0), axis=1).sum()) + r
        if np.median(clear) > _MIN_CLEARANCE * r and near.sum() > enough * length:
            found.append(nodes)
    return found


def find_arcs_to_reconsider(
    fit: TubeFit, parts: Sequence[Curve | None], visibility: Visibility
) -> Arcs | None:
    """Return a fit's arcs without stretches in free space, and the arcs in unexplained points.

    `parts` are the stretches of the curves that are rope. Without anything to cut or add, return None.
    """
    nodes: list[Array] = []
    classes: list[int] = []
    cut = False
    for number, part in enumerate(parts):
        if part is None:
            continue
        r = fit.radius(number)
        places = part.place_at(part.spaced(0.5 * r))
        keep = np.ones(len(places), dtype=bool)
        for stretch in find_runs(visibility.free(places, r)):
            if is_phantom(stretch, len(places), 0.5):
                keep[slice(*stretch)] = False
        cut = cut or not keep.all()
        kept = [places[start:stop] for start, stop in find_runs(keep) if stop - start >= 3]
        nodes += kept
        classes += [int(fit.radius_classes[number])] * len(kept)
    more = trace_unexplained(fit, range(len(fit.radii)))
    if not more.nodes and not cut:
        return None
    return Arcs(nodes + more.nodes, classes + more.classes)


def is_phantom(stretch: Array, count: int, spacing: float) -> bool:
    """Tell whether a run of nodes in free space, away from both ends, is too long to be rope.

    `stretch` has its first node, and the one after its last, of `count` nodes. Their spacing is in radii.
    """
    start, stop = stretch
    return bool(start > 0 and stop < count and (stop - start) * spacing >= _PHANTOM)
