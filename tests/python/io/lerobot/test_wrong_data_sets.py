"""Damaged, foreign and forged data sets: errors that name the file, and say what to do."""

from __future__ import annotations

import re
import shutil

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import strand
from lib.lerobot_files import (
    COLOR,
    DATA,
    DEPTH,
    EPISODES,
    change_info,
    make_ramp,
    write_data_set,
    write_video,
)
from strand.io.budget import Budget
from strand.io.lerobot.mp4_samples import count_samples
from strand.io.lerobot.tables import open_table

K = np.array([[60.0, 0.0, 31.5], [0.0, 60.0, 23.5], [0.0, 0.0, 1.0]])
LENGTHS = (3, 4)
VIDEO = f"videos/{DEPTH}/chunk-000/file-000.mp4"


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return write_data_set(tmp_path_factory.mktemp("whole") / "set", make_ramp(7), LENGTHS)


@pytest.fixture(scope="module")
def pictured(tmp_path_factory):
    return write_data_set(tmp_path_factory.mktemp("pictured") / "set", make_ramp(7), LENGTHS, "tiff")


@pytest.fixture
def copy(whole, tmp_path):
    return shutil.copytree(whole, tmp_path / "set")


@pytest.fixture
def pictures(pictured, tmp_path):
    return shutil.copytree(pictured, tmp_path / "set")


def read(folder, **more):
    with strand.Recording(folder, **{"intrinsics": K, **more}) as recording:
        return list(recording)


def refuse(folder, words, **more):
    with pytest.raises(strand.FileFormatError, match=words) as caught:
        read(folder, **more)
    assert str(folder) in str(caught.value)


def test_missing_files_are_named(copy):
    for name in (VIDEO, DATA, EPISODES, "meta/info.json"):
        (copy / name).unlink()
        with pytest.raises((FileNotFoundError, strand.FileFormatError), match=re.escape(name.split("/")[1])):
            read(copy)


@pytest.mark.parametrize(
    ("version", "words"),
    [
        ("v2.1", r"version 3, got 'v2\.1'; LeRobot converts it: .*convert_dataset_v21_to_v30"),
        ("v4.0", r"version 3, got 'v4\.0'$"),
        ("3.0", r"version 3, got '3\.0'"),
        (3, r"expected the codebase_version"),
    ],
)
def test_other_versions_are_refused(copy, version, words):
    change_info(copy, lambda content: content.update(codebase_version=version))
    refuse(copy, words)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("meta/info.json", b"{"),
        ("meta/info.json", b"[]"),
        (DATA, b""),
        (DATA, b"PAR1" * 10),
        (EPISODES, b"PAR1" + b"\0" * 50 + b"\x20\0\0\0PAR1"),
        (VIDEO, b""),
        (VIDEO, b"\0\0\0\x08free" * 3),
        (VIDEO, b"#EXTM3U\nfile:///etc/passwd\n"),
    ],
)
def test_files_of_another_kind_are_refused(copy, name, data):
    (copy / name).write_bytes(data)
    refuse(copy, name.rsplit("/", 1)[-1].replace(".", r"\."))


@pytest.mark.parametrize("name", [DATA, EPISODES, VIDEO, "meta/info.json"])
def test_files_that_are_cut_off_are_refused(copy, name):
    data = (copy / name).read_bytes()
    for share in (0.1, 0.5, 0.9):
        (copy / name).write_bytes(data[: int(share * len(data))])
        refuse(copy, name.rsplit("/", 1)[-1].replace(".", r"\."))


@pytest.mark.parametrize("name", [DATA, EPISODES, VIDEO])
def test_changed_bytes_raise_errors_of_the_file_alone(copy, name):
    data, rng = (copy / name).read_bytes(), np.random.default_rng(0)
    for _ in range(40):
        changed = bytearray(data)
        for at in rng.integers(0, len(data), 3):
            changed[at] = rng.integers(256)
        (copy / name).write_bytes(changed)
        try:
            read(copy)
        except strand.FileFormatError as error:
            assert str(copy) in str(error)  # noqa: PT017
        except FileNotFoundError as error:
            assert str(copy) in str(error.filename)  # noqa: PT017


