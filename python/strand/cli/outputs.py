"""What is written: refused before there is anything to write, if it cannot be."""

from __future__ import annotations

import argparse
import errno
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from strand.export.files import check_suffix
from strand.support.files import require_writable


def check_outputs(options: argparse.Namespace, read: Sequence[Path]) -> None:
    """Refuse what `strand reconstruct` cannot write.

    Raises
    ------
    ValueError
        If a name is of no format, two outputs are one file, or one is a file that was read.
    OSError
        If a file cannot be written.
    """
    outputs = {"--out": options.out, "--tube": options.tube}
    keep_input(read, outputs, options.figures)
    given = [path for path in outputs.values() if path is not None]
    if len({os.path.realpath(path) for path in given}) < len(given):
        raise ValueError(f"--tube: {options.tube} is what --out writes")
    for path in given:
        require_writable(path)
    if options.figures is not None:
        require_folder(options.figures)
    if options.out is not None and options.every is None:
        check_suffix(options.out)
    if options.tube is not None:
        check_suffix(options.tube, ("ply",))
    if options.every is not None:
        for option in ("tube", "figures"):
            if vars(options)[option] is not None:
                raise ValueError(f"--{option}: of one frame only, and --every asks for several")


def require_folder(path: Path) -> None:
    """Refuse a folder that cannot be made, or not be written to.

    Raises
    ------
    OSError
        If it is something else, or it or what it is to be made in cannot be written.
    """
    there = next(place for place in (path, *path.absolute().parents) if place.exists())
    if not there.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(path))
    if not os.access(there, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))


def keep_input(read: Sequence[Path], outputs: Mapping[str, Path | None], drawn: Path | None = None) -> None:
    """Refuse to write what options name, or a figure, over a file that was read.

    Raises
    ------
    ValueError
        If it would.
    """
    kept = {os.path.realpath(path) for path in read}
    written = {option: [path] for option, path in outputs.items() if path is not None}
    if drawn is not None and drawn.is_dir():
        written["--figures"] = list(drawn.glob("[0-9]*-*.png"))
    for named, paths in written.items():
        for path in paths:
            if os.path.realpath(path) in kept:
                raise ValueError(f"{named}: {path} is part of the scene or the configuration")
