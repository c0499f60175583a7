"""Answer depth images on standard input with ropes on standard output, for programs in other languages.

python serve_ropes.py RADIUS

A request is a line "WIDTH HEIGHT FX FY CX CY SCALE" and the pixels: WIDTH x HEIGHT whole numbers of 16 bits,
as the machine orders bytes. SCALE is metres per unit. The answer is a line "ropes N CONFIDENCE". For each
rope follow "rope NODES RADIUS CLOSED CONFIDENCE" and a line "X Y Z" for each node, in order. Lengths are
metres, in the camera frame. If there is no answer, a line "error REASON" says why. The next request is read,
unless it cannot be found: after a malformed line, or an input that ends within an image. The server then ends
with status 1, as it does if RADIUS is wrong.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from typing import BinaryIO

import numpy as np

import strand

MAX_PIXELS = 100_000_000
MAX_LINE = 1000  # bytes
REQUEST = "WIDTH HEIGHT FX FY CX CY SCALE"


class StreamError(Exception):
    """The next request cannot be found."""


def read_request(source: BinaryIO, line: bytes) -> tuple[np.ndarray, list[float]]:
    """Read the pixels of a request; return them with FX, FY, CX, CY and SCALE."""
    try:
        width, height, *numbers = line.decode().split()
        size, camera = (int(height), int(width)), [float(number) for number in numbers]
        if len(camera) != 5 or not line.endswith(b"\n"):
            raise ValueError
    except ValueError:
        raise StreamError(f"request: expected a line {REQUEST}, got {line[:80]!r}") from None
    if min(size) <= 0 or size[0] * size[1] > MAX_PIXELS:
        raise StreamError(f"request: expected 1 to {MAX_PIXELS} pixels, got {size[1]} x {size[0]}")
    wanted = 2 * size[0] * size[1]
    pixels = source.read(wanted)
    if len(pixels) < wanted:
        raise StreamError(f"request: expected {wanted} bytes of pixels, the input ends after {len(pixels)}")
    return np.frombuffer(pixels, np.uint16).reshape(size), camera


def format_model(model: strand.Model) -> str:
    """Return the lines of an answer."""
    lines = [f"ropes {len(model.chains)} {model.confidence:.6f}"]
    for chain in model.chains:
        head = (len(chain.points), f"{chain.radius:.6f}", int(chain.closed), f"{chain.confidence:.6f}")
        lines.append(" ".join(map(str, ("rope", *head))))
        lines += [f"{x:.6f} {y:.6f} {z:.6f}" for x, y, z in chain.points.tolist()]
    return "\n".join(lines)


def read_radius(words: list[str]) -> float:
    """Return the radius of the command line, metres."""
    try:
        (radius,) = map(float, words)
        if not 0.0 < radius < math.inf:
            raise ValueError
    except ValueError:
        raise StreamError(f"RADIUS: expected a positive number of metres, got {' '.join(words)!r}") from None
    return radius


def answer_requests(source: BinaryIO, words: list[str]) -> Iterator[str]:
    """Yield an answer to each request until the input ends."""
    radius, model = read_radius(words), None
    while line := source.readline(MAX_LINE):
        depth, (fx, fy, cx, cy, scale) = read_request(source, line)
        try:
            view = strand.View.from_depth(
                depth, [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]], depth_scale=scale
            )
            model = strand.reconstruct([view], radius=radius, previous=model)
            yield format_model(model)
        except (strand.StrandError, ValueError) as error:
            yield f"error {' '.join(str(error).split())}"


def main() -> int:
    """Answer requests until the input ends; return the status."""
    # nothing but answers goes to the standard output
    target, sys.stdout = sys.stdout, sys.stderr
    try:
        for answer in answer_requests(sys.stdin.buffer, sys.argv[1:]):
            print(answer, file=target, flush=True)
    except StreamError as error:
        print(f"error {error}", file=target, flush=True)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
