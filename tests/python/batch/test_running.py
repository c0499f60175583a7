"""Batches: shards made, skipped, replaced and kept; arguments."""

from __future__ import annotations

import errno
import os
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image

import strand
from lib.bag_files import record_film, write_bag
from shared.batch_recordings import (
    COUNT,
    SETTINGS,
    read_table,
)
from strand._core import count_cores
from strand.batch import Counts, Settings, find_units, load_table, run, shards
from strand.batch.shards import Shards, list_shards, name_shard, prepare_folder
from strand.batch.work import ShardCounts, Work

SCENE = strand.synthetic.scene("arc", seed=0, views=3)


def test_a_second_run_makes_no_rows(recordings, expected, tmp_path):
    seen = []
    done = run(recordings, tmp_path / "out", SETTINGS, root=recordings, workers=1, progress=seen.append)
    assert done == Counts(COUNT, 0, COUNT, 0)
    assert [one.made for one in seen] == list(range(1, COUNT + 1))
    assert read_table(tmp_path / "out").equals(expected)
    before = {name: (tmp_path / "out" / name).stat().st_mtime_ns for name in list_shards(tmp_path / "out")}
    seen.clear()
    assert run(recordings, tmp_path / "out", SETTINGS, root=recordings, progress=seen.append) == Counts(
        0, COUNT
    )
    assert seen == [Counts(0, skipped) for skipped in range(1, COUNT + 1)]
    assert {name: (tmp_path / "out" / name).stat().st_mtime_ns for name in before} == before


def test_changed_recordings_and_settings_replace_rows(recordings, tmp_path):
    folder, out = tmp_path / "in", tmp_path / "out"
    for name in ("0/00.npz", "0/03.npz"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(recordings / name, folder / name)
    known = Settings(ropes=1, length=0.4)

    def made(settings):
        return run(folder, out, settings, root=folder, workers=1)

    first = made(SETTINGS)
    shutil.copy(recordings / "1" / "01.npz", folder / "0" / "00.npz")
    assert (first, made(SETTINGS)) == (Counts(2, 0, 2, 0), Counts(1, 1, 1, 0, replaced=1))
    assert load_table(out, ["recording"]).column(0).to_pylist() == ["0/00.npz", "0/03.npz"]
    assert made(known) == Counts(2, 0, 2, 0, replaced=2)
    assert set(load_table(out, ["configuration"]).column(0).to_pylist()) == {known.digest}
    assert len(load_table(out)) == len(list_shards(out)) == 2
    # rows of recordings that are not given stay
    (folder / "0" / "03.npz").unlink()
    assert made(known) == Counts(0, 1, 0, 0)
    assert len(load_table(out)) == 2


def test_error_rows_are_kept_or_repeated(recordings, tmp_path):
    folder, out = tmp_path / "in", tmp_path / "out"
    folder.mkdir()
    shutil.copy(recordings / "0" / "00.npz", folder / "good.npz")
    (folder / "bad.npz").write_bytes(b"nonsense")
    (folder / "gone.npz").symlink_to(folder / "nothing.npz")
    assert run(folder, out, SETTINGS, root=folder, workers=1) == Counts(3, 0, 3, 2)
    rows = load_table(out, ["recording", "error"]).to_pylist()
    assert [(row["recording"], (row["error"] or "").partition(":")[0]) for row in rows] == [
        ("bad.npz", "FileFormatError"),
        ("gone.npz", "FileNotFoundError"),
        ("good.npz", ""),
    ]
    assert run(folder, out, SETTINGS, root=folder) == Counts(0, 3, 0, 0)
    assert run(folder, out, SETTINGS, root=folder, workers=1, retry_errors=True) == Counts(2, 1, 2, 2)
    assert len(load_table(out)) == 3


def test_the_next_run_removes_duplicate_rows(recordings, tmp_path):
    one, out, other = recordings / "0" / "00.npz", tmp_path / "out", Settings(ropes=1, radius=0.004)
    (unit,) = find_units([one], SETTINGS, recordings)
    prepare_folder(out, SETTINGS, recordings)
    # two simultaneous runs with different settings, and a worker that died after it wrote its shard
    Work(other, str(out))(unit)
    Work(SETTINGS, str(out))(unit)
    failed = out / name_shard(unit, SETTINGS.digest, True)
    shutil.copy(out / name_shard(unit, SETTINGS.digest, False), failed)
    assert len(load_table(out)) == 3
    assert run(one, out, SETTINGS, root=recordings) == Counts(0, 1, 0, 0, replaced=2)
    assert list_shards(out) == [name_shard(unit, SETTINGS.digest, False)]
    assert Work(SETTINGS, str(out)).give_up(unit, "WorkerDied: three times") == ShardCounts(0, 0)
    assert list_shards(out) == [name_shard(unit, SETTINGS.digest, False)]


def test_stretches_replace_the_error_row_of_an_unopened_recording(tmp_path):
    path = write_bag(tmp_path / "rope", "mcap", record_film(SCENE, 3))
    settings = Settings(radius=0.0042, bounds=SCENE.bounds, world="world", stretch=2)
    out = tmp_path / "out"
    prepare_folder(out, settings, tmp_path)
    (first, second) = find_units([path], settings, tmp_path)
    unopened = replace(first, stop=None)
    Work(settings, str(out)).give_up(unopened, "PermissionError: not now")
    assert run(path, out, settings, root=tmp_path, workers=1) == Counts(2, 0, 3, 0, replaced=1)
    expected = {name_shard(unit, settings.digest, False) for unit in (first, second)}
    assert set(list_shards(out)) == expected
    # when it cannot be opened again, its stretches stay
    listed = Shards(out)
    assert listed.remove_stale(unopened, settings.digest) == 0
    assert listed.find(unopened, settings.digest) in expected
    # an incomplete set of stretches does not count as the whole
    for unit in (first, second):
        part = tmp_path / f"{unit.start}"
        shutil.copytree(out, part)
        (part / name_shard(unit, settings.digest, False)).unlink()
        assert Shards(part).find(unopened, settings.digest) is None


def test_rows_of_an_unreadable_recording_stay(recordings, tmp_path):
    folder, out = tmp_path / "in", tmp_path / "out"
    folder.mkdir()
    for name in ("a.npz", "b.npz"):
        shutil.copy(recordings / "0" / "00.npz", folder / name)
    assert run(folder, out, SETTINGS, root=folder, workers=1) == Counts(2, 0, 2, 0)
    before = list_shards(out)
    (folder / "a.npz").unlink()
    (folder / "a.npz").symlink_to("a.npz")
    assert run(folder, out, SETTINGS, root=folder, workers=1, retry_errors=True) == Counts(0, 1, kept=1)
    assert list_shards(out) == before
    # also if another run has made its rows meanwhile
    (unread, _) = find_units([folder], SETTINGS, folder)
    assert (unread.digest, Work(SETTINGS, str(out))(unread)) == (None, ShardCounts(0, 0))
    # without earlier rows, it gets an error row
    (other, _) = find_units([folder], SETTINGS, tmp_path)
    assert Work(SETTINGS, str(out))(other) == ShardCounts(1, 1)
    said = [row for row in load_table(out, ["recording", "error"]).to_pylist() if row["error"]]
    assert [one["recording"] for one in said] == ["in/a.npz"]
    assert said[0]["error"].startswith("OSError: ")
    # the error row is removed when there are other rows
    shutil.copy(
        out / name_shard(other, SETTINGS.digest, True), out / name_shard(unread, SETTINGS.digest, True)
    )
    assert run(folder, out, SETTINGS, root=folder) == Counts(0, 1, kept=1, replaced=1)
    assert name_shard(unread, SETTINGS.digest, True) not in list_shards(out)


@pytest.fixture
def closed(monkeypatch):
    """A set of folders that nobody can read, not even root."""
    scandir, folders = os.scandir, set()

    def refused(path="."):
        if str(path) in folders:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), path)
        return scandir(path)

    monkeypatch.setattr(os, "scandir", refused)
    return folders


