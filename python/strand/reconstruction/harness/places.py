"""Decide for each place where arcs meet: a junction, a crossing, or an end that lies on a strand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from strand.reconstruction.harness.groups import Place, list_layouts
from strand.reconstruction.harness.lines import End, Lines
from strand.reconstruction.harness.parting import find_parting, find_tip
from strand.reconstruction.harness.surface_map import SurfaceMap
from strand.support.checks import Array

_MAX_MARGIN = 4.0  # margin of a junction at most
_UNLIKE = 0.3  # share of a junction's unexplained heights that lessens its margin


@dataclass(frozen=True, eq=False)
class Junction:
    """A place where arcs are joined.

    Attributes
    ----------
    place : (2,) ndarray
        Row and column.
    hub : (2,) ndarray
        Row and column of the middle of its hubs, where the strands come apart.
    ends : list of End
        The arcs' ends that meet there.
    margin : float
        Cost of the next best interpretation over this one's.
    tied : bool
        Whether a tie tells the place.
    """

    place: Array
    hub: Array
    ends: list[End]
    margin: float
    tied: bool = False


@dataclass(frozen=True, eq=False)
class Passing:
    """Two ends of arcs that are one strand, which crosses another.

    Attributes
    ----------
    ends : (End, End)
    height : float
        Of the strand's surface at the crossing, metres.
    other : float or None
        Of the other strand's surface there; None if the other is an end.
    middle : (2,) ndarray
        Row and column of the crossing.
    margin : float
        Cost of the next best interpretation over this one's.
    place : int
        Number of the place, which may have two of them.
    """

    ends: tuple[End, End]
    height: float
    other: float | None
    middle: Array
    margin: float
    place: int

    @property
    def is_below(self) -> bool:
        """Whether the other strand lies on this one."""
        return self.other is not None and self.height < self.other


@dataclass(frozen=True, eq=False)
class LaidEnd:
    """A free end that lies on another strand, or under it: it goes on to a place."""

    end: End
    place: Array
    under: bool


@dataclass(frozen=True, eq=False)
class Decisions:
    """The readings of all places.

    Attributes
    ----------
    junctions : list of Junction
    passings : list of Passing
    laid : list of LaidEnd
    inner : set of int
        Numbers of arcs inside crossings and junctions, which are no edges.
    """

    junctions: list[Junction]
    passings: list[Passing]
    laid: list[LaidEnd]
    inner: set[int]


def decide_places(lines: Lines, drawn: SurfaceMap, floor: float | None) -> Decisions:
    """Decide what each place where arcs meet is.

    Parameters
    ----------
    lines : Lines
    drawn : SurfaceMap
    floor : float or None
        Height of the table, metres; a crossing rises above its surroundings there. None without a table.
    """
    ((_, places),) = list_layouts(lines, drawn, floor, 1)
    return collect_decisions(lines, drawn, places)


def collect_decisions(lines: Lines, drawn: SurfaceMap, places: Sequence[Place]) -> Decisions:
    """Return what the places of a layout are: junctions, crossings, and ends that lie on strands."""
    junctions: list[Junction] = []
    passings: list[Passing] = []
    laid: list[LaidEnd] = []
    inner: set[int] = set()
    for number, place in enumerate(places):
        group, reading = place.group, place.reading
        inner.update(group.inner)
        ends = group.ends
        for (some, other), height, crossed in zip(
            reading.pairs, reading.heights, reading.others, strict=True
        ):
            both = (ends[some], ends[other])
            middle = lines.hubs[[lines.arcs[arc].hubs[end] for arc, end in both]].mean(axis=0)
            passings.append(Passing(both, height, crossed, middle, place.margin, number))
        if reading.laid is not None:
            port = group.ports[reading.laid]
            base = None if reading.under else reading.heights[0]
            ((some, other),) = reading.pairs
            passed = np.concatenate([lines.arcs[ends[own][0]].cells for own in (some, other)])
            near = {*group.inner, *(arc for arc, _ in ends)}
            further = [arc.cells for number, arc in enumerate(lines.arcs) if number not in near]
            cells = np.concatenate([np.zeros((0, 2)), *further])
            tip = find_tip(port, group.middle, passed, cells, base, drawn)
            laid.append(LaidEnd(ends[reading.laid], tip, reading.under))
        if reading.junction:
            own = [group.ports[port] for port in reading.junction]
            middle = lines.hubs[list(group.hubs)].mean(axis=0) if reading.place is None else reading.place
            margin = min(_MAX_MARGIN, place.margin) - _UNLIKE * reading.unlike
            joined = [ends[port] for port in reading.junction]
            parting = find_parting(middle, own, lines, drawn)
            junctions.append(Junction(parting, middle, joined, margin, reading.tied))
    return Decisions(junctions, passings, laid, inner)
