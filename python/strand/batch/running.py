"""A batch: recordings in, a folder of shards out. Finished work is skipped."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePosixPath

from strand._core import count_cores
from strand.batch import local_engine, ray_engine
from strand.batch.engines import MAX_ATTEMPTS
from strand.batch.settings import Settings
from strand.batch.shards import Shards, name_shard, prepare_folder, read_root
from strand.batch.units import Unit, find_units
from strand.batch.work import ShardCounts, Work
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
"""Names of the engines that `run` accepts."""


@dataclass(frozen=True)
class Counts:
    """The work that a batch has done, so far or in total.

    Attributes
    ----------
    made : int
        Units whose shards were made. A unit is a recording or a stretch of one.
    skipped : int
        Units whose shards existed.
    rows : int
        Rows that were made.
    errors : int
        Rows among these that hold an error.
    replaced : int
        Shards that were removed because the recording's files, the settings or the version changed.
    kept : int
        Recordings that cannot be read now and have earlier shards, which stay.
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
    progress: Callable[[Counts], None] | None = None,
) -> Counts:
    """Reconstruct the ropes of many recordings, and write a Parquet shard for each.

    A shard stays if it comes from the same input with the same settings and version of strand. A shard of
    another state of the recording is replaced. Even if this call is killed, it leaves only whole shards, and
    the next call makes the missing ones.

    Parameters
    ----------
    recordings : path, or sequence of paths
        Scene folders, `.npz` archives, bags, MCAP files, folders of depth images, single files; or folders
        to search for these.
    out : path
        The folder of shards; made if it does not exist.
    settings : Settings, optional
        Facts about all recordings, and how to read them.
    engine : {"local", "ray"}
        `"local"`: processes of this machine; `"ray"`: tasks of Ray, on this machine or on a cluster.
    workers : int, optional
        Number of simultaneous units; by default as many as the cores allow with `threads` each. A cluster at
        `address` uses its own number instead.
    threads : int
        Number of threads of each worker.
    address : str, optional
        Address of a Ray cluster. All its machines have the recordings and `out` at the same paths.
    root : path, optional
        The folder to which the table relates the recordings' names; a recording elsewhere has its whole
        path. By default the root of the last run with the same `out`; in the first run, the current folder.
    retry_errors : bool
        Whether to repeat units whose shards hold errors.
    progress : callable, optional
        Called with the counts so far after each unit, made or skipped.

    Returns
    -------
    Counts
        The total, when every unit has its shard.

    Raises
    ------
    TypeError, ValueError
        If an argument has the wrong type or is out of range; workers and threads need more cores than exist;
        no machine of a cluster has a CPU for each thread; a folder holds no recording; or `root` is not given
        and the last root does not exist.
    OSError
        If a path does not exist, a shard cannot be written (for example on a full disk), or no cluster
        answers at the address.
    ImportError
        If pyarrow, ray, or a package that reads a recording is not installed.
    EngineError
        If processes do not start or have another version of strand, or Ray fails. It is a `StrandError` and
        a `RuntimeError`.
    """
    given = [recordings] if isinstance(recordings, (str, os.PathLike)) else recordings
    paths = [check_path("recordings", path) for path in check_sequence("recordings", given, "paths")]
    if not paths:
        raise ValueError("recordings: expected at least one path, got none")
    folder = check_path("out", out).absolute()
    root_folder = read_root(folder) if root is None else check_path("root", root)
    if not root_folder.is_dir():
        raise ValueError(f"root: expected a folder, got {root_folder}")
    settings = Settings() if settings is None else settings
    if not isinstance(settings, Settings):
        raise TypeError(f"settings: expected strand.batch.Settings, got {type(settings).__name__}")
    check_choice("engine", engine, ENGINES)
    threads = check_integer("threads", threads, 1)
    if address is not None:
        check_text("address", address)
        if engine != "ray":
            raise ValueError("address: for Ray only; give engine='ray' (--engine ray)")
    workers = _choose_workers(workers, threads, on_cluster=address is not None)
    check_bool("retry_errors", retry_errors)
    if progress is not None and not callable(progress):
        raise TypeError(f"progress: expected a callable, got {type(progress).__name__}")
    # report missing packages before the work
    import_extra("pyarrow.parquet")
    if engine == "ray":
        import_extra("ray")
    units = find_units(paths, settings, root_folder, folder)
    first = next(units, None)
    prepare_folder(folder, settings, root_folder)
    shards, work = Shards(folder), Work(settings, str(folder))
    skipped = replaced = kept = 0
    checked_folders: set[str] = set()

    def find_missing() -> Iterator[Unit]:
        nonlocal skipped, replaced, kept
        for unit in _prepend(first, units):
            for name in map(str, PurePosixPath(unit.recording).parents):
                if name in checked_folders:
                    break
                # an earlier run may have failed to search it
                checked_folders.add(name)
                replaced += shards.remove_unreadable(name)
            if shards.must_keep(unit):
                replaced += shards.remove_unreadable(unit.recording)
                kept += 1
                continue
            replaced += shards.remove_stale(unit, settings.digest)
            shard = shards.find(unit, settings.digest)
            if shard is not None and not (
                retry_errors and shard == name_shard(unit, settings.digest, failed=True)
            ):
                skipped += 1
                if progress is not None:
                    progress(replace(counts, skipped=skipped))
                continue
            yield unit

    def make_missing() -> Iterator[tuple[Unit, ShardCounts | None]]:
        missing = find_missing()
        unit = next(missing, None)
        if unit is None:
            # start no processes without work
            return iter(())
        todo = _prepend(unit, missing)
        if engine == "ray":
            return ray_engine.run_units(work, todo, workers, threads, address)
        return local_engine.run_units(work, todo, workers, threads)

    counts = Counts()
    for unit, shard in make_missing():
        if shard is None:
            shard = work.give_up(unit, f"WorkerDied: {MAX_ATTEMPTS} processes ended while they worked on it")
        rows, errors = counts.rows + shard.rows, counts.errors + shard.errors
        counts = Counts(counts.made + 1, skipped, rows, errors, replaced, kept)
        if progress is not None:
            progress(counts)
    return replace(counts, skipped=skipped, replaced=replaced, kept=kept)


def _choose_workers(workers: int | None, threads: int, on_cluster: bool) -> int:
    """Return the number of workers, which never need more cores than this machine has."""
    if not on_cluster and threads > count_cores():
        raise ValueError(f"threads: expected at most {count_cores()}, the number of cores, got {threads}")
    if workers is None:
        return max(count_cores() // threads, 1)
    workers = check_integer("workers", workers, 1)
    if not on_cluster and workers * threads > count_cores():
        raise ValueError(
            f"workers: {workers} workers with threads={threads} need {workers * threads} cores, and this "
            f"machine has {count_cores()}"
        )
    return workers


def _prepend(first: Unit | None, others: Iterator[Unit]) -> Iterator[Unit]:
    if first is not None:
        yield first
    yield from others