def change_columns(path, **columns):
    table = pq.read_table(path)
    for name, values in columns.items():
        table = table.drop_columns(name)
        if values is not None:
            table = table.append_column(name, pa.array(values))
    pq.write_table(table, path)


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"length": [3, 5]}, "expected the episodes from 0 on"),
        ({"dataset_from_index": [0, 4]}, "expected the episodes from 0 on"),
        ({"episode_index": [0, 2]}, "expected the episodes from 0 on"),
        ({"dataset_to_index": [3, 2]}, "expected the episodes from 0 on"),
        ({"length": [0, 7], "dataset_to_index": [0, 7], "dataset_from_index": [0, 0]}, "got one without"),
        ({"dataset_to_index": [3, 1 << 60]}, "expected numbers from 0 to 1000000000"),
        ({"length": [3.0, 4.0]}, "expected whole numbers"),
        ({"length": ["a", "b"]}, "column length: expected numbers"),
        ({"length": None}, "no column length"),
        ({"data/chunk_index": [0, -1]}, "expected numbers from 0"),
        ({f"videos/{DEPTH}/from_timestamp": [0.0, float("nan")]}, "expected numbers from 0"),
        ({"length": [3, None]}, "none missing"),
    ],
)
def test_episodes_that_do_not_follow_each_other_are_refused(copy, columns, words):
    change_columns(copy / EPISODES, **columns)
    refuse(copy, words)


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"index": [0, 1, 2, 3, 4, 5, 8]}, "no row with index 6, a frame of episode 1"),
        ({"index": [0, 1, 2, 3, 5, 4, 6]}, "frames that are not in order"),
        ({"timestamp": [0.0, 0.1, float("nan"), 0, 0, 0, 0]}, "expected seconds in the episode"),
        ({"timestamp": [0.0, 1 / 30, 0.5, 0, 0, 0, 0]}, "no frame at this time"),
        ({"timestamp": [0.0, 1.5 / 30, 0.5, 0, 0, 0, 0]}, "no frame at this time"),
        ({"timestamp": None}, "no column timestamp"),
    ],
)
def test_frames_that_are_missing_are_named(copy, columns, words):
    change_columns(copy / DATA, **columns)
    refuse(copy, words)


def test_a_damaged_frame_spoils_only_itself(copy):
    change_columns(copy / DATA, timestamp=[0.0, 1 / 30, 9.0, 0.0, 1 / 30, 2 / 30, 3 / 30])
    with strand.Recording(copy, intrinsics=K) as recording:
        read_frames = []
        for frame in recording.read_undecoded():
            try:
                read_frames.append(recording.decode(frame).number)
            except strand.FileFormatError as error:
                assert "at 9.000 s" in str(error)  # noqa: PT017
    assert read_frames == [0, 1, 3, 4, 5, 6]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda c: c["features"][DEPTH].update(shape=[48, 65, 1]), "expected images of 65 x 48 pixels"),
        (lambda c: c["features"][DEPTH].update(shape=[48]), "expected the height, width and channels"),
        (lambda c: c["features"][DEPTH].update(shape=[1 << 19, 1 << 19, 1]), "max_bytes"),
        (lambda c: c["features"][DEPTH].update(info={}), "no feature is a depth map"),
        (lambda c: c["features"][DEPTH]["info"].update({"video.depth_max": 0.0}), "depth_min < depth_max"),
        (lambda c: c.update(features=[]), "features by their names"),
        (lambda c: c["features"].update({DEPTH: 5}), "expected a feature with a dtype"),
        (lambda c: c.update(fps=0), "frames per second"),
        (lambda c: c.update(fps=True), "frames per second"),
        (lambda c: c.update(video_path="../{video_key}.mp4"), "expected a path below the folder"),
        (lambda c: c.update(data_path="/data/{file_index}"), "expected a path below the folder"),
        (lambda c: c.update(data_path="{chunk_index:099999999d}"), "expected a path below the folder"),
        (lambda c: c.update(data_path="{chunk_index.real}"), "expected a path below the folder"),
        (lambda c: c.update(data_path="{other}"), "expected data_path as"),
        (lambda c: c["features"].update({"../x": c["features"][DEPTH]}), "expected a name without /"),
    ],
)
def test_descriptions_that_do_not_fit_are_refused(copy, change, words):
    change_info(copy, change)
    refuse(copy, words)


