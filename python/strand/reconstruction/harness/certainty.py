"""How sure a harness is: each place where strands meet, and the graph as a whole."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from strand.geometry.polyline import path_length
from strand.reconstruction.harness.graph import Graph
from strand.reconstruction.harness.look_doubts import doubt_hidden_ends
from strand.reconstruction.harness.method import FoundHarness
from strand.reconstruction.harness.rises import list_rises
from strand.reconstruction.harness.strands import ENDS, WIDER, measure_parts
from strand.ropes.chain import Chain
from strand.ropes.doubt import Doubt
from strand.support.checks import Array
from strand.support.robust import estimate_deviation

_JUNCTION = 0.985  # confidence of a junction that nothing speaks against
_SLOW = 0.92  # of it where branches part slowly, so that the place is not sure
_SLOW_ANGLE = np.radians(50.0)  # radians between branches that part slowly
_SLOW_REACH = (2.0, 8.0)  # radii from the junction between which branches have their directions
_TOUCHING = 0.92  # of it where an end that touches a strand's side looks the same
_STRAIGHT = np.radians(30.0)  # radians: turn of a strand that goes straight on at most
_EQUAL = 1.1  # ratio of radii of one kind of rope at most
_END = 0.998  # that of a free end
_CROSSING = 0.985  # that of a crossing
_EVEN = 0.5  # margin of a place's interpretation where the next best one is as likely
_SCALE = 1.0  # difference of margins that multiplies the odds by e
_WORTH_SAYING = 0.03  # probability against a place that makes a doubt
_UNCONFIRMED = 0.15  # doubt of ropes that cross, which tubes do not confirm
_SMALL_NOISE = 0.4  # of the least radius: noise that raises no doubt
_NOISE_DOUBT = 1.5  # doubt for each further least radius of noise
_SHORT = 3.0  # sums of radii: shorter edges may be part of one place
_SHORT_DOUBT = 0.25  # doubt of each
_NEAR_END = 4.0  # radii: ends nearer than this to another strand may belong to it
_LEVEL = 0.6  # difference of heights of strands beside each other at most, sums of their radii
_NEAR_DOUBT = 0.15  # doubt of each
_INSIDE = 0.85  # distance of an end from another strand's axis where one is inside the other, sums of radii
_INSIDE_DOUBT = 0.5  # doubt of such an end
_GAP = 5.0  # length of a gap in which a strand may go on at most, greater radii of its sides
_GAP_REACH = 4.0  # length of the end that tells where it points, radii
_FACING = 0.3  # cosine of the angle between an end and the way across the gap at least
_GAP_DOUBT = 0.35  # doubt of each
_BENT = np.radians(65.0)  # radians: turn of an edge close to its junction that is no rope's
_BENT_REACH = (1.5, 6.0)  # radii from the junction between which it turns
_BENT_DOUBT = 0.15  # doubt of each
_LOST_WIRES = 0.7  # doubt of a junction at which wires that lie side by side do not add up
_STRETCHES = 8  # of equal numbers of points; the first and the last one do not tell
_FEWEST = 25  # points of each at least
_UNEVEN = 1.55  # scatter of one stretch at least, that of the median one
_SMOOTH = 0.05  # the same, radii
_UNEVEN_DOUBT = 0.4  # doubt of each such strand
_FEWEST_NODES = 20  # of a strand whose parts are compared at least
_WIDER_DOUBT = 0.25  # doubt of each strand that is much wider in one part
_RISE_DOUBT = 0.3  # doubt of each strand that rises over nothing
_LEFT_SHARE = 0.04  # share of points beside all tubes that raises no doubt
_LEFT_DOUBT = 5.0  # doubt for all points beyond


@dataclass(frozen=True, eq=False)
class Certainty:
    """Probabilities and doubts of a graph.

    Attributes
    ----------
    nodes : list of float
        The confidence of each node.
    crossings : list of float
        That of each place where strands cross.
    doubts : list of Doubt
        Doubts of the graph beside these.
    """

    nodes: list[float]
    crossings: list[float]
    doubts: list[Doubt]

    def weigh(self, doubts: Sequence[Doubt]) -> float:
        """Return the probability that the whole graph is right, with all doubts of the answer."""
        alone = sum(doubt.amount for doubt in doubts if doubt.kind not in ("junction", "wires"))
        return float(np.prod([*self.nodes, *self.crossings]) * np.exp(-alone))


def judge(found: FoundHarness, graph: Graph, chains: Sequence[Chain]) -> Certainty:
    """Return how sure a graph is.

    Parameters
    ----------
    found : FoundHarness
    graph : Graph
    chains : sequence of Chain
        The edges.
    """
    decided, fit = found.decided, found.fitted.fit
    joined = {end for strand in found.strands for end in strand.ends if end is not None}
    margins = [decided.junctions[number].margin for number in sorted(joined)]
    tied = [decided.junctions[number].tied for number in sorted(joined)]
    nodes = []
    for number, (margin, is_tied) in enumerate(zip(margins, tied, strict=True)):
        at = _list_directions(graph, chains, number)
        doubtful = (_SLOW if _part_slowly(at) else 1.0) * (
            _TOUCHING if not is_tied and _may_touch(at) else 1.0
        )
        nodes.append(_JUNCTION * _to_probability(margin) * doubtful)
    nodes += [_END] * (len(graph.places) - len(nodes))
    passings = {} if found.traced else {passing.place: passing for passing in decided.passings}
    crossings = [_CROSSING * _to_probability(passing.margin) for passing in passings.values()]
    doubts = [
        Doubt("junction", 1.0 - sure, "whether strands are joined", _WHY_JOINED, graph.places[number])
        for number, sure in enumerate(nodes)
        if sure < 1.0 - _WORTH_SAYING
    ]
    for passing, sure in zip(passings.values(), crossings, strict=True):
        if sure < 1.0 - _WORTH_SAYING:
            place = found.drawn.lift(passing.middle[None], np.array([passing.height]))[0]
            doubts.append(Doubt("junction", 1.0 - sure, "whether strands cross", _WHY_CROSSING, place))
    if not joined and len(found.lines.hubs) and not found.traced:
        reason = "tubes do not confirm that these are ropes without junctions"
        doubts.append(Doubt("rival", _UNCONFIRMED, "whether there is a junction", reason))
    if found.trust is not None:
        amount = -math.log(max(found.trust, 1e-9))
        doubts.append(Doubt("rival", amount, "how ropes run", "where they cross, they may run otherwise"))
    noise = fit.sigma / float(fit.radii.min()) - _SMALL_NOISE
    if noise > 0.0:
        reason = f"the noise, {fit.sigma * 1e3:.2g} mm, is wide for ropes of {fit.radii.min() * 1e3:.2g} mm"
        doubts.append(Doubt("noise", _NOISE_DOUBT * noise, "how the strands run", reason))
    # beside the mask lie points of the table, if there is one
    covered = fit.explained if found.ground.table is None else fit.explained[found.drawn.cover(fit.points)]
    left = 1.0 - float(covered.mean()) - _LEFT_SHARE if len(covered) else 1.0
    if left > 0.0:
        reason = f"{100.0 * (left + _LEFT_SHARE):.0f} % of the points lie on no strand"
        doubts.append(Doubt("left out", _LEFT_DOUBT * left, "what is there", reason))
    doubts += doubt_hidden_ends(graph, chains, found.ground.up)
    doubts += _doubt_edges(graph, chains)
    doubts += _doubt_ends(graph, chains, found.ground.up)
    # on a table, the map shows that nothing lies between ends
    doubts += _doubt_gaps(graph, chains) if found.ground.table is None else []
    doubts += _doubt_lost_wires(found, graph)
    doubts += _doubt_uneven(found)
    doubts += _doubt_widths(found)
    doubts += _doubt_rises(found, chains)
    return Certainty(nodes, crossings, doubts)


_WHY_JOINED = "a crossing, or an end that lies on a strand, explains it nearly as well"
_WHY_CROSSING = "a junction explains it nearly as well"


def _to_probability(margin: float) -> float:
    """Return the probability of an interpretation that is better than the next one by a margin."""
    return float(1.0 / (1.0 + np.exp(-(margin + _EVEN) / _SCALE)))


def _list_directions(graph: Graph, chains: Sequence[Chain], node: int) -> list[tuple[float, Array]]:
    """Return the radius, metres, and the direction of each edge that leaves a node."""
    found = []
    for pair, chain in zip(graph.pairs, chains, strict=True):
        for late in (0, 1):
            if pair[late] == node:
                s = np.minimum(np.array(_SLOW_REACH) * chain.radius, 0.5 * chain.length)
                first, last = chain.at(chain.length - s if late else s)
                length = max(float(np.linalg.norm(last - first)), 1e-12)
                found.append((chain.radius, (last - first) / length))
    return found


def _part_slowly(at: Sequence[tuple[float, Array]]) -> bool:
    """Tell whether two edges leave a node at a small angle."""
    return max(_list_cosines(at), default=-1.0) > float(np.cos(_SLOW_ANGLE))


def _may_touch(at: Sequence[tuple[float, Array]]) -> bool:
    """Tell whether a rope of the same radius may end at the side of one that goes straight on."""
    radii = [radius for radius, _ in at]
    straight = min(_list_cosines(at), default=1.0) < -float(np.cos(_STRAIGHT))
    return len(at) == 3 and straight and max(radii) < _EQUAL * min(radii)


def _list_cosines(at: Sequence[tuple[float, Array]]) -> list[float]:
    """Return the cosine of the angle between each two edges."""
    return [float(one @ other) for k, (_, one) in enumerate(at) for _, other in at[:k]]


def _doubt_edges(graph: Graph, chains: Sequence[Chain]) -> list[Doubt]:
    """Doubt edges that are too short, or that turn sharply beside their junction."""
    degrees, doubts = graph.degrees, []
    for pair, chain in zip(graph.pairs, chains, strict=True):
        radius, length = chain.radius, chain.length
        if length < 2.0 * _SHORT * radius and max(degrees[node] for node in pair) > 1:
            reason = "an edge is hardly longer than thick: is it part of a junction?"
            doubts.append(
                Doubt("rival", _SHORT_DOUBT, "whether there is a branch", reason, chain.at(0.5 * length))
            )
        for late, node in enumerate(pair):
            if degrees[node] < 2 or length < 2.0 * _BENT_REACH[1] * radius:
                continue
            s = np.array([0.0, *_BENT_REACH, _BENT_REACH[1] + _BENT_REACH[0]]) * radius
            places = chain.at(length - s if late else s)
            steps = np.diff(places, axis=0)
            steps /= np.maximum(np.linalg.norm(steps, axis=1, keepdims=True), 1e-12)
            if np.arccos(np.clip(steps[0] @ steps[2], -1.0, 1.0)) > _BENT:
                reason = "an edge turns sharply beside its junction"
                doubts.append(Doubt("rival", _BENT_DOUBT, "how strands run", reason, graph.places[node]))
    return doubts


def _doubt_ends(graph: Graph, chains: Sequence[Chain], up: Array) -> list[Doubt]:
    """Doubt free ends that lie beside another strand, or beside another end, at its height."""
    doubts = []
    for number, late in graph.list_free_ends():
        chain = chains[number]
        tip = chain.points[-late]
        for other in [other for k, other in enumerate(chains) if k != number]:
            offsets, reach = other.points - tip, chain.radius + other.radius
            away = np.linalg.norm(offsets[np.abs(offsets @ up) < _LEVEL * reach], axis=1)
            nearest = float(away.min(initial=np.inf))
            if nearest < _NEAR_END * chain.radius:
                # ropes do not lie inside each other
                amount = _INSIDE_DOUBT if nearest < _INSIDE * reach else _NEAR_DOUBT
                reason = "a strand ends beside another one: they may be joined"
                doubts.append(Doubt("end", amount, "whether a strand ends", reason, tip))
                break
    return doubts


def _doubt_gaps(graph: Graph, chains: Sequence[Chain]) -> list[Doubt]:
    """Doubt free ends that point at each other across a gap: a strand may go on where no camera saw it."""
    tips = []
    for number, late in graph.list_free_ends():
        chain = chains[number]
        s = min(_GAP_REACH * chain.radius, 0.5 * chain.length)
        tip, inner = chain.at([chain.length, chain.length - s] if late else [0.0, s])
        tips.append((number, tip, (tip - inner) / max(float(np.linalg.norm(tip - inner)), 1e-12)))
    doubts = []
    for (some, tip, outward), (other, ahead, back) in combinations(tips, 2):
        way = ahead - tip
        length = float(np.linalg.norm(way))
        faces = min(float(way @ outward), -float(way @ back)) > _FACING * length
        if some != other and faces and length < _GAP * max(chains[some].radius, chains[other].radius):
            reason = f"strands end {1e3 * length:.0f} mm apart, and point at each other"
            doubts.append(Doubt("end", _GAP_DOUBT, "whether strands end", reason, tip + 0.5 * way))
    return doubts


def _doubt_uneven(found: FoundHarness) -> list[Doubt]:
    """Doubt round strands off whose surface points lie farther in one stretch than in the others.

    There two strands run side by side, say.
    """
    fit, doubts = found.fitted.fit, []
    for number in np.flatnonzero(~found.beside.flat).tolist():
        own = np.flatnonzero(fit.curve == number)
        if len(own) < _STRETCHES * _FEWEST:
            continue
        stretches = np.array_split(own[np.argsort(fit.parameter[own], kind="stable")], _STRETCHES)[1:-1]
        scatter = np.array([estimate_deviation(fit.residual[stretch]) for stretch in stretches])
        worst = int(scatter.argmax())
        if scatter[worst] > max(_UNEVEN * float(np.median(scatter)), _SMOOTH * fit.radius(number)):
            reason = "in one stretch, points lie farther off the strand's surface than elsewhere"
            place = fit.points[stretches[worst]].mean(axis=0)
            doubts.append(Doubt("rival", _UNEVEN_DOUBT, "whether two strands run there", reason, place))
    return doubts


def _doubt_widths(found: FoundHarness) -> list[Doubt]:
    """Doubt round strands whose mask is far wider in one part: another strand goes on there, say."""
    drawn, doubts = found.drawn, []
    for strand, is_flat in zip(found.strands, found.beside.flat, strict=True):
        along = path_length(strand.nodes)
        reach = ENDS * strand.half_width
        inner = strand.nodes[(along > reach) & (along < along[-1] - reach)]
        widths = drawn.sample_widths(drawn.flatten(inner)[0])
        # a method for ropes may lead strands off the mask
        inner, widths = inner[widths > 0.0], widths[widths > 0.0]
        if is_flat or len(inner) < _FEWEST_NODES:
            continue
        parts = measure_parts(widths)
        if max(parts) > WIDER * min(parts):
            reason = f"a strand is {max(parts) / min(parts):.1f} times as wide in one part as in another"
            place = np.array_split(inner, len(parts))[int(np.argmax(parts))].mean(axis=0)
            doubts.append(Doubt("rival", _WIDER_DOUBT, "how strands run", reason, place))
    return doubts


def _doubt_rises(found: FoundHarness, chains: Sequence[Chain]) -> list[Doubt]:
    """Doubt strands on a table that rise over nothing: an end may lie below, and another rope go on there."""
    if found.ground.table is None:
        return []
    lines = [(chain.points, chain.radius, chain.closed) for chain in chains]
    reason = "a strand rises over nothing: it may lie on an end"
    return [
        Doubt("rival", _RISE_DOUBT, "whether a strand goes on there", reason, place)
        for place in list_rises(lines, found.ground.up)
    ]


def _doubt_lost_wires(found: FoundHarness, graph: Graph) -> list[Doubt]:
    """Doubt junctions of flat strands whose wires do not add up: a branch lies along one of them, say."""
    beside = found.beside
    if not beside.flat.any():
        return []
    of_round = np.rint((found.fitted.widths / beside.radius) ** 2)
    wires = np.where(beside.flat, beside.wires, of_round)
    doubts = []
    for node in range(len(graph.places)):
        at = [(wires[n], beside.flat[n]) for n, pair in enumerate(graph.pairs) for end in pair if end == node]
        counts = [count for count, _ in at]
        if len(at) > 1 and any(is_flat for _, is_flat in at) and sum(counts) != 2.0 * max(counts):
            reason = f"{', '.join(f'{count:.0f}' for count in counts)} wires side by side do not add up"
            place = graph.places[node]
            doubts.append(Doubt("rival", _LOST_WIRES, "whether a branch is missing", reason, place))
    return doubts
