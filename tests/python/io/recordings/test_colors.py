"""Recordings with colour topics."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from lib.bag_files import FORMATS, PERIOD, START, Messages, write_bag
from strand import Recording
from strand.support.files import FileFormatError

K = np.array([[200.0, 0.0, 79.5], [0.0, 200.0, 59.5], [0.0, 0.0, 1.0]])
OTHER = np.array([[260.0, 0.0, 121.0], [0.0, 255.0, 92.0], [0.0, 0.0, 1.0]])
SHAPE, OTHER_SHAPE = (120, 160), (184, 240)
DISTANCE = 0.5  # metres: a wall that faces the depth camera
MOTION = strand.pose_from_angles(0.02, -0.03, 0.01, [0.03, -0.01, 0.005])  # colour camera to depth camera
PLUMB_BOB = (0.08, -0.05, 0.002, -0.001, 0.01)


def paint(x, y):
    """The wall's colours at places, metres: smooth, so that a pixel's error is small."""
    waves = [np.sin(11.0 * x + 3.0 * y), np.cos(9.0 * y), np.sin(8.0 * x - 6.0 * y)]
    return np.rint(127.5 + 100.0 * np.stack(waves, axis=-1)).astype(np.uint8)


def see_wall(matrix, shape, pose=None, d=None):
    """What a camera at a pose sees of the wall."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    slopes = np.stack(
        [(columns - matrix[0, 2]) / matrix[0, 0], (rows - matrix[1, 2]) / matrix[1, 1]], axis=-1
    )
    pixels, bare = slopes, slopes
    for _ in range(20 if d else 0):  # undistorted by fixed-point steps
        x, y = bare[..., 0], bare[..., 1]
        r = x * x + y * y
        radial = 1.0 + r * (d[0] + r * (d[1] + r * d[4]))
        dx = 2.0 * d[2] * x * y + d[3] * (r + 2.0 * x * x)
        dy = d[2] * (r + 2.0 * y * y) + 2.0 * d[3] * x * y
        bare = np.stack([(pixels[..., 0] - dx) / radial, (pixels[..., 1] - dy) / radial], axis=-1)
    pose = np.eye(4) if pose is None else pose
    rays = np.concatenate([bare, np.ones((*shape, 1))], axis=-1) @ pose[:3, :3].T
    places = pose[:3, 3] + rays * ((DISTANCE - pose[2, 3]) / rays[..., 2])[..., None]
    return paint(places[..., 0], places[..., 1])


WANTED = see_wall(K, SHAPE)
DEPTH = np.full(SHAPE, 500, dtype=np.uint16)


def record(frames=3, *, encoding="rgb8", delay=4_000_000, other=False, tf=True, d=(), ros1=False, info=True):
    """Messages of a depth camera, and of its colours or those of another camera."""
    made = Messages(ros1)
    frame, matrix, shape = ("color", OTHER, OTHER_SHAPE) if other else ("depth", K, SHAPE)
    image = see_wall(OTHER, OTHER_SHAPE, MOTION, d) if other else WANTED
    topic = "/cam/color/image_raw" + ("/compressed" if encoding in ("jpeg", "png") else "")
    if tf:
        yield "/tf_static", START, made.tf([("depth", "color", MOTION), ("world", "depth", np.eye(4))], START)
    yield "/cam/depth/camera_info", START, made.info(K, SHAPE, START, "depth")
    if info:
        yield "/cam/color/camera_info", START, made.info(matrix, shape, START, frame, d)
    for i in range(frames):
        stamp = START + i * PERIOD
        yield "/cam/depth/image_raw", stamp, made.image(DEPTH, stamp, "depth")
        brighter = np.minimum(image, 240) + np.uint8(5 * i)
        yield topic, stamp + delay, made.color(brighter, stamp + delay, frame, encoding)


def brightened(i):
    return np.minimum(WANTED, 240) + np.uint8(5 * i)


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "rgba8", "bgra8", "png", "jpeg"])
def test_colours_of_the_same_camera_are_those_of_its_pixels(tmp_path, kind, encoding):
    path = write_bag(tmp_path / "bag", kind, record(encoding=encoding, ros1=kind == "ros1"))
    with Recording(path) as recording:
        assert recording.color_topics[0].startswith("/cam/color/image_raw")
        assert recording.color_troubles == {}
        frames = list(recording)
    assert [frame.number for frame in frames] == [0, 1, 2]
    for i, frame in enumerate(frames):
        difference = frame.views[0].image.colors.astype(int) - brightened(i)
        assert np.abs(difference).max() <= (12 if encoding == "jpeg" else 0)


@pytest.mark.parametrize("d", [(), PLUMB_BOB])
def test_colours_of_another_camera_are_found_by_projection(tmp_path, d):
    path = write_bag(tmp_path / "bag", "mcap", record(2, other=True, d=d))
    with Recording(path) as recording:
        frames = list(recording)
    for i, frame in enumerate(frames):
        difference = np.abs(frame.views[0].image.colors.astype(int) - brightened(i))
        assert np.percentile(difference, 99) <= 4
        assert difference.max() < 12