def test_a_video_of_eight_bits_is_no_depth(copy):
    write_video(copy / VIDEO, [np.zeros((48, 64, 3), np.uint8)] * 7, "libx264", "yuv420p", {})
    refuse(copy, "expected 12-bit codes")


def test_a_feature_of_colors_is_no_depth(whole):
    with pytest.raises(ValueError, match=rf"no depth feature {re.escape(COLOR)}"):
        strand.Recording(whole, [COLOR], intrinsics=K)


@pytest.mark.parametrize(
    ("data", "words"),
    [(b"II*\0 and more", "not a TIFF"), (b"\x89PNG\r\n\x1a\n", "PNG"), (None, "bytes"), (b"", "bytes")],
)
def test_damaged_images_are_refused(pictures, data, words):
    table = pq.read_table(pictures / DATA)
    files = [*table[DEPTH].to_pylist()[:6], {"bytes": data, "path": "frame.tiff"}]
    column = pa.array(files, table[DEPTH].type)
    pq.write_table(table.drop_columns(DEPTH).append_column(DEPTH, column), pictures / DATA)
    refuse(pictures, words)


def test_an_image_of_another_size_is_not_decoded(pictures):
    change_info(pictures, lambda content: content["features"][DEPTH].update(shape=[48, 65, 1]))
    refuse(pictures, r"expected the depth image's shape \(48, 65\)")


@pytest.mark.parametrize("unit", ["inch", 5])
def test_unknown_units_are_refused(pictures, unit):
    change_info(pictures, lambda content: content["features"][DEPTH]["info"].update(depth_unit=unit))
    refuse(pictures, "expected depth_unit m or mm")


def test_little_memory_is_enough_or_an_error(whole, pictured):
    for folder in (whole, pictured):
        refuse(folder, "max_bytes", max_bytes=20_000)
        assert len(read(folder, max_bytes=32 << 20)) == 7


def test_a_video_that_declares_many_samples_is_refused_by_its_header(copy):
    data = bytearray((copy / VIDEO).read_bytes())
    at = data.index(b"stsz")
    assert count_samples(copy / VIDEO) == int.from_bytes(data[at + 12 : at + 16], "big") == 7
    data[at + 8 : at + 16] = (4).to_bytes(4, "big") + (1 << 31).to_bytes(4, "big")
    (copy / VIDEO).write_bytes(data)
    refuse(copy, r"takes 2\d{11} bytes, but \d+ are left of max_bytes")


def test_a_page_that_declares_much_is_refused_before_it_is_decoded(tmp_path):
    path = tmp_path / "zeros.parquet"
    pq.write_table(pa.table({"index": np.zeros(4_000_000, np.int64)}), path, use_dictionary=False)
    assert path.stat().st_size < 3_000_000
    with (
        pytest.raises(strand.FileFormatError, match="max_bytes=20000000"),
        open_table(path, Budget(20_000_000)) as table,
    ):
        table.read_numbers(["index"])


def test_a_closed_recording_says_so(whole):
    recording = strand.Recording(whole, intrinsics=K)
    recording.close()
    with pytest.raises(ValueError, match="the recording is closed"):
        next(recording.read())
