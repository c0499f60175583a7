"""The Ray engine: one task per unit, on one machine or on many."""

from __future__ import annotations

import logging
import math
import os
import secrets
import shutil
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from typing import Any

from strand._core import set_num_threads
from strand.batch.engines import MAX_ATTEMPTS, EngineError, set_environment
from strand.batch.units import Unit
from strand.batch.work import ShardCounts
from strand.support.extras import import_extra

AHEAD = 2
"""Number of submitted tasks per task that can run, so that no worker waits for the driver."""

_GROWTH_PERIOD = 2.0  # seconds between two looks at the cluster's size; a look takes as long as a task
_ANSWER_TIMEOUT = 10.0  # seconds in which a living cluster answers; Ray itself would try for minutes
_TOKEN_VARIABLES = ("RAY_AUTH_MODE", "RAY_AUTH_TOKEN", "RAY_AUTH_TOKEN_PATH")  # who may connect to Ray


def run_units(
    work: Callable[[Unit], ShardCounts],
    units: Iterator[Unit],
    workers: int,
    threads: int,
    address: str | None = None,
) -> Iterator[tuple[Unit, ShardCounts | None]]:
    """Work on units in tasks of Ray; a task takes one of Ray's CPUs per thread.

    Parameters
    ----------
    work : callable
        The work on a unit; it can be pickled.
    units : iterator of Unit
    workers : int
        Number of simultaneous tasks without an address. The function then starts Ray on the loopback
        address, with its own token, without dashboard and usage statistics, and stops it at the end.
    threads : int
        Number of threads of each task.
    address : str, optional
        Address of a cluster, such as "10.0.0.1:6379" or "auto". The cluster's CPUs limit the number of
        tasks, also while it grows. If the caller has connected to a Ray, the function uses that one.

    Yields
    ------
    unit : Unit
        In the order in which the units end.
    counts : ShardCounts or None
        The result of the work; None if the task's process died `MAX_ATTEMPTS` times.

    Raises
    ------
    ImportError
        If ray is not installed.
    ValueError
        If no machine of the cluster has a CPU for each thread of a task.
    ConnectionError
        If no cluster answers at the address.
    EngineError
        If Ray fails.
    Exception
        The work's own error; the engine then ends all other work.
    """
    ray = import_extra("ray")
    connected = nullcontext() if ray.is_initialized() else _hold_connection(ray, workers * threads, address)
    with connected:
        yield from _run_tasks(ray, work, units, threads)


def _run_tasks(
    ray: Any, work: Callable[[Unit], ShardCounts], units: Iterator[Unit], threads: int
) -> Iterator[tuple[Unit, ShardCounts | None]]:
    pending: dict[Any, Unit] = {}
    try:
        task = ray.remote(num_cpus=threads, max_retries=MAX_ATTEMPTS - 1)(_run_task)
        shared_work = ray.put(work)
        max_pending, last_look = 0, -math.inf
        while True:
            if time.monotonic() - last_look > _GROWTH_PERIOD:
                max_pending, last_look = AHEAD * _count_tasks(ray.nodes(), threads), time.monotonic()
            while len(pending) < max_pending and (unit := next(units, None)) is not None:
                pending[task.remote(shared_work, threads, unit)] = unit
            if not pending:
                return
            ended, _ = ray.wait(list(pending), num_returns=1)
            for reference in ended:
                yield pending.pop(reference), _get_counts(ray, reference)
    except ray.exceptions.RayError as error:
        raise EngineError(f"Ray: {error}") from error
    finally:
        for reference in pending:
            ray.cancel(reference, force=True)


def _get_counts(ray: Any, reference: Any) -> ShardCounts | None:
    """Return the result of a task; None if every process or machine that worked on it died."""
    errors = ray.exceptions
    try:
        counts: ShardCounts = ray.get(reference)
    except errors.RayTaskError as error:
        raise error.cause from error
    except (errors.WorkerCrashedError, errors.OutOfMemoryError, errors.NodeDiedError, errors.ObjectLostError):
        return None
    return counts


@contextmanager
def _hold_connection(ray: Any, cpus: int, address: str | None) -> Iterator[None]:
    """Connect to a cluster or start one; at the end remove its folder, unless an error needs its logs."""
    with nullcontext() if address is not None else _use_private_settings(ray):
        try:
            session = _connect(ray, cpus, address)
        except RuntimeError as error:
            # for example, the cluster has another version of Ray or Python
            raise EngineError(f"Ray: {error}") from error
        try:
            yield
        except EngineError:
            session = None
            raise
        finally:
            ray.shutdown()
            if session is not None:
                shutil.rmtree(session, ignore_errors=True)


def _connect(ray: Any, cpus: int, address: str | None) -> str | None:
    """Connect to a cluster, or start one on this machine and return the folder that it made."""
    if address is not None:
        _check_answers(address)
        ray.init(address=address, log_to_driver=False, logging_level=logging.WARNING)
        return None
    with _listen_on_loopback(ray):
        context = ray.init(
            address="local",
            num_cpus=cpus,
            include_dashboard=False,
            log_to_driver=False,
            # at the level WARNING, it warns of its token at each start
            logging_level=logging.ERROR,
            _node_ip_address="127.0.0.1",
        )
    session: str = context.address_info["session_dir"]
    return session


@contextmanager
def _use_private_settings(ray: Any) -> Iterator[None]:
    """Make Ray send no statistics, and use a secret token; Ray itself would leave a token in a file."""
    variables = {"RAY_USAGE_STATS_ENABLED": "0"}
    if not any(name in os.environ for name in _TOKEN_VARIABLES):
        variables |= {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": secrets.token_hex(32)}
    try:
        with set_environment({name: value for name, value in variables.items() if name not in os.environ}):
            _reload_settings(ray)
            yield
    finally:
        _reload_settings(ray)


def _reload_settings(ray: Any) -> None:
    """Make Ray read the environment again, first its settings, then its token; it read it at its import."""
    ray._raylet.Config.initialize("")
    ray._raylet.AuthenticationTokenLoader.instance().reset_cache()


@contextmanager
def _listen_on_loopback(ray: Any) -> Iterator[None]:
    """Make Ray listen on 127.0.0.1; on Linux it would replace that by the machine's network address."""
    constants = ray._private.ray_constants
    before = constants.ENABLE_RAY_CLUSTER
    constants.ENABLE_RAY_CLUSTER = False
    try:
        yield
    finally:
        constants.ENABLE_RAY_CLUSTER = before


def _check_answers(address: str) -> None:
    """Raise an error if nobody listens at an address; skip addresses without a port, such as "auto"."""
    host, _, port = address.rpartition("://")[2].rpartition(":")
    if not port.isdecimal():
        return
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=_ANSWER_TIMEOUT).close()
    except (OSError, OverflowError) as error:
        raise ConnectionError(f"address: no cluster of Ray answers at {address} ({error})") from error


def _count_tasks(nodes: Sequence[dict[str, Any]], threads: int) -> int:
    """Return the number of tasks that can run at once; one machine has all CPUs of a task."""
    cpus = [int(node["Resources"].get("CPU", 0)) for node in nodes if node["Alive"]]
    tasks = sum(count // threads for count in cpus)
    if not tasks:
        raise ValueError(
            f"threads: expected at most {max(cpus, default=0)}, the most CPUs that Ray has on one machine, "
            f"got {threads}"
        )
    return tasks


def _run_task(work: Callable[[Unit], ShardCounts], threads: int, unit: Unit) -> ShardCounts:
    set_num_threads(threads)
    return work(unit)
