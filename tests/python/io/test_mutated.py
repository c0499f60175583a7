"""Damaged files of every kind: an answer, or the one error."""

from __future__ import annotations

import warnings
from collections import Counter

from lib.mutations import kinds, numbered
from mutated_files import ALLOWED, folder_of, outcome, read


def test_whole_files_are_read(tmp_path):
    for kind in kinds():
        folder = folder_of(tmp_path, kind)
        for data in kind.whole:
            (folder / kind.name).write_bytes(data)
            assert read(kind, folder) is not None


def test_damaged_files_give_an_answer_or_the_one_error(tmp_path):
    every = kinds()
    folders = {kind.name: folder_of(tmp_path, kind) for kind in every}
    seen = Counter()
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        warnings.filterwarnings("ignore", module="PIL")
        for number in range(1500):
            kind, data = numbered(0, number, every, every)
            (folders[kind.name] / kind.name).write_bytes(data)
            what = outcome(kind, folders[kind.name])
            assert what in ALLOWED, f"python benches/mutated_files.py --only {number}: {kind.name}: {what}"
            seen[kind.name, what] += 1
    for kind in every:
        assert seen[kind.name, "answer"]
        assert seen[kind.name, "FileFormatError"] > 20
    assert seen["scene.toml", "OSError"]
