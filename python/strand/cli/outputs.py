"""The outputs of a command, checked before the work starts."""

from __future__ import annotations

import argparse
import errno
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from strand.ropes.model import SUFFIXES
from strand.support.files import check_suffix, require_writable

_SEVERAL = (".csv", ".mcap", ".json", ".jsonl")  # suffixes of files with several frames


def check_outputs(options: argparse.Namespace, inputs: Sequence[Path]) -> None:
    """Refuse outputs that `strand reconstruct` cannot write.

    Raises
    ------
    ValueError
        If an output has an unknown suffix, is another output too, or is one of the inputs.
    OSError
        If a file cannot be written.
    """
    outputs = {"--out": options.out, "--tube": options.tube, "--report": options.report}
    protect_inputs(inputs, outputs, options.figures)
    given = [path for path in outputs.values() if path is not None]
    if len({os.path.realpath(path) for path in given}) < len(given):
        raise ValueError(f"{', '.join(outputs)}: expected different files, got one of them twice")
    for path in given:
        require_writable(path)
    if options.figures is not None:
        require_folder(options.figures)
    if options.out is not None:
        more = ("mcap", *(("graphml",) if options.branches else ()))
        if options.every is None:
            check_suffix(options.out, (*SUFFIXES, *more))
        elif options.out.suffix.lower() not in _SEVERAL:
            raise ValueError(
                f"--out: with --every, expected a .csv, .mcap, .json or .jsonl file, got {options.out}"
            )
    if options.tube is not None:
        check_suffix(options.tube, ("ply",))
    if options.every is not None:
        for option in ("tube", "report", "figures"):
            if vars(options)[option] is not None:
                raise ValueError(f"--{option}: for one frame only; --every asks for several")


def require_folder(path: Path) -> None:
    """Refuse a folder that cannot be made or written to.

    Raises
    ------
    OSError
        If the path is not a folder, or it or its first existing parent cannot be written to.
    """
    existing = next(place for place in (path, *path.absolute().parents) if place.exists())
    if not existing.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(path))
    if not os.access(existing, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))


def protect_inputs(
    inputs: Sequence[Path], outputs: Mapping[str, Path | None], figures: Path | None = None
) -> None:
    """Refuse to write an output, or a figure in the folder `figures`, over an input.

    Raises
    ------
    ValueError
        If an output is an input.
    """
    kept = {os.path.realpath(path) for path in inputs}
    written = {option: [path] for option, path in outputs.items() if path is not None}
    if figures is not None and figures.is_dir():
        written["--figures"] = list(figures.glob("[0-9]*-*.png"))
    for option, paths in written.items():
        for path in paths:
            if os.path.realpath(path) in kept:
                raise ValueError(f"{option}: expected another file than the inputs, got {path}")
