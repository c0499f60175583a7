"""Tests of MCAP files for Foxglove: read by the package `mcap`, and by strand's own records."""

from __future__ import annotations

import json

import jsonschema
import numpy as np
import pytest
from mcap.reader import NonSeekingReader, SeekingReader, make_reader
from scipy.spatial.transform import Rotation

import strand
from shared.tracks import make_tracks
from strand.figures import write_mcap
from strand.io.budget import Budget
from strand.io.recordings.mcap_records import (
    STAMPED,
    read_chunk,
    read_chunk_head,
    read_record,
    walk_records,
)
from strand.io.recordings.unpacking import Limits
from strand.report.scene_updates import _make_schema
from strand.support.mcap_file import Channel, McapFile
from strand.support.mcap_format import CHUNK, MESSAGE, RECORD

R = 0.004
UNDER = strand.Chain(np.linspace([-0.1, 0.0, R], [0.1, 0.0, R], 51), R)
OVER = strand.Chain(np.linspace([0.0, -0.1, 3 * R], [0.0, 0.1, 3 * R], 51), R, color=[1.0, 0.5, 0.0])
STAMPS = (1_700_000_000.0, 1_700_000_000.5)
NANOSECONDS = [1_700_000_000_000_000_000, 1_700_000_000_500_000_000]
MODELS = tuple(
    strand.Model(chains, np.empty((0, 4, 4)), stamp=stamp)
    for chains, stamp in zip(((UNDER, OVER), (UNDER,)), STAMPS, strict=True)
)


def read_own(path):
    """Return times and messages by strand's reader of records, which are in chunks."""
    found, limits = [], Limits(Budget(1 << 30))
    with open(path, "rb") as file:
        at, end = 8, path.stat().st_size - 8
        while at < end:
            kind, _, stop = read_record(file, at, end)
            if kind == CHUNK:
                chunk = read_chunk_head(file, at, stop)[0]
                data = read_chunk(file, chunk, stop, limits)
                for inner, start, last in walk_records(data, limits.begin_pass(end)):
                    if inner == MESSAGE:
                        time = STAMPED.unpack_from(data, start - RECORD.size)[4]
                        found.append((time, json.loads(bytes(data[start + 22 : last]))))
            at = stop
    return found


def find_entity(message, name):
    (found,) = [entity for entity in message["entities"] if entity["id"] == name]
    return found


def test_models_are_messages_at_their_times(tmp_path):
    write_mcap(MODELS, tmp_path / "a.mcap", frame_id="table", lifetime=0.25)
    read = read_own(tmp_path / "a.mcap")
    assert [time for time, _ in read] == NANOSECONDS
    first, second = (message for _, message in read)
    rope = find_entity(first, "rope_1")
    assert rope["timestamp"] == {"sec": 1_700_000_000, "nsec": 0}
    assert find_entity(second, "rope_0")["timestamp"] == {"sec": 1_700_000_000, "nsec": 500_000_000}
    assert (rope["frame_id"], rope["lifetime"]) == ("table", {"sec": 0, "nsec": 250_000_000})
    (line,) = rope["lines"]
    assert (line["thickness"], line["scale_invariant"]) == (2 * R, False)
    assert line["color"] == {"r": 1.0, "g": 0.5, "b": 0.0, "a": 1.0}
    points = [[point[axis] for axis in "xyz"] for point in line["points"]]
    np.testing.assert_allclose(points, OVER.points, rtol=0, atol=5.1e-7)
    # the second model has no rope 1
    gone = {"timestamp": {"sec": 1_700_000_000, "nsec": 500_000_000}, "type": 0, "id": "rope_1"}
    assert (first["deletions"], second["deletions"]) == ([], [gone])


def test_a_crossing_has_the_probability_of_its_order(tmp_path):
    write_mcap(MODELS, tmp_path / "a.mcap")
    (_, first), (_, second) = read_own(tmp_path / "a.mcap")
    (crossing,) = MODELS[0].crossings()
    marks = find_entity(first, "crossings")
    (sphere,), (text,) = marks["spheres"], marks["texts"]
    place = [sphere["pose"]["position"][axis] for axis in "xyz"]
    np.testing.assert_allclose(place, crossing.place, rtol=0, atol=5.1e-7)
    assert float(text["text"]) == np.floor(100 * crossing.probability) / 100
    assert text["pose"]["position"]["z"] > place[2]
    assert find_entity(second, "crossings")["texts"] == []


