"""Tests that damaged files of every kind give an answer or the documented error."""

from __future__ import annotations

import warnings
from collections import Counter

from lib.damaged_files import ALLOWED, damage_file, list_kinds, make_folder, read_file, try_file


def test_whole_files_are_read(tmp_path):
    for kind in list_kinds():
        folder = make_folder(tmp_path, kind)
        for data in kind.whole:
            (folder / kind.name).write_bytes(data)
            assert read_file(kind, folder) is not None


def test_damaged_files_give_an_answer_or_the_documented_error(tmp_path):
    every = list_kinds()
    folders = {kind.name: make_folder(tmp_path, kind) for kind in every}
    seen = Counter()
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        warnings.filterwarnings("ignore", module="PIL")
        for number in range(1500):
            kind, data = damage_file(0, number, every, every)
            (folders[kind.name] / kind.name).write_bytes(data)
            what = try_file(kind, folders[kind.name])
            assert what in ALLOWED, f"python benches/mutated_files.py --only {number}: {kind.name}: {what}"
            seen[kind.name, what] += 1
    for kind in every:
        assert seen[kind.name, "answer"]
        assert seen[kind.name, "FileFormatError"] > 20
    assert seen["scene.toml", "OSError"]
