"""The local engine: processes of this machine, each with so many threads and one unit at a time.

The standard library's pool breaks as a whole when one of its processes dies, does not say on what it worked,
and its processes outlive a driver that was killed. Here each process has a pipe of its own. When that closes,
the driver knows which process died, and of which unit; or the process knows that nobody waits any more.
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
from strand.batch.engines import TRIES, EngineError, environment
from strand.batch.shards import Written, orphaned
from strand.batch.units import Unit

# exit code of a process in which an error was raised; those that were killed have others
_RAISED = 1

_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
_ENVIRONMENT = threading.Lock()

# seconds after which a process without work looks whether the driver is there
_LOOKS = 5.0


@dataclass(eq=False)
class _Worker:
    """A process, its pipe, and the unit that it has, with how many processes died of that before."""

    process: BaseProcess
    pipe: Connection
    ready: bool = False
    unit: Unit | None = None
    deaths: int = 0


def each(
    work: Callable[[Unit], Written], units: Iterator[Unit], workers: int, threads: int
) -> Iterator[tuple[Unit, Written | None]]:
    """Work on units in processes; no more units are taken than there are processes for.

    Parameters
    ----------
    work : callable
        What is done with a unit; it can be pickled.
    units : iterator of Unit
    workers : int
        How many processes.
    threads : int
        How many threads each has.

    Yields
    ------
    unit : Unit
        In the order in which they end.
    written : Written or None
        What the work returned; None if the process died of it, `TRIES` times.

    Raises
    ------
    EngineError
        If processes do not start.
    Exception
        What the work raises; other work is ended.
    """
    _require_starts()
    team: dict[Any, _Worker] = {}
    begun, unborn = False, 0
    again: deque[tuple[Unit, int]] = deque()
    try:
        while True:
            idle = [one for one in team.values() if one.ready and one.unit is None]
            while len(idle) or len(team) < workers:
                unit, deaths = again.popleft() if again else (next(units, None), 0)
                if unit is None:
                    break
                one = idle.pop() if idle else _started(work, threads, team)
                one.unit, one.deaths = unit, deaths
                if one.ready:
                    _give(one)
            busy = [one.pipe for one in team.values() if one.unit is not None]
            if not busy:
                return
            for pipe in wait(busy):
                one = team[pipe]
                try:
                    answer = one.pipe.recv()
                except (EOFError, OSError):
                    code = _buried(one, team)
                    unit, deaths = one.unit, one.deaths
                    if one.ready:
                        deaths += 1
                    else:
                        # whatever ended it, its unit did not
                        unborn += 1
                        if unborn == TRIES * workers or (code == _RAISED and not begun):
                            raise _not_started(code) from None
                    if unit is not None and deaths < TRIES:
                        again.append((unit, deaths))
                    elif unit is not None:
                        yield unit, None
                    continue
                if not one.ready:
                    one.ready = begun = True
                    unborn = 0
                    _give(one)
                    continue
                if isinstance(answer, BaseException):
                    raise answer
                unit, one.unit = one.unit, None
                if unit is not None:
                    yield unit, answer
    finally:
        for one in list(team.values()):
            one.process.kill()
            _buried(one, team)


def _require_starts() -> None:
    """Refuse where no process can be started: multiprocessing says it in other words, or in the process."""
    if multiprocessing.current_process().daemon:
        raise EngineError(
            "processes do not start: those of a multiprocessing.Pool and other daemonic ones may start none; "
            "run the batch in the process that made them"
        )
    main = sys.modules["__main__"]
    file = getattr(main, "__file__", None)
    if getattr(main, "__spec__", None) is None and file is not None and not os.path.exists(file):
        raise EngineError(
            f"processes do not start: they import the program's file, and there is none at {file}; "
            "save the program in a file"
        )


def _not_started(code: int | None) -> EngineError:
    said = f"processes do not start (exit code {code})"
    if code == _RAISED:
        said += '; a script calls this below if __name__ == "__main__":'
    return EngineError(said)


def _started(work: Callable[[Unit], Written], threads: int, team: dict[Any, _Worker]) -> _Worker:
    # spawned, not forked: a fork has whatever locks other threads of the host hold
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_work, args=(theirs, work, threads), daemon=True)
    with _threads_of_libraries(threads), _deaf_to_interrupts():
        process.start()
    theirs.close()
    team[ours] = one = _Worker(process, ours)
    return one


def _give(one: _Worker) -> None:
    # that it has died is seen when its answer is waited for
    with suppress(OSError):
        one.pipe.send(one.unit)


def _buried(one: _Worker, team: dict[Any, _Worker]) -> int | None:
    """Forget a process that has ended, and return its exit code."""
    del team[one.pipe]
    one.pipe.close()
    one.process.join()
    return one.process.exitcode


@contextmanager
def _threads_of_libraries(threads: int) -> Iterator[None]:
    """Let processes that start have no more threads for linear algebra: these are counted on import only."""
    # other batches may start processes from other threads, and all have one environment
    with _ENVIRONMENT, environment(dict.fromkeys(_VARIABLES, str(threads))):
        yield


@contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """Let processes that start know nothing of Ctrl-C, as early as that: it is the driver that ends them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    # multiprocessing starts it with its first process, and would listen again
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _work(pipe: Connection, work: Callable[[Unit], Written], threads: int) -> None:
    """Work until nobody waits any more: in the process."""
    set_num_threads(threads)
    with suppress(EOFError, BrokenPipeError):
        pipe.send(None)
        while True:
            # the pipe stays open as long as a process lives that the driver forked
            while not pipe.poll(_LOOKS):
                if orphaned():
                    return
            unit = pipe.recv()
            try:
                answer: Any = work(unit)
            except Exception as error:
                answer = error
            pipe.send(answer)
