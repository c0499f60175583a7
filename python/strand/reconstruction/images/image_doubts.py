"""Doubts of an answer that was read from images."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

import strand._core as _core
from strand._core import ImageFit
from strand.geometry.lengths import measure_lengths
from strand.geometry.polyline import find_runs, path_length
from strand.reconstruction.courses import Course, are_same_courses
from strand.reconstruction.evidence.confidence import MIN_DOUBT, SCALE, USUAL_NOISE
from strand.reconstruction.images.comparison import Explanation
from strand.reconstruction.images.other_courses import cut_over_table
from strand.ropes.chain import Chain
from strand.ropes.doubt import Doubt
from strand.support.checks import Array
from strand.views.depth_image import DepthImage

_ALWAYS = 0.05  # doubt of any answer: noise is wide and correlated
_ORDER = 0.5  # doubt of an order at a crossing that depth leaves open
_ORDER_SCALE = 5.0  # cost above the other order's that is worth a factor of e in the odds
_END = 0.3  # doubt of an end at another strand
_NEAR_END = 3.2  # radii from an end: nearer strands raise doubt
_NEAR_END_PER_SCATTER = 3.5  # per radius of scatter of depths: farther strands raise doubt then
_END_SCALE = 1.2  # radii nearer than that, over which the doubt grows
_UNCOVERED = 0.15  # doubt per squared radius of mask that no rope covers
_USUAL_UNCOVERED = 0.15  # squared radii of such mask that raise no doubt
_OUTSIDE = 0.05  # doubt per squared radius of tube outside masks
_USUAL_OUTSIDE = 2.0  # squared radii of such tube that raise no doubt
_WIDE = 0.8  # doubt per pixel that masks are too wide on each side
_USUAL_WIDE = 1.25  # pixels too wide that raise no doubt
_SLIMMED = 0.25  # part of that doubt where depth shows how wide ropes are
_UNEVEN = 1.0  # doubt per ratio of the ropes' greatest and least width in an image
_USUAL_UNEVEN = 1.6  # ratio that raises no doubt
_MAX_NOISE_ON_TABLE = 0.5  # doubt where masks show the course, and a table how high ropes lie
_NOISE = 3.0  # doubt per radius of noise
_BARE = 0.05  # doubt per radius of a stretch without depth
_USUAL_BARE = 6.0  # radii of a stretch without depth that raise no doubt: a strand on top hides them
_OVER_TABLE = 1.6  # doubt per radius of a stretch over bare table
_MAX_OVER_TABLE = 2.4  # doubt of such a stretch at most
_MIN_PLACED_DOUBT = 0.05  # smaller doubts of uncovered mask have no place

_OWN_NODES = 16  # nodes at an end that are not another strand
_MIN_DISTANCE = 1.5  # radii: ropes differ where they are farther from each other, and mask is uncovered
_MAX_JUMP = 8  # nodes: where the nearest node of a rival jumps farther, the rival is joined otherwise


def drop_same_courses(explanations: Sequence[Explanation], radius: float) -> list[Explanation]:
    """Drop explanations, the best first, whose ropes of a radius, metres, run as those of a better one."""
    kept: list[tuple[Explanation, list[Course]]] = []
    for one in explanations:
        mine = [Course(nodes, False) for nodes in one.fit.nodes]
        if not any(are_same_courses(mine, theirs, radius) for _, theirs in kept):
            kept.append((one, mine))
    return [one for one, _ in kept]


def find_doubts(
    rivals: Sequence[Explanation],
    fit: ImageFit,
    chains: Sequence[Chain],
    views: Sequence[DepthImage],
    radius: float,
    others: Iterable[Doubt],
    resting: bool,
) -> tuple[Doubt, ...]:
    """Return the doubts of the best explanation, the greatest first.

    They come from rivals, orders at crossings, stretches without depth, mask and ropes that do not cover each
    other, and noise. Their weights were set on random ropes before imitated cameras.

    Parameters
    ----------
    rivals : sequence of Explanation
        The best explanation and those whose ropes have other courses, the best first.
    fit : ImageFit
        The last fit of the best.
    chains : sequence of Chain
        Made of that fit.
    views : sequence of DepthImage
        With corrected poses.
    radius : float
        Metres.
    others : iterable of Doubt
        Further ones.
    resting : bool
        Whether masks were given and ropes lie on a table, so that noise hardly changes the course.
    """
    found = [Doubt("noise", _ALWAYS, "of all that depth decides", "errors of neighbouring pixels are alike")]
    if len(rivals) > 1:
        more = rivals[1].cost - rivals[0].cost
        place, joined = _locate_difference(fit.nodes, rivals[1].fit.nodes, radius)
        reason = f"another way to explain the images costs {more:.1f} more"
        if joined:
            reason += ": strands that touch there and part cross, or the other way round"
        found.append(Doubt("rival", float(np.exp(-more / SCALE)), "how the ropes run", reason, place))
    for crossing, margin in fit.crossings:
        amount = _ORDER * float(np.exp(-margin / _ORDER_SCALE))
        if amount > MIN_DOUBT:
            reason = f"depth hardly decides it (margin {margin:.1f})"
            found.append(Doubt("order", amount, "which strand is on top", reason, np.array(crossing)))
    found += others
    found += _doubt_bare_stretches(chains)
    uncovered, outside = fit.misfit[:2]
    amount = _UNCOVERED * max(uncovered - _USUAL_UNCOVERED, 0.0)
    amount += _OUTSIDE * max(outside - _USUAL_OUTSIDE, 0.0)
    reason = "ropes and masks do not cover each other; is the radius right, and are the masks?"
    place = _locate_uncovered(views, fit.nodes, radius) if amount > _MIN_PLACED_DOUBT else None
    found.append(Doubt("uncovered", amount, "of the ropes found", reason, place))
    reason = f"noise is {fit.noise:.2f} radii wide"
    amount = _NOISE * max(fit.noise - USUAL_NOISE, 0.0)
    amount = min(amount, _MAX_NOISE_ON_TABLE) if resting else amount
    found.append(Doubt("noise", amount, "of all that is finer than the noise", reason))
    kept = (doubt for doubt in found if doubt.amount > MIN_DOUBT)
    return tuple(sorted(kept, key=lambda doubt: -doubt.amount))


def doubt_wide_masks(wider: float, slimmed: bool) -> Iterator[Doubt]:
    """Doubt a radius for which masks are too wide: the radius or the masks may be wrong.

    Parameters
    ----------
    wider : float
        Pixels on each side.
    slimmed : bool
        Whether depth shows how wide the ropes are.
    """
    reason = (
        f"masks are {wider:.1f} pixels wider on each side than the radius says; is it right, and are they?"
    )
    amount = _WIDE * max(wider - _USUAL_WIDE, 0.0)
    yield Doubt("mask", _SLIMMED * amount if slimmed else amount, "of the ropes found", reason)


def doubt_uneven_widths(views: Sequence[DepthImage], chains: Sequence[Array]) -> Iterator[Doubt]:
    """Doubt ropes that are much wider in one part of every view than in another.

    A mask is read as if its ropes had one width, and so strands are lost where they are thinner. A view from
    elsewhere shows them wider.
    """
    nodes = np.concatenate(chains)
    depths = np.array([(nodes - view.pose[:3, 3]) @ view.pose[:3, 2] for view in views])
    nearest = np.maximum(depths.min(axis=1), 1e-3 * depths.max(axis=1))
    ratios = (depths / nearest[:, None]).min(axis=0)
    place = int(ratios.argmax())
    reason = f"ropes are {ratios[place]:.1f} times as wide elsewhere as here"
    amount = min(_UNEVEN * max(float(ratios[place]) - _USUAL_UNEVEN, 0.0), 1.0)
    yield Doubt("mask", amount, "how the ropes run", reason, nodes[place])


def doubt_ends_at_strands(chains: Sequence[Array], scatter: float, radius: float) -> Iterator[Doubt]:
    """Doubt ends next to other strands: the rope may go on under these, or end before them.

    Where single depths scatter, by `scatter` metres, ends are located less well. Strands count from farther
    away then.
    """
    near = _NEAR_END + _NEAR_END_PER_SCATTER * scatter / radius
    for number, nodes in enumerate(chains):
        others = [other for k, other in enumerate(chains) if k != number]
        for end, own in ((nodes[0], nodes[_OWN_NODES:]), (nodes[-1], nodes[:-_OWN_NODES])):
            (square,) = _core.find_squared_distances(end[None], np.concatenate([own, *others])).tolist()
            away = math.sqrt(square) / radius
            if away < near:
                amount = _END * min((near - away) / _END_SCALE, 1.0)
                yield Doubt("end", amount, "where the rope ends", "another strand is next to it", end)


def doubt_over_table(views: Sequence[DepthImage], chains: Sequence[Array], radius: float) -> Iterator[Doubt]:
    """Doubt stretches where views show the table beneath ropes. Depths have far less noise than a radius."""
    for stretch in cut_over_table(views, chains, radius)[1]:
        length = path_length(stretch)[-1]
        amount = min(_OVER_TABLE * float(length) / radius, _MAX_OVER_TABLE)
        reason = f"cameras saw the table along {length * 1e3:.0f} mm of it; the rope may end there"
        yield Doubt("gap", amount, "how the rope runs", reason, stretch[len(stretch) // 2])


def _doubt_bare_stretches(chains: Sequence[Chain]) -> Iterator[Doubt]:
    """Doubt the depth of stretches that only masks show."""
    for chain in chains:
        if chain.points_seen is None:
            continue
        spacing = chain.length / len(chain.points)
        for start, stop in find_runs(chain.points_seen == 0):
            length = (stop - start) * spacing
            more = length / chain.radius - _USUAL_BARE
            if more > 0.0:
                reason = f"{length * 1e3:.0f} mm of rope have no depth"
                place = chain.points[(start + stop) // 2]
                yield Doubt("points", _BARE * more, "how far away the rope is", reason, place)


def _locate_uncovered(views: Sequence[DepthImage], chains: Sequence[Array], radius: float) -> Array | None:
    """Return the point of a mask that is farthest from the ropes; None if they cover all masks."""
    nodes = np.vstack(chains)
    farthest: tuple[float, Array | None] = _MIN_DISTANCE, None
    for view in views:
        rows, columns = view.list_seen()
        seen = view.project(nodes)
        pixels = np.zeros((len(rows), 3))
        pixels[:, 0], pixels[:, 1] = columns, rows
        away = _core.find_squared_distances(pixels, np.column_stack([seen, np.zeros(len(seen))]))
        k = int(away.argmax())
        across = np.sqrt(away[k]) * view.distance / (radius * view.camera.focal[0])
        if across > farthest[0]:
            farthest = float(across), view.lift(rows[k], columns[k], view.depth[rows[k], columns[k]])
    return farthest[1]


def _locate_difference(
    chains: Sequence[Array], others: Sequence[Array], radius: float
) -> tuple[Array | None, bool]:
    """Return where chains run farthest from others, or are joined otherwise; and whether it is a join."""
    theirs = np.vstack(others)
    number = np.repeat(np.arange(len(others)), [len(nodes) for nodes in others])
    farthest: tuple[float, Array | None] = _MIN_DISTANCE * radius, None
    joined: Array | None = None
    for nodes in chains:
        nearest = _core.find_nearest(nodes, theirs)
        away = measure_lengths(nodes - theirs[nearest])
        k = int(away.argmax())
        if away[k] > farthest[0]:
            farthest = float(away[k]), nodes[k]
        jumps = (np.abs(np.diff(nearest)) > _MAX_JUMP) | (np.diff(number[nearest]) != 0)
        if joined is None and jumps.any():
            joined = nodes[int(jumps.argmax())]
    return (farthest[1], False) if farthest[1] is not None else (joined, joined is not None)
