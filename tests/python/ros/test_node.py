"""The node runs on a recorded bag, with a stand-in for ROS; gaps, jumps and broken input are survived."""

from __future__ import annotations

import dataclasses
from itertools import chain

import numpy as np
import pytest

import strand
from lib.bag_files import START, Messages, write_bag
from lib.ros_bags import SECOND, read_bag, record_sequence
from lib.ros_messages import STORE
from lib.ros_stub import read_points, run_node

ROPE = STORE.types["strand_msgs/msg/Rope"]
MASKED = {"use_mask": True, "use_color": False, "ropes": 1}
MADE = Messages()


def change(entries, topic, **fields):
    """Return entries with other fields in the messages of a topic, or without it."""
    return [
        (name, time, dataclasses.replace(message, **fields) if name == topic else message)
        for name, time, message in entries
        if name != topic or fields
    ]


def take(entries, first, last):
    """Return the entries of some of the frames."""
    times = sorted({time for _, time, _ in entries})[first:last]
    return [entry for entry in entries if entry[1] in times]


def find_kinds(bus):
    """Return the kinds of trouble that the node logged."""
    return {text.split(":")[0] for text in bus.said}


def report(bus):
    """Let time go on, and return the next status and its values."""
    bus.advance(bus.now + SECOND)
    (status,) = bus.sent["/diagnostics"][-1].status
    return status, {one.key: one.value for one in status.values}


def measure(rope, frame):
    """Return the largest distance of the frame's nodes from the points of a rope message."""
    points = np.array([[p.x, p.y, p.z] for p in rope.points])
    return strand.Chain(points, 0.004).nearest(frame.nodes[0]).distance.max()


@pytest.mark.parametrize("kind", ["mcap", "sqlite3"])
@pytest.mark.parametrize("meters", [False, True])
def test_a_recorded_bag_is_tracked(kind, meters, carried, radius, tmp_path):
    path = write_bag(tmp_path / "film", kind, record_sequence(carried, meters=meters))
    with run_node(world_frame="world", radius=radius, cloud_nodes=30, **MASKED) as (bus, _):
        bus.play(read_bag(path.parent if path.is_file() else path))
    assert bus.said == []
    assert len(bus.sent["ropes"]) == len(bus.sent["markers"]) == len(carried)
    for message, frame in zip(bus.sent["ropes"], carried, strict=True):
        (rope,) = message.ropes
        assert measure(rope, frame) < 5 * radius
        assert message.header.frame_id == "world"
        assert message.header.stamp.sec * SECOND + message.header.stamp.nanosec == START + round(
            frame.time * SECOND
        )
    assert rope.state == ROPE.TRACKING
    # as programs that consume other trackers' nodes read them: one rope, in order
    cloud = bus.sent["points"][-1]
    nodes = read_points(cloud)
    assert len(nodes) == 30
    assert (cloud.header.frame_id, cloud.header.stamp) == ("world", message.header.stamp)
    ends = np.array([[p.x, p.y, p.z] for p in (rope.points[0], rope.points[-1])])
    np.testing.assert_allclose(nodes[[0, -1]], ends, atol=1e-5)
    steps = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    np.testing.assert_allclose(steps, rope.length / 29, rtol=0.05)


def test_colours_replace_a_mask(colored, radius):
    with run_node(world_frame="world", ropes=1) as (bus, _):
        bus.play(record_sequence(colored, masks=False))
    assert bus.said == []
    assert measure(bus.sent["ropes"][-1].ropes[0], colored[-1]) < 5 * radius


def test_a_named_colour_replaces_a_mask(colored, radius):
    frame = colored[0]
    entries = list(record_sequence([frame], masks=False))
    color = np.median(frame.color[0][frame.labels[0] > 0], axis=0).astype(int).tolist()
    with run_node(world_frame="world", mode="reconstruct", ropes=1, rope_color=color) as (bus, _):
        bus.play(entries)
    assert measure(bus.sent["ropes"][0].ropes[0], frame) < 5 * radius
    with run_node(world_frame="world", mode="reconstruct", rope_color=[0, 255, 0]) as (bus, _):
        bus.play(entries)
    (message,) = bus.sent["ropes"]
    assert message.ropes == []
    assert message.warnings[0].text.startswith("no rope of the given colour")


