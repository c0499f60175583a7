"""Tests that damaged and hostile bags give an answer or the documented error, in bounded memory."""

from __future__ import annotations

import bz2
import io
import os
import random
import struct
import sys
import warnings
from collections import Counter

import lz4.frame
import pytest
from rosbags import rosbag1
from rosbags.rosbag2.storage_mcap import zstd

import strand
from lib.bag_files import FORMATS, START, record_film, write_bag
from strand import Recording
from strand.io.budget import Budget
from strand.io.recordings import is_recording
from strand.io.recordings.ros2_folder import YAML_BYTES
from strand.io.recordings.unpacking import MAX_PART, Limits, unpack, unpack_message
from strand.support.files import FileFormatError

SCENE = strand.synthetic.scene("arc", seed=0, views=2, camera=strand.synthetic.Camera(size=(64, 48)))
KINDS = [
    *((kind, None) for kind in FORMATS),
    *[("ros1", "lz4"), ("ros1", "bz2"), ("mcap", "storage"), ("sqlite3", "message"), ("mcap", "message")],
]
BOMB = 1 << 26  # bytes that a kilobyte decompresses to
LIMIT = 1 << 22


def make_bag(folder, kind, compression=None, frames=4):
    """Write a bag; return it and its file with the messages."""
    path = write_bag(
        folder / f"{kind}_{compression}", kind, record_film(SCENE, frames, kind == "ros1"), compression
    )
    if path.is_file():
        return path, path
    return path, next(one for one in path.iterdir() if one.suffix in (".db3", ".mcap"))


def read_all(path, **options):
    with Recording(path, **options) as recording:
        for frame in recording:
            assert len(frame.views) == 1
        return len(recording)


def drop_index(data):
    """Return an MCAP file whose footer leads to no index."""
    return data[:-28] + bytes(8) + data[-20:]


def test_files_without_an_index_are_read_through(tmp_path):
    path, file = make_bag(tmp_path, "mcap")
    file.write_bytes(drop_index(file.read_bytes()))
    with Recording(path, world="world") as recording:
        numbers = [frame.number for frame in recording if len(recording) == 4]
        pairs = [(one.stamp, other.stamp) for one, other in zip(recording, recording, strict=True)]
    assert numbers == [0, 1, 2, 3]
    assert all(one == other for one, other in pairs)


def test_passes_over_a_recording_do_not_disturb_each_other(tmp_path):
    for kind in FORMATS:
        path, _ = make_bag(tmp_path, kind)
        with Recording(path) as recording:
            stamps = [
                (one.stamp, other.stamp) for one, other in zip(recording, recording.read(1), strict=False)
            ]
            assert [b for _, b in stamps] == recording.stamps[1:].tolist()


