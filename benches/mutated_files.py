"""Read damaged files of every kind, and count what is neither an answer nor the documented error.

    python benches/mutated_files.py --files 1000000 --seed 1 --findings target/findings

Damaged files are made at random (`lib/mutations.py`) in folders that are in memory. Allowed are a value,
`strand.FileFormatError` that names the file, and, where one file names another, `OSError` for what cannot be
opened. All else is a finding, and so are a warning (but Pillow's own: of what is damaged beside the pixels),
more than two seconds of processor time, and more than 200 MB of memory for one file. The files are kept.
`--seed S --only N` reads the one file of that number again.
"""

from __future__ import annotations

import os
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path

import numpy as np

import strand
from lib.mutations import Kind, kinds, numbered
from lib.results import make_parser, run_bench
from lib.whole_files import CAMERA, COLOURS, DEPTH, LABELS, image, npy, ply
from strand import config
from strand.support.files import FileFormatError

SECONDS = 2.0
MEMORY = 200_000  # kB
ALLOWED = ("answer", "FileFormatError", "OSError")
SHOWN = (*ALLOWED, "finding")
LIMIT = 1 << 23  # bytes that a scene may take: the files are small


class TooLong(BaseException):
    """Reading a file took too long."""


def folder_of(parent: Path, kind: Kind) -> Path:
    """A folder with all that a kind's files need beside them."""
    folder = parent / kind.name.replace(".", "_")
    folder.mkdir()
    if kind.view:
        (folder / "scene.toml").write_text(f"{CAMERA}[[view]]\n{kind.view}")
    if kind.name == "scene.toml" or kind.view:
        for name, data in {
            "depth.png": image(DEPTH),
            "mask.png": image(LABELS),
            "color.png": image(COLOURS),
            "depth.npy": npy(DEPTH * 0.001),
            "points.ply": ply("ascii", "double"),
        }.items():
            (folder / name).write_bytes(data)
        os.mkfifo(folder / "fifo.npy")
        (folder / "loop.npy").symlink_to("loop.npy")
        (folder / "endless.npy").symlink_to("/dev/zero")
        (folder / "folder.npy").mkdir()
    return folder


def read(kind: Kind, folder: Path) -> object:
    """What the file of a kind in its folder says; values are looked at as a user would."""
    path = folder / kind.name
    if kind.reader == "config":
        return repr(config.load(path))
    if kind.reader == "model":
        made = strand.load_model(path)
        repr(made), [str(one) for one in (*made.warnings, *made.doubts)], [one.length for one in made.chains]
        made.save(folder / "again.json")
        again = strand.load_model(folder / "again.json")
        np.testing.assert_array_equal(again.poses, made.poses)
        return again
    scene = strand.load_scene(folder if kind.view else path, max_bytes=LIMIT)
    assert scene.views, "a scene without views"
    scene.name.encode()
    for view in scene.views:
        assert np.isfinite(view.points).all(), "points that are not finite"
        assert view.colors is None or len(view.colors) == len(view.points), "colours of other points"
    return scene


def outcome(kind: Kind, folder: Path) -> str:
    """What comes of a file: "answer", "FileFormatError", "OSError", or why it is a finding."""
    try:
        read(kind, folder)
    except FileFormatError as error:
        if not error.file.startswith(str(folder)) or len(error.reason) > 1000:
            return f"message: {str(error)[:100]}"
        return "FileFormatError"
    except OSError as error:
        return where(error) if kind.name != "scene.toml" or error.filename is None else "OSError"
    except (KeyboardInterrupt, TooLong):
        raise
    except BaseException as error:
        return where(error)
    return "answer"


def where(error: BaseException) -> str:
    """The kind of an error, and the last place of strand's that it went through."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if "/strand/" in frame.filename]
    place = f"{Path(frames[-1].filename).name}:{frames[-1].name}" if frames else "?"
    return f"{type(error).__name__} in {place}"


def stop(*_: object) -> None:
    """End the reading of a file."""
    raise TooLong


def main() -> None:
    """Make, read, count."""
    parser = make_parser(__doc__)
    parser.add_argument("--files", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", type=int, help="the number of one file")
    parser.add_argument("--kind", help="only files of this name, such as a.ply")
    parser.add_argument("--findings", type=Path, help="where files of findings are kept")
    options = parser.parse_args()
    resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))
    signal.signal(signal.SIGALRM, stop)
    signal.signal(signal.SIGVTALRM, stop)
    warned: list[str] = []
    warnings.simplefilter("always")
    warnings.filterwarnings("ignore", module="PIL")
    warnings.showwarning = lambda message, category, *_, **__: warned.append(f"{category.__name__} {message}")
    every = kinds()
    chosen = tuple(kind for kind in every if options.kind in (None, kind.name))
    files: Counter[tuple[str, str]] = Counter()
    findings: Counter[tuple[str, str]] = Counter()
    started = time.monotonic()
    shared = "/dev/shm" if Path("/dev/shm").is_dir() else None
    with tempfile.TemporaryDirectory(dir=shared) as parent:
        folders = {kind.name: folder_of(Path(parent), kind) for kind in every}
        for kind in every:  # whole files are read, and what is loaded late is loaded
            for data in kind.whole:
                (folders[kind.name] / kind.name).write_bytes(data)
                read(kind, folders[kind.name])
        numbers = range(options.files) if options.only is None else [options.only]
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        for number in numbers:
            kind, data = numbered(options.seed, number, chosen, every)
            (folders[kind.name] / kind.name).write_bytes(data)
            warned.clear()
            try:
                signal.setitimer(signal.ITIMER_VIRTUAL, SECONDS)
                signal.setitimer(signal.ITIMER_REAL, 60 * SECONDS)  # waits take no processor time
                why = outcome(kind, folders[kind.name])
                signal.setitimer(signal.ITIMER_VIRTUAL, 0)
                signal.setitimer(signal.ITIMER_REAL, 0)
            except TooLong:
                why = "too long"
            grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - most
            most += grown
            if why in ALLOWED and grown > MEMORY:
                why = f"{grown // 1000} MB"
            if why in ALLOWED and warned:
                why = f"warning: {warned[0][:60]}"
            files[kind.name, why if why in ALLOWED else "finding"] += 1
            if why not in ALLOWED:
                findings[kind.name, why] += 1
                if options.findings and findings[kind.name, why] <= 3:
                    options.findings.mkdir(parents=True, exist_ok=True)
                    (options.findings / f"{options.seed}-{number}-{kind.name}").write_bytes(data)
                    print(f"{number}: {kind.name}: {why}", file=sys.stderr, flush=True)
            if number % 100_000 == 99_999:
                print(f"{number + 1} files, {sum(findings.values())} findings", file=sys.stderr, flush=True)
    print("| file | read | answers | refused | findings |\n|---|---|---|---|---|")
    for name in [kind.name for kind in chosen] + ["all"]:
        count = {
            what: sum(n for (of, is_), n in files.items() if name in (of, "all") and is_ == what)
            for what in SHOWN
        }
        refused = count["FileFormatError"] + count["OSError"]
        print(
            f"| {name} | {sum(count.values()):,} | {count['answer']:,} | {refused:,} | {count['finding']:,} |"
        )
    print(f"{sum(files.values()) / (time.monotonic() - started):.0f} files a second")
    for (name, why), count in findings.most_common():
        print(f"{count:8} {name}: {why}")
    sys.exit(bool(findings))


if __name__ == "__main__":
    run_bench(main)
