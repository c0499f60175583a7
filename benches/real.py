"""Reconstruct the real frames of a rope between two grippers and draw the chains over what the camera saw.

python benches/real.py FOLDER [--out DIR] [--frames 0500 0590]

FOLDER holds depth_NNNN.png (16-bit, millimetres), intrinsics.json and, for some frames,
color_image_NNNN.png. One view, radius 3.8 mm as the silhouettes show, one rope. The picture shows the order
along the rope by colour, from the start in blue to the end in yellow, and what only bridges a gap in red.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from PIL import Image

import strand

RADIUS = 0.0038
FRAMES = ("0091", "0156", "0190", "0285", "0500", "0590")


def load_view(folder: Path, frame: str) -> strand.View:
    # turned about x, so that the picture stands upright in plan
    return strand.View.from_depth(
        load_depth(folder, frame),
        load_intrinsics(folder),
        strand.pose_from_angles(np.pi, 0.0, 0.0, [0.0, 0.0, 0.0]),
    )


def load_depth(folder: Path, frame: str) -> np.ndarray:
    return np.asarray(Image.open(folder / f"depth_{frame}.png")) * 1e-3


def load_intrinsics(folder: Path) -> np.ndarray:
    camera = json.loads((folder / "intrinsics.json").read_text())
    return np.array([[camera["fx"], 0, camera["cx"]], [0, camera["fy"], camera["cy"]], [0, 0, 1]])


def draw(folder: Path, models: dict[str, strand.Model], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    intrinsics = load_intrinsics(folder)
    figure, axes = plt.subplots(2, 3, figsize=(12, 7.2), layout="constrained")
    for axis, (frame, model) in zip(axes.flat, models.items(), strict=False):
        colour = folder / f"color_image_{frame}.png"
        depth = load_depth(folder, frame)
        if colour.exists():
            axis.imshow(np.asarray(Image.open(colour).convert("L")), cmap="gray", vmin=0, vmax=255)
        else:
            axis.imshow(np.where(depth > 0, 0.75, 1.0), cmap="gray", vmin=0, vmax=1)
        for chain in model.chains:
            camera = chain.points * [1.0, -1.0, -1.0]
            pixel = (camera / camera[:, 2:]) @ intrinsics.T
            axis.scatter(pixel[:, 0], pixel[:, 1], c=chain.arc_length, s=3.0, cmap="plasma")
            bare = chain.bridged
            axis.scatter(pixel[bare, 0], pixel[bare, 1], color="#e4261c", s=3.0)
        v, u = np.nonzero(depth)
        axis.set_xlim(u.min() - 60, u.max() + 60)
        axis.set_ylim(v.max() + 40, v.min() - 40)
        axis.set_title(f"{frame}: {', '.join(f'{chain.length * 1e3:.0f} mm' for chain in model.chains)}")
        axis.set_xticks([])
        axis.set_yticks([])
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, help="write real.png here")
    parser.add_argument("--frames", nargs="+", default=list(FRAMES))
    arguments = parser.parse_args()
    print(
        "| frame | points | chains | length mm | bridged mm | median distance from the tube mm | confidence |"
    )
    print("|---|---|---|---|---|---|---|")
    models = {}
    for frame in arguments.frames:
        view = load_view(arguments.folder, frame)
        models[frame] = model = strand.reconstruct([view], radius=RADIUS, ropes=1)
        (chain, *_) = model.chains
        off = [abs(chain.nearest(point)[1] - RADIUS) for point in view.world_points]
        print(
            f"| {frame} | {len(view.points)} | {len(model.chains)} | {chain.length * 1e3:.0f} "
            f"| {chain.bridged.mean() * chain.length * 1e3:.0f} | {np.median(off) * 1e3:.2f} "
            f"| {model.confidence:.2f} |"
        )
    if arguments.out:
        draw(arguments.folder, models, arguments.out / "real.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
