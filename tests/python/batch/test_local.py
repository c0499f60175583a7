"""Batches by processes of this machine: made, skipped, replaced; killed drivers and workers, full disks."""

from __future__ import annotations

import errno
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
import types
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image

import strand
from lib.bag_files import film, write
from shared.batch_recordings import (
    SETTINGS,
    Deadly,
    FullDisk,
    find_shards,
    interrupt,
    read_table,
    save_scenes,
)
from strand._core import cores
from strand.batch import Done, EngineError, Settings, find, load, local, run, shards
from strand.batch.engines import TRIES
from strand.batch.shards import Shards, Work, Written, made_ready, name_of, names

COUNT = 18
SCENE = strand.synthetic.scene("arc", seed=0, views=3)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    return save_scenes(tmp_path_factory.mktemp("recordings"), COUNT)


@pytest.fixture(scope="module")
def expected(recordings, tmp_path_factory):
    """The table of a run that nothing disturbed, by two workers."""
    out = tmp_path_factory.mktemp("expected")
    assert run(recordings, out, SETTINGS, root=recordings, workers=2) == Done(COUNT, 0, COUNT, 0)
    return read_table(out)


def again(recordings, out):
    """Run once more, and return what was done."""
    return run(recordings, out, SETTINGS, root=recordings, workers=1)


def test_each_recording_has_its_rows_and_a_second_run_makes_none(recordings, expected, tmp_path):
    seen = []
    done = run(recordings, tmp_path / "out", SETTINGS, root=recordings, workers=1, progress=seen.append)
    assert done == Done(COUNT, 0, COUNT, 0)
    assert [one.made for one in seen] == list(range(1, COUNT + 1))
    assert read_table(tmp_path / "out").equals(expected)
    before = {name: (tmp_path / "out" / name).stat().st_mtime_ns for name in names(tmp_path / "out")}
    seen.clear()
    assert run(recordings, tmp_path / "out", SETTINGS, root=recordings, progress=seen.append) == Done(
        0, COUNT
    )
    assert seen == [Done(0, skipped) for skipped in range(1, COUNT + 1)]
    assert {name: (tmp_path / "out" / name).stat().st_mtime_ns for name in before} == before


