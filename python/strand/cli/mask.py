"""`strand mask`: the mask of ropes in a colour image."""

from __future__ import annotations

import argparse
from io import BytesIO

import numpy as np

import strand
from strand.cli import values
from strand.cli.inputs import load_intrinsics
from strand.cli.outputs import protect_inputs
from strand.cli.progress import show_progress
from strand.io.budget import MAX_BYTES, Budget
from strand.io.images import read_color, read_depth_png
from strand.support.extras import import_extra
from strand.support.files import require_writable, write_bytes

HINT = "find the pixels of ropes in a colour image"
DESCRIPTION = """\
Find the ropes in a colour image, and write a PNG mask that `--mask` reads:
0 is no rope, and each colour of rope has its number."""


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    command.add_argument(
        "image", type=values.parse_path, metavar="IMAGE", help="a PNG, JPEG, BMP or PPM file"
    )
    command.add_argument(
        "-o", "--output", type=values.parse_path, required=True, metavar="FILE", help="the .png file to write"
    )
    command.add_argument(
        "--depth", type=values.parse_path, metavar="FILE", help="the depth image of the same pixels, a .png"
    )
    command.add_argument(
        "--intrinsics",
        type=values.parse_intrinsics,
        metavar="FX,FY,CX,CY",
        help="intrinsics of the depth image, pixels; or a file with the 3 x 3 matrix",
    )
    command.add_argument(
        "--depth-scale",
        type=float,
        default=0.001,
        metavar="METRES",
        help="metres per unit of the depth image (default: 0.001)",
    )
    command.add_argument(
        "--rope-color",
        type=_parse_color,
        action="append",
        metavar="R,G,B",
        help="a rope's colour, from 0 to 255; may come again for several ropes",
    )
    command.add_argument("--ropes", type=int, metavar="N", help="the number of ropes")


def run(options: argparse.Namespace) -> None:
    """Find the ropes of an image, and write their mask."""
    if options.output.suffix.lower() != ".png":
        raise ValueError(f"--output: expected a .png file, got {options.output}")
    inputs = [path for path in (options.image, options.depth) if path is not None]
    protect_inputs(inputs, {"--output": options.output})
    require_writable(options.output)
    budget = Budget(MAX_BYTES)
    with show_progress("read"):
        color = read_color(options.image, budget)
        depth = None if options.depth is None else read_depth_png(options.depth, budget)
    with show_progress("find"):
        found = strand.rope_mask(
            color,
            None if depth is None else options.depth_scale * depth.astype(np.float64),
            load_intrinsics(options.intrinsics),
            rope_color=None if options.rope_color is None else np.array(options.rope_color),
            ropes=options.ropes,
        )
    if not found:
        raise strand.NoRopeError(found.why)
    content = BytesIO()
    import_extra("PIL.Image").fromarray(found.labels.astype(np.uint8)).save(content, "PNG")
    write_bytes(options.output, content.getvalue())
    count = int(found.labels.max())
    print(f"{options.output}: {count} colour{'s' * (count > 1)}, half width {found.radius_px:.1f} pixels")


def _parse_color(text: str) -> tuple[int, ...]:
    parts = text.split(",")
    if len(parts) != 3 or not all(part.strip().isdigit() and int(part) < 256 for part in parts):
        raise argparse.ArgumentTypeError(f"expected three numbers from 0 to 255, got {text!r}")
    return tuple(int(part) for part in parts)
