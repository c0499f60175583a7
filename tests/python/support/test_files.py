"""Tests of atomic writing, bounded reading, JSON and TOML."""

from __future__ import annotations

import errno
import json
import os
import pickle
import re
import socket
import stat
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from strand import FileFormatError, StrandError
from strand.support.files import (
    convert_to_json,
    open_file,
    read_bytes,
    read_json,
    read_toml,
    replace_file,
    write_bytes,
    write_json,
)


def test_write_bytes_replaces_the_file_and_leaves_nothing_else(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(b"old")
    write_bytes(path, b"new")
    assert path.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [path]


def test_write_bytes_keeps_the_usual_permissions(tmp_path):
    (tmp_path / "plain").write_bytes(b"")
    write_bytes(tmp_path / "ours", b"")
    assert (tmp_path / "ours").stat().st_mode == (tmp_path / "plain").stat().st_mode


@pytest.mark.parametrize("mode", [0o600, 0o640, 0o444, 0o755, 0o666])
def test_a_replaced_file_keeps_its_mode(tmp_path, mode):
    path = tmp_path / "a.bin"
    path.write_bytes(b"old")
    path.chmod(mode)
    (tmp_path / "link").symlink_to(path)
    for name in ("a.bin", "link"):
        write_bytes(tmp_path / name, name.encode())
        assert path.read_bytes() == name.encode()
        assert stat.S_IMODE(path.stat().st_mode) == mode
    assert (tmp_path / "link").is_symlink()


def test_nobody_else_reads_a_private_file_while_it_is_written(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(b"old")
    path.chmod(0o600)
    with replace_file(path):
        assert {stat.S_IMODE(entry.stat().st_mode) for entry in tmp_path.iterdir()} == {0o600}


def test_owner_and_group_are_kept_where_the_system_allows(tmp_path, monkeypatch):
    path, asked = tmp_path / "a.bin", []
    path.write_bytes(b"old")
    path.chmod(0o2464)
    was = os.stat(path)

    def claim(place):
        # the owner of a file that this user can only replace
        found = os.lstat(place)
        return os.stat_result((*found[:4], was.st_uid + 1, was.st_gid + 1, *found[6:]))

    def refuse(file, owner, group):
        asked.append((owner, group))
        raise PermissionError(errno.EPERM, "Operation not permitted")

    system = SimpleNamespace(**{**vars(os), "stat": claim, "chown": refuse})
    monkeypatch.setattr("strand.support.rights.os", system)
    write_bytes(path, b"new")
    assert asked == [(-1, was.st_gid + 1), (was.st_uid + 1, -1)]
    assert path.read_bytes() == b"new"
    # another group gets no more than others had
    assert stat.S_IMODE(path.stat().st_mode) == 0o444


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root gives files away")
def test_owner_and_group_are_kept(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(b"old")
    os.chown(path, 1234, 2345)
    path.chmod(0o4710)
    write_bytes(path, b"new")
    status = path.stat()
    assert (status.st_uid, status.st_gid, stat.S_IMODE(status.st_mode)) == (1234, 2345, 0o4710)


def test_extended_attributes_are_kept(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(b"old")
    try:
        os.setxattr(path, "user.origin", b"robot 3")
    except (AttributeError, OSError) as error:
        pytest.skip(f"this system keeps none: {error}")
    write_bytes(path, b"new")
    assert os.getxattr(path, "user.origin") == b"robot 3"


def test_a_file_with_hard_links_is_refused_before_anything_is_written(tmp_path):
    path, other = tmp_path / "a.bin", tmp_path / "b.bin"
    path.write_bytes(b"old")
    os.link(path, other)
    with pytest.raises(OSError, match=r"Has 2 hard links.*a\.bin") as caught:
        write_bytes(path, b"new")
    assert caught.value.errno == errno.EMLINK
    assert path.read_bytes() == other.read_bytes() == b"old"
    assert len(list(tmp_path.iterdir())) == 2
    write_bytes(path, b"new", links=True)
    assert (path.read_bytes(), other.read_bytes()) == (b"new", b"old")


@pytest.mark.parametrize("step", ["fsync", "replace"])
@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt()])
def test_write_bytes_leaves_the_old_file_if_it_fails(tmp_path, monkeypatch, step, error):
    path = tmp_path / "a.bin"
    path.write_bytes(b"old")

    def fail(*_):
        raise error

    monkeypatch.setattr(os, step, fail)
    with pytest.raises(type(error)) as caught:
        write_bytes(path, b"new")
    if isinstance(error, OSError):
        assert caught.value.filename == str(path)
        assert caught.value.errno == errno.ENOSPC
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def write_half(path, error):
    with replace_file(path) as file:
        file.write(b"half")
        raise error


def test_a_file_written_in_pieces_is_complete_or_missing(tmp_path):
    path = tmp_path / "a.bin"
    with replace_file(path) as file:
        file.write(b"one")
        assert not path.exists()
        file.write(b"two")
    assert path.read_bytes() == b"onetwo"
    for error, named in (
        (ValueError("of the caller"), None),
        (FileNotFoundError(2, "No such file", "other.bin"), "other.bin"),
        (OSError(errno.ENOSPC, "No space left on device"), str(path)),
    ):
        with pytest.raises(type(error), match=re.escape(str(error).split("] ")[-1].split(": ")[0])) as caught:
            write_half(path, error)
        assert getattr(caught.value, "filename", None) == named
    assert path.read_bytes() == b"onetwo"
    assert list(tmp_path.iterdir()) == [path]


def test_write_bytes_names_the_file_it_cannot_write(tmp_path):
    with pytest.raises(FileNotFoundError) as caught:
        write_bytes(tmp_path / "no" / "a.bin", b"")
    assert caught.value.filename == str(tmp_path / "no" / "a.bin")
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(NotADirectoryError):
        write_bytes(tmp_path / "file" / "a.bin", b"")


def test_write_bytes_refuses_what_is_not_a_file(tmp_path, monkeypatch):
    with pytest.raises(OSError, match="Not a regular file"):
        write_bytes(tmp_path, b"")
    with pytest.raises(OSError, match="Not a regular file"):
        write_bytes(os.devnull, b"")
    assert not Path(os.devnull).is_file()
    os.mkfifo(tmp_path / "pipe")
    monkeypatch.chdir(tmp_path)  # addresses of sockets are short
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind("socket")
    for name in ("pipe", "socket"):
        with pytest.raises(OSError, match="Not a regular file"):
            write_bytes(tmp_path / name, b"")


def test_write_bytes_writes_through_a_link(tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "there" / "a.bin")
    write_bytes(tmp_path / "link", b"new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "there" / "a.bin").read_bytes() == b"new"


def test_json_comes_back(tmp_path):
    value = {"a": [1, 0.1, True, None, "é"], "b": {}}
    write_json(tmp_path / "a.json", value)
    assert read_json(tmp_path / "a.json") == value


def test_json_written_in_pieces_is_the_same_text(tmp_path):
    rows = np.arange(30_000.0).reshape(-1, 3)
    rows[9999, 1] = np.nan
    value = {
        "rows": rows,
        "objects": [{"a": rows[:2], "none": {}}, {"b": np.arange(5000)}],
        "empty": [(), [], rows[:0]],
        "one": np.float32(0.5),
    }
    write_json(tmp_path / "a.json", value)
    assert (tmp_path / "a.json").read_text() == json.dumps(convert_to_json(value)) + "\n"


def test_json_of_exactly_the_limit_is_written_and_read(tmp_path):
    file = tmp_path / "a.json"
    # a text of 20 bytes with the end of the line, and two quotes; lists take far more memory than space
    for value, size in ((17 * "a", 20 + 32), (1000 * [[]], 4001 + 62_018), (3 * "\xe9", 5 * 21 + 32)):
        write_json(file, value, max_bytes=size)
        assert read_json(file, size) == value
        with pytest.raises(FileFormatError, match=f"more than 2 x max_bytes={size - 1}"):
            read_json(file, size - 1)
        with pytest.raises(StrandError, match=rf"a\.json: the file .* than 2 x max_bytes={size - 1}"):
            write_json(file, value, max_bytes=size - 1)
        assert read_json(file) == value


@pytest.mark.parametrize("number", [np.inf, -np.inf])
def test_write_json_refuses_infinity(tmp_path, number):
    for value in ({"a": number}, {"a": np.full((9000, 2), number)}):
        with pytest.raises(ValueError, match=r"a\.json"):
            write_json(tmp_path / "a.json", value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "data", [b"", b'{"a": [1, 2', b"nonsense", b"\xff\xfe\xfd", b"[NaN]", b"[-Infinity]", b"[" * 100_000]
)
def test_read_json_names_a_bad_file(tmp_path, data):
    (tmp_path / "a.json").write_bytes(data)
    with pytest.raises(FileFormatError, match=r"a\.json"):
        read_json(tmp_path / "a.json")


def test_read_json_without_a_file(tmp_path):
    with pytest.raises(FileNotFoundError):
        read_json(tmp_path / "a.json")


def test_file_format_error_is_a_strand_error_and_a_value_error():
    assert issubclass(FileFormatError, StrandError)
    assert issubclass(FileFormatError, ValueError)


def test_read_toml(tmp_path):
    (tmp_path / "a.toml").write_text("a = 1\n[b]\nc = 'd'\n")
    assert read_toml(tmp_path / "a.toml") == {"a": 1, "b": {"c": "d"}}


def test_the_error_says_file_place_and_reason():
    error = FileFormatError("a.npz", "takes 9 bytes", "depth")
    assert (error.file, error.place, error.reason) == ("a.npz", "depth", "takes 9 bytes")
    assert str(error) == "a.npz: depth: takes 9 bytes"
    assert str(FileFormatError(Path("a.npz"), "the file is empty")) == "a.npz: the file is empty"
    assert len(str(FileFormatError("a", "x" * 10**6))) < 500
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again), again.place) == (FileFormatError, str(error), "depth")


def test_the_place_of_a_check_is_the_argument_in_its_message():
    error = FileFormatError.from_error("a", ValueError("camera.fx: expected a number, got 3: no"))
    assert (error.place, error.reason) == ("camera.fx", "expected a number, got 3: no")
    assert FileFormatError.from_error("a", RecursionError()).reason == "RecursionError"


def test_only_regular_files_are_opened(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "endless").symlink_to("/dev/zero")
    for name in ("pipe", "endless"):
        with pytest.raises(FileFormatError, match=rf"{name}: expected a regular file"):
            open_file(tmp_path / name)
    (tmp_path / "loop").symlink_to("loop")
    for name, number in (("loop", errno.ELOOP), (".", errno.EISDIR), ("no", errno.ENOENT)):
        with pytest.raises(OSError, match=re.escape(os.strerror(number))) as caught:
            open_file(tmp_path / name)
        assert caught.value.errno == number


def test_no_more_is_read_than_allowed(tmp_path):
    (tmp_path / "a").write_bytes(b"12345")
    assert read_bytes(tmp_path / "a", 5) == b"12345"
    with pytest.raises(FileFormatError, match="a: larger than the 4 bytes that may be read"):
        read_bytes(tmp_path / "a", 4)
    with open(tmp_path / "large", "wb") as file:
        file.truncate(1 << 42)  # without blocks on the disk
    with pytest.raises(FileFormatError, match="larger than the"):
        read_bytes(tmp_path / "large", 1 << 41)
    for read in (read_json, read_toml):
        with pytest.raises(FileFormatError, match="larger than the 4 bytes"):
            read(tmp_path / "a", 4)


@pytest.mark.parametrize(
    "data", [b"a = " + b"[" * 100_000, b"a = " + b"{a=" * 5000, b"a.b.c" + b".d" * 50 + b" = 1", b"\xff"]
)
def test_read_toml_names_a_bad_file(tmp_path, data):
    (tmp_path / "a.toml").write_bytes(data)
    with pytest.raises(FileFormatError, match=r"a\.toml: truncated, or not TOML"):
        read_toml(tmp_path / "a.toml")


def test_json_numbers_beyond_floats_are_refused(tmp_path):
    (tmp_path / "a.json").write_text("[1,\n2e999]")
    with pytest.raises(FileFormatError, match="2e999 is too large for a 64-bit float"):
        read_json(tmp_path / "a.json")
    (tmp_path / "a.json").write_text("[1,\n2")
    with pytest.raises(FileFormatError) as caught:
        read_json(tmp_path / "a.json")
    assert caught.value.place == "line 2"


def test_a_link_to_itself_is_not_written(tmp_path):
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(OSError, match="Too many levels of symbolic links"):
        write_bytes(tmp_path / "loop", b"")
