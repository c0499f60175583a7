"""One kind of file under Atheris, as a process of its own: python -m lib.fuzzed_reader NAME [OPTION ...].

Options are libFuzzer's. Without any, it prints the names.
"""

from __future__ import annotations

import contextlib
import random
import sys
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path
from types import FunctionType, ModuleType

import atheris

import strand
from lib.bag_files import FORMATS, record_film, write_bag
from lib.damaged_files import ALLOWED, Kind, list_kinds, locate_error, make_folder, try_file

COUNTED = ("strand.io", "strand.support", "strand.views", "strand.config")  # modules whose edges count
MAX_BYTES = 1 << 22  # of a recording
SUFFIXES = {"ros1": "bag", "sqlite3": "db3", "mcap": "mcap"}
KNOWING = 0.5  # share of the mutations that know the format


def make_recordings(folder: Path) -> tuple[Kind, ...]:
    """Write a small bag of each format, and return them as kinds of files."""
    scene = strand.synthetic.scene("arc", seed=0, views=1, camera=strand.synthetic.Camera(size=(16, 12)))
    kinds = []
    for form in FORMATS:
        path = write_bag(folder / form, form, record_film(scene, 2, form == "ros1"))
        suffix = SUFFIXES[form]
        file = path if path.is_file() else next(path.glob(f"*.{suffix}"))
        kinds.append(Kind(f"a.{suffix}", (file.read_bytes(),), "recording", "", ()))
    return tuple(kinds)


def try_recording(path: Path) -> str:
    """Return "answer" or "FileFormatError" for a recording, or why it is a finding."""
    try:
        with strand.Recording(path, max_bytes=MAX_BYTES) as recording:
            for _ in recording:
                pass
    except strand.FileFormatError:
        return "FileFormatError"
    except Exception as error:
        return locate_error(error)
    return "answer"


def list_functions(module: ModuleType) -> Iterator[FunctionType]:
    """Yield the functions and methods that a module defines."""
    classes = [item for item in vars(module).values() if isinstance(item, type)]
    for owner in (module, *classes):
        for item in vars(owner).values():
            function = item.fget if isinstance(item, property) else getattr(item, "__func__", item)
            if isinstance(function, FunctionType) and function.__module__ == module.__name__:
                yield function


def fuzz_kind(kind: Kind, folder: Path, options: list[str]) -> None:
    """Fuzz one kind of file; the process ends at the end."""
    own, first = make_folder(folder, kind), folder / "first"
    first.mkdir()

    def read(data: bytes) -> None:
        (own / kind.name).write_bytes(data)
        outcome = try_recording(own / kind.name) if kind.reader == "recording" else try_file(kind, own)
        if outcome not in ALLOWED:
            raise AssertionError(outcome)

    def mutate(data: bytes, longest: int, seed: int) -> bytes:
        draw = random.Random(seed)
        if kind.mutations and draw.random() < KNOWING:
            # they need whole files
            with contextlib.suppress(Exception):
                changed = draw.choice(kind.mutations)(draw, data)
                if 0 < len(changed) <= longest:
                    return changed
        return atheris.Mutate(data, longest)

    warnings.simplefilter("ignore")
    for number, data in enumerate(kind.whole):
        (first / str(number)).write_bytes(data)
        read(data)  # loads modules that load late
    for name, module in list(sys.modules.items()):
        if name.startswith(COUNTED):
            for function in set(list_functions(module)):
                atheris.instrument_func(function)
    atheris.Setup([sys.argv[0], *options, str(first)], read, custom_mutator=mutate)
    atheris.Fuzz()


def main() -> None:
    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as parent:
        kinds = {kind.name: kind for kind in (*list_kinds(), *make_recordings(Path(parent)))}
        if not sys.argv[1:]:
            print(*kinds)
            return
        fuzz_kind(kinds[sys.argv[1]], Path(parent), sys.argv[2:])


if __name__ == "__main__":
    main()