def test_each_image_is_reconstructed_in_the_order_of_the_one_before(carried, radius, entries):
    known = {"radius": radius, "least_confidence": 0.0}
    with run_node(world_frame="world", mode="reconstruct", **known, **MASKED) as (bus, _):
        bus.play(take(entries, 0, 3))
    assert bus.said == []
    assert {message.ropes[0].state for message in bus.sent["ropes"]} == {ROPE.RECONSTRUCTED}
    firsts = [message.ropes[0].points[0] for message in bus.sent["ropes"]]
    assert np.ptp([[p.x, p.y, p.z] for p in firsts], axis=0).max() < 0.05
    for message, cloud in zip(bus.sent["ropes"], bus.sent["points"], strict=True):
        np.testing.assert_allclose(
            read_points(cloud), [[p.x, p.y, p.z] for p in message.ropes[0].points], atol=1e-6
        )
    with run_node(
        world_frame="world", mode="reconstruct", **(known | {"least_confidence": 1.0}), **MASKED
    ) as (
        bus,
        _,
    ):
        bus.play(take(entries, 0, 1))
    assert len(bus.sent["ropes"]) == 1
    assert bus.sent["points"] == []


def test_without_a_world_frame_the_camera_is_the_world(carried, radius, entries):
    with run_node(radius=radius, **MASKED) as (bus, _):
        bus.play(take(change(entries, "/tf"), 0, 3))
    message = bus.sent["ropes"][-1]
    assert message.header.frame_id == "camera"
    assert message.ropes[0].points[0].z > 0.2


def test_a_gap_in_tf_costs_its_frames_alone(carried, radius, entries):
    times = sorted({time for _, time, _ in entries})
    lost = times[4:7]
    kept = [entry for entry in entries if entry[0] != "/tf" or entry[1] not in lost]
    # TF goes on after the patience is over
    late = [(topic, time + SECOND * (time > lost[-1]), message) for topic, time, message in kept]
    late = [
        (topic, time, restamp(message, SECOND) if time > times[-1] else message)
        for topic, time, message in late
    ]
    with run_node(world_frame="world", radius=radius, **MASKED) as (bus, _):
        bus.play(late)
        _, values = report(bus)
    assert find_kinds(bus) == {"tf"}
    assert "does not reach the time of the image" in bus.said[0]
    assert (values["tf"], values["answers"]) == ("3", str(len(times) - 3))
    assert measure(bus.sent["ropes"][-1].ropes[0], carried[-1]) < 5 * radius


@pytest.mark.parametrize("shift", [0.0, 0.05])
def test_frames_in_a_short_gap_of_tf_in_which_the_camera_moved_are_dropped(shift, carried, radius, entries):
    times = sorted({time for _, time, _ in entries})
    first, after = 4, 10  # of the frames without TF, and behind them
    assert times[after] - times[first - 1] > 0.22 * SECOND
    moved = np.eye(4)
    moved[0, 3] = shift
    tables = [
        ("/tf", time, MADE.tf([("base", "world", moved if i >= after else np.eye(4))], time))
        for i, time in enumerate(times)
        if not first <= i < after
    ]
    camera = ("/tf_static", times[0] - 1, MADE.tf([("world", "camera", carried[0].poses[0])], times[0]))
    played = sorted([camera, *tables, *change(entries, "/tf")], key=lambda entry: entry[1])
    with run_node(world_frame="base", radius=radius, **MASKED) as (bus, _):
        bus.play(played)
        _, values = report(bus)
    lost = after - first if shift else 0
    assert int(values.get("bad tf", 0)) == lost
    assert int(values["answers"]) == len(times) - lost
    said = [text for text in bus.said if text.startswith("bad tf")]
    assert len(said) == lost
    assert all("TF has a gap of 0.2" in text and "in which 'world' moved" in text for text in said)


