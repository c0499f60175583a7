"""Tests of the contents of recordings."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from lib.bag_files import FORMATS, PERIOD, START, Messages, record_cameras, record_film, write_bag
from strand.io.recordings.bags import Bag
from strand.io.recordings.recording_contents import Topic, read_recording_contents
from strand.support.files import FileFormatError

SCENE = strand.synthetic.scene("arc", seed=0, views=2, camera=strand.synthetic.Camera(size=(40, 30)))
SIZE = (40, 30)
MOST = 1 << 24


@pytest.mark.parametrize("kind", FORMATS)
def test_topics_are_counted_by_the_index(tmp_path, kind):
    path = write_bag(tmp_path / "rope", kind, record_film(SCENE, 4, kind == "ros1"))
    held = read_recording_contents(path, None, MOST)
    assert held.format == ("ROS 1 bag" if kind == "ros1" else "ROS 2 bag" if path.is_dir() else "MCAP file")
    assert held.start == START
    assert held.seconds == pytest.approx(3 * PERIOD * 1e-9)
    assert held.topics == (
        Topic("/camera_info", "sensor_msgs/msg/CameraInfo", 1, None),
        Topic("/depth", "sensor_msgs/msg/Image", 4, pytest.approx(1e9 / PERIOD)),
        Topic("/tf", "tf2_msgs/msg/TFMessage", 4, pytest.approx(1e9 / PERIOD)),
    )
    assert held.tf_frames == ("camera", "world")
    assert held.tf_trouble is None
    (camera,) = held.cameras
    assert (camera.topic, camera.messages, camera.frame, camera.size) == ("/depth", 4, "camera", SIZE)
    assert camera.trouble is None
    with strand.Recording(path) as recording:
        (view,) = next(iter(recording)).views
    assert camera.view.points == len(view.points)
    assert camera.view.distance == (view.image.depth[view.image.depth > 0].min(), view.image.depth.max())


def test_only_the_first_messages_are_read(tmp_path, monkeypatch):
    path = write_bag(tmp_path / "rope", "mcap", record_film(SCENE, 300))
    read = []
    decoded = Bag.decode

    def counted(bag, message):
        read.append(message.topic)
        return decoded(bag, message)

    monkeypatch.setattr(Bag, "decode", counted)
    assert read_recording_contents(path, None, MOST).topics[1].messages == 300
    assert read.count("/depth") < 5
    assert read.count("/tf") == 100


def test_selected_cameras(tmp_path):
    path = write_bag(tmp_path / "rope", "mcap", record_cameras(SCENE))
    held = read_recording_contents(path, None, MOST)
    assert [camera.topic for camera in held.cameras] == [f"/camera_{k}/depth/image_raw" for k in range(2)]
    held = read_recording_contents(path, ["/camera_1/*"], MOST)
    assert [camera.frame for camera in held.cameras] == ["camera_1"]
    with pytest.raises(
        ValueError, match=r"topics: no topic /no; .* has /camera_0/depth/image_raw \(sensor_msgs"
    ):
        read_recording_contents(path, ["/no"], MOST)


def test_unreadable_topics_have_a_reason(tmp_path):
    made = Messages()
    depth = np.ones(SIZE[::-1], np.uint16)
    entries = [
        ("/a/camera_info", START, made.info(SCENE.intrinsics, depth.shape, START, d=(0.1, 0, 0, 0, 0))),
        ("/a/depth", START, made.image(depth, START)),
        ("/b/depth", START, made.image(depth, START, data=np.zeros(7, np.uint8))),
        ("/tf", START, made.tf([("world", "camera", np.eye(4))], START)),
        ("/tf", START + 1, made.tf([("map", "camera", np.eye(4))], START)),
    ]
    held = read_recording_contents(write_bag(tmp_path / "rope", "mcap", entries), None, MOST)
    distorted, broken = held.cameras
    assert (distorted.view, distorted.size) == (None, SIZE)
    assert "--ignore-distortion" in distorted.trouble
    assert "no CameraInfo on /b/camera_info" in broken.trouble
    assert held.tf_frames == ("camera", "world")
    assert "expected one parent" in held.tf_trouble


def test_a_recording_without_depth_or_messages(tmp_path):
    made = Messages()
    info = made.info(SCENE.intrinsics, (30, 40), START)
    held = read_recording_contents(write_bag(tmp_path / "a", "mcap", [("/info", START, info)]), None, MOST)
    assert (len(held.topics), held.cameras, held.tf_frames) == (1, (), ())
    held = read_recording_contents(write_bag(tmp_path / "b", "sqlite3", []), None, MOST)
    assert (held.start, held.seconds, held.topics) == (None, 0.0, ())


@pytest.mark.parametrize("kind", FORMATS)
def test_damaged_files_are_described_or_the_documented_error(tmp_path, kind):
    path = write_bag(tmp_path / "rope", kind, record_film(SCENE, 2, kind == "ros1"))
    file = path if path.is_file() else next(one for one in path.iterdir() if one.suffix in (".db3", ".mcap"))
    whole = file.read_bytes()
    random = np.random.default_rng(5)
    seen = set()
    for number in range(60):
        data = bytearray(whole)
        if number % 4 == 0:
            del data[random.integers(len(data)) :]
        else:
            start = 0 if number % 2 else len(data) - 2000
            for at in start + random.integers(2000, size=6):
                data[at] = random.integers(256)
        damaged = tmp_path / f"damaged{file.suffix}"
        damaged.write_bytes(data)
        try:
            read_recording_contents(damaged, None, MOST)
            seen.add("answer")
        except FileFormatError:
            seen.add("error")
    assert seen == {"answer", "error"}
