"""Sequences as recordings of ROS 2: other readers of MCAP and of messages agree, and strand follows them."""

from __future__ import annotations

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

import strand
from strand.synthetic import sequence
from strand.synthetic.recorded import START


@pytest.fixture(scope="module")
def made():
    return sequence("carry", seed=1, frames=6, views=2, color=True)


@pytest.fixture(scope="module")
def path(made, tmp_path_factory):
    path = tmp_path_factory.mktemp("recorded") / "rope.mcap"
    made.save(path)
    return path


def test_another_library_reads_the_same_messages(made, path):
    store = get_typestore(Stores.ROS2_HUMBLE)
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        found = [(schema, channel.topic, message) for schema, channel, message in reader.iter_messages()]
        counts = reader.get_summary().statistics.channel_message_counts
    assert sorted(counts.values()) == [1, *[len(made)] * 8]
    for schema, topic, message in found:
        assert schema.encoding == "ros2msg"
        # the definition in the file is that of ROS 2
        for name, fields in get_types_from_msg(schema.data.decode(), schema.name).items():
            assert fields == store.fielddefs[name]
        one = store.deserialize_cdr(message.data, schema.name)
        if topic == "/camera_1/depth/image_raw":
            number = round((message.log_time - START) * 30e-9)
            frame = made[number]
            assert one.header.frame_id == "camera_1"
            assert one.header.stamp.sec * 10**9 + one.header.stamp.nanosec == message.log_time
            pixels = one.data.view(np.uint16).reshape(one.height, one.width)
            np.testing.assert_allclose(pixels * 1e-3, frame.depth[1] * frame.depth_scale, atol=5.1e-4)
        if topic == "/camera_0/color/camera_info":
            np.testing.assert_array_equal(one.k.reshape(3, 3), made.intrinsics)
            np.testing.assert_array_equal(one.p.reshape(3, 4)[:, :3], made.intrinsics)
            assert (one.height, one.width, one.roi.do_rectify) == (480, 640, False)
    with AnyReader([path]) as opened:
        assert opened.message_count == 1 + 8 * len(made)


def test_strand_reads_its_views_back(made, path):
    with strand.Recording(path, ["/camera_0/depth/*", "/camera_1/depth/*"], world="table") as recording:
        assert recording.color_topics == ("/camera_0/color/image_raw", "/camera_1/color/image_raw")
        assert len(recording) == len(made)
        for frame, drawn in zip(recording, made, strict=True):
            assert frame.stamp == START + round(drawn.time * 1e9)
            for k, view in enumerate(frame.views):
                np.testing.assert_allclose(view.pose, made.poses[k], atol=1e-12)
                np.testing.assert_array_equal(view.image.colors, drawn.color[k])


def test_one_camera_without_colour(tmp_path):
    made = sequence("still", seed=2, frames=1)
    with pytest.raises(ValueError, match=r"expected a name that ends with \.mcap"):
        made.save(tmp_path / "a.bag")
    made.save(tmp_path / "a.mcap")
    with strand.Recording(tmp_path / "a.mcap") as recording:
        assert recording.topics == ("/camera/depth/image_raw",)
        assert recording.color_topics == (None,)
        (frame,) = recording
    model = strand.reconstruct(frame.views, radius=made.radius)
    assert model.chains[0].length == pytest.approx(made.spacings[0] * (len(made.nodes[0][0]) - 1), rel=0.02)
