"""Ropes that do not branch: chains that are sure, of which no end meets a strand where a junction may be."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from strand._core import NotEnoughDataError
from strand.config import Config
from strand.reconstruction.evidence.confidence import compute_trust
from strand.reconstruction.harness.strands import Strand
from strand.reconstruction.harness.surface_map import SurfaceMap
from strand.reconstruction.stages import Found, Observed, Run
from strand.reconstruction.tubes.clouds import Clouds
from strand.ropes.chain import Chain
from strand.ropes.contacts import Contact, find_contacts
from strand.ropes.crossings import find_crossings
from strand.support.checks import Array

_MAX_VIEWS = 3  # more hardly make chains surer
_MIN_TRUST = 0.6  # of chains that count
_ALIKE = 1.4  # ratio of a radius and the half width of a strand's mask at most
_MEETING = 0.5  # gap between an end's axis and a strand's surface where they meet at most, radii
_LEVEL = 0.5  # difference of their heights there at most, sums of their radii
_SAME_PLACE = 4.0  # distance of such an end from a junction there at most, radii
_OWN = 6.0  # stretch of rope at an end that it cannot meet, radii
_TIED = 0.5  # gap of strands that a tie may hold together, radii
_TIE = 0.95  # height of a tie over the strands' axes at least, ridges: between touching ropes is a valley
_NEAR_CONTACT = 3.0  # distance of a tie from where the strands touch at most, radii
_APART = 1.3  # distance of the axes of strands under a tie at most, sums of their radii
_BENT = np.radians(55.0)  # radians: turn of strands beside each other that are branches instead
_BENT_REACH = np.array([-3.0, -1.5, 1.5, 3.0])  # radii from the place of the turn where it has its directions
_BESIDE = 2.3  # distance of these turns at most, sums of their radii
_STEP = 0.25  # radii: distance of the places where ties are sought


Method = Callable[[Observed, Config, Run], Found]
"""A way to find ropes that do not branch."""


@dataclass(frozen=True, eq=False)
class Ropes:
    """Ropes that a method found, as if none branched.

    Attributes
    ----------
    chains : list of Chain
        Empty if the method is not sure of them.
    trust : float
        How sure it is, from 0 to 1.
    """

    chains: list[Chain]
    trust: float


def trace_ropes(observed: Observed, config: Config, run: Run, method: Method) -> Ropes:
    """Return ropes by a method, in a few of the views.

    Parameters
    ----------
    observed : Observed
    config : Config
    run : Run
        Its warnings stay as they are.
    method : callable
    """
    try:
        found = method(_take_few(observed), config, run.fork())
    except NotEnoughDataError:
        return Ropes([], 0.0)
    # how far an end reaches is no question of branches
    trust = compute_trust([doubt for doubt in found.doubts or () if doubt.kind != "end"])
    return Ropes(list(found.chains) if trust >= _MIN_TRUST else [], trust)


def list_seen_radii(radii: Array, halves: Sequence[float]) -> tuple[int, ...]:
    """Return the numbers of the radii that strands of some half widths may have; all if none may be any.

    Where nobody gave them, some are those of noise. The thinnest ones take tubes longest.
    """
    ratios = np.abs(np.log(radii[:, None] / np.array(halves)))
    seen = np.flatnonzero(ratios.min(axis=1) < np.log(_ALIKE))
    return tuple(seen.tolist() if len(seen) else range(len(radii)))


def find_alone(chains: Sequence[Chain], drawn: SurfaceMap, junctions: Array) -> list[Strand] | None:
    """Return ropes as strands without junctions; None if they may branch.

    Parameters
    ----------
    chains : sequence of Chain
        Of `trace_ropes`.
    drawn : SurfaceMap
    junctions : (J, 2) ndarray
        Rows and columns of the junctions that the map shows.
    """
    up = drawn.frame[:, 2]
    if not chains or _turn_apart(chains, up):
        return None
    meetings = _find_meetings(chains, up)
    if len(meetings) and len(junctions):
        places, _ = drawn.flatten(meetings)
        away = np.linalg.norm(places[:, None] - junctions, axis=2) * drawn.cell
        if away.min() < _SAME_PLACE * max(chain.radius for chain in chains):
            return None
    least = _LEVEL * 2.0 * min(chain.radius for chain in chains)
    if any(abs(crossing.height) < least for crossing in find_crossings(chains, up, ())):
        return None
    contacts = find_contacts(chains, _TIED * min(chain.radius for chain in chains), up)
    if any(_may_be_tied(contact, chains, drawn) for contact in contacts):
        return None
    return [Strand(chain.points, (None, None), chain.radius, chain.closed) for chain in chains]


def _take_few(observed: Observed) -> Observed:
    """Return a few of the views, evenly spread, the held one among them, and as few of their points as do."""
    count = min(len(observed.views), _MAX_VIEWS)
    chosen = sorted(
        (observed.held + len(observed.views) * turn // count) % len(observed.views) for turn in range(count)
    )
    views = [observed.views[place] for place in chosen]
    step = Clouds.from_views(views, None).find_fit_step(observed.radius)
    if step > 1:
        views = [view.select(np.arange(len(view.points)) % step == 0) for view in views]
    return replace(
        observed,
        views=views,
        whole=[observed.whole[place] for place in chosen],
        numbers=[observed.numbers[place] for place in chosen],
        middle=observed.numbers[observed.held],
    )


def _may_be_tied(contact: Contact, chains: Sequence[Chain], drawn: SurfaceMap) -> bool:
    """Tell whether a tie may hold two strands together: between them lies a surface above both."""
    first, second = (chains[number] for number, _ in (contact.first, contact.second))
    reach = first.radius + second.radius
    up = drawn.frame[:, 2]
    if abs(float((contact.point_first - contact.point_second) @ up)) > _LEVEL * reach:
        return False
    some, other = (
        _sample_around(chain, stretch)
        for chain, stretch in ((first, contact.stretch_first), (second, contact.stretch_second))
    )
    gaps = np.linalg.norm(some[:, None] - other, axis=2)
    beside = other[gaps.argmin(axis=1)]
    # where one lies on the other, the surface is high without a tie
    near = (gaps.min(axis=1) < _APART * reach) & (np.abs((some - beside) @ up) < _LEVEL * reach)
    middles = 0.5 * (some + beside)[near]
    if not len(middles):
        return False
    places, heights = drawn.flatten(middles)
    return float((drawn.sample_heights(places) - heights).max()) > 0.5 * _TIE * drawn.ridge * reach


def _sample_around(chain: Chain, stretch: tuple[float, float]) -> Array:
    """Return places (M, 3) on a chain along a stretch and somewhat beyond."""
    more = _NEAR_CONTACT * chain.radius
    low, high = max(stretch[0] - more, 0.0), min(stretch[1] + more, chain.length)
    count = max(int((high - low) / (_STEP * chain.radius)), 2)
    return chain.at(np.linspace(low, high, count))


def _turn_apart(chains: Sequence[Chain], up: Array) -> bool:
    """Tell whether two strands turn sharply beside each other, as branches of two junctions do."""
    bent = [_list_bends(chain, up) for chain in chains]
    for (some, own), (other, others) in combinations(zip(chains, bent, strict=True), 2):
        gaps = np.linalg.norm(own[:, None] - others, axis=2)
        if gaps.min(initial=np.inf) < _BESIDE * (some.radius + other.radius):
            return True
    return False


def _list_bends(chain: Chain, up: Array) -> Array:
    """Return places (M, 3) where a chain turns sharply in the plan: over a crossing it turns in height."""
    reach = _BENT_REACH * chain.radius
    s = np.arange(reach[-1], chain.length - reach[-1], _STEP * chain.radius)
    if not len(s):
        return np.zeros((0, 3))
    before, start, stop, after = (chain.at(s + away) for away in reach)
    first, second = ((way - np.outer(way @ up, up)) for way in (start - before, after - stop))
    sizes = np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)
    cosines = np.einsum("ij,ij->i", first, second) / np.maximum(sizes, 1e-18)
    return chain.at(s[cosines < np.cos(_BENT)])


def _find_meetings(chains: Sequence[Chain], up: Array) -> Array:
    """Return the ends (M, 3) that lie at a strand's side, at its height, metres."""
    found = []
    for number, chain in enumerate(chains):
        if chain.closed:
            continue
        for s in (0.0, chain.length):
            tip = chain.at(np.array([s]))[0]
            if any(
                _lies_beside(tip, chain, _leave_out(chain, s) if other == number else host.points, host, up)
                for other, host in enumerate(chains)
            ):
                found.append(tip)
    return np.array(found).reshape(-1, 3)


def _leave_out(chain: Chain, s: float) -> Array:
    """Return the nodes of a chain that its end at an arc length can meet."""
    away = np.abs(np.linspace(0.0, chain.length, len(chain.points)) - s)
    return chain.points[away > _OWN * chain.radius]


def _lies_beside(tip: Array, chain: Chain, nodes: Array, host: Chain, up: Array) -> bool:
    """Tell whether an end of a chain lies at the side of a host with some nodes, at its height."""
    if not len(nodes):
        return False
    offsets = nodes - tip
    nearest = offsets[np.einsum("ij,ij->i", offsets, offsets).argmin()]
    rise = float(nearest @ up)
    gap = float(np.linalg.norm(nearest - rise * up)) - host.radius
    return gap < _MEETING * chain.radius and abs(rise) < _LEVEL * (chain.radius + host.radius)