def test_unreadable_folders_lose_no_rows_and_leave_no_error(recordings, tmp_path, closed):
    folder, out = tmp_path / "in", tmp_path / "out"
    settings = Settings(ropes=1, intrinsics=SCENE.intrinsics, depth_scale=SCENE.depth_scale)
    images = folder / "depth"
    for name in (images, folder / "sub" / "inner"):
        name.mkdir(parents=True)
    shutil.copy(recordings / "0" / "00.npz", folder / "sub" / "inner" / "b.npz")
    Image.fromarray(SCENE.depth[0]).save(images / "0.png")
    (images / "1.png").write_bytes(b"nonsense")

    def made():
        done = run(folder, out, settings, root=folder, workers=1)
        rows = load_table(out, ["recording", "frame", "error"]).to_pylist()
        return done, [(row["recording"], row["frame"], bool(row["error"])) for row in rows]

    whole = [("depth", 0, False), ("depth", 1, True), ("sub/inner/b.npz", 0, False)]
    assert made() == (Counts(2, 0, 3, 1), whole)
    closed |= {str(images), str(folder / "sub")}
    assert made() == (Counts(1, 0, 1, 1, kept=1), [*whole[:2], ("sub", None, True), whole[2]])
    closed.clear()
    assert made() == (Counts(0, 2, replaced=1), whole)


def test_a_complete_folder_of_shards_may_be_read_only(recordings, tmp_path, monkeypatch):
    run(recordings / "0", tmp_path, SETTINGS, root=recordings, workers=1)
    count = len(list_shards(tmp_path))
    (tmp_path / ".strand-old.tmp").touch()
    os.utime(tmp_path / ".strand-old.tmp", (0, 0))

    def refused(*_, **__):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr(shards, "write_json", refused)
    monkeypatch.setattr(Path, "unlink", refused)
    moved = tmp_path / "moved"
    shutil.copytree(recordings, moved)
    assert run(moved / "0", tmp_path, SETTINGS, root=moved) == Counts(0, count)


