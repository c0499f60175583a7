"""Other answers: reconstructions of single frames on another thread, while the tracker goes on."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass, replace

from strand._core import NotEnoughDataError
from strand.geometry.plane import Plane
from strand.reconstruction.pipeline import reconstruct
from strand.ropes.chain import Chain
from strand.ropes.model import Model
from strand.tracking.beginning import confirms
from strand.tracking.certainty import (
    begin_certainty,
    confirm_certainty,
    contradict_certainty,
    match_chains,
)
from strand.tracking.frame import Frame
from strand.tracking.laying import trim_ends
from strand.tracking.rope_state import RopeState
from strand.tracking.settings import Settings
from strand.tracking.stepping import REPLAY_STEPS, Step, step_ropes
from strand.tracking.watching import Opinion, compare_opinion, is_doubtful

_LATENCY = 3  # frames after which an answer enters, whenever it is ready: equal frames give equal answers
_PATIENCE = 3  # doubtful frames in a row before another answer is asked for
_EVERY = 15  # frames between two answers where nothing is doubtful
_EVERY_UNCONFIRMED = 5  # likewise, until an answer confirms the last one that was taken
_MIN_PIXELS = 30  # of ropes in all images: with fewer, nothing is seen


@dataclass(frozen=True, eq=False)
class _Past:
    """A frame, the time since the one before, s, and the ropes after it."""

    frame: Frame
    elapsed: float
    step: Step


@dataclass(frozen=True, eq=False)
class _Pending:
    """An answer that another thread works on, compared with the ropes, and the number of its frame."""

    answer: Future[tuple[Model, Opinion | None] | None]
    asked: int


@dataclass(frozen=True, eq=False)
class Entered:
    """Another answer as it enters.

    Attributes
    ----------
    step : Step or None
        The ropes as it has them, if it is taken.
    agrees, dissents : bool
        Whether it has the ropes as they were, or is sure and has them elsewhere.
    confidence : float
    chains : tuple of Chain
        Its chain of each rope.
    """

    step: Step | None
    agrees: bool
    dissents: bool
    confidence: float
    chains: tuple[Chain, ...]

    def weigh(self, ropes: Sequence[RopeState]) -> tuple[RopeState, ...]:
        """Return the ropes with the confidence and the doubts that they have after the answer."""
        if self.agrees:
            return tuple(map(confirm_certainty, ropes, self.chains))
        if self.step is not None:
            return tuple(map(begin_certainty, ropes, self.chains))
        if self.dissents:
            return tuple(contradict_certainty(rope, self.confidence) for rope in ropes)
        return tuple(ropes)


class Opinions:
    """Asks for other answers, and lets them enter a fixed number of frames later.

    Attributes
    ----------
    since : int
        Frames since the last answer was asked for.
    blind : bool
        Whether the last frame showed nothing of the ropes.
    """

    def __init__(self, settings: Settings) -> None:
        self.since = 0
        self.blind = False
        self._settings = settings
        self._pool: Executor | None = None
        self._past: deque[_Past] = deque(maxlen=_LATENCY)
        self._pending: _Pending | None = None
        self._doubtful = 0
        self._dissents = False
        self._unconfirmed = False

    def ask(self, frame: Frame) -> Future[Model | str]:
        """Reconstruct a frame on another thread; the answer may be why it has no ropes."""
        return self._second_thread.submit(_reconstruct, frame, self._settings)

    @property
    def _second_thread(self) -> Executor:
        if self._pool is None:
            self._pool = ThreadPoolExecutor(1, "strand-tracker")
        return self._pool

    def remember(self, frame: Frame, elapsed: float, step: Step) -> None:
        """Keep a frame until an answer to it may enter."""
        self._past.append(_Past(frame, elapsed, step))

    def forget(self) -> None:
        """Forget all frames and answers: the ropes begin anew."""
        self._past.clear()
        self._pending = None
        self._doubtful, self._dissents, self._unconfirmed = 0, False, False

    def watch(self, count: int, table: Plane | None, impossible: bool, tentative: bool) -> None:
        """Ask for another answer where the ropes do not explain a frame, and every now and then.

        `count` is the number of the frame, the last that was remembered.
        """
        now = self._past[-1]
        empty = now.step.pixels < _MIN_PIXELS
        back, self.blind = self.blind and not empty, empty
        doubted = not empty and is_doubtful(now.step)
        self._doubtful = self._doubtful + 1 if doubted else 0
        self.since += 1
        every = _EVERY_UNCONFIRMED if self._unconfirmed or self._dissents else _EVERY
        due = back or impossible or self._doubtful >= _PATIENCE or self.since >= every
        if self._pending is None and due and not empty:
            doubted = doubted or back or impossible or tentative
            answer = self._second_thread.submit(_compare, now, self._settings, table, doubted)
            self._pending = _Pending(answer, count)
            self.since = 0

    def enter(self, count: int, table: Plane | None) -> Entered | None:
        """Return what an answer says that is due in frame `count`; None if none is."""
        pending = self._pending
        if pending is None or count < pending.asked + _LATENCY:
            return None
        self._pending = None
        answer, past = pending.answer.result(), list(self._past)
        if answer is None or len(past) < _LATENCY:
            return None
        model, opinion = answer
        before, self._dissents = self._dissents, opinion is not None and opinion.dissents
        agrees = confirms(model, past[0].step.ropes)
        if opinion is None or not (opinion.is_better or (before and self._dissents)):
            self._unconfirmed = self._unconfirmed and not agrees
            chains = tuple(match_chains(model, past[0].step.ropes))
            return Entered(None, agrees, self._dissents, model.confidence, chains)
        self._dissents, self._unconfirmed = False, True
        chains = tuple(match_chains(model, opinion.step.ropes))
        return Entered(self._replay(past, opinion.step, table), agrees, False, model.confidence, chains)

    def _replay(self, past: list[_Past], step: Step, table: Plane | None) -> Step:
        """Return the ropes after the last frame, given those after the first one."""
        self._past.clear()
        self._past.append(_Past(past[0].frame, past[0].elapsed, step))
        for later in past[1:]:
            step = step_ropes(later.frame, step.ropes, step.biases, table, later.elapsed, steps=REPLAY_STEPS)
            self._past.append(_Past(later.frame, later.elapsed, step))
        return step


def _compare(
    past: _Past, settings: Settings, table: Plane | None, doubted: bool
) -> tuple[Model, Opinion | None] | None:
    """Reconstruct a frame, and compare the answer with the ropes after it."""
    model = _reconstruct(past.frame, settings)
    if isinstance(model, str):
        return None
    return model, compare_opinion(model, past.frame, past.step, table, past.elapsed, doubted)


def _reconstruct(frame: Frame, settings: Settings) -> Model | str:
    """Return the ropes of a frame, or why it has no open ones."""
    try:
        model = reconstruct(
            frame.given_views,
            settings.radius,
            ropes=settings.ropes,
            config=settings.config,
            length=settings.length,
        )
    except NotEnoughDataError as error:
        return str(error)
    if not model.chains or any(chain.closed for chain in model.chains):
        return "a rope is a ring, and a tracker follows open ropes only" if model.chains else "no chains"
    if not frame.is_masked:
        return model
    return replace(model, chains=tuple(trim_ends(chain, frame) for chain in model.chains))
