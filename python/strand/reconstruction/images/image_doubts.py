"""What speaks against an answer that was read from images, and how much."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand._core import ImageFit, RopeImages
from strand.geometry.polyline import runs
from strand.reconstruction.courses import Course, are_same_courses, sample_courses
from strand.reconstruction.evidence.confidence import SCALE
from strand.reconstruction.images.comparison import Explanation
from strand.ropes.chain import Chain
from strand.ropes.doubt import Doubt
from strand.support.checks import Array
from strand.views.depth_image import DepthImage

# doubt that wide, correlated noise leaves always, and an order that depth cannot tell at all; a cost of
# this much more for the other order is worth a factor of e in the odds
_ALWAYS, _ORDER, _ORDER_SCALE = 0.05, 0.5, 5.0
# an end this near to another strand may lie under it, radii, and by so much farther for what depths scatter;
# how much doubt that is, and over which distance it grows
_NEAR_END, _FARTHER, _END, _END_SCALE = 3.2, 3.5, 0.3, 1.2
# doubt for each squared radius of mask that nothing covers beyond what is usual, and of tube outside masks
_UNCOVERED, _USUAL_UNCOVERED, _OUTSIDE, _USUAL_OUTSIDE = 0.15, 0.15, 0.05, 2.0
# doubt for each pixel by which masks are wider on a side than is usual
_WIDE, _USUAL_WIDE = 0.8, 1.25
# doubt for each radius of noise beyond what is narrow
_NOISE, _NARROW = 3.0, 0.21
# doubt for each radius of a stretch without depth beyond what a strand on top hides
_BARE, _USUAL_BARE = 0.05, 6.0
# ends are apart from their own rope beyond this many nodes
_OWN = 16
# where the nearest place of a rival jumps by more than this, it is joined otherwise, nodes
_JUMP = 8
# nodes that are compared with all others at a time
_ROWS = 512
# less is not worth mentioning, and less not worth looking where
_LEAST, _PLACED = 1e-3, 0.05


def distinct(explanations: Sequence[Explanation], radius: float) -> list[Explanation]:
    """Leave out explanations by which the ropes run as by a better one.

    Parameters
    ----------
    explanations : sequence of Explanation
        The best first.
    radius : float
        Metres.

    Returns
    -------
    list of Explanation
        The best first.
    """
    kept: list[tuple[Explanation, list[Course]]] = []
    for one in explanations:
        mine = sample_courses([(nodes, False) for nodes in one.fit.nodes])
        if not any(are_same_courses(mine, theirs, radius) for _, theirs in kept):
            kept.append((one, mine))
    return [one for one, _ in kept]


def doubts(
    rivals: Sequence[Explanation],
    fit: ImageFit,
    chains: Sequence[Chain],
    views: Sequence[DepthImage],
    radius: float,
    others: Iterable[Doubt],
) -> tuple[Doubt, ...]:
    """Say what speaks against the best explanation, and how much.

    Rivals that cost hardly more, orders at crossings that depth hardly tells, stretches without depth, mask
    that no rope covers, ropes outside of masks, noise that is wide against the ropes, and others.
    The weights were set on random ropes before imitated cameras.

    Parameters
    ----------
    rivals : sequence of Explanation
        The best explanation and others by which the ropes run otherwise, the best first.
    fit : ImageFit
        The last fit of the best.
    chains : sequence of Chain
        Made of it.
    views : sequence of DepthImage
        With poses as corrected.
    radius : float
        Metres.
    others : iterable of Doubt
        Of ends, and of the masks' width.

    Returns
    -------
    tuple of Doubt
        Those worth mentioning, the greatest first.
    """
    found = [Doubt("noise", _ALWAYS, "of all that depth decides", "errors of neighbouring pixels are alike")]
    if len(rivals) > 1:
        more = rivals[1].cost - rivals[0].cost
        place, joined = _difference(fit.nodes, rivals[1].fit.nodes, radius)
        reason = f"another way to explain the images costs {more:.1f} more"
        if joined:
            reason += ": strands that touch there and part cross, or the other way round"
        found.append(Doubt("rival", float(np.exp(-more / SCALE)), "how the ropes run", reason, place))
    for crossing, margin in fit.crossings:
        amount = _ORDER * float(np.exp(-margin / _ORDER_SCALE))
        reason = f"depth hardly tells it (margin {margin:.1f})"
        found.append(Doubt("order", amount, "which strand is on top", reason, np.array(crossing)))
    found += others
    found += _of_stretches(chains)
    uncovered, outside = fit.misfit[:2]
    amount = _UNCOVERED * max(uncovered - _USUAL_UNCOVERED, 0.0)
    amount += _OUTSIDE * max(outside - _USUAL_OUTSIDE, 0.0)
    reason = "ropes and masks do not cover each other; is the radius right, and are the masks?"
    place = _farthest_uncovered(views, fit.nodes, radius) if amount > _PLACED else None
    found.append(Doubt("uncovered", amount, "of the ropes found", reason, place))
    reason = f"noise is {fit.noise:.2f} radii wide"
    amount = _NOISE * max(fit.noise - _NARROW, 0.0)
    found.append(Doubt("noise", amount, "of all that is finer than the noise", reason))
    return tuple(sorted((doubt for doubt in found if doubt.amount > _LEAST), key=lambda doubt: -doubt.amount))


def _farthest_uncovered(views: Sequence[DepthImage], chains: Sequence[Array], radius: float) -> Array | None:
    """Return what a mask's pixel with depth shows that is farthest from the ropes; None if they cover all."""
    nodes = np.vstack(chains)
    farthest: tuple[float, Array | None] = 1.5, None
    for view in views:
        rows, columns = np.nonzero(view.mask & (view.depth > 0))
        seen = view.project(nodes)
        pixels = np.column_stack([columns, rows, np.zeros(len(rows))])
        away = _core.squared_distances(pixels, np.column_stack([seen, np.zeros(len(seen))]))
        k = int(away.argmax())
        across = np.sqrt(away[k]) * view.distance / (radius * view.camera.focal[0])
        if across > farthest[0]:
            farthest = float(across), view.lift(rows[k], columns[k], view.depth[rows[k], columns[k]])
    return farthest[1]


