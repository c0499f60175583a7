"""The types of option values: paths, lengths, positions, intrinsics."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from strand.io import scene_description


class Repeated(argparse.Action):
    """An option whose value is a list if it is given more than once."""

    def __call__(self, parser: Any, namespace: argparse.Namespace, values: Any, option: Any = None) -> None:
        """Keep a value beside the earlier ones."""
        before = getattr(namespace, self.dest)
        every = [*(before if isinstance(before, list) else [before]), values]
        setattr(namespace, self.dest, values if before is None else every)


def parse_path(text: str) -> Path:
    """Return a path that is not empty."""
    if not text:
        raise argparse.ArgumentTypeError("expected a path, got an empty text")
    return Path(text)


def parse_length(text: str) -> float:
    """Return a length in metres, from text such as 4.2mm."""
    try:
        return scene_description.parse_length(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def parse_position(text: str) -> tuple[float, ...]:
    """Return (3,) coordinates in metres, from three lengths with commas between them."""
    words = text.split(",")
    if len(words) != 3:
        raise argparse.ArgumentTypeError(f"expected x,y,z, got {text!r}")
    return tuple(parse_length(word) for word in words)


def parse_intrinsics(text: str) -> tuple[float, ...] | Path:
    """Return fx, fy, cx and cy in pixels, or the path of a file with the matrix."""
    words = text.split(",")
    try:
        numbers = tuple(float(word) for word in words)
    except ValueError:
        return parse_path(text)
    if len(numbers) != 4:
        raise argparse.ArgumentTypeError(
            f"expected fx,fy,cx,cy with commas and no spaces, or a file, got {text!r}"
        )
    return numbers
