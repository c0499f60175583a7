"""Second look: pieces of string in points that no arc explains."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand import _core
from strand._core import TubeFit
from strand.curve import Curve
from strand.view import Array

# a piece needs this share of the points that others have for their length, and this many nodes
_SHARE, _NODES = 0.2, 2
# its nodes lie farther than this from the axes that are known, in radii
_CLEARANCE = 1.0
# points nearer than this to an axis are those of a tube there, in radii
_REACH = 1.4
# points with less than this share of the usual number of neighbours are noise
_NEIGHBOURS = 0.12


def unexplained(fit: TubeFit) -> np.ndarray:
    """(N,) Whether no curve explains a point: it lies off all surfaces, or where none could be seen."""
    slack = np.maximum(2.5 * fit.sigma, 0.15 * fit.radii[fit.radius_classes[fit.curve]])
    return np.asarray(~(fit.explained & (np.abs(fit.residual) < slack)))


def density(fit: TubeFit, curves: Sequence[Curve]) -> float:
    """Points for each metre of string."""
    length = sum(curve.length for curve in curves)
    return float(fit.inlier.sum() / max(length, float(fit.radii.min())))


def left_over(fit: TubeFit, rope: int = 0) -> list[Array]:
    """Trace pieces of string through the points that no curve explains.

    A strand that touches another, or passes close under it, is claimed with it by a trace; what it leaves is
    found here.

    Parameters
    ----------
    fit : TubeFit
    rope : int
        The kind of rope whose radius they are to have.

    Returns
    -------
    list of (M, 3) ndarray
        Ordered nodes of pieces with enough points of their own, away from all curves, metres.
    """
    r = float(fit.radii[rope])
    lost = unexplained(fit)
    if lost.sum() < 20:
        return []
    usual = _core.typical_neighbors(fit.points, r)
    points, to_camera = fit.points[lost], fit.to_camera[lost]
    company = _core.count_neighbors(points, r) >= _NEIGHBOURS * usual
    points, to_camera = points[company], to_camera[company]
    if len(points) < 20:
        return []
    curves = [Curve.whole(control) for control in fit.curves]
    known = np.concatenate([curve.at(curve.nodes(0.5 * r))[0] for curve in curves])
    enough = _SHARE * density(fit, curves)
    # only the direction to the camera matters to a trace
    arcs = _core.trace_tubes(points, points + 100.0 * r * to_camera, r, min_nodes=_NODES)
    pieces = []
    for nodes, _ in arcs:
        clear = np.sqrt(((nodes[:, None] - known[None]) ** 2).sum(axis=2).min(axis=1))
        near = ((points[:, None] - nodes[None]) ** 2).sum(axis=2).min(axis=1) < (_REACH * r) ** 2
        length = float(np.linalg.norm(np.diff(nodes, axis=0), axis=1).sum()) + r
        if np.median(clear) > _CLEARANCE * r and near.sum() > enough * length:
            pieces.append(nodes)
    return pieces
