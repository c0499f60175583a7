"""The local engine: killed drivers and workers, full disks, threads, scripts."""

from __future__ import annotations

import errno
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
import types
from pathlib import Path

import pytest

import strand
from shared.batch_recordings import (
    COUNT,
    SETTINGS,
    Deadly,
    FullDisk,
    find_shards,
    interrupt,
    read_table,
)
from strand._core import count_cores
from strand.batch import Counts, EngineError, find_units, load_table, local_engine, run
from strand.batch.engines import MAX_ATTEMPTS
from strand.batch.shards import list_shards, prepare_folder
from strand.batch.work import Work


def again(recordings, out):
    """Run the batch again, and return its counts."""
    return run(recordings, out, SETTINGS, root=recordings, workers=1)


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
            # this process keeps the driver's pipes open
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


def test_a_killed_driver_leaves_whole_shards_and_the_next_run_completes_them(recordings, expected, tmp_path):
    out = tmp_path / "out"
    prepare_folder(out, SETTINGS, recordings)
    (tmp_path / "driver.py").write_text(DRIVER)
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, str(tmp_path / "driver.py"), str(recordings), str(out)]
    driver = subprocess.Popen(command, env=paths, stderr=subprocess.PIPE)
    until(lambda: len(list_shards(out)) >= 3)
    started = children(driver.pid)
    workers = [one for one in started if b"spawn_main" in Path(f"/proc/{one}/cmdline").read_bytes()]
    (forked,) = (one for one in started if os.getpgid(one) == one)
    assert len(workers) >= 2
    driver.kill()
    driver.wait()
    # the workers finish their units and end, although the forked process lives on
    try:
        until(lambda: not any(Path(f"/proc/{one}").exists() for one in workers))
    finally:
        os.kill(forked, signal.SIGKILL)
        driver.communicate()
    before = find_shards(out)
    assert 3 <= len(before) < COUNT
    assert again(recordings, out) == Counts(COUNT - len(before), len(before), COUNT - len(before), 0)
    assert read_table(out).equals(expected)
    assert len(list_shards(out)) == COUNT


def test_a_killed_worker_is_replaced_and_its_unit_made(recordings, expected, tmp_path):
    killed = []

    def kill(done):
        if done.made in (2, 5):
            for one in multiprocessing.active_children()[: done.made - 1]:
                os.kill(one.pid, signal.SIGKILL)
                killed.append(one.pid)

    done = run(recordings, tmp_path, SETTINGS, root=recordings, workers=2, progress=kill)
    assert len(killed) == 3
    assert done == Counts(COUNT, 0, COUNT, 0)
    assert read_table(tmp_path).equals(expected)
    assert not multiprocessing.active_children()


@pytest.fixture
def killed_at_start(monkeypatch):
    """Return a function that makes the first `most` processes die before they are ready."""
    started = local_engine._start_worker

    def kill(most):
        pids = []

        def start(*arguments):
            one = started(*arguments)
            if len(pids) < most:
                pids.append(one.process.pid)
                one.process.kill()
            return one

        monkeypatch.setattr(local_engine, "_start_worker", start)
        return pids

    return kill


def test_workers_that_are_killed_while_they_start_are_replaced(recordings, killed_at_start):
    units = list(find_units([recordings], SETTINGS, recordings))[:3]
    pids = killed_at_start(MAX_ATTEMPTS)
    answers = list(local_engine.run_units(interrupt, iter(units), workers=2, threads=1))
    assert len(pids) == MAX_ATTEMPTS
    # these deaths do not count against a unit
    assert sorted(unit.recording for unit, written in answers if written) == [one.recording for one in units]


def test_failed_starts_end_with_an_error(recordings, killed_at_start):
    pids = killed_at_start(99)
    with pytest.raises(EngineError, match=r"processes do not start \(exit code -9\)$"):
        next(
            local_engine.run_units(
                interrupt, find_units([recordings], SETTINGS, recordings), workers=2, threads=1
            )
        )
    assert MAX_ATTEMPTS * 2 <= len(pids) < MAX_ATTEMPTS * 2 + 2
    assert not multiprocessing.active_children()


def test_processes_that_cannot_start_are_refused_early(recordings, monkeypatch):
    def begin():
        next(
            local_engine.run_units(
                interrupt, find_units([recordings], SETTINGS, recordings), workers=1, threads=1
            )
        )

    monkeypatch.setitem(multiprocessing.current_process()._config, "daemon", True)
    with pytest.raises(EngineError, match=r"of a multiprocessing.Pool, cannot start others"):
        begin()
    monkeypatch.undo()
    piped = types.ModuleType("__main__")
    piped.__file__ = "<stdin>"
    monkeypatch.setitem(sys.modules, "__main__", piped)
    with pytest.raises(EngineError, match="<stdin> does not exist; save the program"):
        begin()


