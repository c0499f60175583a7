"""How near tracked ropes are to the truth of a simulated sequence, frame by frame."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

import strand
from strand.ropes.summary import ACT_CONFIDENCE
from strand.synthetic.sequences import SyntheticSequence
from strand.tracking.events import Event
from strand.tracking.track import Track, TrackedRope

RIGHT = 5.0  # radii: Fréchet distance below which a rope is right
PLACES = 120  # along a rope, for the Fréchet distance
MATCHED = 4  # first frames in which ropes are matched with the true ones anew
DEVIATIONS = 2.0
SOON = 0.5  # s after an occlusion
MUCH = 0.15  # of a rope hidden: an occlusion
ACTED = np.linspace(0.1, 0.9, 9)  # shares of a rope's length: places to act on
EXPLAINED = 0.03  # of the ropes' pixels that no rope explains, at most
BESIDE = 4.0  # radii around a place that are seen
ASTRAY = 2.0  # radii from the rope: a place that is wrong
NEAR_EVENT = 0.5  # s between a true and a reported crossing event

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Judged:
    """One rope in one frame; lengths in metres, `frechet` in radii; `seen_distance` without hidden parts.

    `acted` of the places along it may be acted on by the rule of docs/tracking.md, `astray` of them are off.
    """

    time: float
    frechet: float
    turned: bool
    material: float
    distance: float
    seen_distance: float
    within: float
    predicted: int
    hidden: int
    both: int
    share_hidden: float
    points: Array
    acted: int
    astray: int


@dataclass
class Watched:
    """A tracked sequence: what was judged, and the processor time of its frames, s."""

    sequence: SyntheticSequence
    ropes: list[Judged | None] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    true_events: list[tuple[float, str, int, int]] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    beside: float = 0.0
    exchanged: int = 0
    true_numbers: dict[int, int] = field(default_factory=dict)


class Later(Future[Any]):
    """A task that runs when its answer is asked for; `spent` is called with its processor time, s."""

    def __init__(self, work: Callable[[], Any], spent: Callable[[float], None]) -> None:
        super().__init__()
        self.work, self.spent = work, spent

    def result(self, timeout: float | None = None) -> Any:
        if not self.done():
            begun = time.process_time()
            self.set_result(self.work())
            self.spent(time.process_time() - begun)
        return super().result(timeout)


class Beside:
    """Stands for the tracker's second thread, so that its processor time is counted apart."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def submit(self, work: Callable[..., Any], *arguments: Any) -> Later:
        return Later(lambda: work(*arguments), self.add)

    def add(self, seconds: float) -> None:
        self.seconds += seconds


def track_sequence(
    sequence: SyntheticSequence, *, masks: bool = True, anchors: bool = False, lengths: bool = False
) -> Watched:
    """Track a sequence and judge each frame."""
    whole = [
        spacing * (len(nodes) - 1)
        for spacing, nodes in zip(sequence.spacings, sequence.nodes[0], strict=True)
    ]
    tracker = strand.Tracker(sequence.radius, len(whole), whole if lengths else None)
    beside = Beside()
    tracker._opinions._pool = beside  # type: ignore[assignment]
    watched = Watched(sequence)
    pairs: dict[int, tuple[int, bool]] = {}
    for number, frame in enumerate(sequence):
        views = frame.views if masks else [_drop_mask(frame, camera) for camera in range(len(frame.depth))]
        if anchors and pairs:
            _anchor(tracker, frame, pairs, whole)
        begun, other = time.process_time(), beside.seconds
        track = tracker.update(views, frame.time)
        watched.seconds.append(time.process_time() - begun - (beside.seconds - other))
        watched.events += track.events
        if track.ropes and (not pairs or number < MATCHED):
            pairs = _match(track, frame.nodes)
        watched.ropes += _judge(frame, track, pairs, whole, sequence.radius)
        watched.exchanged += _count_exchanged(frame.nodes, track, pairs)
    watched.beside = beside.seconds
    watched.true_numbers = {number: i for i, (number, _) in pairs.items()}
    watched.true_events = list_true_events(sequence)
    return watched


def _drop_mask(frame: Any, camera: int) -> strand.View:
    colors = None if frame.color is None else frame.color[camera]
    return strand.View.from_depth(
        frame.depth[camera], frame.intrinsics, frame.poses[camera], colors, depth_scale=frame.depth_scale
    )


