"""Whole files, or none; JSON and TOML."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import numpy as np
import pytest

from strand import FileFormatError, StrandError
from strand.files import read_json, read_toml, write_bytes, write_json


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


def test_write_bytes_names_the_file_it_cannot_write(tmp_path):
    with pytest.raises(FileNotFoundError) as caught:
        write_bytes(tmp_path / "no" / "a.bin", b"")
    assert caught.value.filename == str(tmp_path / "no" / "a.bin")
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(NotADirectoryError):
        write_bytes(tmp_path / "file" / "a.bin", b"")


def test_write_bytes_refuses_what_is_not_a_file(tmp_path):
    with pytest.raises(OSError, match="Not a regular file"):
        write_bytes(tmp_path, b"")
    with pytest.raises(OSError, match="Not a regular file"):
        write_bytes(os.devnull, b"")
    assert not Path(os.devnull).is_file()


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


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
def test_write_json_refuses_what_json_cannot_say(tmp_path, number):
    with pytest.raises(ValueError, match=r"a\.json"):
        write_json(tmp_path / "a.json", {"a": number})
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