def restamp(message, later):
    """Return a message whose stamps are later, ns."""

    def move(header):
        total = header.stamp.sec * SECOND + header.stamp.nanosec + later
        return MADE.header(header.frame_id, total)

    if hasattr(message, "transforms"):
        moved = [dataclasses.replace(one, header=move(one.header)) for one in message.transforms]
        return dataclasses.replace(message, transforms=moved)
    return dataclasses.replace(message, header=move(message.header))


@pytest.mark.parametrize("tf", ["none", "empty", "other frames", "not a rotation"])
def test_tf_that_gives_no_pose_is_named(tf, entries):
    frames = take(entries, 0, 3)
    if tf == "none":
        frames = change(frames, "/tf")
    elif tf == "empty":
        frames = change(frames, "/tf", transforms=[])
    elif tf == "other frames":
        transforms = MADE.tf([("base", "hand", np.eye(4))], START).transforms
        frames = change(frames, "/tf", transforms=transforms)
    with run_node(world_frame="world", **MASKED) as (bus, node):
        if tf == "not a rotation":
            wrong = MADE.tf([("world", "camera", np.eye(4))], START).transforms[0]
            wrong.transform.rotation.w = 0.5
            node._buffer.lookup_transform = lambda *_: wrong
        bus.play(frames)
        status, values = report(bus)
    assert status.level == 2
    kind = "bad tf" if tf == "not a rotation" else "tf"
    assert find_kinds(bus) == {kind}
    assert values[kind] == "3"
    assert bus.sent["ropes"] == []


def test_a_bag_that_is_played_again_begins_anew(carried, radius, entries):
    later = [(topic, time + 20 * SECOND, restamp(message, 20 * SECOND)) for topic, time, message in entries]
    again = [(topic, time + 40 * SECOND, message) for topic, time, message in entries]
    with run_node(world_frame="world", radius=radius, **MASKED) as (bus, _):
        bus.play(chain(later, again))
    # TF's buffer is cleared with the first image, after the first transform
    assert find_kinds(bus) == {"jump", "tf"}
    assert len(bus.sent["ropes"]) == 2 * len(carried) - 1
    begun = [event.kind for message in bus.sent["ropes"] for event in message.events]
    assert begun.count("begun") == 2
    assert measure(bus.sent["ropes"][-1].ropes[0], carried[-1]) < 5 * radius


def test_late_and_double_images_are_dropped(entries):
    doubled = list(chain.from_iterable((entry, entry) for entry in take(entries, 0, 4)))
    mixed = [*doubled, *[entry for entry in take(entries, 1, 2) if entry[0] == "depth/image"]]
    with run_node(world_frame="world", **MASKED) as (bus, _):
        bus.play(mixed)
        _, values = report(bus)
    assert (values["answers"], values["late"]) == ("4", "5")


def test_another_camera_info_begins_anew(carried, entries):
    matrix = carried[0].intrinsics * [[1.05], [1.05], [1.0]]
    zoomed = MADE.info(matrix, carried[0].depth[0].shape, START)
    changed = change(take(entries, 3, 6), "depth/camera_info", k=zoomed.k, p=zoomed.p)
    with run_node(world_frame="world", **MASKED) as (bus, _):
        bus.play([*take(entries, 0, 3), *changed])
        _, values = report(bus)
    assert find_kinds(bus) == {"calibration"}
    assert values["answers"] == "6"
    assert [event.kind for message in bus.sent["ropes"] for event in message.events] == ["begun", "begun"]