def test_a_second_run_keeps_the_root(recordings, tmp_path, monkeypatch):
    folder, out = tmp_path / "in", tmp_path / "out"
    shutil.copytree(recordings / "0", folder / "0")
    count = len(list((folder / "0").iterdir()))
    monkeypatch.chdir(folder)
    assert run("0", out, SETTINGS, workers=1).made == count
    monkeypatch.chdir(tmp_path)
    assert run(folder, out, SETTINGS, workers=1) == Counts(0, count)
    monkeypatch.chdir(recordings)
    folder.rename(tmp_path / "moved")
    with pytest.raises(
        ValueError, match=f"root: {out} names recordings relative to {folder}, which is not a folder"
    ):
        run(tmp_path / "moved", out, SETTINGS)
    for _ in range(2):
        assert run(tmp_path / "moved", out, SETTINGS, root=tmp_path / "moved") == Counts(0, count)
    assert run(tmp_path / "moved", out, SETTINGS) == Counts(0, count)
    (out / "_root.json").write_text("{}")
    with pytest.raises(strand.FileFormatError, match=r"_root\.json: expected the path of a folder"):
        run(tmp_path / "moved", out, SETTINGS)
    (out / "_root.json").write_text("{")
    assert run(tmp_path / "moved", out, SETTINGS, root=tmp_path / "moved") == Counts(0, count)
    assert run(tmp_path / "moved", out, SETTINGS) == Counts(0, count)


def test_other_files_beside_shards_are_ignored(recordings, tmp_path):
    assert run(recordings / "0" / "00.npz", tmp_path, SETTINGS, workers=1) == Counts(1, 0, 1, 0)
    (name,) = list_shards(tmp_path)
    (tmp_path / name).with_name("whole.parquet").write_bytes(b"another")
    old = tmp_path / ".strand-left.tmp"
    old.touch()
    os.utime(old, (0, 0))
    assert run(recordings / "0" / "00.npz", tmp_path, SETTINGS, workers=1) == Counts(0, 1, 0, 0)
    assert (len(load_table(tmp_path)), old.exists()) == (1, False)


def test_half_written_files_are_ignored_and_removed_when_old(recordings, tmp_path):
    assert run(recordings / "0" / "00.npz", tmp_path, SETTINGS, workers=1) == Counts(1, 0, 1, 0)
    (name,) = list_shards(tmp_path)
    old, new = ((tmp_path / name).with_name(f".strand-{k}.tmp") for k in "01")
    for half in (old, new):
        half.write_bytes(b"half")
    os.utime(old, (0, 0))
    assert run(recordings / "0" / "00.npz", tmp_path, SETTINGS, workers=1) == Counts(0, 1, 0, 0)
    assert (old.exists(), new.exists(), len(load_table(tmp_path))) == (False, True, 1)


def test_workers_never_need_more_cores_than_there_are(recordings, tmp_path):
    with pytest.raises(ValueError, match="cores, and this machine has"):
        run(recordings, tmp_path, workers=count_cores() + 1)
    with pytest.raises(ValueError, match="cores, and this machine has"):
        run(recordings, tmp_path, workers=2, threads=count_cores())
    with pytest.raises(
        ValueError, match=f"threads: expected at most {count_cores()}, .* got {count_cores() + 1}"
    ):
        run(recordings, tmp_path, threads=count_cores() + 1)
    before = strand.num_threads(), dict(os.environ)
    assert run(recordings / "0" / "00.npz", tmp_path, SETTINGS, threads=count_cores()).made == 1
    assert (strand.num_threads(), dict(os.environ)) == before


@pytest.mark.parametrize(
    ("wrong", "error", "said"),
    [
        ({"engine": "dask"}, ValueError, "engine: expected one of local, ray"),
        ({"address": "127.0.0.1:1"}, ValueError, "address: for Ray only"),
        ({"settings": {"radius": 1}}, TypeError, "settings: expected strand.batch.Settings"),
        ({"threads": 0}, ValueError, "threads: expected at least 1"),
        ({"recordings": []}, ValueError, "recordings: expected at least one"),
        ({"recordings": ""}, ValueError, "recordings: expected a path, got an empty text"),
        ({"recordings": [None]}, TypeError, "recordings: expected a path, got NoneType"),
        ({"recordings": b"in"}, TypeError, "recordings: expected a sequence of paths, got bytes"),
        ({"out": ""}, ValueError, "out: expected a path, got an empty text"),
        ({"out": None}, TypeError, "out: expected a path, got NoneType"),
        ({"root": 7}, TypeError, "root: expected a path, got int"),
        ({"root": "nowhere"}, ValueError, "root: expected a folder, got nowhere"),
        ({"progress": 5}, TypeError, "progress: expected a callable, got int"),
    ],
)
def test_arguments_are_checked_before_the_work(recordings, tmp_path, wrong, error, said):
    with pytest.raises(error, match=said):
        run(**{"recordings": recordings, "out": tmp_path / "out", **wrong})
    assert not (tmp_path / "out").exists()


def test_pyarrow_is_asked_for_where_it_is_missing(recordings, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(ImportError, match=r'pyarrow is needed here: pip install "[\w.-]+\[batch\]"'):
        run(recordings, tmp_path / "out")
    assert not (tmp_path / "out").exists()
