"""Events of tracked ropes, and the watch that notices crossings made and undone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from strand._core import find_crossed_segments
from strand.geometry.plane import Plane
from strand.support.checks import Array
from strand.tracking.rope_state import RopeState

_SAME_PLACE = 8.0  # radii along both strands: a crossing moves by less in a frame
_CONFIRMED = 4  # frames in which a crossing is seen, or not, until it counts as made, or undone
_BENT = 6.0  # radii of rope between two strands; within less it only bends
_AT_END = 1.0  # radii: a crossing this near to an end is not there yet
_HIGH = 0.6  # radii: height of one strand over the other that tells which lies on top
_MEMORY = 0.7  # of the mean height of the last frames
_HIDDEN_AGE = 0.15  # s: where both strands were not seen for longer, crossings are not judged
_FROM_END = 12.0  # radii: strands farther from all ends cannot pass through one another


@dataclass(frozen=True)
class Event:
    """Something that happened to a tracked rope; `str()` describes it in words.

    Attributes
    ----------
    kind : str
        "begun", "crossing made", "crossing undone", "end covered", "end seen", "lost", "found" or
        "restarted".
    time : float
        Time of the answer, s.
    rope : int
        Number of the rope; of the upper strand for a crossing.
    s : float or None
        Place along the rope, metres: of the crossing, or of the end.
    under : (int, float) or None
        Rope and place of the lower strand of a crossing.
    doubtful : bool
        Whether a crossing was made or undone away from all ends, where strands cannot pass through one
        another.
    """

    kind: str
    time: float
    rope: int
    s: float | None = None
    under: tuple[int, float] | None = None
    doubtful: bool = False

    def __str__(self) -> str:
        place = "" if self.s is None else f" at {1e3 * self.s:.0f} mm"
        text = f"{self.time:.3f} s: rope {self.rope}{place}: {self.kind}"
        if self.under is not None:
            text += f", over rope {self.under[0]} at {1e3 * self.under[1]:.0f} mm"
        return text + (", doubtful" if self.doubtful else "")


@dataclass(frozen=True)
class WatchedCrossing:
    """A crossing that is followed.

    Attributes
    ----------
    ropes : (int, int)
        Numbers of both ropes, the smaller first.
    s : (float, float)
        Places along both, metres.
    height : float
        Mean height of the first strand over the second, metres.
    count : int
        Frames in which it was seen until it was made; since then frames in a row in which it was not.
    made : bool
    margin : float
        Distance from the nearest end along the rope when it was first seen, metres.
    """

    ropes: tuple[int, int]
    s: tuple[float, float]
    height: float
    count: int = 1
    made: bool = False
    margin: float = 0.0


def watch_crossings(
    watched: Sequence[WatchedCrossing],
    ropes: Sequence[RopeState],
    up: Array,
    time: float,
    first: bool,
) -> tuple[tuple[WatchedCrossing, ...], list[Event]]:
    """Return the crossings to follow after a frame, and which were made or undone.

    Those of the `first` frame are made already.
    """
    now = find_track_crossings(ropes, up)
    numbers = {rope.number: rope for rope in ropes}
    free = list(now)
    kept: list[WatchedCrossing] = []
    events: list[Event] = []
    for old in watched:
        radius = numbers[old.ropes[0]].radius
        near = [(_measure_distance(old, new), i) for i, new in enumerate(free) if new.ropes == old.ropes]
        best = min(near, default=(np.inf, -1))
        if best[0] <= _SAME_PLACE * radius * (1.0 + 0.5 * (old.count if old.made else 0)):
            new = free.pop(best[1])
            height = old.height
            if abs(new.height) > _HIGH * radius or not old.made:
                height = _MEMORY * old.height + (1.0 - _MEMORY) * new.height
            if old.made and np.sign(height) != np.sign(old.height):
                height = old.height  # strands do not pass through one another
            count = 0 if old.made else old.count + 1
            kept.append(replace(old, s=new.s, height=height, count=count))
        elif not old.made:
            continue
        elif _is_judged(old, numbers):
            kept.append(replace(old, count=old.count + 1))
        else:
            kept.append(old)
    kept += [replace(new, made=first, count=0 if first else 1) for new in free]
    after: list[WatchedCrossing] = []
    for one in kept:
        if not one.made and one.count >= _CONFIRMED and _is_judged(one, numbers):
            one = replace(one, made=True, count=0)
            events.append(_describe("crossing made", one, numbers, time))
        elif one.made and one.count >= _CONFIRMED:
            events.append(_describe("crossing undone", one, numbers, time))
            continue
        after.append(one)
    return tuple(after), _pair_off(events)


def find_track_crossings(ropes: Sequence[RopeState], up: Array) -> list[WatchedCrossing]:
    """Return where ropes cross as seen along `up`, beyond bends and ends."""
    axes = Plane(up, 0.0).axes
    nodes = np.concatenate([rope.nodes for rope in ropes])
    starts = np.cumsum([0] + [len(rope.nodes) for rope in ropes])
    segments = np.concatenate(
        [np.stack([np.arange(a, b - 1), np.arange(a + 1, b)], axis=1) for a, b in pairwise(starts.tolist())]
    )
    pairs, shares, _ = find_crossed_segments((nodes - nodes.mean(axis=0)) @ axes, segments)
    found = []
    for pair, share in zip(segments[pairs][:, :, 0], shares, strict=True):
        places = []
        for node, x in zip(pair, share, strict=True):
            i = int(np.searchsorted(starts, node, side="right")) - 1
            rope = ropes[i]
            at = node - starts[i] + x
            point = (1.0 - x) * nodes[node] + x * nodes[node + 1]
            places.append((rope.number, float(at * rope.spacing), float(point @ up), rope))
        places.sort(key=lambda place: (place[0], place[1]))
        (a, sa, ha, first), (b, sb, hb, second) = places
        if a == b and sb - sa < _BENT * first.radius:
            continue
        margins = [min(s, rope.length - s) - _AT_END * rope.radius for s, rope in ((sa, first), (sb, second))]
        if min(margins) < 0.0:
            continue
        found.append(WatchedCrossing((a, b), (sa, sb), ha - hb, margin=min(margins)))
    return found


def _measure_distance(one: WatchedCrossing, other: WatchedCrossing) -> float:
    return max(abs(a - b) for a, b in zip(one.s, other.s, strict=True))


def _is_judged(crossing: WatchedCrossing, numbers: dict[int, RopeState]) -> bool:
    """Tell whether the strands around a crossing were seen lately."""
    for number, s in zip(crossing.ropes, crossing.s, strict=True):
        rope = numbers[number]
        reach = 4.0 * rope.radius / rope.spacing
        at = s / rope.spacing
        low, high = max(round(at - reach), 0), min(round(at + reach) + 1, len(rope.nodes))
        if rope.scalars[low:high, 2].min() > _HIDDEN_AGE:
            return False
    return True


def _describe(kind: str, one: WatchedCrossing, numbers: dict[int, RopeState], time: float) -> Event:
    places = list(zip(one.ropes, one.s, strict=True))
    over, under = places if one.height >= 0 else places[::-1]
    margin = one.margin
    if kind == "crossing undone":
        margin = min(min(s, numbers[number].length - s) for number, s in places)
    return Event(kind, time, over[0], over[1], under, margin > _FROM_END * numbers[over[0]].radius)


def _pair_off(events: list[Event]) -> list[Event]:
    """Return events without doubt about two of a kind in a frame: a loop was laid over a strand."""
    kinds = [event.kind for event in events]
    return [replace(event, doubtful=event.doubtful and kinds.count(event.kind) == 1) for event in events]


def watch_ends(ropes: Sequence[RopeState], time: float) -> tuple[tuple[RopeState, ...], list[Event]]:
    """Return ropes with the ends that count as covered, and which were covered or seen again.

    An end changes when it was otherwise in several frames in a row.
    """
    events, watched = [], []
    for rope in ropes:
        covered, counts = list(rope.covered_ends), list(rope.end_counts)
        for end, s in ((0, 0.0), (1, rope.length)):
            hidden = bool(rope.hidden[-end])
            counts[end] = counts[end] + 1 if hidden != covered[end] else 0
            if counts[end] >= _CONFIRMED:
                covered[end], counts[end] = hidden, 0
                kind = "end covered" if hidden else "end seen"
                events.append(Event(kind, time, rope.number, s))
        watched.append(
            replace(rope, covered_ends=(covered[0], covered[1]), end_counts=(counts[0], counts[1]))
        )
    return tuple(watched), events
