"""A batch: recordings in, a folder of shards out; what is there already is not made again."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePosixPath

from strand._core import cores
from strand.batch import local, ray
from strand.batch.engines import TRIES
from strand.batch.settings import Settings
from strand.batch.shards import Shards, Work, Written, made_ready, name_of, root_of
from strand.batch.units import Unit, find
from strand.support.checks import (
    check_bool,
    check_choice,
    check_integer,
    check_path,
    check_sequence,
    check_text,
)
from strand.support.extras import import_extra

ENGINES = ("local", "ray")
"""What units may be worked on by."""


@dataclass(frozen=True)
class Done:
    """What a batch did, so far or in all.

    Attributes
    ----------
    made : int
        Units whose shards were made: recordings, or stretches of them.
    skipped : int
        Units whose shards were there.
    rows : int
        Rows that were made.
    errors : int
        Of these, rows that say an error.
    replaced : int
        Shards that were there and went: of other files of a recording, other settings or another version.
    kept : int
        Recordings that cannot be read now, and were before: their shards stay as they are.
    """

    made: int = 0
    skipped: int = 0
    rows: int = 0
    errors: int = 0
    replaced: int = 0
    kept: int = 0


def run(
    recordings: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    settings: Settings | None = None,
    *,
    engine: str = "local",
    workers: int | None = None,
    threads: int = 1,
    address: str | None = None,
    root: str | os.PathLike[str] | None = None,
    retry_errors: bool = False,
    progress: Callable[[Done], None] | None = None,
) -> Done:
    """Reconstruct the ropes of many recordings, and write a Parquet shard for each.

    A shard that is there, made of the same input by the same settings and version of strand, is kept. What
    was made of another state of a recording, or by others, is replaced. Whatever ends this call, whole shards
    are left only, and the next call makes the others.

    Parameters
    ----------
    recordings : path, or sequence of paths
        Scene folders, `.npz` archives, bags, MCAP files, folders of depth images, single files; or folders
        in which these are sought.
    out : path
        The folder of shards; it is made if there is none.
    settings : Settings, optional
        What is known of all recordings, and how they are read.
    engine : {"local", "ray"}
        `"local"`: processes of this machine; `"ray"`: tasks of Ray, here or on a cluster.
    workers : int, optional
        How many units are worked on at once; as many as `threads` fit the cores if not given. With `address`
        it counts for nothing: a cluster has its own number of CPUs.
    threads : int
        How many threads each worker has.
    address : str, optional
        Of a Ray cluster. Recordings and `out` are at the same paths on all its machines.
    root : path
        The folder below which the table names recordings; those elsewhere have their whole path. If not
        given, that of the last time with the same `out`; the first time, the current folder.
    retry_errors : bool
        Whether units whose shards say errors are made again.
    progress : callable, optional
        Called with what was done so far after each unit, made or skipped.

    Returns
    -------
    Done
        When every unit has its shard.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or out of range, workers and threads need more cores than there
        are, no machine of a cluster has CPUs for a worker, a folder holds no recording, or `root` is not
        given and that of the last time is not here.
    OSError
        If a path does not exist, or a shard cannot be written: a full disk, for example. If no cluster
        answers at the address.
    ImportError
        If pyarrow, ray or what reading a recording needs is not installed.
    EngineError
        If processes do not start or have another version of strand, or Ray cannot go on; a `StrandError` and
        a `RuntimeError`.
    """
    given = [recordings] if isinstance(recordings, (str, os.PathLike)) else recordings
    paths = [check_path("recordings", one) for one in check_sequence("recordings", given, "paths")]
    if not paths:
        raise ValueError("recordings: expected at least one path, got none")
    folder = check_path("out", out).absolute()
    above = root_of(folder) if root is None else check_path("root", root)
    if not above.is_dir():
        raise ValueError(f"root: expected a folder, got {above}")
    settings = Settings() if settings is None else settings
    if not isinstance(settings, Settings):
        raise TypeError(f"settings: expected strand.batch.Settings, got {type(settings).__name__}")
    check_choice("engine", engine, ENGINES)
    threads = check_integer("threads", threads, 1)
    if address is not None:
        check_text("address", address)
        if engine != "ray":
            raise ValueError("address: only Ray has one; give engine='ray' (--engine ray)")
    workers = _workers(workers, threads, elsewhere=address is not None)
    check_bool("retry_errors", retry_errors)
    if progress is not None and not callable(progress):
        raise TypeError(f"progress: expected something to call, got {type(progress).__name__}")
    # that something is missing is said before the work
    import_extra("pyarrow.parquet")
    if engine == "ray":
        import_extra("ray")
    units = find(paths, settings, above, folder)
    first = next(units, None)
    made_ready(folder, settings, above)
    shards, work = Shards(folder), Work(settings, str(folder))
    skipped = replaced = kept = 0
    folders: set[str] = set()

    def missing() -> Iterator[Unit]:
        nonlocal skipped, replaced, kept
        for unit in _after(first, units):
            for name in map(str, PurePosixPath(unit.recording).parents):
                if name in folders:
                    break
                # it may be one that could not be searched at another time
                folders.add(name)
                replaced += shards.remove_unread(name)
            if shards.kept(unit):
                replaced += shards.remove_unread(unit.recording)
                kept += 1
                continue
            replaced += shards.remove_stale(unit, settings.digest)
            there = shards.there(unit, settings.digest)
            if there is not None and not (retry_errors and there == name_of(unit, settings.digest, True)):
                skipped += 1
                if progress is not None:
                    progress(replace(done, skipped=skipped))
                continue
            yield unit

    def ended() -> Iterator[tuple[Unit, Written | None]]:
        todo = missing()
        unit = next(todo, None)
        if unit is None:
            # nothing is started for nothing
            return iter(())
        if engine == "ray":
            return ray.each(work, _after(unit, todo), workers, threads, address)
        return local.each(work, _after(unit, todo), workers, threads)

    done = Done()
    for unit, written in ended():
        if written is None:
            written = work.give_up(unit, f"WorkerDied: {TRIES} processes ended while they worked on it")
        rows, errors = done.rows + written.rows, done.errors + written.errors
        done = Done(done.made + 1, skipped, rows, errors, replaced, kept)
        if progress is not None:
            progress(done)
    return replace(done, skipped=skipped, replaced=replaced, kept=kept)


def _workers(workers: int | None, threads: int, elsewhere: bool) -> int:
    """Return how many workers there are: never more than have cores."""
    if not elsewhere and threads > cores():
        raise ValueError(f"threads: expected at most {cores()}, as many as there are cores, got {threads}")
    if workers is None:
        return max(cores() // threads, 1)
    workers = check_integer("workers", workers, 1)
    if not elsewhere and workers * threads > cores():
        needed = workers * threads
        raise ValueError(
            f"workers: {workers} of {threads} threads each need {needed} cores, and there are {cores()}"
        )
    return workers


def _after(first: Unit | None, others: Iterator[Unit]) -> Iterator[Unit]:
    if first is not None:
        yield first
    yield from others
