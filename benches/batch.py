"""Compare both engines of `strand.batch` with a loop of `reconstruct`, over many small recordings.

python benches/batch.py [--recordings N] [--workers N ...] [--repeat N] [--folder DIR]

The recordings are simulated scenes of two views of 160 x 120 pixels, made once in a temporary folder. One
thread works on each recording in three ways: it reconstructs; it also makes rows, with crossings; it also
writes shards. Then come the local engine and Ray, each with each number of workers. The table has:

- the rate of the whole call, and the rate from the first to the last unit, without the start,
- the overheads: a worker's time for a unit, over reconstructing and over shards in the loop,
- the driver's processor time for a unit,
- the memory of the driver and all processes below it, at a tenth of the units and at the end. Memory that
  processes share counts once.

The bench compares the tables of all runs bit for bit, but for the column `seconds`, and exits with 1 if they
differ. At last it times the parts that a batch adds to a unit: finding it, making its rows, writing its shard
with and without a flush to the disk, listing shards, and looking one up.
"""

from __future__ import annotations

import hashlib
import io
import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import pyarrow as pa

import strand
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from strand._core import count_cores
from strand.batch import Settings, Unit, find_units, load_table, make_rows, run
from strand.batch.running import Counts
from strand.batch.shards import Shards
from strand.batch.table import VARYING_COLUMN, Row, make_record_batch
from strand.batch.work import Work
from strand.batch.writing import write_rows
from strand.support.files import write_bytes
from strand.synthetic import SHAPES, Camera, Noise, scene

SMALL = (160, 120)  # pixels
SETTINGS = Settings(ropes=1)
CALLS = 200  # of a part that is timed
LOOKUPS = 10_000  # of a shard
SHARDS = 100_000  # in the folder that is listed


def make_recordings(folder: Path, count: int) -> Path:
    """Make the recordings that do not exist yet."""
    for seed in range(count):
        path = folder / f"{seed // 100:03}" / f"{seed:06}.npz"
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            name = SHAPES[seed % len(SHAPES)]
            scene(name, views=2, camera=Camera(size=SMALL), seed=seed, noise=Noise(flying=0.0)).save(path)
    return folder


def reconstruct_unit(unit: Unit) -> None:
    """Read and reconstruct a recording, as a loop without batches does."""
    recorded = strand.load_scene(unit.path)
    strand.reconstruct(recorded.views, recorded.radius, recorded.bounds, ropes=1)


def time_loop(units: Sequence[Unit], works: Sequence[Callable[[Unit], object]]) -> list[float]:
    """Return the seconds that each work takes for a unit, in a plain loop on one thread.

    The works take turns at each unit and at being first, so that other work of the machine slows all.
    """
    strand.set_num_threads(1)
    spent = [0.0] * len(works)
    for work in works:
        work(units[0])
    for number, unit in enumerate(units):
        for turn in range(len(works)):
            which = (number + turn) % len(works)
            begun = time.perf_counter()
            works[which](unit)
            spent[which] += time.perf_counter() - begun
    strand.set_num_threads(0)
    return [one / len(units) for one in spent]