@pytest.mark.parametrize(
    ("topic", "fields", "error"),
    [
        ("depth/image", {"encoding": "rgb8"}, "encoding: expected depth"),
        ("depth/image", {"height": 0}, "CameraInfo: expected one for images of 640 x 0 pixels"),
        ("depth/image", {"data": np.zeros(9, np.uint8)}, "do not fit in 9 bytes"),
        ("depth/camera_info", {"height": 48, "width": 64}, "got 64 x 48"),
        ("depth/camera_info", {"k": np.zeros(9)}, "expected a pinhole matrix, got zeros"),
        ("depth/camera_info", {"d": np.array([0.1, 0, 0, 0, 0])}, "expected no distortion"),
        ("depth/camera_info", {"header": MADE.header("other", START)}, "camera_info: expected .* 'camera'"),
        ("mask/image", {"encoding": "bgr8"}, "mask: expected an Image of mono8"),
        ("mask/image", {"height": 9}, "mask: expected the depth image's"),
        ("mask/image", {"header": MADE.header("", START)}, "mask: expected the depth image's frame 'camera'"),
    ],
)
def test_wrong_images_are_named_and_the_next_are_used(topic, fields, error, entries):
    wrong = change(take(entries, 0, 1), topic, **fields)
    with run_node(world_frame="world", **MASKED) as (bus, _):
        bus.play([*wrong, *take(entries, 1, 3)])
        _, values = report(bus)
    assert find_kinds(bus) - {"calibration"} == {"wrong image"}
    assert values["wrong image"] == "1"
    assert values["answers"] == "2"
    with pytest.raises(AssertionError, match=error):
        raise AssertionError(bus.said[0])


