"""Messages of strand_msgs hold what models and tracks say, and come back from a bag as they were."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import strand
from lib.bag_files import START, Messages, write_bag
from lib.ros_bags import read_bag
from lib.ros_messages import STORE, fill_message, send
from strand.ropes.doubt import Doubt, ModelWarning
from strand.tracking.events import Event
from strand_ros.messages import make_header, make_no_ropes, make_ropes, make_status

HEADER = make_header(Messages().header("", START + 7).stamp, "world")
KINDS = STORE.types["strand_msgs/msg/Rope"]


@pytest.fixture(scope="module")
def model():
    """Return a model with a crossing, a label, doubts and warnings."""
    scene = strand.synthetic.scene("figure8", views=3)
    found = strand.reconstruct(scene.views, radius=scene.radius, bounds=scene.bounds)
    doubt = Doubt("rival", 0.5, "how it runs", "two ways are alike", np.array([0.1, 0.2, 0.3]))
    warning = ModelWarning("branch", "it ends on a side", chains=(0,))
    chains = tuple(
        dataclasses.replace(chain, doubts=(doubt,), label=3, hidden_ends=(False, True))
        for chain in found.chains
    )
    return dataclasses.replace(found, chains=chains, doubts=(doubt,), warnings=(warning,))


@pytest.fixture(scope="module")
def track():
    frames = strand.synthetic.sequence("loop", seed=1, frames=8)
    tracker = strand.Tracker(radius=frames.radius)
    for frame in frames:
        found = tracker.update([frame.view()], 1.7e9 + frame.time)
    events = (Event("begun", 1.7e9, 0), Event("crossing made", 1.7e9, 0, 0.1, (0, 0.3), True))
    return dataclasses.replace(found, events=events)


def list_places(points):
    return np.array([[p.x, p.y, p.z] for p in points])


def test_a_model_is_told_in_full(model):
    sent = send(fill_message("strand_msgs/msg/Ropes", make_ropes(model, HEADER)))
    (rope,), (chain,) = sent.ropes, model.chains
    assert (sent.header.frame_id, sent.header.stamp.sec, sent.header.stamp.nanosec) == (
        "world",
        START // 10**9,
        7,
    )
    np.testing.assert_array_equal(list_places(rope.points), chain.points)
    np.testing.assert_array_equal(rope.s, chain.arc_length)
    upper = np.triu_indices(3)
    np.testing.assert_array_equal(
        np.reshape(rope.covariance, (-1, 6)), [node[upper] for node in chain.covariance]
    )
    np.testing.assert_array_equal(rope.seen == KINDS.BRIDGED, chain.bridged)
    assert (rope.id, rope.label, rope.state, rope.closed) == (0, 3, KINDS.RECONSTRUCTED, False)
    assert (rope.first_hidden, rope.last_hidden) == (False, True)
    assert (rope.radius, rope.length, rope.confidence) == (chain.radius, chain.length, chain.confidence)
    assert len(rope.velocity) == 0
    crossing, want = sent.crossings[0], model.crossings()[0]
    assert len(sent.crossings) == len(model.crossings())
    assert (crossing.over, crossing.over_s, crossing.under_s) == (0, want.over[1], want.under[1])
    assert crossing.probability == want.probability
    np.testing.assert_array_equal(list_places([crossing.over_point])[0], want.point_over)
    assert list_places([sent.up]).tolist() == [model.up.tolist()]
    assert sent.crossings_listed
    assert sent.confidence == model.confidence
    for doubt in (sent.doubts[0], rope.doubts[0]):
        assert (doubt.kind, doubt.amount, doubt.has_place, doubt.place.z) == ("rival", 0.5, True, 0.3)
        assert doubt.text == "unsure how it runs: two ways are alike"
    assert rope.doubts[0].ropes.tolist() == [0]
    (warning,) = sent.warnings
    assert (warning.kind, warning.text, warning.ropes.tolist()) == ("branch", "it ends on a side", [0])
    assert np.isnan(warning.amount)
    assert not warning.has_place


def test_a_track_is_told_in_full(track):
    sent = send(fill_message("strand_msgs/msg/Ropes", make_ropes(track.model, HEADER, track)))
    (rope,), (want,) = sent.ropes, track.ropes
    assert rope.state == {"tentative": 1, "tracking": 2, "coasting": 3, "lost": 4}[want.state]
    assert (rope.id, rope.generation, rope.length_sd) == (want.number, want.generation, want.length_sd)
    np.testing.assert_array_equal(rope.s, want.s)
    np.testing.assert_array_equal(np.reshape(rope.velocity, (-1, 3)), want.velocity)
    np.testing.assert_array_equal(rope.seen == KINDS.PREDICTED, want.predicted)
    np.testing.assert_array_equal(rope.seen == KINDS.SEEN, want.seen)
    begun, crossed = sent.events
    assert (begun.kind, begun.stamp.sec, begun.has_under) == ("begun", 1_700_000_000, False)
    assert np.isnan(begun.s)
    assert (crossed.s, crossed.has_under, crossed.under_s, crossed.doubtful) == (0.1, True, 0.3, True)


def test_states_have_the_numbers_of_the_definition():
    names = ("RECONSTRUCTED", "TENTATIVE", "TRACKING", "COASTING", "LOST")
    assert [getattr(KINDS, name) for name in names] == [0, 1, 2, 3, 4]
    assert (KINDS.SEEN, KINDS.BRIDGED, KINDS.PREDICTED) == (0, 1, 2)


def test_an_image_without_an_answer_says_why():
    sent = send(fill_message("strand_msgs/msg/Ropes", make_no_ropes(HEADER, "no rope on the table")))
    assert sent.ropes == []
    assert [(one.kind, one.text) for one in sent.warnings] == [("no rope", "no rope on the table")]


def test_a_status_is_read_as_other_nodes_write_it():
    status = make_status(2, "bad", [("answers", 3)])
    assert status["level"] == b"\x02"  # rclpy has bytes for this field
    sent = send(fill_message("diagnostic_msgs/msg/DiagnosticStatus", status))
    assert (sent.level, sent.message, sent.values[0].key, sent.values[0].value) == (2, "bad", "answers", "3")


@pytest.mark.parametrize("kind", ["mcap", "sqlite3"])
def test_a_bag_gives_messages_back_as_they_were(kind, model, track, tmp_path):
    told = [make_ropes(model, HEADER), make_ropes(track.model, HEADER, track), make_no_ropes(HEADER, "none")]
    written = [
        ("/ropes", START + i, fill_message("strand_msgs/msg/Ropes", one)) for i, one in enumerate(told)
    ]
    path = write_bag(tmp_path / "ropes", kind, written)
    read = list(read_bag(path.parent if path.is_file() else path))
    assert len(read) == 3
    for (topic, time, message), (_, want_time, want) in zip(read, written, strict=True):
        assert (topic, time) == ("/ropes", want_time)
        assert STORE.serialize_cdr(message, message.__msgtype__) == STORE.serialize_cdr(
            want, want.__msgtype__
        )
        assert str(message) == str(want)
