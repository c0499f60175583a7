"""Run docs/first_grasp.md and draw the pictures of its steps.

python docs/making/first_grasp.py
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

import strand

DOCS = Path(__file__).resolve().parents[1]
FOLDER = DOCS / "images" / "first_grasp"
COLOURS = ("#f58518", "#e45756", "#54a24b")
DRAWN = {"bbox_inches": "tight", "dpi": 90, "metadata": {"Software": None}}


def walked() -> dict[str, Any]:
    """Run the page's blocks, and return what they made."""
    page = (DOCS / "first_grasp.md").read_text(encoding="utf-8")
    names: dict[str, Any] = {}
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        for code in re.findall(r"```python\n(.*?)```", page, re.DOTALL):
            exec(code, names)
        os.chdir(before)
    return names


def image(names: dict[str, Any]) -> tuple[Figure, Axes]:
    """Start a picture of the first depth image: the higher above the table, the brighter."""
    normal, offset = names["found"].tables[0]
    depth = names["depth"]
    heights = np.full(depth.shape, np.nan)
    heights[depth > 0] = names["view"].world_points @ normal - offset
    figure = Figure(figsize=(6.4, 4.4))
    axes = figure.subplots()
    axes.imshow(heights * 1e3, cmap="gray", vmin=-15.0, vmax=60.0)
    axes.set_xlim(110, 610)
    axes.set_ylim(420, 80)
    axes.autoscale(False)
    axes.set_axis_off()
    return figure, axes


def chains(axes: Axes, names: dict[str, Any], model: strand.Model) -> None:
    """Draw a model's chains as the first camera sees them, with their ends."""
    for chain, colour in zip(model.chains, COLOURS, strict=False):
        columns, rows = seen(chain.points, names["K"], model.poses[0])
        axes.plot(columns, rows, color=colour, linewidth=2.0, label=f"{chain.length * 1e3:.0f} mm")
        axes.plot(columns[[0, -1]], rows[[0, -1]], "o", color=colour, markersize=5)
    axes.legend(loc="lower right")
    axes.set_title(f"confidence {model.confidence:.2f}", fontsize=10)


def seen(points: np.ndarray, intrinsics: np.ndarray, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Columns and rows at which a camera sees points of the world."""
    placed = (points - pose[:3, 3]) @ pose[:3, :3] @ intrinsics.T
    return placed[:, 0] / placed[:, 2], placed[:, 1] / placed[:, 2]


def grasp(names: dict[str, Any]) -> Figure:
    """Draw the chain from above the table, with the gripper's fingers."""
    pose, chain, opening = names["best"].pose, names["chain"], names["best"].width
    x, y, _ = pose[:3, :3].T
    figure = Figure(figsize=(5.6, 4.8))
    axes = figure.subplots()
    above = (chain.points - pose[:3, 3]) @ np.column_stack([x, -y]) * 1e3
    radius = chain.radius * 1e3
    axes.plot(*above.T, color=COLOURS[0], linewidth=2.0)
    for side in (-1.0, 1.0):
        corner = (-8.0, side * 0.5e3 * opening - 4.0)
        axes.add_patch(Rectangle(corner, 16.0, 8.0, color="#4c78a8"))
    for start, along in (((0, 0), (25, 0)), ((0, 0), (0, 25))):
        axes.annotate("", np.add(start, along), start, arrowprops={"arrowstyle": "->", "color": "#222222"})
    axes.text(27, 0, "along the rope", va="center", fontsize=8)
    axes.text(0, 27, "across it", ha="center", va="bottom", fontsize=8)
    reach = 90.0
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-reach, reach)
    axes.set_aspect("equal")
    axes.set_xlabel("mm from the grasp")
    axes.set_title(f"{names['best'].s * 1e3:.0f} mm from the start, radius {radius:.1f} mm", fontsize=10)
    return figure


def draw(names: dict[str, Any], folder: Path) -> None:
    """Draw one picture for each step."""
    folder.mkdir(parents=True, exist_ok=True)
    figure, _ = image(names)
    figure.savefig(folder / "1-depth.png", **DRAWN)
    figure, axes = image(names)
    mask = names["found"].views[0].mask
    axes.imshow(np.dstack([np.full((*mask.shape, 3), (0.96, 0.52, 0.09)), 0.8 * mask]))
    figure.savefig(folder / "2-found.png", **DRAWN)
    for name, model in (("3-one-view", "first"), ("4-three-views", "model")):
        figure, axes = image(names)
        chains(axes, names, names[model])
        figure.savefig(folder / f"{name}.png", **DRAWN)
    grasp(names).savefig(folder / "5-grasp.png", **DRAWN)


def main() -> int:
    draw(walked(), FOLDER)
    return 0


if __name__ == "__main__":
    sys.exit(main())