def test_only_the_unit_that_kills_every_process_is_given_up(recordings, tmp_path):
    out, notes = tmp_path / "out", tmp_path / "notes"
    notes.mkdir()
    prepare_folder(out, SETTINGS, recordings)
    units = list(find_units([recordings], SETTINGS, recordings))
    bad, bad_once = units[1].recording, units[4].recording
    work = Work(SETTINGS, str(out))
    deadly = Deadly(Deadly(work, (bad_once,), 1, str(notes)), (bad,), 99, str(notes))
    answers = dict(local_engine.run_units(deadly, iter(units), workers=2, threads=1))
    assert [unit.recording for unit, written in answers.items() if written is None] == [bad]
    assert len(answers) == len(units)
    assert (notes / bad.replace("/", "-")).read_bytes() == b"x" * MAX_ATTEMPTS
    work.give_up(next(unit for unit in units if unit.recording == bad), "WorkerDied: here")
    rows = load_table(out, ["recording", "error"]).to_pylist()
    assert [row for row in rows if row["error"]] == [{"recording": bad, "error": "WorkerDied: here"}]
    assert len(rows) == COUNT


def mounted(folder, size):
    """Mount a small disk at a folder, and tell whether the user may do that."""
    folder.mkdir(exist_ok=True)
    words = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)]
    return subprocess.run(words, capture_output=True).returncode == 0


@pytest.fixture
def disk(tmp_path):
    """A folder, and whether it is a small disk of its own."""
    folder = tmp_path / "disk"
    own = mounted(folder, "256k")
    yield folder, own
    if own:
        subprocess.run(["umount", str(folder)], check=True)


def test_a_full_disk_stops_the_run_and_leaves_whole_shards(recordings, expected, disk):
    out, own = disk
    if own:
        with pytest.raises(OSError, match="No space left") as raised:
            run(recordings, out, SETTINGS, root=recordings, workers=2)
    else:
        prepare_folder(out, SETTINGS, recordings)
        full = FullDisk(Work(SETTINGS, str(out)), 5)
        with pytest.raises(OSError, match="No space left") as raised:
            list(local_engine.run_units(full, find_units([recordings], SETTINGS, recordings), 2, 1))
    assert raised.value.errno == errno.ENOSPC
    before = find_shards(out)
    assert 0 < len(before) < COUNT
    assert not list(out.glob("*/.strand-*.tmp"))
    if own:
        subprocess.run(["mount", "-o", "remount,size=16m", str(out)], check=True)
    assert again(recordings, out) == Counts(COUNT - len(before), len(before), COUNT - len(before), 0)
    assert read_table(out).equals(expected)


def test_workers_ignore_interrupts(recordings):
    units = list(find_units([recordings], SETTINGS, recordings))[:2]
    assert len(list(local_engine.run_units(interrupt, iter(units), 1, 1))) == 2


def test_two_batches_do_not_mix_up_their_environments():
    before, seen = dict(os.environ), []

    def another():
        with local_engine._limit_library_threads(3):
            seen.append(os.environ["OMP_NUM_THREADS"])

    other = threading.Thread(target=another)
    with local_engine._limit_library_threads(2):
        other.start()
        other.join(0.2)
        assert (seen, os.environ["OMP_NUM_THREADS"]) == ([], "2")
    other.join(60)
    assert (seen, dict(os.environ)) == (["3"], before)


def test_cores_are_those_that_the_process_may_use():
    script = "import os; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))}); "
    script += "import strand._core; print(strand._core.count_cores())"
    found = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert (found.stdout, 1 <= count_cores() <= len(os.sched_getaffinity(0))) == ("1\n", True)


def test_a_worker_of_another_version_is_refused(recordings, tmp_path):
    prepare_folder(tmp_path, SETTINGS, recordings)
    other = Work(SETTINGS, str(tmp_path), version="0.0.1")
    with pytest.raises(
        EngineError, match=f"version {strand.__version__} in a worker, and 0.0.1 in the driver"
    ):
        list(local_engine.run_units(other, find_units([recordings], SETTINGS, recordings), 1, 1))
    assert not list_shards(tmp_path)


def test_a_script_without_a_main_guard_gets_a_hint(recordings, tmp_path):
    (tmp_path / "script.py").write_text(
        f"from strand.batch import run\nrun({str(recordings)!r}, {str(tmp_path / 'out')!r}, workers=1)\n"
    )
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, str(tmp_path / "script.py")]
    done = subprocess.run(command, env=paths, capture_output=True, text=True, timeout=60)
    assert 'below if __name__ == "__main__":' in done.stderr
    assert done.returncode == 1
    assert not list_shards(tmp_path / "out")
