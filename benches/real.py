"""Reconstruct the real frames of a rope between two grippers and draw the chains over the points.

python benches/real.py FOLDER [--out DIR] [--frames 0500 0590]

FOLDER holds depth_NNNN.png (16-bit, millimetres) and intrinsics.json. One view, radius 6 mm, one rope.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from PIL import Image

import strand
from strand import figures

RADIUS = 0.006


def load_view(folder: Path, frame: str) -> strand.View:
    camera = json.loads((folder / "intrinsics.json").read_text())
    intrinsics = np.array([[camera["fx"], 0, camera["cx"]], [0, camera["fy"], camera["cy"]], [0, 0, 1]])
    depth = np.asarray(Image.open(folder / f"depth_{frame}.png")) * 1e-3
    # turned about x, so that the picture stands upright in plan
    return strand.View.from_depth(
        depth, intrinsics, strand.pose_from_angles(np.pi, 0.0, 0.0, [0.0, 0.0, 0.0])
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, help="write a picture of each frame here")
    parser.add_argument("--frames", nargs="+", default=["0500", "0590"])
    arguments = parser.parse_args()
    print("| frame | points | chains | length mm | median distance from the tube mm | notes |")
    print("|---|---|---|---|---|---|")
    for frame in arguments.frames:
        view = load_view(arguments.folder, frame)
        model = strand.reconstruct([view], radius=RADIUS, ropes=1)
        (chain, *_) = model.chains
        off = [abs(chain.nearest(point)[1] - RADIUS) for point in view.world_points]
        print(
            f"| {frame} | {len(view.points)} | {len(model.chains)} | {chain.length * 1e3:.0f} "
            f"| {np.median(off) * 1e3:.2f} | {'; '.join(model.warnings)} |"
        )
        if arguments.out:
            arguments.out.mkdir(parents=True, exist_ok=True)
            figures.plot_over_points(model, view.world_points, arguments.out / f"real-{frame}.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
