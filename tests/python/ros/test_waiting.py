"""Depth images wait for what belongs to them: paired by time, in order, in bounded memory."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from strand_ros.waiting import Dropped, Frame, WaitingRoom

POSE = np.diag([1.0, -1.0, -1.0, 1.0])
MS = 10**6  # nanoseconds


def stamped(time, content=None):
    """Return a message with a stamp, ms."""
    stamp = SimpleNamespace(sec=0, nanosec=0) if time is None else count(time)
    return SimpleNamespace(header=SimpleNamespace(stamp=stamp, frame_id="camera"), content=content)


def count(time):
    nanoseconds = 10**18 + round(time * MS)
    return SimpleNamespace(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)


def make_room(*needed, find_pose=None, most=5, newest=False):
    room = WaitingRoom(needed, 0.02, 0.5, most, find_pose, newest)
    room.set_info("info")
    return room


def content(done):
    return [
        one.kind if isinstance(one, Dropped) else (one.depth.content, *one.images.values()) for one in done
    ]


def test_depth_alone_is_complete_at_once():
    room = make_room()
    assert room.add_depth(stamped(0, "depth"), 0.0) == []
    (frame,) = room.take(0.0)
    assert isinstance(frame, Frame)
    assert (frame.depth.content, frame.info, frame.pose, frame.fresh) == ("depth", "info", None, False)
    assert room.take(9.0) == []


def test_images_of_one_stamp_do_not_wait_for_later_ones():
    room = make_room("color", "mask")
    room.add_depth(stamped(0, "depth"), 0.0)
    room.add_image("mask", stamped(0, "mask"))
    assert room.take(0.0) == []
    room.add_image("color", stamped(0, "color"))
    (frame,) = room.take(0.0)
    assert {name: one.content for name, one in frame.images.items()} == {"color": "color", "mask": "mask"}


@pytest.mark.parametrize("order", ["color first", "depth first"])
def test_the_nearest_colour_is_taken(order):
    room = make_room("color")
    images = [("color", stamped(-12, "before")), ("color", stamped(5, "after"))]
    if order == "depth first":
        room.add_depth(stamped(0, "depth"), 0.0)
    for name, image in images:
        assert room.take(0.1) == []
        room.add_image(name, image)
    if order == "color first":
        room.add_depth(stamped(0, "depth"), 0.0)
    (frame,) = room.take(0.1)
    assert frame.images["color"].content == "after"


def test_an_earlier_colour_is_taken_when_no_other_comes():
    room = make_room("color")
    room.add_image("color", stamped(-12, "before"))
    room.add_depth(stamped(0, "depth"), 0.0)
    assert room.take(0.4) == []
    (frame,) = room.take(0.5)
    assert frame.images["color"].content == "before"


def test_a_lost_colour_is_noticed_when_the_next_comes():
    room = make_room("color")
    room.add_depth(stamped(0, "first"), 0.0)
    room.add_depth(stamped(33, "second"), 0.033)
    late = stamped(33, "color")
    room.add_image("color", late)
    first, second = room.take(0.034)
    assert first == Dropped("color", "no color within 0.02 s of a depth image")
    assert (second.depth.content, second.images["color"]) == ("second", late)


@pytest.mark.parametrize("missing", ["camera info", "color", "tf"])
def test_depth_is_dropped_when_it_has_waited_too_long(missing):
    def find_pose(frame, stamp):
        if missing == "tf":
            raise LookupError("no frame 'camera'")
        return POSE

    room = make_room("color", find_pose=find_pose)
    if missing == "camera info":
        room.set_info(None)
    if missing != "color":
        room.add_image("color", stamped(0))
    room.add_depth(stamped(0), 0.0)
    assert room.take(0.49) == []
    assert content(room.take(0.5)) == [missing]
    assert len(room) == (missing != "color")


def test_a_pose_that_comes_late_is_used():
    known = []

    def find_pose(frame, stamp):
        assert frame == "camera"
        if not known:
            raise LookupError("not yet")
        return POSE

    room = make_room(find_pose=find_pose)
    room.add_depth(stamped(0), 0.0)
    assert room.take(0.1) == []
    known.append(True)
    (frame,) = room.take(0.2)
    assert frame.pose is POSE


def test_a_pose_that_will_not_come_is_not_waited_for():
    def find_pose(frame, stamp):
        if stamp.nanosec < 20 * MS:
            raise LookupError("TF begins later")
        return POSE

    room = make_room(find_pose=find_pose)
    room.add_depth(stamped(0, "first"), 0.0)
    assert room.take(0.0) == []
    room.add_depth(stamped(33, "second"), 0.033)
    assert content(room.take(0.033)) == ["tf", ("second",)]


def test_a_broken_pose_is_not_waited_for():
    def find_pose(frame, stamp):
        raise ValueError("expected a unit quaternion")

    room = make_room(find_pose=find_pose)
    room.add_depth(stamped(0), 0.0)
    assert room.take(0.0) == [Dropped("bad tf", "expected a unit quaternion")]


def test_order_is_kept_while_the_first_waits():
    room = make_room("mask")
    for time in (0, 33, 66):
        room.add_depth(stamped(time, time), 0.0)
    third, second = stamped(66), stamped(33)
    room.add_image("mask", second)
    assert content(room.take(0.0)) == ["mask", (33, second)]
    room.add_image("mask", third)
    assert content(room.take(0.0)) == [(66, third)]


def test_memory_is_bounded():
    room = make_room("color", most=5)
    room.set_info(None)
    reasons = []
    for time in range(1000):
        for _ in range(3):
            room.add_image("color", stamped(time))
        reasons += room.add_depth(stamped(time), 1e-3 * time)
        assert not [one for one in room.take(1e-3 * time) if isinstance(one, Frame)]
        assert len(room) <= 10
    assert {one.kind for one in reasons} == {"queue"}
    assert reasons[-1].reason == "over 5 depth images wait; no CameraInfo has come"


def test_stamps_of_zero_and_late_ones_are_dropped():
    room = make_room()
    assert content(room.add_depth(stamped(None), 0.0)) == ["stamp"]
    room.add_depth(stamped(100, "on time"), 0.0)
    for time in (100, 99, -900):
        assert content(room.add_depth(stamped(time), 0.0)) == ["late"]
    assert content(room.take(0.0)) == [("on time",)]


def test_time_that_begins_anew_is_noticed():
    room = make_room("color")
    room.add_depth(stamped(5000), 0.0)
    room.add_image("color", stamped(5033))
    again = stamped(0, "again")
    room.add_image("color", again)
    assert content(room.add_depth(stamped(0, "depth"), 0.1)) == ["jump", "jump"]
    (frame,) = room.take(0.1)
    assert (frame.depth.content, frame.images["color"], frame.fresh) == ("depth", again, True)
    room.add_image("color", stamped(33))
    room.add_depth(stamped(33), 0.2)
    (frame,) = room.take(0.2)
    assert not frame.fresh


@pytest.mark.parametrize("queued", [1, 5])
def test_a_new_beginning_is_not_lost_with_a_dropped_image(queued):
    room = make_room("mask", most=queued)
    room.add_depth(stamped(5000), 0.0)
    room.add_depth(stamped(0), 0.1)
    room.add_depth(stamped(33, "second"), 0.1)
    mask = stamped(33)
    room.add_image("mask", mask)
    frame = room.take(0.1)[-1]
    assert (frame.depth.content, frame.fresh) == ("second", True)


def test_the_newest_is_taken_if_asked():
    room = make_room(newest=True)
    room.add_depth(stamped(9000), 0.0)
    for time in (0, 33, 66):
        room.add_depth(stamped(time, time), 0.0)
    *dropped, frame = room.take(0.0)
    assert content(dropped) == ["skipped", "skipped"]
    assert (frame.depth.content, frame.fresh) == (66, True)
