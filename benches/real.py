"""Reconstruct the real frames of a rope between two grippers, and draw the chains over the images.

python benches/real.py [--out DIR] [--frames 0500 0590] [--masks]

The frames are those of benches/lib/frames.py: one view of one rope with a radius of 3.8 mm, as the
silhouettes show. The picture shows the order along the rope by colour, from blue to yellow, and bridged gaps
in red.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import strand
from lib import frames
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row

RADIUS = 0.0038  # metres


def draw_frames(models: dict[str, strand.Model], path: Path) -> None:
    """Draw chains over the frames."""
    intrinsics = frames.load_intrinsics()
    figure = Figure(figsize=(12, 7.2), layout="constrained")
    axes = figure.subplots(2, 3)
    for axis, (frame, model) in zip(axes.flat, models.items(), strict=False):
        depth, gray = frames.load_depth(frame), frames.load_gray(frame)
        if gray is not None:
            axis.imshow(gray, cmap="gray", vmin=0, vmax=255)
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
    parser = make_parser(__doc__)
    parser.add_argument("--out", type=Path, metavar="DIR", help="write real.png here")
    parser.add_argument(
        "--frames",
        nargs="+",
        metavar="NNNN",
        choices=frames.list_frames(),
        default=frames.list_frames(),
        help="(default: all)",
    )
    parser.add_argument("--masks", action="store_true", help="give the pixels with depth as masks")
    arguments = parser.parse_args()
    lengths = ("length mm", "bridged mm", "median distance from the tube mm")
    print_head("frame", "points", "chains", *lengths, "confidence")
    models = {}
    for frame in arguments.frames:
        view = frames.load_view(frame, arguments.masks)
        models[frame] = model = strand.reconstruct([view], radius=RADIUS, ropes=1)
        (chain, *_) = model.chains
        off = np.abs(chain.nearest(view.world_points).distance - RADIUS)
        millimetres = (
            f"{chain.length * 1e3:.0f}",
            f"{chain.bridged.mean() * chain.length * 1e3:.0f}",
            f"{np.median(off) * 1e3:.2f}",
        )
        print_row(frame, len(view.points), len(model.chains), *millimetres, f"{model.confidence:.2f}")
    if arguments.out:
        draw_frames(models, arguments.out / "real.png")
    return 0


if __name__ == "__main__":
    run_bench(main)