def test_what_changed_is_made_again_in_place_of_what_was_there(recordings, tmp_path):
    folder, out = tmp_path / "in", tmp_path / "out"
    for name in ("0/00.npz", "0/03.npz"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(recordings / name, folder / name)
    known = Settings(ropes=1, length=0.4)

    def made(settings):
        return run(folder, out, settings, root=folder, workers=1)

    first = made(SETTINGS)
    shutil.copy(recordings / "1" / "01.npz", folder / "0" / "00.npz")
    assert (first, made(SETTINGS)) == (Done(2, 0, 2, 0), Done(1, 1, 1, 0, replaced=1))
    assert load(out, ["recording"]).column(0).to_pylist() == ["0/00.npz", "0/03.npz"]
    assert made(known) == Done(2, 0, 2, 0, replaced=2)
    assert set(load(out, ["configuration"]).column(0).to_pylist()) == {known.digest}
    assert len(load(out)) == len(names(out)) == 2
    # what is given no more stays
    (folder / "0" / "03.npz").unlink()
    assert made(known) == Done(0, 1, 0, 0)
    assert len(load(out)) == 2


def test_errors_are_rows_that_are_kept_or_tried_again(recordings, tmp_path):
    folder, out = tmp_path / "in", tmp_path / "out"
    folder.mkdir()
    shutil.copy(recordings / "0" / "00.npz", folder / "good.npz")
    (folder / "bad.npz").write_bytes(b"nonsense")
    (folder / "gone.npz").symlink_to(folder / "nothing.npz")
    assert run(folder, out, SETTINGS, root=folder, workers=1) == Done(3, 0, 3, 2)
    rows = load(out, ["recording", "error"]).to_pylist()
    assert [(row["recording"], (row["error"] or "").partition(":")[0]) for row in rows] == [
        ("bad.npz", "FileFormatError"),
        ("gone.npz", "FileNotFoundError"),
        ("good.npz", ""),
    ]
    assert run(folder, out, SETTINGS, root=folder) == Done(0, 3, 0, 0)
    assert run(folder, out, SETTINGS, root=folder, workers=1, retry_errors=True) == Done(2, 1, 2, 2)
    assert len(load(out)) == 3


def test_rows_that_are_there_twice_are_mended_by_the_next_run(recordings, tmp_path):
    one, out, other = recordings / "0" / "00.npz", tmp_path / "out", Settings(ropes=1, radius=0.004)
    (unit,) = find([one], SETTINGS, recordings)
    made_ready(out, SETTINGS, recordings)
    # as of two runs at once with different settings; and of a worker that died after its shard was there
    Work(other, str(out))(unit)
    Work(SETTINGS, str(out))(unit)
    failed = out / name_of(unit, SETTINGS.digest, True)
    shutil.copy(out / name_of(unit, SETTINGS.digest, False), failed)
    assert len(load(out)) == 3
    assert run(one, out, SETTINGS, root=recordings) == Done(0, 1, 0, 0, replaced=2)
    assert names(out) == [name_of(unit, SETTINGS.digest, False)]
    assert Work(SETTINGS, str(out)).give_up(unit, "WorkerDied: three times") == Written(0, 0)
    assert names(out) == [name_of(unit, SETTINGS.digest, False)]


def test_what_could_not_be_opened_when_it_was_sought_gives_way_to_its_stretches(tmp_path):
    path = write(tmp_path / "rope", "mcap", film(SCENE, 3))
    settings = Settings(radius=0.0042, bounds=SCENE.bounds, world="world", stretch=2)
    out = tmp_path / "out"
    made_ready(out, settings, tmp_path)
    (first, second) = find([path], settings, tmp_path)
    unopened = replace(first, stop=None)
    Work(settings, str(out)).give_up(unopened, "PermissionError: not now")
    assert run(path, out, settings, root=tmp_path, workers=1) == Done(2, 0, 3, 0, replaced=1)
    expected = {name_of(unit, settings.digest, False) for unit in (first, second)}
    assert set(names(out)) == expected
    # and where it cannot be opened again, what was made of it stays
    listed = Shards(out)
    assert listed.remove_stale(unopened, settings.digest) == 0
    assert listed.there(unopened, settings.digest) in expected
    # but a part of it is not the whole
    for unit in (first, second):
        part = tmp_path / f"{unit.start}"
        shutil.copytree(out, part)
        (part / name_of(unit, settings.digest, False)).unlink()
        assert Shards(part).there(unopened, settings.digest) is None


def test_what_was_made_of_a_recording_that_cannot_be_read_now_stays(recordings, tmp_path):
    folder, out = tmp_path / "in", tmp_path / "out"
    folder.mkdir()
    for name in ("a.npz", "b.npz"):
        shutil.copy(recordings / "0" / "00.npz", folder / name)
    assert run(folder, out, SETTINGS, root=folder, workers=1) == Done(2, 0, 2, 0)
    before = names(out)
    (folder / "a.npz").unlink()
    (folder / "a.npz").symlink_to("a.npz")
    assert run(folder, out, SETTINGS, root=folder, workers=1, retry_errors=True) == Done(0, 1, kept=1)
    assert names(out) == before
    # also if another run made it since this one looked
    (unread, _) = find([folder], SETTINGS, folder)
    assert (unread.digest, Work(SETTINGS, str(out))(unread)) == (None, Written(0, 0))
    # with nothing to keep it has a row that says why
    (other, _) = find([folder], SETTINGS, tmp_path)
    assert Work(SETTINGS, str(out))(other) == Written(1, 1)
    said = [row for row in load(out, ["recording", "error"]).to_pylist() if row["error"]]
    assert [one["recording"] for one in said] == ["in/a.npz"]
    assert said[0]["error"].startswith("OSError: ")
    # and that goes when it is there beside rows
    shutil.copy(out / name_of(other, SETTINGS.digest, True), out / name_of(unread, SETTINGS.digest, True))
    assert run(folder, out, SETTINGS, root=folder) == Done(0, 1, kept=1, replaced=1)
    assert name_of(unread, SETTINGS.digest, True) not in names(out)


@pytest.fixture
def closed(monkeypatch):
    """Close folders, also for those who may read all."""
    scandir, folders = os.scandir, set()

    def refused(path="."):
        if str(path) in folders:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), path)
        return scandir(path)

    monkeypatch.setattr(os, "scandir", refused)
    return folders


