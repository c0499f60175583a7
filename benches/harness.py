"""Reconstruct a real branched wire harness and draw its chains: the answer for an object that is no rope.

python benches/harness.py [FILE] [--out DIR]

FILE holds one point a line, metres; the default is the harness of tests/data. Nobody knows where the camera
was, so the bench puts it far above. The picture shows the points from above and from the side, each chain in
its own colour, and the places where a chain may end on another's side.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import strand
from lib.collection import DATA
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from strand.ropes.doubt import DOUBTS

POINTS = DATA / "harness" / "wireHarness.txt"
RADIUS = 0.006  # metres
HEIGHT = 40.0  # metres: the camera above the points


def draw_chains(points: np.ndarray, model: strand.Model, path: Path) -> None:
    """Draw points and chains from above and from the side."""
    figure = Figure(figsize=(8, 7.5), layout="constrained")
    axes = figure.subplots(1, 2, width_ratios=[4, 1])
    for axis, (across, up) in zip(axes, ((0, 1), (2, 1)), strict=True):
        axis.scatter(points[:, across], points[:, up], s=2.0, color="0.75")
        for number, chain in enumerate(model.chains):
            nodes = chain.points
            label = f"{number}: {chain.length * 1e3:.0f} mm"
            axis.plot(nodes[:, across], nodes[:, up], color=f"C{number}", linewidth=2.0, label=label)
            axis.plot(nodes[[0, -1], across], nodes[[0, -1], up], "o", color=f"C{number}", markersize=5.0)
        for place in (warning.place for warning in model.warnings if warning.kind == "branch"):
            axis.plot(place[across], place[up], "o", color="black", fillstyle="none", markersize=16.0)
        axis.set_title("from the side" if across == 2 else "from above")
        axis.set_aspect("equal")
        axis.set_xlabel(f"{'xyz'[across]}, m")
        axis.set_ylabel("y, m")
    axes[0].legend(loc="upper left", fontsize=8, title="rings: a branch?")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100)


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("file", metavar="FILE", type=Path, nargs="?", default=POINTS, help="other points")
    parser.add_argument("--out", type=Path, metavar="DIR", help="write harness.png here")
    arguments = parser.parse_args()
    points = np.loadtxt(arguments.file)
    camera = points.mean(axis=0) + np.array([0.0, 0.0, HEIGHT])
    view = strand.View.from_world(points, camera)
    model = strand.reconstruct([view], RADIUS)
    lengths = ", ".join(f"{chain.length * 1e3:.0f}" for chain in model.chains)
    meeting = sum(warning.kind == "branch" for warning in model.warnings)
    unsure = sum(warning.kind in DOUBTS for warning in model.warnings)
    print_head("points", "chains", "lengths mm", "confidence", "ends on another's side", "places in doubt")
    print_row(len(points), len(model.chains), lengths, f"{model.confidence:.5f}", meeting, unsure)
    print()
    print(*model.warnings, sep="\n")
    if arguments.out:
        draw_chains(points, model, arguments.out / "harness.png")
    return 0


if __name__ == "__main__":
    run_bench(main)