def test_no_probability_seems_to_reach_one(tmp_path):
    exact = {"confidence": 0.9996, "covariance": np.tile(1e-8 * np.eye(3), (51, 1, 1))}
    chains = tuple(strand.Chain(chain.points, R, **exact) for chain in (UNDER, OVER))
    model = strand.Model(chains, np.empty((0, 4, 4)), confidence=0.9996)
    assert 0.995 < model.crossings()[0].probability < 1.0
    write_mcap([model], tmp_path / "a.mcap")
    ((_, message),) = read_own(tmp_path / "a.mcap")
    assert find_entity(message, "crossings")["texts"][0]["text"] == "0.99"
    (said,) = [one for one in find_entity(message, "rope_1")["metadata"] if one["key"] == "confidence"]
    assert said["value"] == "0.99"


def read_arrow(arrow):
    """Return an arrow's tail, direction and length: the direction is the x axis turned by a quaternion."""
    place, turn = arrow["pose"]["position"], arrow["pose"]["orientation"]
    rotation = Rotation.from_quat([turn[axis] for axis in "xyzw"])
    tail = np.array([place[axis] for axis in "xyz"])
    return tail, rotation.apply([1.0, 0.0, 0.0]), arrow["shaft_length"] + arrow["head_length"]


def test_arrows_point_along_ropes(tmp_path):
    rng = np.random.default_rng(0)
    directions = [*rng.normal(size=(8, 3)), *np.eye(3), *-np.eye(3)]
    chains = [strand.Chain(np.linspace(-0.1, 0.1, 21)[:, None] * way, R) for way in directions]
    write_mcap([strand.Model(chains, np.empty((0, 4, 4)))], tmp_path / "a.mcap")
    ((_, message),) = read_own(tmp_path / "a.mcap")
    for number, chain in enumerate(chains):
        (arrow,) = find_entity(message, f"rope_{number}")["arrows"]
        tail, ahead, length = read_arrow(arrow)
        np.testing.assert_allclose(ahead, chain.tangent_at(0.0), atol=1e-9)
        np.testing.assert_allclose(tail + length * ahead, chain.at(0.5 * chain.length), atol=1e-6)


def test_arrows_of_pulls_and_grasps(tmp_path):
    gripper = strand.Gripper(0.03, 0.006, 0.004, 0.03)
    write_mcap(MODELS, tmp_path / "a.mcap", pulls=True, gripper=gripper)
    (_, first), (_, second) = read_own(tmp_path / "a.mcap")
    (pull,) = MODELS[0].pull_plan().pulls
    tail, ahead, length = read_arrow(find_entity(first, "pulls")["arrows"][0])
    np.testing.assert_allclose(tail, pull.place, atol=1e-6)
    np.testing.assert_allclose(length * ahead, pull.distance * pull.direction, atol=1e-9)
    assert find_entity(second, "pulls")["arrows"] == []
    best = {}
    for grasp in MODELS[0].grasps(gripper):
        best.setdefault(grasp.chain, grasp)
    arrows = find_entity(first, "grasps")["arrows"]
    assert len(arrows) == len(best) == 2
    for arrow, grasp in zip(arrows, best.values(), strict=True):
        tail, ahead, length = read_arrow(arrow)
        np.testing.assert_allclose(ahead, grasp.approach, atol=1e-9)
        np.testing.assert_allclose(tail + length * ahead, grasp.pose[:3, 3], atol=1e-6)
    write_mcap(MODELS, tmp_path / "a.mcap")
    names = {entity["id"] for _, message in read_own(tmp_path / "a.mcap") for entity in message["entities"]}
    assert names == {"rope_0", "rope_1", "crossings"}