def test_folders_that_cannot_be_searched_now_lose_nothing_and_leave_nothing(recordings, tmp_path, closed):
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
        rows = load(out, ["recording", "frame", "error"]).to_pylist()
        return done, [(row["recording"], row["frame"], bool(row["error"])) for row in rows]

    whole = [("depth", 0, False), ("depth", 1, True), ("sub/inner/b.npz", 0, False)]
    assert made() == (Done(2, 0, 3, 1), whole)
    closed |= {str(images), str(folder / "sub")}
    assert made() == (Done(1, 0, 1, 1, kept=1), [*whole[:2], ("sub", None, True), whole[2]])
    closed.clear()
    assert made() == (Done(0, 2, replaced=1), whole)


def test_a_folder_of_shards_that_is_complete_may_be_read_only(recordings, tmp_path, monkeypatch):
    run(recordings / "0", tmp_path, SETTINGS, root=recordings, workers=1)
    count = len(names(tmp_path))
    (tmp_path / ".strand-old.tmp").touch()
    os.utime(tmp_path / ".strand-old.tmp", (0, 0))

    def refused(*_):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr(shards, "write_json", refused)
    monkeypatch.setattr(Path, "unlink", refused)
    moved = tmp_path / "moved"
    shutil.copytree(recordings, moved)
    assert run(moved / "0", tmp_path, SETTINGS, root=moved) == Done(0, count)


def test_a_second_run_names_recordings_as_the_first_wherever_it_is_run(recordings, tmp_path, monkeypatch):
    folder, out = tmp_path / "in", tmp_path / "out"
    shutil.copytree(recordings / "0", folder / "0")
    count = len(list((folder / "0").iterdir()))
    monkeypatch.chdir(folder)
    assert run("0", out, SETTINGS, workers=1).made == count
    monkeypatch.chdir(tmp_path)
    assert run(folder, out, SETTINGS, workers=1) == Done(0, count)
    monkeypatch.chdir(recordings)
    folder.rename(tmp_path / "moved")
    with pytest.raises(ValueError, match=f"root: {out} names recordings below {folder}, which is no folder"):
        run(tmp_path / "moved", out, SETTINGS)
    for _ in range(2):
        assert run(tmp_path / "moved", out, SETTINGS, root=tmp_path / "moved") == Done(0, count)
    assert run(tmp_path / "moved", out, SETTINGS) == Done(0, count)
    (out / "_root.json").write_text("{}")
    with pytest.raises(strand.FileFormatError, match=r"_root\.json: expected the path of a folder"):
        run(tmp_path / "moved", out, SETTINGS)
    (out / "_root.json").write_text("{")
    assert run(tmp_path / "moved", out, SETTINGS, root=tmp_path / "moved") == Done(0, count)
    assert run(tmp_path / "moved", out, SETTINGS) == Done(0, count)


