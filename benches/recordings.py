"""Measure memory and time of recordings of 50 and 500 frames: memory does not grow with the frames.

python benches/recordings.py [--frames 50 500] [--size 640 480]

One camera sees the views of a scene again and again, with depth in millimetres. A process of its own reads
each recording. Its memory is the peak above the memory before the file is opened.
"""

from __future__ import annotations

import multiprocessing
import re
import tempfile
import time
from pathlib import Path

from lib.bag_files import FORMATS, record_film, write_bag
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from strand import Recording, synthetic

NAMES = {"ros1": "ROS 1 bag", "sqlite3": "ROS 2 bag (SQLite)", "mcap": "MCAP"}


def read_peak() -> float:
    """Return the peak memory of this process, MB."""
    status = Path("/proc/self/status").read_text()
    return int(re.search(r"VmHWM:\s+(\d+) kB", status)[1]) / 1024


def read_recording(path: Path, world: str | None, results: multiprocessing.SimpleQueue) -> None:
    """Read all frames. Put the number of frames, the memory in MB and the time of a frame in ms."""
    before, begun, count = read_peak(), time.perf_counter(), 0
    with Recording(path, world=world) as recording:
        for frame in recording:
            count += 1
            assert frame.views[0].image is not None
    results.put((count, read_peak() - before, (time.perf_counter() - begun) / count * 1e3))


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--frames", type=int, nargs="+", default=[50, 500])
    parser.add_argument("--size", type=int, nargs=2, default=[640, 480], metavar=("WIDTH", "HEIGHT"))
    arguments = parser.parse_args()
    scene = synthetic.scene("paper", camera=synthetic.Camera(size=tuple(arguments.size)))
    context = multiprocessing.get_context("spawn")
    print_head("recording", "poses", "frames", "file MB", "memory MB", "ms a frame")
    for kind in FORMATS:
        for frames in arguments.frames:
            with tempfile.TemporaryDirectory() as folder:
                path = write_bag(Path(folder) / "film", kind, record_film(scene, frames, kind == "ros1"))
                size = sum(one.stat().st_size for one in ([path] if path.is_file() else path.iterdir()))
                for world in (None, "world"):
                    results = context.SimpleQueue()
                    child = context.Process(target=read_recording, args=(path, world, results))
                    child.start()
                    child.join()
                    count, memory, spent = results.get()
                    poses = "none" if world is None else "TF"
                    print_row(NAMES[kind], poses, count, f"{size / 1e6:.0f}", f"{memory:.0f}", f"{spent:.1f}")
    return 0


if __name__ == "__main__":
    run_bench(main)
