"""LeRobot data sets as recordings: every frame is the one that was written, in any order of reading."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import strand
from lib.lerobot_files import COLOR, DEPTH, change_info, make_colors, make_ramp, quantize, write_data_set
from strand.io.file_contents import read_contents
from strand.io.lerobot.depth_codes import read_codes

K = np.array([[60.0, 0.0, 31.5], [0.0, 60.0, 23.5], [0.0, 0.0, 1.0]])
LENGTHS = (7, 5, 13)
FRAMES = sum(LENGTHS)


@pytest.fixture(scope="module")
def ramp():
    return make_ramp(FRAMES)


@pytest.fixture(scope="module")
def videos(tmp_path_factory, ramp):
    """Return data sets with a key frame every second frame, and with one at the beginning alone."""
    folder = tmp_path_factory.mktemp("videos")
    return [
        write_data_set(folder / f"{gap}", ramp, LENGTHS, colors=make_colors(FRAMES), key_frames=gap)
        for gap in (2, 250)
    ]


def open_set(folder, **options):
    return strand.Recording(folder, intrinsics=K, **options)


def depth_of(frame):
    return np.asarray(frame.views[0].image.depth)


def check_frame(frame, ramp, error):
    exact = ramp[frame.number] * 1e-3
    depth = depth_of(frame)
    np.testing.assert_array_equal(depth == 0, exact == 0)
    assert np.abs(depth - exact).max() <= error


def test_the_frames_of_videos_are_those_written_to_half_a_step(videos, ramp):
    half = 0.5 * (np.log(13.5) - np.log(3.51)) / 4095 * (0.9 + 3.5)
    for folder in videos:
        with open_set(folder) as recording:
            frames = list(recording)
        assert [frame.number for frame in frames] == list(range(FRAMES))
        for frame in frames:
            check_frame(frame, ramp, half)


@pytest.mark.parametrize("kind", ["tiff", "png"])
def test_the_frames_of_images_are_exact(tmp_path, ramp, kind):
    with open_set(write_data_set(tmp_path / "set", ramp, LENGTHS, kind)) as recording:
        for frame in recording:
            check_frame(frame, ramp, 1e-12)
        for number in (20, 3, 3, 19):
            check_frame(next(recording.read(number)), ramp, 1e-12)


def test_images_of_floats_are_in_metres(tmp_path, ramp):
    metres = (ramp * 1e-3).astype(np.float32)
    with open_set(write_data_set(tmp_path / "set", metres, LENGTHS, "tiff")) as recording:
        np.testing.assert_array_equal(depth_of(next(iter(recording))), metres[0])


def test_whole_numbers_without_a_unit_are_millimetres_unless_the_caller_says(tmp_path, ramp):
    folder = write_data_set(tmp_path / "set", ramp, LENGTHS, "png", info={"depth_unit": None})
    with open_set(folder) as recording:
        check_frame(next(iter(recording)), ramp, 1e-12)
    with open_set(folder, depth_scale=1e-4) as recording:
        np.testing.assert_allclose(depth_of(next(iter(recording))), ramp[0] * 1e-4)


def test_frames_in_any_order_are_those_of_sequential_reading(videos):
    orders = [range(0, FRAMES, step) for step in (3, 9)]
    rng = np.random.default_rng(0)
    orders += [rng.permutation(FRAMES).tolist(), list(reversed(range(FRAMES)))]
    for folder in videos:
        with open_set(folder, color_topics=[COLOR]) as recording:
            whole = {frame.number: frame.views[0] for frame in recording}
        for order in orders:
            with open_set(folder, color_topics=[COLOR]) as recording:
                for number in order:
                    view = next(recording.read(number, number + 1)).views[0]
                    np.testing.assert_array_equal(view.image.depth, whole[number].image.depth)
                    np.testing.assert_array_equal(view.colors, whole[number].colors)


def test_stamps_go_on_from_episode_to_episode(videos):
    with open_set(videos[0]) as recording:
        assert recording.episodes == (range(0, 7), range(7, 12), range(12, 25))
        assert len(recording) == recording.most_frames == FRAMES
        np.testing.assert_allclose(recording.stamps, np.arange(FRAMES) / 30 * 1e9, atol=100)
        frame = next(recording.read(recording.episodes[1].start))
        assert (frame.number, frame.stamp) == (7, recording.stamps[7])
        assert frame.views[0].stamp == frame.stamp / 1e9


def test_colors_come_only_if_the_caller_names_them(videos):
    with open_set(videos[0]) as recording:
        assert recording.color_topics == (None,)
        assert COLOR in recording.color_troubles[DEPTH]
        assert next(iter(recording)).views[0].colors is None
    with open_set(videos[0], color_topics=[COLOR]) as recording:
        colors = next(recording.read(9)).views[0].colors
        assert np.abs(colors[:, 0] * 255 - 90).max() < 4
    with pytest.raises(ValueError, match="no colour feature other"):
        open_set(videos[0], color_topics=["other"])


def test_files_and_contents(videos):
    with open_set(videos[0]) as recording:
        names = {path.relative_to(videos[0]).as_posix() for path in recording.files}
    assert names == {
        "meta/info.json",
        "data/chunk-000/file-000.parquet",
        f"videos/{DEPTH}/chunk-000/file-000.mp4",
    }
    contents = read_contents(videos[0], max_bytes=1 << 30)
    assert (contents.format, contents.episodes) == ("LeRobot data set v3.0", 3)
    kinds = {topic.topic: topic.kind for topic in contents.topics}
    assert kinds[DEPTH] == "depth video (0.01 to 10 m, log, lossless)"
    (camera,) = contents.cameras
    assert (camera.topic, camera.messages, camera.trouble) == (DEPTH, FRAMES, None)
    assert camera.view.size == (64, 48)
    assert camera.view.no_return == 25


def test_linear_codes_and_bounds():
    info = {"video.use_log": False, "video.depth_min": 0.2, "video.depth_max": 2.0}
    depths = read_codes(info).list_depths()
    assert depths[0] == depths[-1] == 0.0
    np.testing.assert_allclose(depths[1:-1], 0.2 + 1.8 * np.arange(1, 4095) / 4095, rtol=1e-6)
    metres = np.linspace(0.05, 9.9, 1000)
    found = read_codes({}).list_depths()[quantize(metres)]
    assert np.abs(found - metres).max() < 0.5 * 3.29e-4 * 13.5


@pytest.mark.parametrize(
    "info",
    [
        {"video.depth_min": -1.0},
        {"video.depth_min": 2.0, "video.depth_max": 1.0},
        {"video.shift": -3.0},
        {"video.use_log": "yes"},
        {"video.depth_max": "far"},
        {"video.depth_max": 1e300},
    ],
)
def test_impossible_codes_are_refused(info):
    with pytest.raises(ValueError, match=r"depth|log|shift"):
        read_codes(info)


def test_two_cameras_need_poses(tmp_path, ramp):
    folder = write_data_set(tmp_path / "set", ramp, LENGTHS, "png")

    def make_both_depth(content):
        content["features"][COLOR] |= {"shape": [48, 64, 1], "info": {"is_depth_map": True}}

    change_info(folder, make_both_depth)
    with pytest.raises(ValueError, match=r"topics: several show depth.*top_depth"):
        open_set(folder)
    with pytest.raises(ValueError, match="2 cameras need poses"):
        open_set(folder, topics=["observation.images.*"])
    with open_set(folder, topics=["*_depth"]) as recording:
        assert recording.topics == (DEPTH,)


def test_a_legacy_mark_of_depth_is_understood(tmp_path, ramp):
    folder = write_data_set(tmp_path / "set", ramp, LENGTHS, "png")

    def change(content):
        content["features"][DEPTH]["info"] = {"video.is_depth_map": True}

    change_info(folder, change)
    with open_set(folder) as recording:
        check_frame(next(itertools.islice(recording, 4, None)), ramp, 1e-12)
