"""Ray as an engine: a task for each unit, on one machine or many."""

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
from strand.batch.engines import TRIES, EngineError, environment
from strand.batch.shards import Written
from strand.batch.units import Unit
from strand.support.extras import import_extra

AHEAD = 2
"""Tasks that are asked for, for each that can run: enough that no worker waits for the driver."""

# seconds after which a cluster may have grown; asking takes as long as a task
_GROWS = 2.0
# seconds in which a cluster answers if it is there; Ray itself would try for minutes
_ANSWERS = 10.0
# by which users tell Ray who may reach it
_TOKENS = ("RAY_AUTH_MODE", "RAY_AUTH_TOKEN", "RAY_AUTH_TOKEN_PATH")


def each(
    work: Callable[[Unit], Written],
    units: Iterator[Unit],
    workers: int,
    threads: int,
    address: str | None = None,
) -> Iterator[tuple[Unit, Written | None]]:
    """Work on units in tasks of Ray; a task takes as many of Ray's CPUs as it has threads.

    Parameters
    ----------
    work : callable
        What is done with a unit.
    units : iterator of Unit
    workers : int
        How many tasks run at once, if there is no address: Ray is started here, on the loopback address
        and with a token of its own, without dashboard and usage statistics, and stopped at the end.
    threads : int
        How many threads each has.
    address : str, optional
        A cluster's, such as "10.0.0.1:6379" or "auto"; as many tasks run as it has CPUs for, also when it
        grows. A Ray that the caller has connected to is used, whatever is given.

    Yields
    ------
    unit : Unit
        In the order in which they end.
    written : Written or None
        What the work returned; None if the task's process died, `TRIES` times.

    Raises
    ------
    ImportError
        If ray is not installed.
    ValueError
        If no machine of the cluster has as many CPUs as a task has threads.
    ConnectionError
        If there is no cluster at the address.
    EngineError
        If Ray cannot go on.
    Exception
        What the work raises; other work is ended.
    """
    ray = import_extra("ray")
    connected = nullcontext() if ray.is_initialized() else _connected(ray, workers * threads, address)
    with connected:
        yield from _each(ray, work, units, threads)


def _each(
    ray: Any, work: Callable[[Unit], Written], units: Iterator[Unit], threads: int
) -> Iterator[tuple[Unit, Written | None]]:
    pending: dict[Any, Unit] = {}
    try:
        task = ray.remote(num_cpus=threads, max_retries=TRIES - 1)(_task)
        shared = ray.put(work)
        most, asked = 0, -math.inf
        while True:
            if time.monotonic() - asked > _GROWS:
                most, asked = AHEAD * _room(ray.nodes(), threads), time.monotonic()
            while len(pending) < most and (unit := next(units, None)) is not None:
                pending[task.remote(shared, threads, unit)] = unit
            if not pending:
                return
            ended, _ = ray.wait(list(pending), num_returns=1)
            for reference in ended:
                yield pending.pop(reference), _written(ray, reference)
    except ray.exceptions.RayError as error:
        raise EngineError(f"Ray: {error}") from error
    finally:
        for reference in pending:
            ray.cancel(reference, force=True)


def _written(ray: Any, reference: Any) -> Written | None:
    """Return what a task returned; None if each process or machine that worked on it died."""
    errors = ray.exceptions
    try:
        written: Written = ray.get(reference)
    except errors.RayTaskError as error:
        raise error.cause from error
    except (errors.WorkerCrashedError, errors.OutOfMemoryError, errors.NodeDiedError, errors.ObjectLostError):
        return None
    return written


@contextmanager
def _connected(ray: Any, cpus: int, address: str | None) -> Iterator[None]:
    """Connect to a cluster, or start one here, whose folder goes at the end unless its logs are needed."""
    with nullcontext() if address is not None else _told(ray):
        try:
            session = _connect(ray, cpus, address)
        except RuntimeError as error:
            # the cluster has another version of Ray or Python, for example
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
    """Connect to a cluster, or start one here and return the folder that it made for itself."""
    if address is not None:
        _require_answer(address)
        ray.init(address=address, log_to_driver=False, logging_level=logging.WARNING)
        return None
    with _loopback(ray):
        context = ray.init(
            address="local",
            num_cpus=cpus,
            include_dashboard=False,
            log_to_driver=False,
            # it warns of its token at each start
            logging_level=logging.ERROR,
            _node_ip_address="127.0.0.1",
        )
    session: str = context.address_info["session_dir"]
    return session


@contextmanager
def _told(ray: Any) -> Iterator[None]:
    """Tell Ray to send no statistics, and a token that nobody else knows: it would leave one in a file."""
    said = {"RAY_USAGE_STATS_ENABLED": "0"}
    if not any(name in os.environ for name in _TOKENS):
        said |= {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": secrets.token_hex(32)}
    try:
        with environment({name: value for name, value in said.items() if name not in os.environ}):
            _read_again(ray)
            yield
    finally:
        _read_again(ray)


def _read_again(ray: Any) -> None:
    """Have Ray read the environment, which it does when it is imported; its settings before its token."""
    ray._raylet.Config.initialize("")
    ray._raylet.AuthenticationTokenLoader.instance().reset_cache()


@contextmanager
def _loopback(ray: Any) -> Iterator[None]:
    """Have Ray take 127.0.0.1 as it is; on Linux it would take the machine's address in its network."""
    constants = ray._private.ray_constants
    before = constants.ENABLE_RAY_CLUSTER
    constants.ENABLE_RAY_CLUSTER = False
    try:
        yield
    finally:
        constants.ENABLE_RAY_CLUSTER = before


def _require_answer(address: str) -> None:
    """Refuse an address at which nobody listens; Ray knows addresses without a port, such as "auto"."""
    host, _, port = address.rpartition("://")[2].rpartition(":")
    if not port.isdecimal():
        return
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=_ANSWERS).close()
    except (OSError, OverflowError) as error:
        raise ConnectionError(f"address: no cluster of Ray answers at {address} ({error})") from error


def _room(nodes: Sequence[dict[str, Any]], threads: int) -> int:
    """How many tasks the machines have CPUs for: all CPUs of a task are of one machine."""
    cpus = [int(node["Resources"].get("CPU", 0)) for node in nodes if node["Alive"]]
    room = sum(own // threads for own in cpus)
    if not room:
        raise ValueError(
            f"threads: expected at most {max(cpus, default=0)}, the most CPUs that Ray has on one machine, "
            f"got {threads}"
        )
    return room


def _task(work: Callable[[Unit], Written], threads: int, unit: Unit) -> Written:
    set_num_threads(threads)
    return work(unit)