def test_pixels_without_depth_have_a_colour_too(tmp_path):
    entries = [
        (topic, time, Messages().image(np.where(np.arange(160) % 9 < 3, 0, DEPTH), time, "depth"))
        if topic.endswith("depth/image_raw")
        else (topic, time, message)
        for topic, time, message in record(1, other=True)
    ]
    with Recording(write_bag(tmp_path / "bag", "mcap", entries)) as recording:
        (frame,) = recording
    assert np.percentile(np.abs(frame.views[0].image.colors.astype(int) - brightened(0)), 99) <= 4
    assert len(frame.views[0].colors) == len(frame.views[0].points) < DEPTH.size


@pytest.mark.parametrize("world", [None, "world"])
def test_the_nearest_colours_in_time_are_taken_within_the_tolerance(tmp_path, world):
    # each colour image is nearer to the next depth image
    path = write_bag(tmp_path / "bag", "sqlite3", record(4, delay=PERIOD - 5_000_000))
    with Recording(path, world=world) as recording:
        frames = list(recording)
        assert len(recording) == 4
        assert [frame.number for frame in recording.read(1, 4, 2)] == [1, 3]
        (third,) = recording.read(3)
    assert frames[0].views[0].image.colors is None
    for i in (1, 2, 3):
        np.testing.assert_array_equal(frames[i].views[0].image.colors, brightened(i - 1))
    np.testing.assert_array_equal(third.views[0].image.colors, brightened(2))


def test_several_cameras_have_their_own_colours(tmp_path):
    made, entries = Messages(), []
    for k, name in enumerate("ab"):
        entries.append((f"/{name}/depth/camera_info", START, made.info(K, SHAPE, START, name)))
        entries.append((f"/{name}/depth/image", START, made.image(DEPTH, START, name)))
        entries.append((f"/{name}/rgb/image", START, made.color(brightened(k), START, name)))
    path = write_bag(tmp_path / "bag", "mcap", entries)
    with Recording(path, ["/?/*/image"], poses=[np.eye(4)] * 2) as recording:
        assert recording.topics == ("/a/depth/image", "/b/depth/image")
        assert recording.color_topics == ("/a/rgb/image", "/b/rgb/image")
        (frame,) = recording
    for k, view in enumerate(frame.views):
        np.testing.assert_array_equal(view.image.colors, brightened(k))
    exchanged = ["/b/rgb/image", "/b/rgb/image"]
    with (
        pytest.raises(ValueError, match=r"color_topics: .*/b/rgb/image: no CameraInfo on /b/rgb/camera_info"),
    ):
        Recording(path, ["/?/depth/image"], poses=[np.eye(4)] * 2, color_topics=exchanged)


def test_colours_may_be_turned_off(tmp_path):
    path = write_bag(tmp_path / "bag", "mcap", record())
    with Recording(path, color_topics=[]) as recording:
        assert recording.color_topics == (None,)
        assert all(frame.views[0].image.colors is None for frame in recording)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"other": True, "tf": False}, "no frame 'color' in TF"),
        ({"other": True, "info": False}, "no CameraInfo on /cam/color/camera_info"),
        ({"other": True, "d": (0.1, 0.2)}, "CameraInfo.distortion_model: expected plumb_bob or"),
    ],
)
def test_colours_that_cannot_be_aligned_are_skipped_unless_they_are_named(tmp_path, changes, reason):
    if "d" in changes:
        entries = []
        for topic, time, message in record(other=True):
            if topic == "/cam/color/camera_info":
                message = Messages().info(OTHER, OTHER_SHAPE, START, "color", changes["d"])
            entries.append((topic, time, message))
    else:
        entries = record(**changes)
    path = write_bag(tmp_path / "bag", "mcap", entries)
    with Recording(path) as recording:
        assert recording.color_topics == (None,)
        assert reason in recording.color_troubles["/cam/depth/image_raw"]
        assert next(iter(recording)).views[0].image.colors is None
    with pytest.raises(ValueError, match=r"color_topics: .*/cam/color/image_raw: ") as caught:
        Recording(path, color_topics=["/cam/color/image_raw"])
    assert reason in str(caught.value)


@pytest.mark.parametrize(
    ("topics", "message"),
    [
        (["/no"], "color_topics: .*/no: no such topic with messages; the recording has /cam/color"),
        (["/cam/depth/image_raw"], "color_topics: .*: expected colours, got '16UC1'"),
        (
            ["/cam/depth/camera_info"],
            "color_topics: .*: expected colour images, got sensor_msgs/msg/CameraInfo",
        ),
        (["/a", "/b"], "color_topics: expected one for each of 1 topics, or none, got 2"),
    ],
)
def test_wrong_colour_topics_are_named(tmp_path, topics, message):
    path = write_bag(tmp_path / "bag", "mcap", record(1))
    with pytest.raises(ValueError, match=message):
        Recording(path, color_topics=topics)
    with pytest.raises(TypeError, match="color_topics: expected a sequence of text, got str"):
        Recording(path, color_topics="/cam/color/image_raw")


def test_a_damaged_colour_image_spoils_its_frame_alone(tmp_path):
    entries = list(record(3, encoding="png"))
    entries[-1][2].data = entries[-1][2].data[:50]
    with Recording(write_bag(tmp_path / "bag", "mcap", entries)) as recording:
        frames = list(recording.read_undecoded())
        assert recording.decode(frames[1]).views[0].image.colors is not None
        with pytest.raises(FileFormatError, match=r"/cam/color/image_raw/compressed at .*: .*truncated"):
            recording.decode(frames[2])
