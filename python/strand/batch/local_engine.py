"""The local engine: processes of this machine, one unit at a time each.

The standard library's `ProcessPoolExecutor` does not fit. It breaks as a whole when one process dies, does
not say on which unit, and its processes outlive a killed driver. With one pipe per worker, a closed pipe
tells us who died, and on which unit. It also tells a worker that its driver has died.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any

from strand._core import set_num_threads
from strand.batch.engines import MAX_ATTEMPTS, EngineError, set_environment
from strand.batch.units import Unit
from strand.batch.work import ShardCounts, is_orphaned

_ERROR_EXIT_CODE = 1  # exit code of a process that raised an error; a killed process has another
_POLL_PERIOD = 5.0  # seconds: an idle worker checks this often whether its driver lives

_THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
_ENVIRONMENT_LOCK = threading.Lock()


@dataclass(eq=False)
class _Worker:
    """A process with its pipe, its unit, and the number of processes that died on that unit before."""

    process: BaseProcess
    pipe: Connection
    ready: bool = False
    unit: Unit | None = None
    deaths: int = 0


def run_units(
    work: Callable[[Unit], ShardCounts], units: Iterator[Unit], workers: int, threads: int
) -> Iterator[tuple[Unit, ShardCounts | None]]:
    """Work on units in processes; take a unit only when a process is free for it.

    Parameters
    ----------
    work : callable
        The work on a unit; it can be pickled.
    units : iterator of Unit
    workers : int
        Number of processes.
    threads : int
        Number of threads of each process.

    Yields
    ------
    unit : Unit
        In the order in which the units end.
    counts : ShardCounts or None
        The result of the work; None if `MAX_ATTEMPTS` processes died on the unit.

    Raises
    ------
    EngineError
        If processes do not start.
    Exception
        The work's own error; the engine then ends all other work.
    """
    _check_can_start()
    team: dict[Any, _Worker] = {}
    any_started, failed_starts = False, 0
    retries: deque[tuple[Unit, int]] = deque()
    try:
        while True:
            idle = [worker for worker in team.values() if worker.ready and worker.unit is None]
            while len(idle) or len(team) < workers:
                unit, deaths = retries.popleft() if retries else (next(units, None), 0)
                if unit is None:
                    break
                worker = idle.pop() if idle else _start_worker(work, threads, team)
                worker.unit, worker.deaths = unit, deaths
                if worker.ready:
                    _send_unit(worker)
            busy = [worker.pipe for worker in team.values() if worker.unit is not None]
            if not busy:
                return
            for pipe in wait(busy):
                worker = team[pipe]
                try:
                    answer = worker.pipe.recv()
                except (EOFError, OSError):
                    code = _remove_worker(worker, team)
                    unit, deaths = worker.unit, worker.deaths
                    if worker.ready:
                        deaths += 1
                    else:
                        # it died before it got its unit
                        failed_starts += 1
                        if failed_starts == MAX_ATTEMPTS * workers or (
                            code == _ERROR_EXIT_CODE and not any_started
                        ):
                            raise _make_start_error(code) from None
                    if unit is not None and deaths < MAX_ATTEMPTS:
                        retries.append((unit, deaths))
                    elif unit is not None:
                        yield unit, None
                    continue
                if not worker.ready:
                    worker.ready = any_started = True
                    failed_starts = 0
                    _send_unit(worker)
                    continue
                if isinstance(answer, BaseException):
                    raise answer
                unit, worker.unit = worker.unit, None
                if unit is not None:
                    yield unit, answer
    finally:
        for worker in list(team.values()):
            worker.process.kill()
            _remove_worker(worker, team)


def _check_can_start() -> None:
    """Raise an error where no process can start; multiprocessing's own error would not say why."""
    if multiprocessing.current_process().daemon:
        raise EngineError(
            "processes do not start: a daemonic process, such as a worker of a multiprocessing.Pool, cannot "
            "start others; run the batch in its parent process"
        )
    main = sys.modules["__main__"]
    file = getattr(main, "__file__", None)
    if getattr(main, "__spec__", None) is None and file is not None and not os.path.exists(file):
        raise EngineError(
            f"processes do not start: they import the program's file, and {file} does not exist; "
            "save the program in a file"
        )


def _make_start_error(code: int | None) -> EngineError:
    message = f"processes do not start (exit code {code})"
    if code == _ERROR_EXIT_CODE:
        message += '; in a script, call this below if __name__ == "__main__":'
    return EngineError(message)


def _start_worker(work: Callable[[Unit], ShardCounts], threads: int, team: dict[Any, _Worker]) -> _Worker:
    # a forked process would inherit the locks that other threads of the host hold
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_run_worker, args=(theirs, work, threads), daemon=True)
    with _limit_library_threads(threads), _block_interrupts():
        process.start()
    theirs.close()
    team[ours] = worker = _Worker(process, ours)
    return worker


def _send_unit(worker: _Worker) -> None:
    # if the worker has died, waiting for its answer finds out
    with suppress(OSError):
        worker.pipe.send(worker.unit)


def _remove_worker(worker: _Worker, team: dict[Any, _Worker]) -> int | None:
    """Remove a worker whose process has ended, and return its exit code."""
    del team[worker.pipe]
    worker.pipe.close()
    worker.process.join()
    return worker.process.exitcode


@contextmanager
def _limit_library_threads(threads: int) -> Iterator[None]:
    """Limit the threads for linear algebra in processes that start; libraries read this at their import."""
    # all batches of this process share one environment
    with _ENVIRONMENT_LOCK, set_environment(dict.fromkeys(_THREAD_VARIABLES, str(threads))):
        yield


@contextmanager
def _block_interrupts() -> Iterator[None]:
    """Block Ctrl-C in processes that start, from their first moment; the driver ends them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    # multiprocessing starts it with the first process, which would unblock the signal
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _run_worker(pipe: Connection, work: Callable[[Unit], ShardCounts], threads: int) -> None:
    """Work on units until the driver ends; this runs in the worker's process."""
    set_num_threads(threads)
    with suppress(EOFError, BrokenPipeError):
        pipe.send(None)
        while True:
            # a process that the driver forked may keep the pipe open after the driver's end
            while not pipe.poll(_POLL_PERIOD):
                if is_orphaned():
                    return
            unit = pipe.recv()
            try:
                answer: Any = work(unit)
            except Exception as error:
                answer = error
            pipe.send(answer)
