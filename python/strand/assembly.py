"""Ways to make strings of arcs, each fitted to the points and compared with the others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from strand import _core
from strand._core import NotEnoughDataError, TubeFit
from strand.config import Linking
from strand.curve import Curve
from strand.ends import string_parts
from strand.hues import Hues
from strand.known import NOTHING, Known, contradiction
from strand.linking import Links, aimed, part_at_contacts, without_shadows
from strand.pieces import left_over, unexplained
from strand.topology import path_length, runs, walk
from strand.view import Array
from strand.visibility import Sight

Chains = list[tuple[Array, bool]]

# what an explanation costs: bending for each radian^2 / radius of it, bends sharper than this (times the
# radius) besides, each string, each radius of string that was seen through or that is in another strand's
# place
_BENDING, _SHARP, _KINK, _STRING, _EMPTY, _INSIDE = 1.5, 0.6, 4.0, 10.0, 2.0, 4.0
# a stretch of string this long that cameras saw through, in radii, is none; what a way costs that has one
_PHANTOM, _GONE = 1.0, 20.0
# each string more or less than there are; each radius that a known length is missed by, at most a string
_COUNT, _LENGTH = 30.0, 2.0
# two strands are 2 radii apart; nearer than this is no noise
_CONTACT = 1.5
# ends cut back by so many radii where arcs run into each other
_CUT_BACK = (2.5, 6.0)
# what a join may cost to be obvious, for each end
_OBVIOUS = 1.25
# more arcs than this are no strings
_MOST = 200
# joins whose matching costs up to this much more without them are tried without, and at most so many
_DOUBT, _TRIES = 8.0, 4


@dataclass(frozen=True, eq=False)
class Assembly:
    """One way to make strings of arcs.

    Attributes
    ----------
    links : Links
        The arcs, and what joins cost.
    joins : tuple of (int, int)
        Pairs of ends that are joined.
    chains : list of ((K, 3) ndarray, bool)
        Nodes of each string, metres, and whether it is closed.
    matching_cost : float
    left_out : tuple of (K, 3) ndarray
        Nodes of what became too short a string, metres.
    """

    links: Links
    joins: tuple[tuple[int, int], ...]
    chains: Chains
    matching_cost: float
    left_out: tuple[Array, ...]


@dataclass(frozen=True, eq=False)
class Judged:
    """An assembly after it was fitted.

    Attributes
    ----------
    assembly : Assembly
    fit : TubeFit
    cost : float
        What is left unexplained, what it takes to explain the rest, in radii of string, what differences of
        colour cost at joins, and `amiss`.
    amiss : float
        What of it is for contradicting what is known of the strings beforehand.
    """

    assembly: Assembly
    fit: TubeFit
    cost: float
    amiss: float


def assembled(
    arcs: Sequence[Array],
    radius: float,
    config: Linking,
    sight: Sight | None,
    without: Sequence[tuple[int, int]] = (),
    links: Links | None = None,
    known: Known = NOTHING,
    hues: Hues | None = None,
) -> Assembly | None:
    """Join arcs by the matching of least cost; None if that leaves no string long enough.

    If that leaves more strings than there are, or strings open that are rings, longer gaps are bridged too.
    """
    if links is None:
        links = Links.between(arcs, radius, config, sight, hues)
    joins, cost = links.matched(config.free_end, without)

    def long_enough(chain: tuple[Array, bool]) -> bool:
        return bool(path_length(chain[0])[-1] > config.min_length * radius)

    def open_pieces(made: Chains, least: float) -> list[int]:
        """Return for each arc the number of its chain if that has ends and is long enough, else -1."""
        pieces = [-1] * len(links.arcs)
        for number, (chain, (entered, closed)) in enumerate(
            zip(made, walk(len(links.arcs), joins), strict=True)
        ):
            for end in entered:
                enough = path_length(chain[0])[-1] > least * radius
                pieces[end // 2] = number if enough and not closed else -1
        return pieces

    made = links.joined(joins, radius, config, sight)
    ropes = known.ropes
    if ropes is not None and sum(map(long_enough, made)) > ropes:
        pieces = open_pieces(made, config.min_length)
        # pairs that the matching is to do without may still be what makes the strings so few
        barred = [pair for pair in without if pair not in links.costs]
        joins = links.bridged(joins, pieces, ropes, radius, config, sight, barred)
        made = links.joined(joins, radius, config, sight)
    if config.rings == "always" and not all(closed for _, closed in made):
        pieces = open_pieces(made, config.loop)
        joins = links.closed(joins, pieces, ropes is not None, radius, config, sight)
        made = links.joined(joins, radius, config, sight)
    if known.lengths:
        made = links.joined(joins, radius, config, sight, known)
    chains = [chain for chain in made if long_enough(chain)]
    left_out = tuple(chain[0] for chain in made if not long_enough(chain))
    return Assembly(links, tuple(joins), chains, cost, left_out) if chains else None


def decide(
    arcs: Sequence[Array],
    radius: float,
    config: Linking,
    sight: Sight | None,
    fitted: Callable[[Chains], TubeFit],
    known: Known = NOTHING,
    hues: Hues | None = None,
) -> list[Judged]:
    """Fit the likely assemblies of arcs and compare them.

    Parameters
    ----------
    arcs : sequence of (M, 3) ndarray
        Ordered nodes, metres.
    radius : float
        The strings' radius, metres.
    config : Linking
    sight : Sight, optional
        What the views saw.
    fitted : callable
        Fits chains to the points.
    known : Known, optional
        What is known of the strings beforehand.
    hues : Hues, optional
        The arcs' colours.

    Returns
    -------
    list of Judged
        No two alike, the best first; empty if there is no string.

    Raises
    ------
    strand.NotEnoughDataError
        If there are so many arcs that they are no strings.
    """
    judged: list[Judged] = []

    def consider(assembly: Assembly | None) -> None:
        if assembly is not None and not any(
            alike(assembly.chains, other.assembly.chains, radius) for other in judged
        ):
            fit = fitted(assembly.chains)
            amiss = _amiss(assembly.chains, radius, config, known)
            cost = explanation_cost(fit, sight)
            contrast = assembly.links.contrast
            if contrast is not None:
                cost += float(sum(contrast[pair] for pair in assembly.joins))
            judged.append(Judged(assembly, fit, cost + amiss, amiss))

    def tried(pieces: Sequence[Array]) -> None:
        consider(assembled(pieces, radius, config, sight, known=known, hues=hues))

    if len(arcs) > _MOST:
        raise NotEnoughDataError(
            f"views: {len(arcs)} pieces look like string, more than can be put together; does the extraction "
            "range (bounds) leave out everything else?"
        )
    arcs = aimed(without_shadows(arcs, radius), radius)
    parted = part_at_contacts(arcs, radius, config)
    tried(parted)
    if len(parted) != len(arcs):
        tried(arcs)
        for back in _CUT_BACK:
            tried(part_at_contacts(arcs, radius, config, back))
    # with the obvious joins made first, more ends turn out to lie inside others
    links = Links.between(arcs, radius, config, sight, hues)
    merged = [nodes for nodes, _ in links.joined(links.matched(_OBVIOUS)[0], radius, config, sight)]
    if len(merged) < len(arcs):
        for back in _CUT_BACK:
            pieces = part_at_contacts(merged, radius, config, back)
            if len(pieces) > len(merged):
                tried(pieces)
    if not judged:
        return []
    first = min(judged, key=lambda one: one.cost)
    best = first.assembly
    tries = sorted(
        (best.links.matched(config.free_end, [pair])[1] - best.matching_cost, pair)
        for pair in best.joins
        if pair in best.links.costs
    )
    few = known.ropes is not None and len(best.chains) < known.ropes
    wrong = bool(known.lengths) and first.amiss > 0
    for more, pair in tries[:_TRIES]:
        if more < _DOUBT or few or wrong:
            consider(assembled([], radius, config, sight, [pair], best.links, known))
    for pair in best.joins if wrong else ():
        if pair not in best.links.costs:
            consider(assembled([], radius, config, sight, [pair], best.links, known))
    return sorted(judged, key=lambda one: one.cost)


def _amiss(chains: Chains, radius: float, config: Linking, known: Known) -> float:
    """Return what chains cost that contradict what is known of the strings."""
    amiss = 0.0 if known.ropes is None else _COUNT * abs(len(chains) - known.ropes)
    if config.rings == "always":
        amiss += _COUNT * sum(not closed for _, closed in chains)
    if known.lengths:
        lengths = [float(path_length(nodes)[-1]) for nodes, _ in chains]
        for length, true in zip(lengths, known.expected(lengths), strict=True):
            amiss += min(_LENGTH * contradiction(length, true, radius), _COUNT)
    return amiss


def forced(judged: Sequence[Judged]) -> float:
    """How much dearer the best way is than one that disregards what is known of the strings.

    Parameters
    ----------
    judged : sequence of Judged
        The best first.

    Returns
    -------
    float
        In the unit of the costs.
    """
    free = [one.cost - one.amiss for one in judged]
    return free[0] - min(free)


def reopened(
    fit: TubeFit, parts: Sequence[Curve | None], sight: Sight
) -> tuple[list[Array], list[int]] | None:
    """Look at a fit for what speaks against it: points left over, string where cameras saw none.

    Parameters
    ----------
    fit : TubeFit
    parts : sequence of (Curve or None)
        The stretch of each curve that is string.
    sight : Sight
        What the views saw.

    Returns
    -------
    list of (M, 3) ndarray, list of int, or None
        Nodes of the pieces to decide on again, metres, and the kind of rope of each; None if nothing speaks
        against the fit.
    """
    pieces: list[Array] = []
    ropes: list[int] = []
    cut = False
    for number, part in enumerate(parts):
        if part is None:
            continue
        r = fit.radius(number)
        nodes = part.at(part.nodes(0.5 * r))[0]
        keep = np.ones(len(nodes), dtype=bool)
        for stretch in runs(sight.free(nodes, r)):
            if _phantom(stretch, len(nodes), 0.5):
                keep[slice(*stretch)] = False
        cut = cut or not keep.all()
        kept = [nodes[start:stop] for start, stop in runs(keep) if stop - start >= 3]
        pieces += kept
        ropes += [int(fit.radius_classes[number])] * len(kept)
    extra = [(nodes, rope) for rope in range(len(fit.radii)) for nodes in left_over(fit, rope)]
    if not extra and not cut:
        return None
    return pieces + [nodes for nodes, _ in extra], ropes + [rope for _, rope in extra]


def _phantom(stretch: tuple[int, int], count: int, spacing: float) -> bool:
    """Tell whether a run of nodes that was seen through, not at an end, is too long to be string."""
    start, stop = stretch
    return start > 0 and stop < count and (stop - start) * spacing >= _PHANTOM


def alike(some: Chains, others: Chains, radius: float) -> bool:
    """Tell whether two sets of chains run through the same places in the same order."""
    if len(some) != len(others):
        return False
    left = [(_places(nodes), path_length(nodes)[-1], closed) for nodes, closed in others]
    for nodes, closed in some:
        places, length = _places(nodes), path_length(nodes)[-1]
        for k, (theirs, their_length, their_closed) in enumerate(left):
            apart = min(
                np.linalg.norm(places - theirs, axis=1).max(),
                np.linalg.norm(places - theirs[::-1], axis=1).max(),
            )
            if closed == their_closed and abs(length - their_length) < 4.0 * radius and apart < 4.0 * radius:
                del left[k]
                break
        else:
            return False
    return True


def _places(nodes: Array) -> Array:
    """(33, 3) Places evenly along a chain."""
    s = path_length(nodes)
    return np.stack([np.interp(np.linspace(0.0, s[-1], 33), s, nodes[:, k]) for k in range(3)], axis=1)


def explanation_cost(fit: TubeFit, sight: Sight | None) -> float:
    """Cost of an explanation of the points, in radii of string.

    What lengths of string the unexplained points would make, the bending energy, a price for each string, and
    for each stretch of string where there can be none.

    Parameters
    ----------
    fit : TubeFit
    sight : Sight, optional
        What the views saw.

    Returns
    -------
    float
    """
    r = fit.radius(0)
    parts = [part for part in string_parts(fit, exclusive=False) if part is not None]
    if not parts:
        return float("inf")
    lost = unexplained(fit)
    each = (~lost).sum() * r / max(sum(part.length for part in parts), r)
    cost = float(lost.sum() / max(each, 1.0)) + _STRING * len(fit.curves)
    spacing = 0.25
    centres, places, number = [], [], []
    for k, part in enumerate(parts):
        s = part.nodes(spacing * r)
        position, _, curvature = part.at(s)
        bend = np.minimum(np.linalg.norm(curvature, axis=1) * r, 1.5)
        cost += _BENDING * spacing * float((bend**2 + _KINK * np.maximum(bend - _SHARP, 0.0)).sum())
        if sight is not None:
            empty = sight.free(position, r)
            cost += _EMPTY * spacing * float(empty.sum())
            cost += _GONE * sum(_phantom(stretch, len(s), spacing) for stretch in runs(empty))
        centres.append(position[::2])
        places.append(s[::2])
        number.append(np.full(len(s[::2]), k))
    centre, place, which = np.concatenate(centres), np.concatenate(places), np.concatenate(number)
    near = _core.overlapping(centre, which, place, _CONTACT * r, 5.0 * r)
    if sight is not None:
        # where nothing was seen, bridges know nothing of each other's height
        near &= ~sight.occluded(centre, r)
    return cost + _INSIDE * 2.0 * spacing * float(near.sum())