def test_other_files_below_the_shards_are_passed_over(recordings, tmp_path):
    assert run(recordings / "0" / "00.npz", tmp_path, SETTINGS, workers=1) == Done(1, 0, 1, 0)
    (name,) = names(tmp_path)
    (tmp_path / name).with_name("whole.parquet").write_bytes(b"another")
    old = tmp_path / ".strand-left.tmp"
    old.touch()
    os.utime(old, (0, 0))
    assert run(recordings / "0" / "00.npz", tmp_path, SETTINGS, workers=1) == Done(0, 1, 0, 0)
    assert (len(load(tmp_path)), old.exists()) == (1, False)


DRIVER = """
import os
import sys
import time
from shared.batch_recordings import SETTINGS
from strand.batch import run


def fork(_):
    if not forks:
        forks.append(os.fork())
        if forks == [0]:
            # holds what the driver has open
            os.setpgid(0, 0)
            time.sleep(600)


if __name__ == "__main__":
    forks = []
    run(sys.argv[1], sys.argv[2], SETTINGS, root=sys.argv[1], workers=2, progress=fork)
"""


def children(parent):
    return [int(word) for word in Path(f"/proc/{parent}/task/{parent}/children").read_text().split()]


def until(true, seconds=60.0):
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.002)


def test_a_driver_that_is_killed_leaves_whole_shards_and_the_next_completes_them(
    recordings, expected, tmp_path
):
    out = tmp_path / "out"
    made_ready(out, SETTINGS, recordings)
    (tmp_path / "driver.py").write_text(DRIVER)
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, str(tmp_path / "driver.py"), str(recordings), str(out)]
    driver = subprocess.Popen(command, env=paths, stderr=subprocess.PIPE)
    until(lambda: len(names(out)) >= 3)
    started = children(driver.pid)
    workers = [one for one in started if b"spawn_main" in Path(f"/proc/{one}/cmdline").read_bytes()]
    (forked,) = (one for one in started if os.getpgid(one) == one)
    assert len(workers) >= 2
    driver.kill()
    driver.wait()
    # whoever worked for it ends what it has, and then itself, though what it forked lives on
    try:
        until(lambda: not any(Path(f"/proc/{one}").exists() for one in workers))
    finally:
        os.kill(forked, signal.SIGKILL)
        driver.communicate()
    before = find_shards(out)
    assert 3 <= len(before) < COUNT
    assert again(recordings, out) == Done(COUNT - len(before), len(before), COUNT - len(before), 0)
    assert read_table(out).equals(expected)
    assert len(names(out)) == COUNT


def test_a_worker_that_is_killed_is_replaced_and_its_unit_made(recordings, expected, tmp_path):
    killed = []

    def kill(done):
        if done.made in (2, 5):
            for one in multiprocessing.active_children()[: done.made - 1]:
                os.kill(one.pid, signal.SIGKILL)
                killed.append(one.pid)

    done = run(recordings, tmp_path, SETTINGS, root=recordings, workers=2, progress=kill)
    assert len(killed) == 3
    assert done == Done(COUNT, 0, COUNT, 0)
    assert read_table(tmp_path).equals(expected)
    assert not multiprocessing.active_children()


@pytest.fixture
def killed_at_start(monkeypatch):
    """Have the first processes killed before they are ready, so many as are asked for."""
    started = local._started

    def kill(most):
        pids = []

        def start(*arguments):
            one = started(*arguments)
            if len(pids) < most:
                pids.append(one.process.pid)
                one.process.kill()
            return one

        monkeypatch.setattr(local, "_started", start)
        return pids

    return kill


def test_workers_that_are_killed_while_they_start_are_replaced(recordings, killed_at_start):
    units = list(find([recordings], SETTINGS, recordings))[:3]
    pids = killed_at_start(TRIES)
    answers = list(local.each(interrupt, iter(units), workers=2, threads=1))
    assert len(pids) == TRIES
    # none of these deaths is a unit's
    assert sorted(unit.recording for unit, written in answers if written) == [one.recording for one in units]


