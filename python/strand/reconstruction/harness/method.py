"""Find a harness: ropes that branch, as a graph of junctions, ends and strands."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

import strand._core as _core
from strand._core import NotEnoughDataError
from strand.config import Config
from strand.reconstruction.default import find_chains
from strand.reconstruction.harness.alone import Method, Ropes, find_alone, list_seen_radii, trace_ropes
from strand.reconstruction.harness.flat_bundles import (
    FlatBundles,
    find_flat_bundles,
    hold_at_ties,
    lay_strands,
)
from strand.reconstruction.harness.ground import Ground, find_ground
from strand.reconstruction.harness.groups import list_layouts
from strand.reconstruction.harness.joint_fit import Fitted, fit_harness
from strand.reconstruction.harness.lines import Lines, trace_lines
from strand.reconstruction.harness.net_evidence import weigh_layouts
from strand.reconstruction.harness.onward import follow_ends
from strand.reconstruction.harness.places import Decisions, collect_decisions, decide_places
from strand.reconstruction.harness.rises import list_rises
from strand.reconstruction.harness.strands import (
    Strand,
    drop_collapsed,
    follow_strands,
    list_pairs,
    reach_edges,
)
from strand.reconstruction.harness.surface_map import SurfaceMap, make_map
from strand.reconstruction.harness.wires import Possible, choose_radii, list_bundles
from strand.reconstruction.stages import Observed, Run
from strand.reconstruction.tubes.clouds import Clouds
from strand.reconstruction.tubes.method import find_chains as find_tubes
from strand.reconstruction.wide_surfaces import describe_surface
from strand.ropes.netlist import Netlist
from strand.support.checks import Array

_MAX_WIDTH = 1.8  # half width of strands whose points may be a surface, greatest radii
_MAX_LAYOUTS = 12  # that a netlist chooses from
_LEAST_COSINE = 0.25  # of the angle between up and the way to the cameras
_SAME_COSINE = 0.98  # of the same: above it both looks are one
_MAX_ASKED = 40  # places where strands meet of ropes that tubes are asked about at most
_MAX_STRANDS = 120  # of a harness: more are a net, or no ropes


SECOND_LOOK = "a look at the harness from the cameras"
AS_ROPES = "the ropes that there are if none branches"
"""Names of the work that a deadline may skip."""


@dataclass(frozen=True, eq=False)
class FoundHarness:
    """A harness, and what it was found by.

    Attributes
    ----------
    drawn : SurfaceMap
    ground : Ground
    lines : Lines
    decided : Decisions
    strands : list of Strand
        Before the fit.
    beside : FlatBundles
        Which strands are wires side by side.
    places : (J, 3) ndarray
        The junctions before the fit, metres.
    fitted : Fitted
    trust : float or None
        How sure a method for ropes is of the strands, which are ropes without junctions; None if the strands
        are those of the map.
    """

    drawn: SurfaceMap
    ground: Ground
    lines: Lines
    decided: Decisions
    strands: list[Strand]
    beside: FlatBundles
    places: Array
    fitted: Fitted
    trust: float | None

    @property
    def traced(self) -> bool:
        """Whether a method for ropes traced the strands."""
        return self.trust is not None


def find_harnesses(
    observed: Observed, config: Config, run: Run, wire: float | None = None, net: Netlist | None = None
) -> Iterator[FoundHarness]:
    """Yield the graph of ropes that branch as it looks from above, from the cameras, and as ropes alone.

    From above, no strand hides another's side, but one view does not see what lies behind strands. From the
    cameras nothing is missing, but strands that lie one behind the other look as if they met. The methods for
    ropes see through tangles in single views, but know no junctions; nothing is yielded if they are not sure.

    Parameters
    ----------
    observed : Observed
    config : Config
    run : Run
        Past its deadline, nothing follows the first.
    wire : float, optional
        The radius of a wire, metres, if strands are bundles of wires.
    net : Netlist, optional
        The harness as it should be: evidence where heights do not decide.

    Raises
    ------
    strand.NotEnoughDataError
        If the points show no ropes from above.
    """
    values = observed.radii.values
    asked = _Asked(
        observed,
        (float(values.min()), float(values.max())),
        Possible(
            None if observed.radii.free or observed.radii.held else values,
            None if wire is None else list_bundles(wire),
        ),
        wire,
        net,
        config,
        run,
    )
    with run.stage("register"):
        ground = find_ground(observed, asked.extremes)
    by_tubes = cache(lambda some: asked.trace(some, find_tubes))
    above = _look(ground, ground.up, asked)
    first = _answer(above, by_tubes, asked)
    yield first
    if first.traced:
        # ropes may leave a bridge between them unexplained
        with contextlib.suppress(NotEnoughDataError):
            yield _fit(above, None, asked)
        return
    toward = ground.ways.sum(axis=0)
    toward /= np.linalg.norm(toward)
    if _LEAST_COSINE < float(toward @ ground.up) < _SAME_COSINE and not run.skips(SECOND_LOOK):
        with contextlib.suppress(NotEnoughDataError):
            yield _answer(_look(ground, toward, asked), by_tubes, asked)
    # several views tell strands apart, and reading all their images would take long
    if len(observed.views) == 1 and not run.skips(AS_ROPES):
        # the image is read for ropes of one radius alone, as each of several would take long, too
        last = _find_ropes(
            above, lambda some: asked.trace(some, find_chains) if len(some) == 1 else Ropes([], 0.0), asked
        )
        if last is not None:
            yield last


_TraceRopes = Callable[[tuple[int, ...]], Ropes]


@dataclass(frozen=True, eq=False)
class _Asked:
    """The question to all looks: the views, the radii and the wire that strands may have, the netlist."""

    observed: Observed
    extremes: tuple[float, float]
    possible: Possible
    wire: float | None
    net: Netlist | None
    config: Config
    run: Run

    def trace(self, some: tuple[int, ...], method: Method) -> Ropes:
        """Return ropes with the radii of some numbers, by a method."""
        observed = replace(self.observed, radii=self.observed.radii.select(some))
        return trace_ropes(observed, self.config, self.run, method)


@dataclass(frozen=True, eq=False)
class _Sight:
    """A harness as it looks from one side, before the fit; the attributes are those of `FoundHarness`."""

    ground: Ground
    drawn: SurfaceMap
    lines: Lines
    decided: Decisions
    strands: list[Strand]
    beside: FlatBundles
    places: Array


def _look(ground: Ground, toward: Array, asked: _Asked) -> _Sight:
    """Return a harness as it looks against a unit vector."""
    observed, run, possible = asked.observed, asked.run, asked.possible
    with run.stage("map"):
        drawn = make_map(
            ground.clouds,
            ground.viewpoints,
            ground.floor,
            ground.up,
            toward,
            asked.extremes,
            observed.held,
        )
        lines = trace_lines(drawn, asked.extremes[0])
    with run.stage("places"):
        if len(lines.arcs) > _MAX_STRANDS:
            raise NotEnoughDataError(
                f"views: the points make {len(lines.arcs)} strands, at most {_MAX_STRANDS}: a net, or noise; "
                "give bounds or masks of the ropes alone"
            )
        floor = None if ground.table is None else ground.table.offset
        decided = _decide(lines, drawn, floor, possible.radii, asked.net)
        strands = follow_strands(lines, decided, drawn, possible.radii)
        if not strands:
            raise NotEnoughDataError("views: the points make no strand; is the radius right, in metres?")
        _refuse_surfaces(strands, observed, asked.extremes[1])
        beside = find_flat_bundles(strands, drawn, ground.table, asked.wire)
        if beside.flat.any():
            decided = hold_at_ties(decided, strands, beside, drawn)
            strands = follow_strands(lines, decided, drawn, possible.radii)
        places = _lift_junctions(decided, strands)
        strands = drop_collapsed(strands)
        beside = find_flat_bundles(strands, drawn, ground.table, asked.wire)
        strands, ground = follow_ends(strands, beside.flat, ground)
    return _Sight(ground, drawn, lines, decided, strands, beside, places)


def _answer(sight: _Sight, ropes: _TraceRopes, asked: _Asked) -> FoundHarness:
    """Return the ropes that do not branch, or the graph that the map shows; `ropes` traces some radii."""
    found = _find_ropes(sight, ropes, asked) if len(sight.lines.hubs) or _hides_ends(sight) else None
    return _fit(sight, None, asked) if found is None else found


def _hides_ends(sight: _Sight) -> bool:
    """Tell whether an end may lie under a strand, or on it, without a hub."""
    lines = [(strand.nodes, strand.half_width, strand.closed) for strand in sight.strands]
    return sight.ground.table is not None and len(list_rises(lines, sight.ground.up)) > 0


def _find_ropes(sight: _Sight, ropes: _TraceRopes, asked: _Asked) -> FoundHarness | None:
    """Return ropes that do not branch; None if they may."""
    decided, drawn = sight.decided, sight.drawn
    with asked.run.stage("places"):
        if (
            len(sight.lines.hubs) > _MAX_ASKED
            or asked.net is not None
            or any(junction.tied for junction in decided.junctions)
            or _are_bundles(sight.strands, len(sight.places), asked.possible.given)
        ):
            return None
        halves = [strand.half_width for strand in sight.strands]
        traced = ropes(list_seen_radii(asked.observed.radii.values, halves))
        junctions = np.array([junction.place for junction in decided.junctions]).reshape(-1, 2)
        alone = find_alone(traced.chains, drawn, junctions)
        if alone is None:
            return None
        strands = reach_edges(alone, drawn)
        beside = find_flat_bundles(strands, drawn, sight.ground.table, asked.wire)
    sight = replace(sight, strands=strands, beside=beside, places=np.zeros((0, 3)))
    return _fit(sight, traced.trust, asked)


def _fit(sight: _Sight, trust: float | None, asked: _Asked) -> FoundHarness:
    """Fit strands to the points of all views."""
    observed, ground, drawn, beside = asked.observed, sight.ground, sight.drawn, sight.beside
    with asked.run.stage("fit"):
        strands = lay_strands(sight.strands, beside, drawn)
        centers = np.array([view.viewpoint for view in observed.views])
        clouds = Clouds(
            [_core.copy_constant(cloud) for cloud in ground.given], centers, observed.held, observed.bounds
        )
        held = [junction.tied for junction in sight.decided.junctions][: len(sight.places)]
        fitted = fit_harness(
            clouds,
            strands,
            beside,
            sight.places,
            held,
            ground.motions,
            asked.possible,
            asked.config,
            ground.correlated,
        )
    return FoundHarness(
        drawn, ground, sight.lines, sight.decided, strands, beside, sight.places, fitted, trust
    )


def _decide(
    lines: Lines, drawn: SurfaceMap, floor: float | None, radii: Array | None, net: Netlist | None
) -> Decisions:
    """Decide what each place is: as costs least, or least together with a netlist."""
    if net is None:
        return decide_places(lines, drawn, floor)
    layouts = list_layouts(lines, drawn, floor, _MAX_LAYOUTS)
    decided = [collect_decisions(lines, drawn, places) for _, places in layouts]
    found = [(follow_strands(lines, one, drawn, radii), len(one.junctions)) for one in decided]
    costs = np.array([cost for cost, _ in layouts]) + weigh_layouts(net, found)
    best = int(costs.argmin())
    rival = float(np.sort(costs)[1] - costs[best]) if len(costs) > 1 else np.inf
    # where the netlist decides, a place is as sure as the whole
    places = [
        replace(place, margin=rival) if (place.margin < rival and best == 0) or place.margin < 0.0 else place
        for place in layouts[best][1]
    ]
    return collect_decisions(lines, drawn, places)


def _refuse_surfaces(strands: list[Strand], observed: Observed, radius: float) -> None:
    """Refuse strands far wider than ropes of the greatest radius, metres, that look like a surface."""
    if np.median([strand.half_width for strand in strands]) > _MAX_WIDTH * radius:
        surface = describe_surface(observed.views, radius)
        if surface is not None:
            raise NotEnoughDataError(f"views: {surface}")


def _are_bundles(strands: list[Strand], junctions: int, radii: Array | None) -> bool:
    """Tell whether all junctions have the widths of bundles that part, which ropes that touch have not."""
    if not junctions or radii is None:
        return False
    halves = np.array([strand.half_width for strand in strands])
    chosen = choose_radii(halves, list_pairs(strands, junctions), radii)
    return not chosen.unequal and not chosen.refused


def _lift_junctions(decided: Decisions, strands: list[Strand]) -> Array:
    """Return the junctions (J, 3): where their thickest strand ends, metres."""
    places = np.zeros((len(decided.junctions), 3))
    for number in range(len(places)):
        at = [
            (strand.half_width, strand.nodes[-late])
            for strand in strands
            for late in (0, 1)
            if strand.ends[late] == number
        ]
        places[number] = max(at, key=lambda found: found[0])[1]
    return places
