"""Many small recordings through both engines of `strand.batch`, against a loop of `reconstruct`.

python benches/batch.py [--recordings N] [--workers N ...] [--repeat N] [--folder DIR]

The recordings are simulated scenes of two views of 160 x 120 pixels, drawn from seeds, made once into a
temporary folder. A loop on one thread reads and reconstructs each; then makes its rows too, with the
crossings; then writes them as shards as well. Then come the local engine and Ray, started here, with each
number of workers. A rate is that of the whole call, and that between the first unit and the last one, which
leaves out how long processes and Ray take to start. The overheads are what a unit takes of a worker's time
beyond reconstructing in the loop, and beyond shards in the loop, which is the same without an engine. The
driver's share is its processor time for each unit. Memory is that of the driver and of all processes below it
(proportional shares, which count what is shared once), at a tenth of the units and at the end.

The tables of all runs are compared bit for bit, but for the column `seconds`. Then come the parts of a unit
that a batch adds, alone: finding it, making its rows, writing its shard with and without the flush to the
disk; listing shards, and looking one up. The exit code is 1 if tables differ.
"""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import pyarrow as pa

import strand
from lib.results import make_parser, run_bench
from strand._core import cores
from strand.batch import Settings, Unit, find_units, load_table, make_rows, run
from strand.batch.running import Counts
from strand.batch.shards import Shards
from strand.batch.table import VARYING_COLUMN, Row, make_record_batch
from strand.batch.work import Work, encode_parquet
from strand.support.files import write_bytes
from strand.synthetic import SHAPES, Camera, Noise, scene

SMALL = (160, 120)  # pixels
SETTINGS = Settings(ropes=1)


def made(folder: Path, count: int) -> Path:
    """Make recordings that are not there yet."""
    for seed in range(count):
        path = folder / f"{seed // 100:03}" / f"{seed:06}.npz"
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            name = SHAPES[seed % len(SHAPES)]
            scene(name, views=2, camera=Camera(size=SMALL), seed=seed, noise=Noise(flying=0.0)).save(path)
    return folder


def answer(unit: Unit) -> None:
    """What a loop without batches does."""
    recorded = strand.load_scene(unit.path)
    strand.reconstruct(recorded.views, recorded.radius, recorded.bounds, ropes=1)


