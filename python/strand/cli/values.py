"""What the words of options mean: paths, lengths, places, cameras."""

from __future__ import annotations

import argparse
from pathlib import Path

from strand.io.scene_description import parse_length


def path(text: str) -> Path:
    """Return a path, which is not empty."""
    if not text:
        raise argparse.ArgumentTypeError("expected a path, got an empty text")
    return Path(text)


def length(text: str) -> float:
    """Return a length in metres, of text such as 4.2mm."""
    try:
        return parse_length(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def place(text: str) -> tuple[float, ...]:
    """(3,) Lengths with commas between them, metres."""
    words = text.split(",")
    if len(words) != 3:
        raise argparse.ArgumentTypeError(f"expected x,y,z, got {text!r}")
    return tuple(length(word) for word in words)


def intrinsics(text: str) -> tuple[float, ...] | Path:
    """Return fx, fy, cx and cy, pixels, or the file that holds a matrix."""
    words = text.split(",")
    try:
        numbers = tuple(float(word) for word in words)
    except ValueError:
        return path(text)
    if len(numbers) != 4:
        raise argparse.ArgumentTypeError(f"expected fx,fy,cx,cy or a file, got {text!r}")
    return numbers
