"""How sure tracked ropes are, which doubts they keep, and why there are none."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import strand
from strand.ropes.doubt import Doubt
from strand.synthetic import sequence
from strand.tracking.certainty import (
    begin_certainty,
    confirm_certainty,
    contradict_certainty,
    drop_settled,
    match_chains,
    pack_doubts,
    unpack_doubts,
)
from strand.tracking.opinions import Entered
from strand.tracking.rope_state import make_state
from strand.tracking.stepping import Step

LINE = np.stack([np.linspace(0.0, 0.3, 60), np.zeros(60), np.zeros(60)], axis=1)
HIDDEN = Doubt("hidden end", 1.4, "where a rope ends", "something stands in front", LINE[0])
END = Doubt("end", 0.4, "where a rope ends", "nothing is seen")


def make_rope(**values):
    return replace(make_state(0, LINE, 0.004, 0.3, 0.0, None), **values)


def make_chain(confidence, *doubts):
    return strand.Chain(LINE, 0.004, confidence=confidence, doubts=doubts)


def test_hidden_ends_do_not_count():
    held, free = make_chain(0.495, HIDDEN, END), make_chain(0.95, END)
    assert begin_certainty(make_rope(), free).confidence == 0.95
    rope = begin_certainty(make_rope(), held)
    # the end's own bound stays
    assert rope.confidence == pytest.approx(0.495 * math.exp(0.5 * 1.4 - 0.2 * (0.4 - 0.15)))
    assert rope.doubts == (HIDDEN, END)
    # another doubt about the same end does not count either
    same, far = (replace(END, amount=1.2, place=LINE[0] + [x, 0.0, 0.0]) for x in (0.015, 0.017))
    bound = 0.2 * (1.2 - 0.15)
    for other, left in ((same, 0.0), (far, bound)):
        again = begin_certainty(make_rope(), make_chain(0.4, HIDDEN, other))
        assert again.confidence == pytest.approx(0.4 * math.exp(0.7 - left))
    assert begin_certainty(make_rope(), make_chain(1.0, HIDDEN)).confidence == 1.0
    assert math.isnan(begin_certainty(make_rope(), make_chain(float("nan"))).confidence)


def test_later_answers_make_a_rope_surer_and_contradictions_less_sure():
    rope = begin_certainty(make_rope(), make_chain(0.7, END))
    assert confirm_certainty(rope, make_chain(0.6)) is rope
    assert confirm_certainty(rope, make_chain(float("nan"))) is rope
    surer = confirm_certainty(rope, make_chain(0.97))
    assert (surer.confidence, surer.doubts) == (0.97, ())
    unknown = begin_certainty(make_rope(), make_chain(float("nan")))
    assert confirm_certainty(unknown, make_chain(0.8)).confidence == 0.8
    doubted = contradict_certainty(surer, 0.96)
    assert doubted.confidence == pytest.approx(0.04)
    assert [doubt.kind for doubt in doubted.doubts] == ["rival"]
    assert contradict_certainty(doubted, 0.91) is doubted
    assert contradict_certainty(surer, 1.0).confidence == 0.0


def test_an_answer_that_enters_confirms_replaces_or_contradicts():
    rope, chain = begin_certainty(make_rope(), make_chain(0.7, END)), make_chain(0.95)
    worse = make_chain(0.6, END)
    step = Step((rope,), np.zeros(1), 0.0, 100)
    for taken, agrees, dissents, said, expected in (
        (None, True, False, chain, 0.95),
        (None, True, False, worse, 0.7),
        (step, False, False, worse, 0.6),
        (step, True, False, worse, 0.7),
        (None, False, True, chain, 0.05),
        (None, False, False, chain, 0.7),
    ):
        entered = Entered(taken, agrees, dissents, 0.95, (said,))
        assert entered.weigh([rope])[0].confidence == pytest.approx(expected)


def test_an_end_that_is_seen_settles_its_doubt():
    rope = make_rope(doubts=(HIDDEN, END, replace(HIDDEN)), covered_ends=(True, False))
    assert [doubt.kind for doubt in drop_settled(rope).doubts] == ["hidden end", "end"]
    assert drop_settled(replace(rope, covered_ends=(False, False))).doubts == (END,)
    assert drop_settled(replace(rope, covered_ends=(True, True))).doubts == rope.doubts


def test_each_rope_has_the_nearest_chain_whichever_way_it_runs():
    chains = [strand.Chain(LINE[::-1] + np.array([0, 0.1 * k, 0]), 0.004) for k in range(3)]
    model = strand.Model(chains, np.eye(4)[None])
    ropes = [replace(make_rope(), nodes=make_rope().nodes + np.array([0, y, 0])) for y in (0.19, 0.02)]
    assert match_chains(model, ropes) == [chains[2], chains[0]]


def test_doubts_are_saved_as_they_are():
    again = unpack_doubts(pack_doubts((HIDDEN, END)))
    assert [(d.kind, d.amount, d.about, d.reason) for d in again] == [
        (d.kind, d.amount, d.about, d.reason) for d in (HIDDEN, END)
    ]
    np.testing.assert_array_equal(again[0].place, HIDDEN.place)
    assert again[1].place is None


def test_a_held_rope_may_be_acted_on_and_tells_its_doubts():
    made = sequence("carry", seed=1, frames=6)
    tracker = strand.Tracker(radius=made.radius, ropes=1)
    for frame in made:
        track = tracker.update([frame.view()], frame.time)
    (rope,) = track.ropes
    assert (rope.state, any(rope.hidden_ends)) == ("tracking", True)
    assert rope.confidence > 0.9
    assert "hidden end" in {doubt.kind for doubt in rope.doubts}
    assert [doubt.amount for doubt in track.model.doubts] == sorted(
        (doubt.amount for doubt in rope.doubts), reverse=True
    )
    assert "hidden end" in {warning.kind for warning in track.model.warnings}
    again = strand.Tracker.from_state(tracker.state, radius=made.radius, ropes=1)
    assert again.state.keys() == tracker.state.keys()
    assert [doubt.kind for doubt in again.predict(track.time).ropes[0].doubts] == [
        doubt.kind for doubt in rope.doubts
    ]


def test_a_later_answer_makes_a_rope_surer():
    made = sequence("wave", seed=1, frames=20)
    tracker = strand.Tracker(radius=made.radius, ropes=1)
    said = [tracker.update([frame.view()], frame.time).ropes[0].confidence for frame in made]
    assert said[0] < 0.9 < said[-1]
    assert said == sorted(said)


@pytest.mark.parametrize(
    ("settings", "reason"),
    [({"radius": 4.2}, "does not fit into points"), ({"ropes": 3}, "found, fewer than ropes = 3")],
)
def test_a_track_without_ropes_says_why(settings, reason):
    made = sequence("still", seed=1, frames=2)
    tracker = strand.Tracker(**{"radius": made.radius, **settings})
    for frame in made:
        track = tracker.update([frame.view()], frame.time)
    assert track.ropes == ()
    assert reason in track.reason
    assert reason in repr(track)
