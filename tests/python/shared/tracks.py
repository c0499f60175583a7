"""Answers of a tracker, made by hand."""

from __future__ import annotations

import numpy as np

from strand.tracking.events import Event
from strand.tracking.track import Track, TrackedRope

UP = np.array([0.0, 0.0, 1.0])
NODES = 21


def make_rope(number, shift=0.0, label=None):
    """Return a straight rope of 200 mm, half of it predicted."""
    s = np.linspace(0.0, 0.2, NODES)
    predicted = s > 0.1
    return TrackedRope(
        np.stack([s, np.full(NODES, shift), np.full(NODES, 0.004)], axis=1),
        0.004,
        covariance=np.tile(1e-6 * np.diag([1.0, 2.0, 3.0]), (NODES, 1, 1)),
        confidence=0.9 if number else float("nan"),
        label=label,
        number=number,
        s=s,
        velocity=np.tile([0.1, 0.0, 0.0], (NODES, 1)),
        seen=~predicted,
        predicted=predicted,
        age=np.where(predicted, 0.2, 0.0),
        length_sd=0.001,
    )


def make_tracks():
    """Return nothing, one rope, two ropes with events."""
    happened = (
        Event("crossing made", 0.2, 1, 0.05, (0, 0.15), True),
        Event("begun", 0.2, 1),
    )
    return [
        Track((), (), 0.0, (0.0,), 0.0, UP, None),
        Track((make_rope(0),), (Event("begun", 0.1, 0),), 0.1, (0.1,), 0.01, UP, None),
        Track((make_rope(0, 0.01), make_rope(1, 0.02, label=7)), happened, 0.2, (0.2,), 0.02, UP, None),
    ]


def check_rows(rows, tracks, numbers=None):
    """Check the rows of a table against the answers of a tracker with one rope."""
    assert [row["frame"] for row in rows] == list(range(len(tracks)) if numbers is None else numbers)
    for row, track in zip(rows, tracks, strict=True):
        (rope,) = track.ropes
        assert row["time"] == track.time
        assert row["image_times"] == list(track.image_times)
        assert row["error"] is None
        assert (row["rope"], row["state"]) == (rope.number, rope.state)
        assert (row["arc_length"][-1], row["length_sd"]) == (rope.length, rope.length_sd)
        np.testing.assert_array_equal(row["nodes"], rope.points)
        np.testing.assert_array_equal(row["velocity"], rope.velocity)
        np.testing.assert_array_equal(np.reshape(row["covariance"], (-1, 3, 3)), rope.covariance)
        np.testing.assert_array_equal(row["arc_length"], rope.s)
        for name in ("seen", "predicted", "age"):
            np.testing.assert_array_equal(row[name], getattr(rope, name))
        assert [event["kind"] for event in row["events"]] == [event.kind for event in track.events]