def list_broken(value):
    """Return values of a field's type that make no sense in a message."""
    if isinstance(value, np.ndarray):
        numbers = (np.nan, 1e300) if value.dtype.kind == "f" else ()
        return [value[: len(value) // 2], *(np.full_like(value, number) for number in (0, *numbers))]
    if isinstance(value, int):
        return [0, value + 1]
    return ["", "mono16"] if isinstance(value, str) else []


@pytest.mark.parametrize("topic", ["depth/image", "depth/camera_info", "mask/image"])
def test_broken_fields_never_stop_the_node(topic, entries):
    first, second = take(entries, 0, 1), take(entries, 1, 2)
    message = next(one for name, _, one in first if name == topic)
    tried = 0
    for field in dataclasses.fields(message):
        if field.name == "__msgtype__":
            continue
        for broken in list_broken(getattr(message, field.name)):
            with run_node(world_frame="world", **MASKED) as (bus, _):
                bus.play([*change(first, topic, **{field.name: broken}), *second])
                _, values = report(bus)
            assert values["depth images"] == "2"
            assert int(values["answers"]) + int(values.get("wrong image", 0)) == 2
            assert int(values["answers"]) >= 1
            points = [p for one in bus.sent["ropes"] for rope in one.ropes for p in rope.points]
            assert np.isfinite([[p.x, p.y, p.z] for p in points]).all()
            tried += 1
    assert tried > 8


@pytest.mark.parametrize("mode", ["track", "reconstruct"])
@pytest.mark.parametrize("seen", ["no depth", "empty mask"])
def test_a_first_image_without_a_rope_is_survived(mode, seen, carried, radius, entries):
    first = take(entries, 0, 1)
    depth = next(message for topic, _, message in first if topic == "depth/image")
    if seen == "no depth":
        nothing = np.full((depth.height, depth.width), np.nan, np.float32)
        image = MADE.image(nothing, START)
        first = change(
            first, "depth/image", **{name: getattr(image, name) for name in ("encoding", "step", "data")}
        )
    else:
        first = change(first, "mask/image", data=np.zeros(depth.height * depth.width, np.uint8))
    known = {"radius": radius} | MASKED
    with run_node(world_frame="world", mode=mode, **known) as (bus, _):
        bus.play([*first, *take(entries, 1, 4)])
        status, values = report(bus)
    empty, *others = bus.sent["ropes"]
    assert empty.ropes == []
    assert empty.warnings[0].kind == "no rope"
    assert empty.warnings[0].text
    assert [len(message.ropes) for message in others] == [1, 1, 1]
    assert (status.level, values["no rope"]) == (1, "1")


def test_a_rope_that_leaves_is_lost_and_no_longer_shown(carried, radius, entries):
    end = max(time for _, time, _ in entries)
    frame = carried[0]
    empty = np.where(frame.labels[0] > 0, 0, frame.depth[0])
    depth = np.round(1e3 * frame.depth_scale * empty).astype(np.uint16)
    bare = []
    for i in range(1, 40):
        time = end + i * SECOND // 30
        bare += [
            ("/tf", time, MADE.tf([("world", "camera", frame.poses[0])], time)),
            ("mask/image", time, MADE.image(np.zeros(depth.shape, np.uint8), time, encoding="mono8")),
            ("depth/image", time, MADE.image(depth, time)),
        ]
    with run_node(world_frame="world", radius=radius, **MASKED) as (bus, _):
        bus.play([*entries, *bare])
        shown = len(bus.sent["points"])
        last = bus.sent["ropes"][-1]
        _, values = report(bus)
    assert last.ropes[0].state == ROPE.LOST
    assert shown < len(bus.sent["ropes"])
    assert len(bus.sent["markers"][-1].markers) == 1  # which deletes the others
    assert "lost: rope 0" in bus.said[-1]
    assert int(values["doubt"]) > 5


def test_a_rope_that_moved_in_a_gap_is_not_shown_until_it_is_found():
    made = strand.synthetic.sequence("carry", seed=71, frames=45)
    frames, radius = list(made), float(made.radius)
    seen = [*frames[:16], *frames[31:]]
    with run_node(world_frame="world", radius=radius, **MASKED) as (bus, _):
        bus.play(record_sequence(seen))
    sizes = {frame.number: frame.nodes[0] for frame in frames}
    stamps = {START + round(frame.time * SECOND): frame.number for frame in frames}
    wrong, shown = set(), {count(cloud) for cloud in bus.sent["points"]}
    for message in bus.sent["ropes"]:
        nodes = np.array([[p.x, p.y, p.z] for p in message.ropes[0].points])
        true = strand.Chain(sizes[stamps[count(message)]], radius)
        if true.nearest(nodes).distance.max() > 5 * radius:
            wrong.add(count(message))
            assert message.unexplained > 0.03
    assert len(wrong) > 0
    assert not wrong & shown
    assert len(shown) > 30 - len(wrong) - 8
    assert find_kinds(bus) == {"doubt"}


def test_a_tracked_rope_that_is_not_sure_is_not_shown(entries, radius):
    known = {"radius": radius} | MASKED
    with run_node(world_frame="world", lengths=[400.0], **known) as (bus, _):  # millimetres
        bus.play(entries)
        status, _ = report(bus)
    assert bus.sent["ropes"][-1].ropes[0].state == ROPE.TRACKING
    assert bus.sent["points"] == []
    assert all(len(message.markers) == 1 for message in bus.sent["markers"])
    assert bus.said[-1] == "doubt: confidence below 0.5: rope 0: 0.00"
    assert status.level == 2
    with run_node(world_frame="world", lengths=[400.0], least_confidence=0.0, **known) as (bus, _):
        bus.play(entries)
    assert bus.sent["points"]
    assert bus.said == []


def count(message):
    return message.header.stamp.sec * SECOND + message.header.stamp.nanosec


def test_an_unexpected_error_is_reported_and_the_next_image_is_used(entries, monkeypatch):
    with run_node(world_frame="world", **MASKED) as (bus, node):
        bus.play(take(entries, 0, 2))
        with monkeypatch.context() as broken:
            broken.setattr(node._follower._tracker, "update", lambda *_: 1 / 0)
            bus.play(take(entries, 2, 3))
        bus.play(take(entries, 3, 5))
        _, values = report(bus)
    assert bus.said == ["error: ZeroDivisionError: division by zero"]
    assert (values["error"], values["answers"]) == ("1", "4")
    assert [event.kind for message in bus.sent["ropes"] for event in message.events] == ["begun", "begun"]


def test_reports_say_whether_all_is_well(entries):
    with run_node(world_frame="world", **MASKED) as (bus, _):
        bus.play(take(entries, 0, 3))
        well, values = report(bus)
        silent, _ = report(bus)
        response = bus.services["~/reset"](None, type("Response", (), {})())
    assert (well.level, well.message) == (0, "3 answers")
    assert (silent.level, silent.message) == (3, "no depth images")
    assert values["answers"] == "3"
    assert {"ms an answer, median", "ms since the image, most"} <= set(values)
    assert response.success