def test_processes_that_are_always_killed_are_not_started_for_ever(recordings, killed_at_start):
    pids = killed_at_start(99)
    with pytest.raises(EngineError, match=r"processes do not start \(exit code -9\)$"):
        next(local.each(interrupt, find([recordings], SETTINGS, recordings), workers=2, threads=1))
    assert TRIES * 2 <= len(pids) < TRIES * 2 + 2
    assert not multiprocessing.active_children()


def test_where_no_process_can_be_started_is_said_before_one_is(recordings, monkeypatch):
    def begin():
        next(local.each(interrupt, find([recordings], SETTINGS, recordings), workers=1, threads=1))

    monkeypatch.setitem(multiprocessing.current_process()._config, "daemon", True)
    with pytest.raises(EngineError, match=r"of a multiprocessing.Pool .* may start none"):
        begin()
    monkeypatch.undo()
    piped = types.ModuleType("__main__")
    piped.__file__ = "<stdin>"
    monkeypatch.setitem(sys.modules, "__main__", piped)
    with pytest.raises(EngineError, match="there is none at <stdin>; save the program"):
        begin()


def test_a_unit_that_ends_every_process_is_given_up_and_others_are_not(recordings, tmp_path):
    out, notes = tmp_path / "out", tmp_path / "notes"
    notes.mkdir()
    made_ready(out, SETTINGS, recordings)
    units = list(find([recordings], SETTINGS, recordings))
    bad, bad_once = units[1].recording, units[4].recording
    work = Work(SETTINGS, str(out))
    deadly = Deadly(Deadly(work, (bad_once,), 1, str(notes)), (bad,), 99, str(notes))
    answers = dict(local.each(deadly, iter(units), workers=2, threads=1))
    assert [unit.recording for unit, written in answers.items() if written is None] == [bad]
    assert len(answers) == len(units)
    assert (notes / bad.replace("/", "-")).read_bytes() == b"x" * TRIES
    work.give_up(next(unit for unit in units if unit.recording == bad), "WorkerDied: here")
    rows = load(out, ["recording", "error"]).to_pylist()
    assert [row for row in rows if row["error"]] == [{"recording": bad, "error": "WorkerDied: here"}]
    assert len(rows) == COUNT


def mounted(folder, size):
    """Whether a small disk can be mounted there: that takes rights that not everyone has."""
    folder.mkdir(exist_ok=True)
    words = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)]
    return subprocess.run(words, capture_output=True).returncode == 0


@pytest.fixture
def disk(tmp_path):
    """A folder, and whether it is a disk of its own that holds few shards."""
    folder = tmp_path / "disk"
    own = mounted(folder, "256k")
    yield folder, own
    if own:
        subprocess.run(["umount", str(folder)], check=True)


def test_a_disk_that_fills_up_stops_the_run_and_leaves_whole_shards(recordings, expected, disk):
    out, own = disk
    if own:
        with pytest.raises(OSError, match="No space left") as raised:
            run(recordings, out, SETTINGS, root=recordings, workers=2)
    else:
        made_ready(out, SETTINGS, recordings)
        full = FullDisk(Work(SETTINGS, str(out)), 5)
        with pytest.raises(OSError, match="No space left") as raised:
            list(local.each(full, find([recordings], SETTINGS, recordings), 2, 1))
    assert raised.value.errno == errno.ENOSPC
    before = find_shards(out)
    assert 0 < len(before) < COUNT
    assert not list(out.glob("*/.strand-*.tmp"))
    if own:
        subprocess.run(["mount", "-o", "remount,size=16m", str(out)], check=True)
    assert again(recordings, out) == Done(COUNT - len(before), len(before), COUNT - len(before), 0)
    assert read_table(out).equals(expected)