def measure_memory(root: int) -> float:
    """Return the memory of a process and all below it, MB. Shared memory is divided among its users."""
    below: dict[int, list[int]] = {}
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(status.read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue
        below.setdefault(parent, []).append(int(status.parent.name))
    total, left = 0.0, [root]
    while left:
        process = left.pop()
        left += below.get(process, [])
        try:
            lines = Path(f"/proc/{process}/smaps_rollup").read_text().splitlines()
        except OSError:
            continue
        total += sum(float(line.split()[1]) for line in lines if line.startswith("Pss:"))
    return total / 1e3


def digest_table(table: pa.Table) -> str:
    """Return a digest of all columns but the one in which runs differ."""
    content = pa.BufferOutputStream()
    with pa.ipc.new_stream(content, table.drop_columns([VARYING_COLUMN]).schema) as stream:
        stream.write_table(table.drop_columns([VARYING_COLUMN]).combine_chunks())
    return hashlib.sha256(content.getvalue()).hexdigest()[:16]


def run_engine(name: str, workers: int, recordings: Path, count: int, loops: Sequence[float]) -> str:
    """Run a batch, print its row, and return its table's digest."""
    ends: list[float] = []
    sizes: list[float] = []

    def progress(done: Counts) -> None:
        ends.append(time.perf_counter())
        if done.made in (max(count // 10, 1), count):
            sizes.append(measure_memory(os.getpid()))
            # the measurement is no part of the batch
            ends[-1] = time.perf_counter()

    with tempfile.TemporaryDirectory(dir=recordings.parent) as out:
        begun, spent = time.perf_counter(), time.process_time()
        run(recordings, out, SETTINGS, engine=name, workers=workers, root=recordings, progress=progress)
        whole, spent = time.perf_counter() - begun, time.process_time() - spent
        # from the first unit of the last worker on, as all workers start together
        steady = (ends[-1] - ends[workers - 1]) / (count - workers)
        over = [steady * workers / alone - 1.0 for alone in loops]
        found = digest_table(load_table(out))
        # the next batch does not pay for this table's memory
        pa.default_memory_pool().release_unused()
    print_row(
        *(f"{name}, {workers}", f"{count / whole:.1f}", f"{1 / steady:.1f}", f"{over[0]:+.1%}"),
        *(f"{over[-1]:+.1%}", f"{spent / count * 1e3:.2f}", f"{sizes[0]:.0f} to {sizes[-1]:.0f}", found),
    )
    return found


def time_calls(work: Callable[[int], object], count: int) -> float:
    """Return the milliseconds that a call takes, on average."""
    begun = time.perf_counter()
    for k in range(count):
        work(k)
    return (time.perf_counter() - begun) / count * 1e3


def print_parts(recordings: Path) -> None:
    """Print the time of each part that a batch adds to a unit."""
    with tempfile.TemporaryDirectory(dir=recordings.parent) as folder:
        out = Path(folder)
        begun = time.perf_counter()
        units = list(find_units([recordings], SETTINGS, recordings))
        print(f"finding: {(time.perf_counter() - begun) / len(units) * 1e3:.3f} ms a unit")
        recorded = strand.load_scene(units[0].path)
        model = strand.reconstruct(recorded.views, recorded.radius, recorded.bounds, ropes=1)
        row = Row("one", 0, None, 0.0, 0, model.chains[0], model.confidence)

        def encode(_: int = 0) -> bytes:
            content = io.BytesIO()
            write_rows([row], content, "0", units[0].digest)
            return content.getvalue()

        data = encode()
        print(f"crossings: {time_calls(lambda _: model.crossings(), CALLS):.3f} ms")
        print(f"digest of settings: {time_calls(lambda _: SETTINGS.digest, CALLS):.3f} ms")
        print(f"rows: {time_calls(lambda _: make_record_batch([row], '0', '0'), CALLS):.3f} ms")
        print(f"rows as parquet: {time_calls(encode, CALLS):.3f} ms, {len(data)} bytes")
        print(f"written, flushed: {time_calls(lambda k: write_bytes(out / f'{k}', data), CALLS):.3f} ms")
        print(f"written, not flushed: {time_calls(lambda k: (out / f'{k}').write_bytes(data), CALLS):.3f} ms")
        (out / "shards").mkdir()
        for k in range(SHARDS):
            name = hashlib.sha256(b"%d" % k).hexdigest()
            (out / "shards" / name[:2]).mkdir(exist_ok=True)
            (out / "shards" / name[:2] / f"{name[:16]}-{name[16:32]}-0-end.parquet").touch()
        begun = time.perf_counter()
        shards = Shards(out / "shards")
        spent = time.perf_counter() - begun
        print(f"listing {SHARDS} shards: {spent:.2f} s, {sys.getsizeof(shards.names[0]) + 8} bytes each")
        looked = time_calls(lambda k: shards.find(units[k % len(units)], SETTINGS.digest), LOOKUPS)
        print(f"looking one up: {looked:.3f} ms")


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--recordings", type=int, default=2000, metavar="N", help="(default: 2000)")
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2], metavar="N", help="(default: 1 2)")
    parser.add_argument(
        "--repeat", type=int, default=1, metavar="N", help="runs of the loop and the engines (default: 1)"
    )
    parser.add_argument("--folder", type=Path, metavar="DIR", help="keep the recordings there")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) if arguments.folder is None else arguments.folder
        begun = time.perf_counter()
        recordings = make_recordings(folder / f"{arguments.recordings}", arguments.recordings)
        print(
            f"{arguments.recordings} recordings, {time.perf_counter() - begun:.0f} s, {count_cores()} cores\n"
        )
        found = set()
        units = list(find_units([recordings], SETTINGS, recordings))
        for _ in range(arguments.repeat):
            with tempfile.TemporaryDirectory(dir=folder) as out:
                loops = time_loop(
                    units, (reconstruct_unit, lambda unit: make_rows(unit, SETTINGS), Work(SETTINGS, out))
                )
            for name, spent in zip(("reconstruct", "rows", "shards"), loops, strict=True):
                print(
                    f"loop, {name}: {spent * 1e3:.2f} ms a recording, {1 / spent:.1f} a second, "
                    f"{spent / loops[0] - 1.0:+.1%}"
                )
            print()
            print_head(
                *("engine, workers", "a second", "without the start", "over reconstruct", "over shards"),
                *("driver / ms", "memory / MB", "table"),
            )
            for name in ("local", "ray"):
                for workers in arguments.workers:
                    found.add(run_engine(name, workers, recordings, len(units), loops))
            print()
        print_parts(recordings)
    print(f"tables that differ: {len(found) - 1}")
    return int(len(found) > 1)


if __name__ == "__main__":
    run_bench(main)
