"""Tests of the frames of recordings against views of the same images."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from lib import bag_files
from lib.bag_files import (
    FORMATS,
    PERIOD,
    START,
    Messages,
    convert_to_millimeters,
    record_cameras,
    record_film,
    write_bag,
)
from strand import Recording
from strand.io import recordings
from strand.io.recordings import is_recording
from strand.support.files import FileFormatError

SCENE = strand.synthetic.scene("arc", seed=0, views=3, camera=strand.synthetic.Camera(size=(160, 120)))
DEPTHS = convert_to_millimeters(SCENE)
K = SCENE.intrinsics


def make_views(poses=SCENE.poses):
    return [
        strand.View.from_depth(depth, K, pose, depth_scale=0.001)
        for depth, pose in zip(DEPTHS, poses, strict=True)
    ]


def assert_same(views, others, atol=0.0):
    assert len(views) == len(others)
    for view, other in zip(views, others, strict=True):
        np.testing.assert_array_equal(view.points, other.points)
        np.testing.assert_allclose(view.pose, other.pose, rtol=0, atol=atol)


@pytest.mark.parametrize(
    ("kind", "compression"),
    [
        *((kind, None) for kind in FORMATS),
        *[("ros1", "lz4"), ("ros1", "bz2"), ("sqlite3", "message"), ("mcap", "message"), ("mcap", "storage")],
    ],
)
def test_cameras_of_a_scene_give_the_views_of_the_scene(tmp_path, kind, compression):
    path = write_bag(tmp_path / "bag", kind, record_cameras(SCENE, kind == "ros1"), compression)
    assert is_recording(path)
    with Recording(path, ["/camera_*"], world="world") as recording:
        assert recording.topics == tuple(f"/camera_{k}/depth/image_raw" for k in range(3))
        (frame,) = recording
        assert (len(recording), recording.stamps.tolist()) == (1, [START])
        assert (frame.number, frame.stamp, frame.time) == (0, START, START / 1e9)
        assert all(file.exists() for file in recording.files)
    assert [view.stamp for view in frame.views] == list(frame.times)
    assert len(set(frame.times)) == 3
    assert_same(frame.views, make_views(), atol=1e-12)


@pytest.mark.parametrize("kind", FORMATS)
def test_a_scene_is_read_back_from_a_recording(tmp_path, kind):
    path = write_bag(tmp_path / "bag", kind, record_cameras(SCENE, kind == "ros1"))
    known = {"radius": SCENE.radius, "bounds": SCENE.bounds, "ropes": 1}
    with Recording(path, ["/camera_*"], world="world") as recording:
        model = strand.reconstruct(next(iter(recording)).views, **known)
    want = strand.reconstruct(make_views(), **known)
    np.testing.assert_allclose(model.chains[0].points, want.chains[0].points, rtol=0, atol=1e-9)


@pytest.mark.parametrize("kind", FORMATS)
def test_one_camera_is_read_frame_by_frame(tmp_path, kind):
    path = write_bag(tmp_path / "bag", kind, record_film(SCENE, 7, kind == "ros1"))
    with Recording(path) as recording:
        assert recording.topics == ("/depth",)
        frames = list(recording)
        assert [frame.number for frame in frames] == list(range(7))
        assert [frame.stamp for frame in frames] == recording.stamps.tolist()
        assert np.diff(recording.stamps).tolist() == [PERIOD] * 6
        assert len(recording) == 7
        assert [frame.number for frame in recording.read(1, None, 2)] == [1, 3, 5]
        assert [frame.number for frame in recording.read(2, 4)] == [2, 3]
        assert list(recording.read(7)) == []
        assert not recording.stamps.flags.writeable
    assert_same([frame.views[0] for frame in frames[:3]], make_views(np.tile(np.eye(4), (3, 1, 1))))
    assert_same(frames[5].views, [frames[2].views[0]])


def test_a_moving_camera_is_placed_by_tf(tmp_path):
    path = write_bag(tmp_path / "bag", "mcap", record_film(SCENE, 4))
    with Recording(path, world="world") as recording:
        frames = list(recording)
        assert [frame.number for frame in recording.read(1, None, 2)] == [1, 3]
        assert_same(next(recording.read(2)).views, frames[2].views)
    assert_same([frame.views[0] for frame in frames[:3]], make_views(), atol=1e-12)


def test_frames_without_a_pose_are_dropped(tmp_path):
    made = Messages()
    entries = [entry for entry in record_film(SCENE, 6) if entry[0] != "/tf"]
    entries += [
        ("/tf", START + i * PERIOD, made.tf([("world", "camera", SCENE.poses[0])], START + i * PERIOD))
        for i in (2, 3)
    ]
    entries.sort(key=lambda entry: entry[1])
    path = write_bag(tmp_path / "bag", "sqlite3", entries)
    with Recording(path, world="world", tolerance=0.001) as recording:
        assert len(recording) == 2
        assert [frame.stamp for frame in recording] == [START + 2 * PERIOD, START + 3 * PERIOD]
        assert [frame.number for frame in recording] == [0, 1]
    with Recording(path, world="world", tolerance=0.04) as recording:
        assert len(recording) == 4


def test_no_frame_with_a_pose_is_an_error(tmp_path):
    made = Messages()
    entries = [entry for entry in record_film(SCENE, 3) if entry[0] != "/tf"]
    late = START + 10**12
    entries.append(("/tf", late, made.tf([("world", "camera", np.eye(4))], late)))
    path = write_bag(tmp_path / "bag", "mcap", entries)
    with (
        Recording(path, world="world") as recording,
        pytest.raises(FileFormatError, match="TF lacks the pose of a camera at all of 3 times"),
    ):
        next(iter(recording))


def test_poses_may_be_given(tmp_path):
    path = write_bag(tmp_path / "bag", "mcap", record_cameras(SCENE))
    with Recording(path, ["/camera_*"], poses=SCENE.poses) as recording:
        (frame,) = recording
    assert_same(frame.views, make_views())
    with pytest.raises(ValueError, match=r"poses: expected one for each of 3 topics, got 2"):
        Recording(path, ["/camera_*"], poses=SCENE.poses[:2])
    with pytest.raises(ValueError, match=r"poses\[1\]: expected a rigid motion"):
        Recording(path, ["/camera_*"], poses=[np.eye(4), np.diag([2.0, 1, 1, 1]), np.eye(4)])
    with pytest.raises(ValueError, match="poses: expected either poses, or world"):
        Recording(path, ["/camera_*"], poses=SCENE.poses, world="world")


def record_two_cameras(offset, second_every=1, frames=6):
    """Return messages of two cameras; the second is `offset` later, and written in a burst at the end."""
    made = Messages()
    size = DEPTHS[0].shape
    yield "/a/camera_info", START, made.info(K, size, START)
    yield "/b/camera_info", START, made.info(K, size, START)
    for i in range(frames):
        yield "/a/depth", START + i * PERIOD, made.image(DEPTHS[i % 3], START + i * PERIOD)
    for i in range(0, frames, second_every):
        late = START + frames * PERIOD + i
        yield "/b/depth", late, made.image(DEPTHS[i % 3] + np.uint16(i + 1), START + i * PERIOD + offset)


@pytest.mark.parametrize("kind", ["sqlite3", "mcap"])
def test_views_of_one_time_make_a_frame_wherever_they_are_in_the_file(tmp_path, kind):
    path = write_bag(tmp_path / "bag", kind, record_two_cameras(5_000_000))
    poses = [np.eye(4)] * 2
    with Recording(path, ["/a/depth", "/b/depth"], poses=poses, tolerance=0.006) as recording:
        frames = list(recording)
        assert len(recording) == len(frames) == 6
    for i, frame in enumerate(frames):
        np.testing.assert_array_equal(frame.views[0].image.depth, DEPTHS[i % 3] * 0.001)
        np.testing.assert_allclose(frame.views[1].image.depth, (DEPTHS[i % 3] + i + 1) * 0.001)
    with (
        Recording(path, ["/a/depth", "/b/depth"], poses=poses, tolerance=0.004) as recording,
        pytest.raises(FileFormatError, match=r"messages of all topics are never within 0\.004 s"),
    ):
        len(recording)


def test_a_slower_camera_makes_fewer_frames_or_is_used_twice(tmp_path):
    path = write_bag(tmp_path / "bag", "mcap", record_two_cameras(0, second_every=2))
    poses = [np.eye(4)] * 2
    with Recording(path, ["/a/depth", "/b/depth"], poses=poses, tolerance=0.01) as recording:
        assert recording.stamps.tolist() == [START + i * PERIOD for i in (0, 2, 4)]
        assert [frame.number for frame in recording] == [0, 1, 2]
    with Recording(path, ["/a/depth", "/b/depth"], poses=poses, tolerance=0.04) as recording:
        frames = list(recording)
    assert len(frames) == 6
    np.testing.assert_array_equal(frames[0].views[1].points, frames[1].views[1].points)


def test_views_far_apart_in_the_file_are_held_within_a_limit(tmp_path):
    path = write_bag(tmp_path / "bag", "sqlite3", record_two_cameras(0, frames=12))
    limit = 6 * DEPTHS[0].nbytes
    with (
        Recording(path, ["/a/*", "/b/*"], poses=[np.eye(4)] * 2, max_bytes=limit) as recording,
        pytest.raises(FileFormatError, match=f"more than max_bytes={limit} apart in the file"),
    ):
        list(recording)


def test_several_topics_need_a_choice_and_poses(tmp_path):
    path = write_bag(tmp_path / "bag", "mcap", record_cameras(SCENE))
    every = ", ".join(f"/camera_{k}/depth/image_raw" for k in range(3))
    with pytest.raises(ValueError, match=f"topics: several show depth.*: {every}$"):
        Recording(path)
    with pytest.raises(ValueError, match=r"world: 3 cameras need poses"):
        Recording(path, ["/camera_*"])
    with pytest.raises(ValueError, match=r"topics: no topic /front; .* has /camera_0/depth/image_raw \(sens"):
        Recording(path, ["/front"])
    with pytest.raises(ValueError, match=r"topics: no depth: /tf_static is tf2_msgs/msg/TFMessage; "):
        Recording(path, ["/tf_static"])
    with pytest.raises(ValueError, match=r"no frame 'map' in TF; there are camera_0, camera_1, camera_2, w"):
        Recording(path, ["/camera_1*"], world="map")


def test_a_recording_without_depth_lists_its_topics(tmp_path):
    made = Messages()
    color = made.image(DEPTHS[0], START, encoding="rgb8")
    path = write_bag(tmp_path / "bag", "mcap", [("/color", START, color)])
    with pytest.raises(FileFormatError, match=r"no topic shows depth; it has /color \(sensor_msgs/msg/Image"):
        Recording(path)
    path = write_bag(tmp_path / "tf", "mcap", [("/tf", START, made.tf([("a", "b", np.eye(4))], START))])
    with pytest.raises(FileFormatError, match=r"no topic shows depth; it has /tf \(tf2_msgs/msg/TFMessage\)"):
        Recording(path)


def test_images_need_a_camera_info_beside_them(tmp_path):
    entries = [entry for entry in record_film(SCENE, 2) if entry[0] != "/camera_info"]
    path = write_bag(tmp_path / "bag", "mcap", entries)
    with pytest.raises(
        FileFormatError, match=r"no CameraInfo on /camera_info .the bag has it on: none.; give intrinsics"
    ):
        Recording(path)
    with Recording(path, intrinsics=K) as recording:
        assert_same(next(iter(recording)).views, make_views([np.eye(4)] * 3)[:1])


def test_a_camera_info_of_another_image_is_refused(tmp_path):
    made = Messages()
    entries = [("/camera_info", START, made.info(K, (480, 640), START)), *record_film(SCENE, 2)]
    entries = [entry for i, entry in enumerate(entries) if i != 1]
    path = write_bag(tmp_path / "bag", "mcap", entries)
    with (
        Recording(path) as recording,
        pytest.raises(FileFormatError, match="160 x 120 pixels, got 640 x 480"),
    ):
        next(iter(recording))


def test_distortion_is_refused_unless_ignored(tmp_path):
    made = Messages()
    info = made.info(K, DEPTHS[0].shape, START, d=[0.1, -0.05, 0, 0, 0])
    entries = [("/camera_info", START, info), ("/depth", START, made.image(DEPTHS[0], START))]
    path = write_bag(tmp_path / "bag", "mcap", entries)
    with pytest.raises(FileFormatError, match=r"/camera_info: CameraInfo.D: expected no distortion"):
        Recording(path)
    with Recording(path, ignore_distortion=True) as recording:
        assert_same(next(iter(recording)).views, make_views([np.eye(4)] * 3)[:1])


@pytest.mark.parametrize("unit", [0.001, 0.00025, None])
def test_unit_of_realsense_recordings(tmp_path, unit):
    made = Messages(ros1=True)
    stream = "/device_0/sensor_0/Depth_0"
    image = made.image(DEPTHS[0], START, "0", encoding="mono16")
    color = made.make("std_msgs/msg/Float32", data=0.0)
    entries = [
        ("/device_0/sensor_1/Color_0/image/data", START, made.image(DEPTHS[0], START, "1", encoding="rgb8")),
        ("/device_0/sensor_0/option/Gain/value", START, color),
        (f"{stream}/info/camera_info", START, made.info(K, DEPTHS[0].shape, START, "0")),
        (f"{stream}/image/data", START, image),
    ]
    if unit is not None:
        number = made.make("std_msgs/msg/Float32", data=unit)
        entries.append(("/device_0/sensor_0/option/Depth Units/value", START, number))
    path = write_bag(tmp_path / "rs", "ros1", entries)
    with Recording(path) as recording:
        assert recording.topics == (f"{stream}/image/data",)
        if unit is None:
            with pytest.raises(FileFormatError, match="mono16 has no unit"):
                next(iter(recording))
        else:
            (frame,) = recording
            want = strand.View.from_depth(DEPTHS[0], K, depth_scale=unit)
            np.testing.assert_array_equal(frame.views[0].points, want.points)


def test_points_and_compressed_depth_are_read_too(tmp_path):
    made = Messages()
    view = make_views()[0]
    cloud = strand.msgs.make_point_cloud2(view.points, "camera", START)
    fields = [made.make("sensor_msgs/msg/PointField", **field) for field in cloud["fields"]]
    message = made.make(
        "sensor_msgs/msg/PointCloud2",
        **cloud
        | {
            "header": made.header("camera", START),
            "fields": fields,
            "data": np.frombuffer(cloud["data"], np.uint8),
        },
    )
    path = write_bag(tmp_path / "points", "mcap", [("/points", START, message)])
    with Recording(path) as recording:
        assert recording.topics == ("/points",)
        (frame,) = recording
        np.testing.assert_array_equal(frame.views[0].points, view.points.astype(np.float32))
    topic = "/depth/image/compressedDepth"
    entries = [
        ("/depth/camera_info", START, made.info(K, DEPTHS[0].shape, START)),
        (topic, START, made.compressed(DEPTHS[0], START)),
        ("/points", START, message),
    ]
    path = write_bag(tmp_path / "png", "mcap", entries)
    with Recording(path) as recording:
        assert recording.topics == (topic,)
        assert_same(next(iter(recording)).views, make_views([np.eye(4)] * 3)[:1])


def test_frames_of_older_messages_without_a_stamp_have_the_time_of_recording(tmp_path):
    made = Messages()
    entries = [("/camera_info", START, made.info(K, DEPTHS[0].shape, 0))]
    entries += [("/depth", START + i, made.image(DEPTHS[0], 0)) for i in range(2)]
    path = write_bag(tmp_path / "bag", "mcap", entries)
    with Recording(path) as recording:
        assert recording.stamps.tolist() == [START, START + 1] == [frame.stamp for frame in recording]


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"tolerance": -1.0}, ValueError, "tolerance: expected a number >= 0"),
        ({"world": 3}, TypeError, "world: expected text"),
        ({"topics": "/depth"}, TypeError, "topics: expected a sequence of text, got str"),
        ({"topics": [1]}, TypeError, "topics: expected text"),
        ({"depth_scale": 0}, ValueError, "depth_scale: expected a positive number"),
        ({"intrinsics": np.zeros((3, 3))}, ValueError, "intrinsics: expected"),
        ({"ignore_distortion": 1}, TypeError, "ignore_distortion: expected True or False"),
        ({"max_bytes": 0}, ValueError, "max_bytes: expected at least 1"),
        ({"poses": [np.eye(3)]}, ValueError, r"poses\[0\]: expected shape"),
    ],
)
def test_wrong_arguments_are_named(tmp_path, arguments, error, message):
    path = write_bag(tmp_path / "bag", "mcap", record_film(SCENE, 1))
    with pytest.raises(error, match=message):
        Recording(path, **arguments)


def test_wrong_ranges_of_frames_are_named(tmp_path):
    path = write_bag(tmp_path / "bag", "mcap", record_film(SCENE, 1))
    with Recording(path, tolerance=1e300) as recording:
        for arguments in ((-1,), (0, -1), (0, None, 0)):
            with pytest.raises(ValueError, match="expected at least"):
                recording.read(*arguments)
        assert len(list(recording)) == 1


def test_public_names():
    assert strand.Recording is recordings.Recording
    assert set(recordings.__all__) == {"Frame", "Recording", "is_recording"}
    assert bag_files.FORMATS == ("ros1", "sqlite3", "mcap")