def wide_masks(taken: Sequence[DepthImage], images: RopeImages, radius: float) -> Iterator[Doubt]:
    """Doubt a radius, metres, for which masks are too wide: it may be wrong, or they may."""
    wider = [
        pixels - radius * image.camera.focal[0] / image.distance
        for image, pixels in zip(taken, images.radii, strict=True)
    ]
    more = float(np.median(wider))
    reason = (
        f"masks are {more:.1f} pixels wider on each side than the radius says; is it right, and are they?"
    )
    yield Doubt("uncovered", _WIDE * max(more - _USUAL_WIDE, 0.0), "of the ropes found", reason)


def ends_at_strands(chains: Sequence[Array], scatter: float, radius: float) -> Iterator[Doubt]:
    """Doubt ends next to other strands: they may lie under them, or be led on.

    Where single depths scatter, by so many metres, ends are seen less well, and what is farther away is next
    to them.
    """
    near = _NEAR_END + _FARTHER * scatter / radius
    for number, nodes in enumerate(chains):
        for end, own in ((nodes[0], nodes[_OWN:]), (nodes[-1], nodes[:-_OWN])):
            others = np.vstack([own, *(other for k, other in enumerate(chains) if k != number)])
            if not len(others):
                continue
            away = float(np.sqrt(((others - end) ** 2).sum(axis=1).min())) / radius
            amount = _END * min(max((near - away) / _END_SCALE, 0.0), 1.0)
            yield Doubt("end", amount, "where the rope ends", "another strand is next to it", end)


def _of_stretches(chains: Sequence[Chain]) -> Iterator[Doubt]:
    """Doubts about stretches without depth: only the mask says where they are."""
    for chain in chains:
        if chain.points_seen is None:
            continue
        spacing = chain.length / len(chain.points)
        for start, stop in runs(chain.points_seen == 0):
            length = (stop - start) * spacing
            amount = _BARE * max(length / chain.radius - _USUAL_BARE, 0.0)
            reason = f"{length * 1e3:.0f} mm of rope have no depth"
            yield Doubt(
                "points", amount, "how far away the rope is", reason, chain.points[(start + stop) // 2]
            )


def _difference(chains: Sequence[Array], others: Sequence[Array], radius: float) -> tuple[Array | None, bool]:
    """Return where other chains run elsewhere, or are joined otherwise; and whether they are only that."""
    theirs = np.vstack(others)
    number = np.repeat(np.arange(len(others)), [len(nodes) for nodes in others])
    farthest: tuple[float, Array | None] = 1.5 * radius, None
    joined: Array | None = None
    for nodes in chains:
        nearest, away = _nearest(nodes, theirs)
        k = int(away.argmax())
        if away[k] > farthest[0]:
            farthest = float(away[k]), nodes[k]
        jumps = (np.abs(np.diff(nearest)) > _JUMP) | (np.diff(number[nearest]) != 0)
        if joined is None and jumps.any():
            joined = nodes[int(jumps.argmax())]
    return (farthest[1], False) if farthest[1] is not None else (joined, joined is not None)


def _nearest(nodes: Array, others: Array) -> tuple[NDArray[np.intp], Array]:
    """(M,), (M,) Which of other nodes is nearest to each, and how far away it is."""
    nearest = np.empty(len(nodes), dtype=np.intp)
    away = np.empty(len(nodes))
    for first in range(0, len(nodes), _ROWS):
        some = slice(first, first + _ROWS)
        squares = np.zeros((len(nodes[some]), len(others)))
        for k in range(3):
            squares += (nodes[some, k, None] - others[:, k]) ** 2
        nearest[some] = squares.argmin(axis=1)
        away[some] = np.sqrt(squares.min(axis=1))
    return nearest, away