def loop(units: Sequence[Unit], works: Sequence[Callable[[Unit], object]]) -> list[float]:
    """Seconds that each work takes for a unit, in a plain loop on one thread.

    They take turns at each unit, and at being the first, so that all meet the machine as it is at that time.
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


def memory(root: int) -> float:
    """Memory of a process and all below it, MB: what several share is shared out among them."""
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


def digest(table: pa.Table) -> str:
    """Of all columns but the one in which runs differ."""
    content = pa.BufferOutputStream()
    with pa.ipc.new_stream(content, table.drop_columns([VARYING_COLUMN]).schema) as stream:
        stream.write_table(table.drop_columns([VARYING_COLUMN]).combine_chunks())
    return hashlib.sha256(content.getvalue()).hexdigest()[:16]


def engine(name: str, workers: int, recordings: Path, count: int, loops: Sequence[float]) -> str:
    """Run a batch, print its row, and return its table's digest."""
    ends: list[float] = []
    sizes: list[float] = []

    def progress(done: Counts) -> None:
        ends.append(time.perf_counter())
        if done.made in (max(count // 10, 1), count):
            sizes.append(memory(os.getpid()))
            # what looking took is no part of the batch
            ends[-1] = time.perf_counter()

    with tempfile.TemporaryDirectory(dir=recordings.parent) as out:
        begun, spent = time.perf_counter(), time.process_time()
        run(recordings, out, SETTINGS, engine=name, workers=workers, root=recordings, progress=progress)
        whole, spent = time.perf_counter() - begun, time.process_time() - spent
        # with several workers the first ends are close: units after the first of each count
        steady = (ends[-1] - ends[workers - 1]) / (count - workers)
        over = [steady * workers / alone - 1.0 for alone in loops]
        found = digest(load_table(out))
        # what the table took is no part of the next batch
        pa.default_memory_pool().release_unused()
    print(
        f"| {name}, {workers} | {count / whole:.1f} | {1 / steady:.1f} | {over[0]:+.1%} | {over[-1]:+.1%} "
        f"| {spent / count * 1e3:.2f} | {sizes[0]:.0f} to {sizes[-1]:.0f} | {found} |",
        flush=True,
    )
    return found


def timed(work: Callable[[int], object], count: int) -> float:
    """Milliseconds for each of some calls."""
    begun = time.perf_counter()
    for k in range(count):
        work(k)
    return (time.perf_counter() - begun) / count * 1e3


def parts(recordings: Path) -> None:
    """Print what a batch adds to a unit, part by part."""
    with tempfile.TemporaryDirectory(dir=recordings.parent) as folder:
        out = Path(folder)
        begun = time.perf_counter()
        units = list(find_units([recordings], SETTINGS, recordings))
        print(f"finding: {(time.perf_counter() - begun) / len(units) * 1e3:.3f} ms a unit")
        recorded = strand.load_scene(units[0].path)
        model = strand.reconstruct(recorded.views, recorded.radius, recorded.bounds, ropes=1)
        row = Row("one", 0, None, 0.0, 0, model.chains[0], model.confidence)
        batch = make_record_batch([row], "0", "0")
        data = encode_parquet(batch, units[0])
        print(f"crossings: {timed(lambda _: model.crossings(), 200):.3f} ms")
        print(f"digest of settings: {timed(lambda _: SETTINGS.digest, 200):.3f} ms")
        print(f"rows: {timed(lambda _: make_record_batch([row], '0', '0'), 200):.3f} ms")
        print(f"parquet: {timed(lambda _: encode_parquet(batch, units[0]), 200):.3f} ms, {len(data)} bytes")
        print(f"written, flushed: {timed(lambda k: write_bytes(out / f'{k}', data), 200):.3f} ms")
        print(f"written, not flushed: {timed(lambda k: (out / f'{k}').write_bytes(data), 200):.3f} ms")
        (out / "shards").mkdir()
        count = 100_000
        for k in range(count):
            name = hashlib.sha256(b"%d" % k).hexdigest()
            (out / "shards" / name[:2]).mkdir(exist_ok=True)
            (out / "shards" / name[:2] / f"{name[:16]}-{name[16:32]}-0-end.parquet").touch()
        begun = time.perf_counter()
        shards = Shards(out / "shards")
        spent = time.perf_counter() - begun
        print(f"listing {count} shards: {spent:.2f} s, {sys.getsizeof(shards.names[0]) + 8} bytes each")
        looked = timed(lambda k: shards.find(units[k % len(units)], SETTINGS.digest), 10_000)
        print(f"looking one up: {looked:.3f} ms")


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--recordings", type=int, default=2000, metavar="N", help="(default: 2000)")
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2], metavar="N", help="(default: 1 2)")
    parser.add_argument("--repeat", type=int, default=1, metavar="N", help="of the loop and engines")
    parser.add_argument("--folder", type=Path, metavar="DIR", help="keep recordings there (default: nowhere)")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) if arguments.folder is None else arguments.folder
        begun = time.perf_counter()
        recordings = made(folder / f"{arguments.recordings}", arguments.recordings)
        print(f"{arguments.recordings} recordings, {time.perf_counter() - begun:.0f} s, {cores()} cores\n")
        found = set()
        units = list(find_units([recordings], SETTINGS, recordings))
        for _ in range(arguments.repeat):
            with tempfile.TemporaryDirectory(dir=folder) as out:
                loops = loop(units, (answer, lambda unit: make_rows(unit, SETTINGS), Work(SETTINGS, out)))
            for name, spent in zip(("reconstruct", "rows", "shards"), loops, strict=True):
                print(
                    f"loop, {name}: {spent * 1e3:.2f} ms a recording, {1 / spent:.1f} a second, "
                    f"{spent / loops[0] - 1.0:+.1%}"
                )
            heads = (
                "a second | without the start | over reconstruct | over shards | driver / ms | memory / MB"
            )
            print(f"\n| engine, workers | {heads} | table |\n|---|---|---|---|---|---|---|---|")
            for name in ("local", "ray"):
                for workers in arguments.workers:
                    found.add(engine(name, workers, recordings, len(units), loops))
            print()
        parts(recordings)
    print(f"tables that differ: {len(found) - 1}")
    return int(len(found) > 1)


if __name__ == "__main__":
    run_bench(main)