def test_what_is_predicted_of_a_tracked_rope_is_grey(tmp_path):
    tracks = make_tracks()
    write_mcap((track.model for track in tracks), tmp_path / "a.mcap")
    for track, (time, message) in zip(tracks, read_own(tmp_path / "a.mcap"), strict=True):
        assert time == round(track.time * 1e9)
        for rope in track.ropes:
            lines = find_entity(message, f"rope_{rope.number}")["lines"]
            greys = [line["color"]["r"] == line["color"]["g"] for line in lines]
            assert (True in greys, False in greys) == (rope.predicted.any(), not rope.predicted.all())


def test_messages_have_all_fields_of_the_schema(tmp_path):
    write_mcap(MODELS, tmp_path / "a.mcap")
    schema = _make_schema()
    for _, message in read_own(tmp_path / "a.mcap"):
        jsonschema.Draft202012Validator(schema).validate(message)
        for entity in message["entities"]:
            assert set(entity) == set(schema["properties"]["entities"]["items"]["properties"])


def test_the_package_mcap_reads_the_file_and_its_index(tmp_path):
    path = tmp_path / "a.mcap"
    with open(path, "wb") as file:
        written = McapFile(file, [Channel("/ropes", "kind", b"{}")], "strand")
        sent = [(time, b"%d" % time * 4000) for time in range(1000, 1400)]  # chunks end in between
        for time, data in sent:
            written.add(time, data)
        written.end()
    with open(path, "rb") as file:
        opened = SeekingReader(file, validate_crcs=True)
        found = [(message.log_time, message.data) for _, _, message in opened.iter_messages()]
        summary = opened.get_summary()
        middle = [message.log_time for *_, message in opened.iter_messages(start_time=1199, end_time=1202)]
    with open(path, "rb") as file:
        streamed = [message.log_time for *_, message in NonSeekingReader(file).iter_messages()]
    assert found == sent
    assert middle == [1199, 1200, 1201]
    assert streamed == [time for time, _ in sent]
    assert len(summary.chunk_indexes) == summary.statistics.chunk_count > 1
    assert summary.statistics.channel_message_counts == {1: 400}
    write_mcap(MODELS, path, topic="/lines")
    with open(path, "rb") as file:
        for (schema, channel, message), time in zip(
            make_reader(file, validate_crcs=True).iter_messages(), NANOSECONDS, strict=True
        ):
            assert (schema.name, schema.encoding) == ("foxglove.SceneUpdate", "jsonschema")
            assert (channel.topic, channel.message_encoding) == ("/lines", "json")
            assert (message.log_time, message.publish_time) == (time, time)
            jsonschema.Draft202012Validator(json.loads(schema.data)).validate(json.loads(message.data))


def test_one_model_needs_no_time_and_no_model_is_an_empty_file(tmp_path):
    write_mcap([strand.Model((UNDER,), np.empty((0, 4, 4)))], tmp_path / "a.mcap")
    assert [time for time, _ in read_own(tmp_path / "a.mcap")] == [0]
    write_mcap([], tmp_path / "a.mcap")
    assert read_own(tmp_path / "a.mcap") == []


def test_models_of_one_stamp_are_written(tmp_path):
    write_mcap([MODELS[0], MODELS[0]], tmp_path / "a.mcap")
    assert len(read_own(tmp_path / "a.mcap")) == 2


@pytest.mark.parametrize(
    ("models", "error", "reason"),
    [
        (MODELS[0], TypeError, "models: expected an iterable of Model, got Model"),
        ([MODELS[0], 3], TypeError, r"models\[1\]: expected a Model, got int"),
        ([MODELS[0], strand.Model((), np.empty((0, 4, 4)))], ValueError, "expected a stamp in each"),
        ([strand.Model((), np.empty((0, 4, 4))), MODELS[0]], ValueError, "expected a stamp in each"),
        (
            [strand.Model((), np.empty((0, 4, 4)), stamp=-1.0)],
            ValueError,
            r"models\[0\].stamp: expected seconds",
        ),
        (
            MODELS[::-1],
            ValueError,
            r"models\[1\].stamp: .+ in the order of their stamps, got one 0.5 s before",
        ),
    ],
)
def test_wrong_models_are_named_and_leave_no_file(models, error, reason, tmp_path):
    with pytest.raises(error, match=reason):
        write_mcap(models, tmp_path / "a.mcap")
    assert list(tmp_path.iterdir()) == []