@pytest.mark.parametrize(("kind", "compression"), KINDS)
def test_truncated_bags_are_named(tmp_path, kind, compression):
    path, file = make_bag(tmp_path, kind, compression)
    data = file.read_bytes()
    for part in (0, 1, 7, 30, len(data) // 3, len(data) // 2, len(data) - 1):
        file.write_bytes(data[:part])
        with pytest.raises(FileFormatError) as caught:
            read_all(path)
        assert caught.value.file.startswith(str(path))


def test_damaged_bags_give_an_answer_or_the_documented_error(tmp_path):
    bags = [make_bag(tmp_path, *kind) for kind in KINDS]
    files = [(path, file, file.read_bytes()) for path, file in bags]
    files += [
        (path, path / "metadata.yaml", (path / "metadata.yaml").read_bytes())
        for path, _ in bags
        if path.is_dir()
    ]
    seen = Counter()
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        for number in range(250):
            rng = random.Random(number)
            path, file, whole = rng.choice(files)
            data, at = bytearray(whole), rng.randrange(len(whole))
            how = rng.randrange(4)
            if how == 0:
                data[at] = rng.randrange(256)
            elif how == 1:
                size = rng.choice([1, 2, 4, 8])
                data[at : at + size] = rng.choice([0, 2**31, 2**32 - 1, 2**63, 2**64 - 1, 2**40]).to_bytes(8)[
                    :size
                ]
            elif how == 2:
                data[at : at + 60] = whole[:60]
            else:
                del data[at : at + rng.randrange(1, 300)]
            file.write_bytes(data)
            try:
                read_all(path, max_bytes=LIMIT)
                seen["answer"] += 1
            except FileFormatError as error:
                seen["error" if str(path.parent) in error.file else "another file"] += 1
            file.write_bytes(whole)
    assert seen["answer"] > 20
    assert seen["error"] > 70
    assert not seen["another file"]


@pytest.mark.parametrize("name", ["a.bag", "a.mcap", "a.db3"])
def test_other_files_are_not_bags(tmp_path, name):
    path = tmp_path / name
    for data in (b"", b"\x89PNG\r\n\x1a\n" + bytes(100), b"#ROSBAG V1.2\n", os.urandom(5000), b"a" * 5000):
        path.write_bytes(data)
        with pytest.raises(FileFormatError) as caught:
            Recording(path)
        assert caught.value.file == str(path)


def test_missing_files_and_folders(tmp_path):
    with pytest.raises(FileNotFoundError):
        Recording(tmp_path / "no.bag")
    with pytest.raises(FileNotFoundError, match=r"metadata\.yaml"):
        Recording(tmp_path)
    (tmp_path / "a.txt").write_text("a")
    with pytest.raises(FileFormatError, match=r"expected a \.bag, \.mcap, \.db3 file or the folder"):
        Recording(tmp_path / "a.txt")
    os.mkfifo(tmp_path / "pipe.bag")
    with pytest.raises(FileFormatError, match="expected a regular file"):
        Recording(tmp_path / "pipe.bag")
    path, file = make_bag(tmp_path, "sqlite3")
    file.unlink()
    os.mkfifo(file)
    with pytest.raises(FileFormatError, match="expected a regular file"):
        Recording(path)
    (path / "metadata.yaml").write_bytes(b"a: " + b"b" * YAML_BYTES)
    with pytest.raises(FileFormatError, match=r"metadata\.yaml: larger than"):
        Recording(path)
    assert [is_recording(tmp_path / name) for name in ("a.bag", "a.txt", ".")] == [True, False, False]


def test_compressed_files_are_refused(tmp_path):
    path = write_bag(tmp_path / "bag", "sqlite3", record_film(SCENE, 2), "file")
    with pytest.raises(
        FileFormatError, match=r"\.zstd: the file is compressed as a whole; decompress it first"
    ):
        Recording(path)


def test_a_closed_recording_raises_an_error(tmp_path):
    path, _ = make_bag(tmp_path, "ros1")
    recording = Recording(path)
    recording.close()
    recording.close()
    with pytest.raises(ValueError, match="the recording is closed"):
        next(iter(recording))


def compress(kind, data):
    return {"zstd": zstd.compress, "lz4": lz4.frame.compress, "bz2": bz2.compress}[kind](data)


def unpack_bytes(kind, packed, size):
    return unpack(kind, io.BytesIO(packed), len(packed), size)


@pytest.mark.parametrize("kind", ["zstd", "lz4", "bz2"])
def test_parts_have_the_size_that_they_declare(kind):
    data = os.urandom(3_000_000) + bytes(BOMB - 3_000_000)
    packed = compress(kind, data)
    assert unpack_bytes(kind, packed, BOMB) == data
    for size in (0, 1000, BOMB - 1):
        with pytest.raises(ValueError, match=f"decompresses to more than the {size} bytes that it declares"):
            unpack_bytes(kind, packed, size)
    with pytest.raises(ValueError, match=f"decompresses to {BOMB} bytes, but declares {BOMB + 1}"):
        unpack_bytes(kind, packed, BOMB + 1)
    with pytest.raises(ValueError, match="truncated compressed data"):
        unpack_bytes(kind, packed[:-5], BOMB)
    with pytest.raises(ValueError, match="the file ends 5 bytes too early"):
        unpack(kind, io.BytesIO(packed[:-5]), len(packed), BOMB)
    assert unpack_bytes(kind, compress(kind, b"a") + compress(kind, b"b"), 2) == b"ab"
    with pytest.raises(ValueError, match="at most 64 frames"):
        unpack_bytes(kind, compress(kind, b"") * 65, 0)


def test_parts_without_compression_have_the_size_that_they_declare():
    assert unpack_bytes("none", b"abc", 3) == b"abc"
    for packed, size in ((b"abc", 2), (b"abc", 4)):
        with pytest.raises(ValueError, match=f"a part of 3 bytes declares {size}"):
            unpack_bytes("", packed, size)
    with pytest.raises(ValueError, match="the file ends within it"):
        unpack("", io.BytesIO(b"abc"), 4, 4)


def test_parts_that_do_not_fit_are_refused_by_their_size():
    Limits(Budget(1000)).check_part(1000)
    for size, most in ((1001, 1000), (1 << 62, 1000), (MAX_PART + 1, 1 << 40)):
        with pytest.raises(ValueError, match=f"takes {size} bytes, more than"):
            Limits(Budget(most)).check_part(size)


def test_messages_that_become_too_large_are_refused():
    packed = zstd.compress(bytes(BOMB))
    assert len(packed) < 10_000
    streamed = zstd.ZstdCompressor()
    hidden = streamed.compress(bytes(BOMB)) + streamed.flush()
    assert zstd.get_frame_info(hidden).decompressed_size is None
    for data in (packed, hidden):
        assert unpack_message(data, BOMB) == bytes(BOMB)
        with pytest.raises(ValueError, match=f"decompresses to more than {LIMIT} bytes"):
            unpack_message(data, LIMIT)


def test_work_grows_with_the_file():
    for size, files in ((0, 1), (1 << 20, 1), (1 << 20, 8)):
        work = Limits(Budget(1), files).begin_pass(size)
        work.unpack((1 << 28) // files + 1024 * size)
        work.count((1 << 14) // files + size // 4)
        with pytest.raises(
            ValueError, match="decompresses to more than 268435456 bytes and 1024 for each byte"
        ):
            work.unpack(1)
        with pytest.raises(ValueError, match="has more than 16384 records and one for every 4 bytes"):
            work.count(1)


def test_chunks_of_mcap_that_declare_too_much_are_refused(tmp_path):
    path, file = make_bag(tmp_path, "mcap", "storage")
    # the first chunk declares its size in its header and in the index
    data = file.read_bytes()
    start = 8 + 9 + int.from_bytes(data[9:17], "little")
    assert data[start] == 6
    size = data[start + 25 : start + 33]
    assert data.count(size) >= 2
    file.write_bytes(data.replace(size, struct.pack("<Q", 1 << 62)))
    with pytest.raises(FileFormatError, match=f"takes {1 << 62} bytes, more than"):
        Recording(path)


@pytest.mark.parametrize("compression", ["lz4", "bz2"])
def test_chunks_of_rosbags_that_become_too_large_are_refused(tmp_path, compression):
    path, file = make_bag(tmp_path, "ros1", compression)
    with rosbag1.Reader(path) as reader:
        ((_, chunk),) = reader.chunks.items()
    data = file.read_bytes()
    packed = compress(compression, bytes(1 << 21)).ljust(chunk.datasize, b"\0")
    assert len(packed) == chunk.datasize
    file.write_bytes(data[: chunk.datapos] + packed + data[chunk.datapos + chunk.datasize :])
    with pytest.raises(FileFormatError, match=r"decompresses to more than the \d+ bytes that it declares"):
        Recording(path)


def test_an_index_that_leads_in_circles_is_refused(tmp_path):
    path, file = make_bag(tmp_path, "ros1", frames=40)
    data = file.read_bytes()
    at = struct.unpack_from("<Q", data, data.index(b"index_pos=") + 10)[0]
    while at < len(data):  # the last record belongs to the only chunk
        last, at = at, at + 4 + struct.unpack_from("<L", data, at)[0]
        at += 4 + struct.unpack_from("<L", data, at)[0]
    count = 4_000
    place = data.index(b"chunk_count=") + 12
    file.write_bytes(data[:place] + struct.pack("<L", count) + data[place + 4 :] + data[last:] * (count - 1))
    with pytest.raises(FileFormatError, match="leads to the same place again and again"):
        Recording(path)


def test_definitions_of_types_in_a_bag_are_not_used(tmp_path):
    path, file = make_bag(tmp_path, "ros1")
    data = file.read_bytes()
    definition = b"uint32 height"
    assert definition in data
    file.write_bytes(data.replace(definition, b"int32[9] abcd"[: len(definition)].ljust(len(definition))))
    assert read_all(path) == 4


@pytest.mark.parametrize(
    ("kind", "compression", "module", "name"),
    [("ros1", "lz4", "lz4.frame", "lz4"), ("mcap", "storage", "backports.zstd", r"backports\.zstd")],
)
def test_a_missing_package_is_named(tmp_path, monkeypatch, kind, compression, module, name):
    path, _ = make_bag(tmp_path, kind, compression)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ImportError, match=rf'{name} is needed here: pip install "[\w.-]+\[recordings\]"'):
        Recording(path)


def test_times_beyond_any_clock_are_refused(tmp_path):
    path, file = make_bag(tmp_path, "mcap")
    data = file.read_bytes()
    stamp = struct.pack("<Q", START)
    assert stamp in data
    file.write_bytes(drop_index(data.replace(stamp, struct.pack("<Q", 2**63 - 5))))
    with pytest.raises(FileFormatError):
        read_all(path)