def _anchor(
    tracker: strand.Tracker, frame: Any, pairs: dict[int, tuple[int, bool]], whole: Sequence[float]
) -> None:
    for gripper in frame.grippers:
        number, turned = pairs[gripper.rope]
        s = whole[gripper.rope] - gripper.s if turned else gripper.s
        if gripper.holds:
            tracker.anchor(number, s, gripper.pose, frame.time)
        elif tracker._holds:
            tracker.release(number, s)


def _match(track: Track, nodes: Sequence[Array]) -> dict[int, tuple[int, bool]]:
    """Return the number of each true rope's track, and whether it runs the other way."""
    pairs, free = {}, list(track.ropes)
    for i, line in enumerate(nodes):
        options = [
            (
                float(np.linalg.norm(_place(rope, turned, PLACES) - _resample(line, PLACES), axis=1).mean()),
                rope.number,
                turned,
            )
            for rope in free
            for turned in (False, True)
        ]
        if not options:
            continue
        _, number, turned = min(options)
        pairs[i] = number, turned
        free = [rope for rope in free if rope.number != number]
    return pairs


def _count_exchanged(nodes: Sequence[Array], track: Track, pairs: dict[int, tuple[int, bool]]) -> int:
    """Return how many tracks are nearer to another true rope than to their own."""
    count = 0
    for i, (number, turned) in pairs.items():
        rope = _find(track, number)
        if rope is None or len(nodes) < 2:
            continue
        line = _place(rope, turned, PLACES)
        away = [float(np.linalg.norm(line - _resample(other, PLACES), axis=1).mean()) for other in nodes]
        count += int(np.argmin(away)) != i and min(away) < RIGHT * rope.radius
    return count


def _judge(
    frame: Any, track: Track, pairs: dict[int, tuple[int, bool]], whole: Sequence[float], radius: float
) -> list[Judged | None]:
    judged: list[Judged | None] = []
    for i, (line, hidden) in enumerate(zip(frame.nodes, frame.hidden, strict=True)):
        number, turned = pairs.get(i, (-1, False))
        rope = _find(track, number)
        if rope is None:
            judged.append(None)
            continue
        at = np.linspace(0.0, whole[i], len(line))
        own = rope.s[-1] - rope.s[::-1] if turned else rope.s
        points = rope.points[::-1] if turned else rope.points
        covariance = rope.covariance[::-1] if turned else rope.covariance
        predicted = rope.predicted[::-1] if turned else rope.predicted
        there = np.stack([np.interp(at, own, points[:, k]) for k in range(3)], axis=1)
        near = np.clip(np.searchsorted(own, at), 0, len(own) - 1)
        off = np.linalg.norm(there - line, axis=1)
        deviation = np.sqrt(np.trace(covariance[near], axis1=1, axis2=2))
        places = _place(rope, turned, PLACES)
        true = _resample(line, PLACES)
        frechet = measure_frechet(places, true)
        distances = measure_distances(places, line)
        is_seen = ~hidden[np.linalg.norm(places[:, None] - line, axis=2).argmin(axis=1)]
        chosen = _choose_places(rope, track)
        judged.append(
            Judged(
                time=frame.time,
                frechet=frechet / radius,
                turned=measure_frechet(places[::-1], true) < min(frechet, RIGHT * radius),
                material=float(np.median(off)),
                distance=float(distances.mean()),
                seen_distance=float(distances[is_seen].mean()) if is_seen.any() else np.nan,
                within=float((off < DEVIATIONS * deviation).mean()),
                predicted=int(predicted[near].sum()),
                hidden=int(hidden.sum()),
                both=int((predicted[near] & hidden).sum()),
                share_hidden=float(hidden.mean()),
                points=places,
                acted=len(chosen),
                astray=int((measure_distances(chosen, line) > ASTRAY * radius).sum()) if len(chosen) else 0,
            )
        )
    return judged


def _choose_places(rope: TrackedRope, track: Track) -> Array:
    """Return (K, 3) the places of a rope that may be acted on."""
    if rope.state != "tracking" or not rope.confidence > ACT_CONFIDENCE or track.unexplained >= EXPLAINED:
        return np.empty((0, 3))
    near = np.abs(rope.s[:, None] - ACTED * rope.length) < BESIDE * rope.radius
    seen = (rope.seen[:, None] | ~near).all(axis=0)
    return np.asarray(rope.at(ACTED[seen] * rope.length))


