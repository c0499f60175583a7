"""Answer depth images on standard input with ropes on standard output, for programs in other languages.

python serve_ropes.py RADIUS

A request is a line "WIDTH HEIGHT FX FY CX CY SCALE" and the pixels: WIDTH x HEIGHT whole numbers of 16 bits,
as the machine orders bytes. SCALE is metres per unit. The answer is a line "ropes N CONFIDENCE". For each
rope follow "rope NODES RADIUS CLOSED CONFIDENCE" and a line "X Y Z" for each node, in order. Lengths are
metres, in the camera frame. If there is no answer, a line "error REASON" says why; the next request is read.
"""

from __future__ import annotations

import sys
from typing import BinaryIO

import numpy as np

import strand

MAX_PIXELS = 100_000_000


def read_view(source: BinaryIO, head: list[str]) -> strand.View:
    """Read the pixels of a request, and return their view."""
    width, height = int(head[0]), int(head[1])
    fx, fy, cx, cy, scale = map(float, head[2:])
    if not 0 < width * height <= MAX_PIXELS:
        raise SystemExit(f"expected at most {MAX_PIXELS} pixels, got {width} x {height}")
    pixels = source.read(2 * width * height)
    if len(pixels) < 2 * width * height:
        raise SystemExit("the input ends within an image")
    depth = np.frombuffer(pixels, np.uint16).reshape(height, width)
    return strand.View.from_depth(depth, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], depth_scale=scale)


def format_model(model: strand.Model) -> str:
    """Return the lines of an answer."""
    lines = [f"ropes {len(model.chains)} {model.confidence:.6f}"]
    for chain in model.chains:
        head = (len(chain.points), f"{chain.radius:.6f}", int(chain.closed), f"{chain.confidence:.6f}")
        lines.append(" ".join(map(str, ("rope", *head))))
        lines += [f"{x:.6f} {y:.6f} {z:.6f}" for x, y, z in chain.points.tolist()]
    return "\n".join(lines)


def main() -> None:
    """Answer requests until the input ends."""
    radius, model = float(sys.argv[1]), None
    # nothing but answers goes to the standard output
    target, sys.stdout = sys.stdout, sys.stderr
    while line := sys.stdin.buffer.readline():
        try:
            view = read_view(sys.stdin.buffer, line.decode().split())
            model = strand.reconstruct([view], radius=radius, previous=model)
            answer = format_model(model)
        except (strand.StrandError, ValueError) as error:
            answer = f"error {' '.join(str(error).split())}"
        print(answer, file=target, flush=True)


if __name__ == "__main__":
    main()
