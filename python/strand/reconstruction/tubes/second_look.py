"""Second look: arcs in points that no curve explains, and stretches of curves that cannot be rope."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

import strand._core as _core
from strand._core import TubeFit
from strand.geometry.curve import Curve
from strand.geometry.polyline import find_runs
from strand.reconstruction.evidence.visibility import Visibility
from strand.reconstruction.tubes.clouds import Arcs
from strand.support.checks import Array

# an arc needs this share of the points that others have for their length, and this many nodes
_SHARE, _NODES = 0.2, 2
# its nodes lie farther than this from the axes that are known, in radii
_CLEARANCE = 1.0
# points nearer than this to an axis are those of a tube there, in radii
_REACH = 1.4
# a stretch of rope this long that cameras saw through, in radii, is none
_PHANTOM = 1.0
# points with less than this share of the typical number of neighbours are noise
_NEIGHBORS = 0.12


def unexplained(fit: TubeFit) -> np.ndarray:
    """(N,) Whether no curve explains a point: it lies off all surfaces, or where none could be seen."""
    tolerance = np.maximum(2.5 * fit.sigma, 0.15 * fit.radii[fit.radius_classes[fit.curve]])
    return np.asarray(~(fit.explained & (np.abs(fit.residual) < tolerance)))


def density(fit: TubeFit, curves: Sequence[Curve]) -> float:
    """Points for each metre of rope."""
    length = sum(curve.length for curve in curves)
    return float(fit.inlier.sum() / max(length, float(fit.radii.min())))


def unexplained_arcs(fit: TubeFit, classes: Iterable[int]) -> Arcs:
    """Trace arcs through the points that no curve explains.

    A strand that touches another, or passes close under it, is claimed with it by a trace; what it leaves is
    found here.

    Parameters
    ----------
    fit : TubeFit
    classes : iterable of int
        The classes of radius that the arcs may have.

    Returns
    -------
    Arcs
        Those with enough points of their own, away from all curves.
    """
    found = [(nodes, number) for number in classes for nodes in _of_radius(fit, float(fit.radii[number]))]
    return Arcs([nodes for nodes, _ in found], [number for _, number in found])


def _of_radius(fit: TubeFit, r: float) -> list[Array]:
    """Return the unexplained arcs of one radius."""
    lost = unexplained(fit)
    if lost.sum() < 20:
        return []
    typical = _core.typical_neighbors(fit.points, r)
    points, to_camera = fit.points[lost], fit.to_camera[lost]
    company = _core.count_neighbors(points, r) >= _NEIGHBORS * typical
    points, to_camera = points[company], to_camera[company]
    if len(points) < 20:
        return []
    curves = [Curve.whole(control) for control in fit.curves]
    known = np.concatenate([curve.at(curve.spaced(0.5 * r))[0] for curve in curves])
    enough = _SHARE * density(fit, curves)
    # only the direction to the camera matters to a trace
    arcs = _core.trace_tubes(points, points + 100.0 * r * to_camera, r, min_nodes=_NODES)
    found = []
    for nodes, _ in arcs:
        clear = np.sqrt(_core.squared_distances(nodes, known))
        near = _core.squared_distances(points, nodes) < (_REACH * r) ** 2
        length = float(np.linalg.norm(np.diff(nodes, axis=0), axis=1).sum()) + r
        if np.median(clear) > _CLEARANCE * r and near.sum() > enough * length:
            found.append(nodes)
    return found


def to_decide_again(fit: TubeFit, parts: Sequence[Curve | None], visibility: Visibility) -> Arcs | None:
    """Look at a fit for what speaks against it: unexplained arcs, rope where cameras saw free space.

    Parameters
    ----------
    fit : TubeFit
    parts : sequence of (Curve or None)
        The stretch of each curve that is rope.
    visibility : Visibility
        What the views saw.

    Returns
    -------
    Arcs or None
        The arcs to decide on again; None if nothing speaks against the fit.
    """
    nodes: list[Array] = []
    classes: list[int] = []
    cut = False
    for number, part in enumerate(parts):
        if part is None:
            continue
        r = fit.radius(number)
        places = part.at(part.spaced(0.5 * r))[0]
        keep = np.ones(len(places), dtype=bool)
        for stretch in find_runs(visibility.free(places, r)):
            if is_phantom(stretch, len(places), 0.5):
                keep[slice(*stretch)] = False
        cut = cut or not keep.all()
        kept = [places[start:stop] for start, stop in find_runs(keep) if stop - start >= 3]
        nodes += kept
        classes += [int(fit.radius_classes[number])] * len(kept)
    more = unexplained_arcs(fit, range(len(fit.radii)))
    if not more.nodes and not cut:
        return None
    return Arcs(nodes + more.nodes, classes + more.classes)


def is_phantom(stretch: Array, count: int, spacing: float) -> bool:
    """Tell whether a run of nodes that cameras saw through, not at an end, is too long to be rope.

    Parameters
    ----------
    stretch : (2,) ndarray of int
        Its first node, and the one after its last.
    count : int
        How many nodes there are.
    spacing : float
        Between two nodes, in radii.
    """
    start, stop = stretch
    return bool(start > 0 and stop < count and (stop - start) * spacing >= _PHANTOM)