def _find(track: Track, number: int) -> TrackedRope | None:
    return next((rope for rope in track.ropes if rope.number == number), None)


def _place(rope: TrackedRope, turned: bool, count: int) -> Array:
    s = np.linspace(0.0, rope.s[-1], count)
    line = np.stack([np.interp(s, rope.s, rope.points[:, k]) for k in range(3)], axis=1)
    return line[::-1] if turned else line


def _resample(line: Array, count: int) -> Array:
    at = np.linspace(0.0, len(line) - 1.0, count)
    return np.stack([np.interp(at, np.arange(len(line)), line[:, k]) for k in range(3)], axis=1)


def measure_distances(places: Array, line: Array) -> Array:
    """Return the distance of each of (K, 3) places from a line of (N, 3) points, metres."""
    starts, ways = line[:-1], np.diff(line, axis=0)
    off = places[:, None] - starts
    shares = np.clip((off * ways).sum(axis=2) / np.square(ways).sum(axis=1), 0.0, 1.0)
    return np.asarray(np.linalg.norm(off - shares[..., None] * ways, axis=2).min(axis=1))


def measure_frechet(one: Array, other: Array) -> float:
    """Return the discrete Fréchet distance of two lines, metres."""
    distances = np.linalg.norm(one[:, None] - other, axis=2)
    reach = np.maximum.accumulate(distances[0])
    for row in distances[1:]:
        below = np.minimum(reach, np.concatenate([[np.inf], reach[:-1]]))
        now = np.empty_like(row)
        before = np.inf
        for k, (least, distance) in enumerate(zip(below.tolist(), row.tolist(), strict=True)):
            before = max(distance, min(least, before))
            now[k] = before
        reach = now
    return float(reach[-1])


def list_true_events(sequence: SyntheticSequence, frames: int = 4) -> list[tuple[float, str, int, int]]:
    """Return the true crossings made and undone: time, kind, and the numbers of the upper and the lower rope.

    A crossing counts if it lasts for some frames, and is two radii from all ends.
    """
    kept: list[list[float | int]] = []
    events: list[tuple[float, str, int, int]] = []
    for number, frame in enumerate(sequence):
        now = [one for one in frame.crossings if _is_inside(one, frame, sequence)]
        for one in now:
            place = sorted([one.over, one.under])
            match = next(
                (
                    old
                    for old in kept
                    if (old[0], old[2]) == (place[0][0], place[1][0])
                    and abs(old[1] - place[0][1]) + abs(old[3] - place[1][1]) < 30.0 * sequence.radius
                ),
                None,
            )
            if match is None:
                kept.append(
                    [
                        place[0][0],
                        place[0][1],
                        place[1][0],
                        place[1][1],
                        1,
                        0,
                        number,
                        one.over[0],
                        one.under[0],
                        0,
                    ]
                )
            else:
                match[1], match[3], match[5] = place[0][1], place[1][1], -1
                match[4] += 1
        for old in list(kept):
            old[5] += 1
            if old[5] == 0 and old[4] == frames and not old[9]:
                old[9] = 1
                if old[6] > 0:
                    events.append((frame.time, "crossing made", int(old[7]), int(old[8])))
            if old[5] >= frames:
                kept.remove(old)
                if old[9]:
                    events.append((frame.time, "crossing undone", int(old[7]), int(old[8])))
    return events


def _is_inside(crossing: Any, frame: Any, sequence: SyntheticSequence) -> bool:
    for rope, s in (crossing.over, crossing.under):
        length = sequence.spacings[rope] * (len(frame.nodes[rope]) - 1)
        if min(s, length - s) < 2.0 * sequence.radius:
            return False
    return True


def match_events(watched: Watched) -> tuple[int, int, int, int]:
    """Return the numbers of true, reported, matching and reversed events of crossings."""
    free = [event for event in watched.events if event.kind.startswith("crossing")]
    reported, matched, turned = len(free), 0, 0
    for at, kind, over, under in watched.true_events:
        near = [event for event in free if event.kind == kind and abs(event.time - at) < NEAR_EVENT]
        if not near:
            continue
        best = min(near, key=lambda event: abs(event.time - at))
        free.remove(best)
        matched += 1
        turned += over != under and watched.true_numbers.get(best.rope) != over
    return len(watched.true_events), reported, matched, turned