def test_what_is_half_written_is_no_shard_and_goes_when_it_is_old(recordings, tmp_path):
    assert run(recordings / "0" / "00.npz", tmp_path, SETTINGS, workers=1) == Done(1, 0, 1, 0)
    (name,) = names(tmp_path)
    old, new = ((tmp_path / name).with_name(f".strand-{k}.tmp") for k in "01")
    for half in (old, new):
        half.write_bytes(b"half")
    os.utime(old, (0, 0))
    assert run(recordings / "0" / "00.npz", tmp_path, SETTINGS, workers=1) == Done(0, 1, 0, 0)
    assert (old.exists(), new.exists(), len(load(tmp_path))) == (False, True, 1)


def test_workers_are_deaf_to_interrupts(recordings):
    units = list(find([recordings], SETTINGS, recordings))[:2]
    assert len(list(local.each(interrupt, iter(units), 1, 1))) == 2


def test_workers_never_need_more_cores_than_there_are(recordings, tmp_path):
    with pytest.raises(ValueError, match="cores, and there are"):
        run(recordings, tmp_path, workers=cores() + 1)
    with pytest.raises(ValueError, match="cores, and there are"):
        run(recordings, tmp_path, workers=2, threads=cores())
    with pytest.raises(ValueError, match=f"threads: expected at most {cores()}, .* got {cores() + 1}"):
        run(recordings, tmp_path, threads=cores() + 1)
    before = strand.num_threads(), dict(os.environ)
    assert run(recordings / "0" / "00.npz", tmp_path, SETTINGS, threads=cores()).made == 1
    assert (strand.num_threads(), dict(os.environ)) == before


def test_two_batches_do_not_mix_up_their_environments():
    before, seen = dict(os.environ), []

    def another():
        with local._threads_of_libraries(3):
            seen.append(os.environ["OMP_NUM_THREADS"])

    other = threading.Thread(target=another)
    with local._threads_of_libraries(2):
        other.start()
        other.join(0.2)
        assert (seen, os.environ["OMP_NUM_THREADS"]) == ([], "2")
    other.join(60)
    assert (seen, dict(os.environ)) == (["3"], before)


def test_cores_are_those_that_the_process_may_use():
    script = "import os; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))}); "
    script += "import strand._core; print(strand._core.cores())"
    found = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert (found.stdout, 1 <= cores() <= len(os.sched_getaffinity(0))) == ("1\n", True)


def test_a_worker_of_another_version_is_refused(recordings, tmp_path):
    made_ready(tmp_path, SETTINGS, recordings)
    other = Work(SETTINGS, str(tmp_path), version="0.0.1")
    with pytest.raises(EngineError, match=f"version {strand.__version__} here, and 0.0.1 where"):
        list(local.each(other, find([recordings], SETTINGS, recordings), 1, 1))
    assert not names(tmp_path)


@pytest.mark.parametrize(
    ("wrong", "error", "said"),
    [
        ({"engine": "dask"}, ValueError, "engine: expected one of local, ray"),
        ({"address": "127.0.0.1:1"}, ValueError, "address: only Ray has one"),
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
        ({"progress": 5}, TypeError, "progress: expected something to call, got int"),
    ],
)
def test_arguments_are_checked_before_the_work(recordings, tmp_path, wrong, error, said):
    with pytest.raises(error, match=said):
        run(**{"recordings": recordings, "out": tmp_path / "out", **wrong})
    assert not (tmp_path / "out").exists()


def test_a_script_without_a_guard_is_told_of_it(recordings, tmp_path):
    (tmp_path / "script.py").write_text(
        f"from strand.batch import run\nrun({str(recordings)!r}, {str(tmp_path / 'out')!r}, workers=1)\n"
    )
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, str(tmp_path / "script.py")]
    done = subprocess.run(command, env=paths, capture_output=True, text=True, timeout=60)
    assert 'below if __name__ == "__main__":' in done.stderr
    assert done.returncode == 1
    assert not names(tmp_path / "out")


def test_pyarrow_is_asked_for_where_it_is_missing(recordings, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(ImportError, match=r'pyarrow is needed here: pip install "[\w.-]+\[batch\]"'):
        run(recordings, tmp_path / "out")
    assert not (tmp_path / "out").exists()
