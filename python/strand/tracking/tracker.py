"""Tracker: the same ropes, frame after frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strand.config import Config
from strand.geometry.plane import Plane
from strand.ropes.model import Model
from strand.support.checks import Array, check_integer, check_number, freeze_array
from strand.tracking.beginning import (
    ASKED,
    Beginning,
    agree,
    begin_ropes,
    choose_beginning,
    keep_order,
    make_beginning,
)
from strand.tracking.certainty import confirm_certainty, drop_settled, match_chains
from strand.tracking.events import Event, WatchedCrossing, watch_crossings, watch_ends
from strand.tracking.frame import Frame, check_frame, make_past_frame
from strand.tracking.holding import Held, Place, check_reach, find_hold, find_rope, hold_place, place_holds
from strand.tracking.masks import Appearance, find_mask, learn_colors
from strand.tracking.opinions import Opinions
from strand.tracking.rope_state import LOST, TENTATIVE, TRACKING, RopeState
from strand.tracking.saved_state import SavedState, pack_state, unpack_state
from strand.tracking.settings import check_settings
from strand.tracking.states import LOST_AGE, confirm_state, judge_state, lose_rope
from strand.tracking.stepping import Step, step_ropes
from strand.tracking.table import find_table
from strand.tracking.track import Track, describe_rope
from strand.tracking.watching import is_doubtful
from strand.views.view import View

_INTERVAL = 1.0 / 30.0  # s between frames without times
_MOST_AHEAD = 5.0  # s that a prediction goes ahead
_TABLE_EVERY = 30  # frames between two looks for the table
_FIRST_FRAMES = 5  # frames in which the errors of depth are learned quickly
_MOST_ELAPSED = 1.0  # s: ropes move no farther in a longer gap between frames
_USUAL_RADIUS = 0.005  # metres, until a rope is found


class Tracker:
    """Follows ropes through the images of one camera or of several, frame after frame.

    Ends keep their order, places keep their arc length, and hidden places are predicted and said to be. A
    tracker begins by itself: the first frames are reconstructed until several answers agree. Later a
    reconstruction runs beside it on another thread. Its answer enters a fixed number of frames later, so
    equal frames give equal answers. Not safe to call from two threads at once.

    Parameters
    ----------
    radius : float or sequence of float, optional
        The ropes' radius or radii, metres, as in `reconstruct`.
    ropes : int, optional
        The number of ropes; by default as many as the first answer has.
    length : float or sequence of float, optional
        The ropes' lengths, metres, as in `reconstruct`. Without it, a rope whose end is covered when it
        begins is taken to go on for up to 3.5 radii below what covers it. `length_sd` says how unsure it is.
    model : Model, optional
        An answer for the first frame, for instance of other views. It may be a little older.
    config : Config, optional
        For `reconstruct`.

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If a number is out of range, or the model has no chains.

    Examples
    --------
    >>> import strand
    >>> frames = strand.synthetic.sequence("carry", seed=1, frames=3)
    >>> tracker = strand.Tracker(radius=frames.radius, ropes=1)
    >>> for frame in frames:
    ...     track = tracker.update([frame.view()], frame.time)
    >>> len(track.ropes)
    1
    """

    def __init__(
        self,
        radius: float | Sequence[float] | None = None,
        ropes: int | None = None,
        length: float | Sequence[float] | None = None,
        model: Model | None = None,
        config: Config | None = None,
    ) -> None:
        self._settings = check_settings(radius, ropes, length, model, config)
        self._ropes: tuple[RopeState, ...] = ()
        self._last: Frame | None = None
        self._table: Plane | None = None
        self._up: Array | None = None
        self._biases: Array = np.zeros(0)
        self._count = 0
        self._answers: list[Beginning] = []
        self._chosen: Beginning | None = None
        self._reason = ""
        self._step: Step | None = None
        self._opinions = Opinions(self._settings)
        self._crossings: tuple[WatchedCrossing, ...] = ()
        self._events: list[Event] = []
        self._holds: dict[Place, Held] = {}
        self._appearances: list[Appearance | None] = []

    def update(self, views: Sequence[View | None], time: float | Sequence[float] | None = None) -> Track:
        """Move the ropes to where the images of a frame show them.

        Parameters
        ----------
        views : sequence of View or None
            One view of a depth image for each camera, always in the same order; None where a camera has no
            image. Poses may change from frame to frame.
        time : float or sequence of float, optional
            Time of the images, or one for each of them, s, later than that of the last frame. By default
            it is `View.stamp`; frames of views without a stamp are 1/30 s apart.

        Returns
        -------
        Track
            At the time of the latest image.

        Raises
        ------
        TypeError
            If an argument is of the wrong kind.
        ValueError
            If a view has no depth image, the number of cameras or the size of an image has changed, or
            the time is not later than the last one.
        """
        given = check_frame(views, time, self._last, _INTERVAL)
        elapsed = _INTERVAL if self._last is None else given.time - self._last.time
        before = self.__dict__ | {"_events": list(self._events), "_appearances": list(self._appearances)}
        try:
            if self._last is None:
                self._biases = np.zeros(len(given.views))
                self._appearances = [None] * len(given.views)
            frame = self._find_masks(given, elapsed)
            self._last = frame
            self._find_table(frame)
            if self._ropes:
                self._follow(frame, elapsed)
            elif frame.given_views:
                self._begin(frame)
        except BaseException:
            # a frame that fails changes nothing
            self.__dict__.update(before)
            raise
        self._count += 1
        return self._answer(frame.time, frame.times)

    def predict(self, time: float) -> Track:
        """Return where the ropes will be at a time, s, that is not before the last frame.

        Every node goes on with its velocity. The covariances grow with the time ahead.
        """
        at = check_number("time", time)
        if self._last is None:
            raise ValueError("time: expected a tracker that has seen a frame")
        if at < self._last.time:
            raise ValueError(f"time: expected a time from {self._last.time:g} s on, got {at:g}")
        ahead = at - self._last.time
        if ahead > _MOST_AHEAD:
            raise ValueError(
                f"time: expected a time up to {_MOST_AHEAD:g} s after the last frame, got {at:g}"
            )
        ropes = tuple(describe_rope(rope, self._upwards, ahead) for rope in self._ropes)
        step = self._step
        bare = 0.0 if step is None else step.unexplained
        return Track(ropes, (), at, self._last.times, bare, freeze_array(self._upwards), self._table)

    def anchor(self, rope: int, s: float, pose: ArrayLike, time: float | None = None) -> None:
        """Say that a gripper holds a rope at a place, until `release`.

        Call it again whenever the gripper moves.

        Parameters
        ----------
        rope : int
            Number of the rope.
        s : float
            Arc length of the place, metres; places beyond an end count as the end.
        pose : (4, 4) or (3,) array_like
            Pose of the gripper's middle between the fingers in the world frame, or its position, metres.
        time : float, optional
            Time of the pose, s; by default that of the next frame. Two poses give the gripper's velocity.
        """
        state, place = find_rope(self._ropes, check_integer("rope", rope)), check_number("s", s)
        place = min(max(place, 0.0), state.length)
        key = find_hold(self._holds, state, place) or (state.number, place)
        held = hold_place(self._holds.get(key), pose, time)
        check_reach(state, place, held.point)
        self._holds[key] = held

    def release(self, rope: int, s: float) -> None:
        """Say that no gripper holds a rope at a place any more: the nearest place that `anchor` gave.

        Raises
        ------
        ValueError
            If there is no such rope, or nothing holds it.
        """
        state, place = find_rope(self._ropes, check_integer("rope", rope)), check_number("s", s)
        key = find_hold(self._holds, state, place, np.inf)
        if key is None:
            raise ValueError(f"rope, s: expected a place that is held, got rope {rope} at {s:g} m")
        del self._holds[key]

    @property
    def state(self) -> dict[str, NDArray[Any]]:
        """The tracker's knowledge as arrays by their names, which `numpy.savez` takes.

        It leaves out a reconstruction that runs beside it. `Tracker.from_state` goes on from it.
        """
        return pack_state(
            SavedState(
                time=None if self._last is None else self._last.time,
                count=self._count,
                since_opinion=self._opinions.since,
                biases=self._biases,
                up=self._up,
                table=self._table,
                ropes=self._ropes,
                crossings=self._crossings,
                holds=dict(self._holds),
                appearances=tuple(self._appearances),
            )
        )

    @classmethod
    def from_state(
        cls,
        state: Mapping[str, Any],
        radius: float | Sequence[float] | None = None,
        ropes: int | None = None,
        length: float | Sequence[float] | None = None,
        config: Config | None = None,
    ) -> Tracker:
        """Return a tracker that goes on from a saved state, given what the first one was told.

        Parameters
        ----------
        state : mapping of str to array
            `Tracker.state`, or what `numpy.load` returns for the file that `numpy.savez` wrote of it.
        radius, ropes, length, config
            As in `Tracker`.

        Raises
        ------
        ValueError
            If it is not the state of a tracker, or of another version.
        """
        saved = unpack_state(state)
        tracker = cls(radius, ropes, length, None, config)
        if saved.time is not None:
            tracker._last = make_past_frame(saved.time, len(saved.biases))
        tracker._count, tracker._opinions.since = saved.count, saved.since_opinion
        tracker._biases, tracker._up, tracker._table = saved.biases, saved.up, saved.table
        tracker._ropes, tracker._crossings = saved.ropes, saved.crossings
        tracker._holds, tracker._appearances = saved.holds, list(saved.appearances)
        return tracker

    @property
    def _upwards(self) -> Array:
        return np.array([0.0, 0.0, 1.0]) if self._up is None else self._up

    # frames

    def _begin(self, frame: Frame) -> None:
        """Begin with the ropes of the first frames."""
        if self._settings.model is not None:
            chosen, certain = make_beginning(self._settings.model, frame), True
        else:
            choice = self._choose(frame)
            if choice is None:
                return
            chosen, certain = choice
        ropes = begin_ropes(chosen, self._settings.ropes, self._settings.lengths, certain)
        self._start(ropes, chosen, frame)

    def _start(self, ropes: tuple[RopeState, ...], chosen: Beginning, frame: Frame) -> None:
        again = bool(self._ropes)
        self._chosen = chosen
        self._up = np.asarray(chosen.model.up if self._table is None else self._table.normal)
        if self._table is None:
            self._table = chosen.model.table
        if not frame.is_masked:
            self._learn(frame, ropes, fresh=True)
            frame = self._find_masks(frame, _INTERVAL, ropes)
        step = step_ropes(frame, ropes, self._biases, self._table, _INTERVAL, bias_gain=0.5, free=True)
        still = tuple(
            replace(
                rope,
                velocities=np.zeros_like(rope.nodes),
                covered_ends=(bool(rope.hidden[0]), bool(rope.hidden[-1])),
            )
            for rope in step.ropes
        )
        judged = tuple(judge_state(rope, step.unexplained) for rope in still)
        self._take(replace(step, ropes=judged))
        self._opinions.forget()
        self._opinions.remember(frame, _INTERVAL, replace(step, ropes=judged))
        if not again:
            self._events += [Event("begun", frame.time, rope.number) for rope in ropes]
        self._crossings, _ = watch_crossings((), self._ropes, self._upwards, frame.time, True)

    def _follow(self, frame: Frame, elapsed: float) -> None:
        """Move the ropes to where a frame shows them."""
        if self._is_tentative and self._count < ASKED and frame.given_views:
            self._begin_again(frame)
        before = self._ropes
        self._enter(frame)
        held = place_holds(self._ropes, self._holds, frame.time)
        gain = 0.5 if self._count < _FIRST_FRAMES else 0.1
        if elapsed > LOST_AGE:
            held, elapsed = tuple(map(lose_rope, held)), min(elapsed, _MOST_ELAPSED)
            self._opinions.blind = True
        step = step_ropes(frame, held, self._biases, self._table, elapsed, bias_gain=gain)
        self._take(step)
        self._opinions.remember(frame, elapsed, step)
        impossible = self._judge(before, frame.time)
        if not frame.is_masked and not is_doubtful(step):
            self._learn(frame, self._ropes)
        self._opinions.watch(self._count, self._table, impossible, self._is_tentative)

    @property
    def _is_tentative(self) -> bool:
        return any(rope.state == TENTATIVE for rope in self._ropes)

    def _begin_again(self, frame: Frame) -> None:
        """Ask another first frame, and begin anew if its answer is surer."""
        choice = self._choose(frame)
        if choice is None:
            return
        chosen, certain = choice
        if self._chosen is None or not agree(chosen.model, self._chosen.model):
            ropes = begin_ropes(chosen, self._settings.ropes, self._settings.lengths, certain)
            self._start(keep_order(self._ropes, ropes), chosen, frame)
        elif certain:
            self._ropes = tuple(replace(rope, state=TRACKING) for rope in self._ropes)
        for answer in self._answers:
            if agree(answer.model, chosen.model):
                chains = match_chains(answer.model, self._ropes)
                self._ropes = tuple(map(confirm_certainty, self._ropes, chains))

    def _choose(self, frame: Frame) -> tuple[Beginning, bool] | None:
        """Ask a first frame; return the best answer so far, and whether it is certain."""
        found = self._opinions.ask(frame).result()
        if isinstance(found, str):
            self._reason = found
            return None
        self._reason = f"{len(found.chains)} found, fewer than ropes = {self._settings.ropes}"
        self._answers = [*self._answers, make_beginning(found, frame)][-ASKED:]
        return choose_beginning(self._answers, self._settings.ropes)

    def _take(self, step: Step) -> None:
        self._step, self._ropes, self._biases = step, step.ropes, step.biases

    def _judge(self, before: Sequence[RopeState], time: float) -> bool:
        """Say in which state each rope is, and what happened; return whether that is impossible."""
        assert self._step is not None
        judged = tuple(judge_state(rope, self._step.unexplained) for rope in self._ropes)
        for old, new in zip(before, judged, strict=True):
            if old.state != LOST and new.state == LOST:
                self._events.append(Event("lost", time, new.number))
            if old.state == LOST and new.state == TRACKING:
                self._events.append(Event("found", time, new.number))
        judged, ended = watch_ends(judged, time)
        if any(event.kind == "end seen" for event in ended):
            judged = tuple(map(drop_settled, judged))
        self._events += ended
        self._crossings, crossed = watch_crossings(self._crossings, judged, self._upwards, time, False)
        self._events += crossed
        self._take(replace(self._step, ropes=judged))
        return any(event.doubtful for event in crossed)

    def _enter(self, frame: Frame) -> None:
        """Let an answer enter that was asked for a fixed number of frames ago."""
        entered = self._opinions.enter(self._count, self._table)
        if entered is None:
            return
        if entered.step is None:
            ropes = map(confirm_state, self._ropes) if entered.agrees else self._ropes
            self._ropes = entered.weigh(tuple(ropes))
            return
        pairs = zip(self._ropes, entered.step.ropes, strict=True)
        restarted = [new.number for old, new in pairs if new.generation != old.generation]
        self._events += [Event("restarted", frame.time, number) for number in restarted]
        if restarted:
            self._crossings, _ = watch_crossings((), entered.step.ropes, self._upwards, frame.time, True)
        live = [
            replace(
                new,
                state=old.state,
                covered_ends=old.covered_ends,
                end_counts=old.end_counts,
                confidence=old.confidence,
                doubts=old.doubts,
            )
            for old, new in zip(self._ropes, entered.step.ropes, strict=True)
        ]
        self._take(replace(entered.step, ropes=tuple(live)))
        self._ropes = entered.weigh(self._ropes)

    # what the frames show beside ropes

    def _find_masks(self, frame: Frame, elapsed: float, ropes: Sequence[RopeState] = ()) -> Frame:
        """Return a frame with masks near the ropes where the images have none."""
        tracked = ropes or self._ropes
        if frame.is_masked or not tracked:
            return frame
        masks = list(frame.masks)
        for i, view in enumerate(frame.views):
            if view is not None and view.image is not None and view.image.labels is None:
                seen = self._appearances[i]
                masks[i] = find_mask(view.image, tracked, self._table, seen, elapsed)
        return replace(frame, masks=tuple(masks))

    def _learn(self, frame: Frame, ropes: Sequence[RopeState], fresh: bool = False) -> None:
        """Learn the ropes' colours from images without a mask."""
        for i, view in enumerate(frame.views):
            if view is not None and view.image is not None and view.image.labels is None:
                before = None if fresh else self._appearances[i]
                self._appearances[i] = learn_colors(view.image, ropes, before)

    def _find_table(self, frame: Frame) -> None:
        """Look for the table now and then; it stays where it was unless it is found near there."""
        if self._count % _TABLE_EVERY and self._table is not None:
            return
        radius = self._settings.typical_radius or (self._ropes[0].radius if self._ropes else _USUAL_RADIUS)
        self._table = find_table(frame, radius, self._table)

    def _answer(self, time: float, times: tuple[float, ...]) -> Track:
        events, self._events = tuple(self._events), []
        ropes = tuple(describe_rope(rope, self._upwards) for rope in self._ropes)
        bare = 0.0 if self._step is None else self._step.unexplained
        reason = "" if ropes else self._reason
        return Track(ropes, events, time, times, bare, freeze_array(self._upwards), self._table, reason)
