"""`strand mask`: the mask of ropes in a colour image."""

from __future__ import annotations

import argparse
from io import BytesIO
from pathlib import Path

import numpy as np

import strand
from strand.cli import values
from strand.cli.inputs import load_intrinsics
from strand.cli.outputs import protect_inputs
from strand.cli.progress import show_progress
from strand.cli.terminal import flush_before_message, print_message
from strand.io.budget import MAX_BYTES, Budget
from strand.io.images import read_color, read_depth_png
from strand.support.checks import check_positive
from strand.support.extras import import_extra
from strand.support.files import require_writable, write_bytes

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
        metavar="METRES",
        help="metres per unit of the depth image, such as 0.001 for millimetres; --depth needs it",
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
    given = (options.image, options.depth, options.intrinsics)
    protect_inputs([path for path in given if isinstance(path, Path)], {"--output": options.output})
    require_writable(options.output)
    scale = _check_depth_scale(options)
    budget = Budget(MAX_BYTES)
    with show_progress("read"):
        color = read_color(options.image, budget)
        depth = None if options.depth is None else read_depth_png(options.depth, budget)
    with show_progress("find"):
        found = strand.rope_mask(
            color,
            None if depth is None else scale * depth.astype(np.float64),
            load_intrinsics(options.intrinsics),
            rope_color=None if options.rope_color is None else np.array(options.rope_color),
            ropes=options.ropes,
        )
    if not found:
        raise strand.NoRopeError(found.why)
    content = BytesIO()
    import_extra("PIL.Image").fromarray(found.labels.astype(np.uint8)).save(content, "PNG")
    write_bytes(options.output, content.getvalue())
    labels = np.unique(found.labels[found.labels > 0])
    print(
        f"{options.output}: {len(labels)} colour{'s' * (len(labels) > 1)}, "
        f"half width {found.radius_px:.1f} pixels"
    )
    flush_before_message()
    for label, rgb in enumerate(options.rope_color or (), 1):
        if label not in labels:
            print_message(f"strand: no rope of --rope-color {','.join(map(str, rgb))} (label {label})")


def _check_depth_scale(options: argparse.Namespace) -> float:
    """Return the depth image's metres per unit; 1 without a depth image."""
    if options.depth is None:
        for name in ("intrinsics", "depth_scale"):
            if vars(options)[name] is not None:
                raise ValueError(f"--{name.replace('_', '-')}: expected --depth along with it")
        return 1.0
    if options.depth_scale is None:
        raise ValueError(
            f"--depth-scale: {options.depth} holds whole numbers in an unknown unit: give their metres, "
            "0.001 for millimetres"
        )
    return check_positive("--depth-scale", options.depth_scale)


def _parse_color(text: str) -> tuple[int, ...]:
    parts = text.split(",")
    if len(parts) != 3 or not all(part.strip().isdigit() and int(part) < 256 for part in parts):
        raise argparse.ArgumentTypeError(f"expected three numbers from 0 to 255, got {text!r}")
    return tuple(int(part) for part in parts)
