"""Draw the pictures of docs/masks.md: each kind of mask, and each kind of colour image, with strand's answer.

python docs/making/masks.py
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

import strand
from strand.synthetic import COLOR_KINDS, FRAMES, color_scene, frame_scene

FOLDER = Path(__file__).resolve().parents[1] / "images"
COLORS = ("#f58518", "#4c78a8", "#54a24b", "#b279a2")
MASK = "#e45756"
COLUMNS = 4
MARGIN = 20  # pixels around the ropes
DRAWN = {"bbox_inches": "tight", "dpi": 70, "pil_kwargs": {"quality": 75}}


def draw_chains(
    axes: Axes, view: strand.View, ropes: int, radius: float | None, *, bare: bool = False
) -> str:
    """Draw the chains of a view, or of its bare points; return the confidence, or why there is no answer."""
    given = strand.View(view.points, view.pose) if bare else view
    try:
        model = strand.reconstruct([given], radius, ropes=ropes)
    except strand.StrandError as error:
        return f"refused: {str(error)[:40]}"
    for number, chain in enumerate(model.chains):
        places = view.image.project(chain.points)
        color = COLORS[number % len(COLORS)]
        axes.plot(
            *places.T,
            color=color,
            linewidth=1.5,
            path_effects=[withStroke(linewidth=2.8, foreground="white")],
        )
    return f"confidence {model.confidence:.2f}"


def draw_frame(axes: Axes, kind: str) -> None:
    """Draw a mask, or where points were seen, over its depth image, with the answer."""
    bare = kind == "points"
    made = frame_scene("usual" if bare else kind, 4)
    (depth,), (mask,) = made.depth * made.depth_scale, made.mask
    if bare:
        mask = mask & (depth > 0)
    (view,) = made.views
    middle = np.median(depth[mask & (depth > 0)])
    axes.imshow(
        np.where(depth > 0, depth, np.nan),
        cmap="gray_r",
        vmin=middle - 8 * made.radius,
        vmax=middle + 8 * made.radius,
    )
    axes.contourf(mask, [0.5, 1.5], colors=[MASK], alpha=0.5)
    radius = None if kind == "mixed" else made.radius
    said = draw_chains(axes, view, len(made.truth), radius, bare=bare)
    zoom(axes, view, made.truth)
    axes.set_title(f"{kind}: {said}", fontsize=9)


def draw_color(axes: Axes, kind: str) -> None:
    """Draw a colour image with the outline of the mask that strand finds in it, and the answer."""
    made = color_scene(kind, 1)
    found = strand.rope_mask(made.color[0])
    axes.imshow(made.color[0])
    if found.mask.any():
        axes.contour(found.mask, [0.5], colors=MASK, linewidths=1.0)
    said = draw_chains(axes, made.views[0], len(made.scene.truth), None)
    zoom(axes, made.views[0], made.scene.truth)
    axes.set_title(f"{kind}: {said}", fontsize=9)


def zoom(axes: Axes, view: strand.View, ropes: Sequence[np.ndarray]) -> None:
    """Show the surroundings of ropes in a view's image alone."""
    places = np.concatenate([view.image.project(nodes) for nodes in ropes])
    height, width = view.image.depth.shape
    left, top = np.maximum(places.min(axis=0) - MARGIN, -0.5)
    right, bottom = np.minimum(places.max(axis=0) + MARGIN, (width - 0.5, height - 0.5))
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)


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
    draw_sheet(FOLDER / "masks.jpg", (*FRAMES, "points"), draw_frame)
    draw_sheet(FOLDER / "colors.jpg", COLOR_KINDS, draw_color)
    return 0


if __name__ == "__main__":
    sys.exit(main())
