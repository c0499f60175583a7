"""Draw the pictures of docs/masks.md: each kind of mask, and each kind of colour image, with strand's answer.

python docs/making/masks.py
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import strand
from strand.synthetic import COLOR_KINDS, FRAMES, color_scene, frame_scene

FOLDER = Path(__file__).resolve().parents[1] / "images"
COLORS = ("#f58518", "#4c78a8", "#54a24b", "#b279a2")
MASK = "#e45756"
COLUMNS = 4
MARGIN = 20  # pixels around the ropes
DRAWN = {"bbox_inches": "tight", "dpi": 70, "pil_kwargs": {"quality": 75}}


def draw_chains(axes: Axes, views: tuple[strand.View, ...], ropes: int, radius: float | None) -> str:
    """Draw the chains of one view; return the confidence, or why there is no answer."""
    try:
        model = strand.reconstruct(views, radius, ropes=ropes)
    except strand.StrandError as error:
        return f"refused: {str(error)[:40]}"
    for number, chain in enumerate(model.chains):
        places = views[0].image.project(chain.points)
        axes.plot(*places.T, color=COLORS[number % len(COLORS)], linewidth=1.5)
    return f"confidence {model.confidence:.2f}"


def draw_frame(axes: Axes, kind: str) -> None:
    """Draw a mask over its depth image, with the answer."""
    made = frame_scene(kind, 4)
    (depth,), (mask,) = made.depth * made.depth_scale, made.mask
    view_image = made.views[0].image
    middle = np.median(depth[mask & (depth > 0)])
    axes.imshow(
        np.where(depth > 0, depth, np.nan),
        cmap="gray_r",
        vmin=middle - 8 * made.radius,
        vmax=middle + 8 * made.radius,
    )
    axes.contourf(mask, [0.5, 1.5], colors=[MASK], alpha=0.5)
    said = draw_chains(axes, made.views, len(made.truth), None if kind == "mixed" else made.radius)
    zoom(axes, np.concatenate([view_image.project(nodes) for nodes in made.truth]))
    axes.set_title(f"{kind}: {said}", fontsize=9)


def draw_color(axes: Axes, kind: str) -> None:
    """Draw a colour image with the outline of the mask that strand finds in it, and the answer."""
    made = color_scene(kind, 1)
    found = strand.rope_mask(made.color[0])
    axes.imshow(made.color[0])
    if found.mask.any():
        axes.contour(found.mask, [0.5], colors=MASK, linewidths=0.7)
    said = draw_chains(axes, made.views, len(made.scene.truth), None)
    axes.set_title(f"{kind}: {said}", fontsize=9)


def zoom(axes: Axes, places: np.ndarray) -> None:
    """Show the surroundings of (N, 2) places alone."""
    (left, top), (right, bottom) = places.min(axis=0), places.max(axis=0)
    axes.set_xlim(left - MARGIN, right + MARGIN)
    axes.set_ylim(bottom + MARGIN, top - MARGIN)


def draw_sheet(path: Path, kinds: tuple[str, ...], draw: Callable[[Axes, str], None]) -> None:
    """Draw a picture of each kind on one sheet."""
    rows = -(-len(kinds) // COLUMNS)
    figure = Figure(figsize=(4.2 * COLUMNS, 3.4 * rows), layout="constrained")
    cells = figure.subplots(rows, COLUMNS, squeeze=False).ravel()
    for cell in cells:
        cell.set_axis_off()
    for cell, kind in zip(cells, kinds, strict=False):
        draw(cell, kind)
    figure.savefig(path, **DRAWN)


def main() -> int:
    draw_sheet(FOLDER / "masks.jpg", FRAMES, draw_frame)
    draw_sheet(FOLDER / "colors.jpg", COLOR_KINDS, draw_color)
    return 0


if __name__ == "__main__":
    sys.exit(main())
