"""Draw figures of the stages of the published method."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from strand.report.drawing import (
    DIMENSION,
    FONT_SIZE,
    GRAY,
    INK,
    LEFT,
    MAX_NAMES,
    MAX_POINTS,
    RIGHT,
    WIDTH,
    make_dot,
    make_drawing,
    make_figure,
    make_line_entries,
    make_panel,
    make_stroke,
    pick_spread,
)
from strand.report.drawn_chains import color_paths, find_ends, find_rope_ends, pick_color
from strand.report.tables import take_stage
from strand.ropes.model import Model
from strand.ropes.notebook import PALETTE
from strand.support.checks import Array
from strand.support.extras import import_extra

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MAX_NORMALS = 800  # normals that are drawn
_NORMAL_LENGTH = 0.03  # of the points' extent
_PANEL_HEIGHT = 1.6  # inches
_PANEL_GAP = 0.5  # inches


def draw_normals(model: Model) -> Figure:
    """Draw the points, some of them with their outward unit normals (fig. 6 c)."""
    points, vectors = np.vstack(take_stage(model, "filtered")), np.vstack(take_stage(model, "normals"))
    key = {"right": (1, 0), "up": (0, 1), "left": (-1, 0), "down": (0, -1)}
    key["towards the reader"] = (0, 0)
    key_colors = _color_directions(np.array(list(key.values())))
    legend = [make_stroke(name, color) for name, color in zip(key, key_colors, strict=True)]
    drawing = make_drawing(model, points, f"Normals at {len(points):,} points", legend)
    drawing.draw_points(points[pick_spread(len(points), MAX_POINTS // 3)], GRAY, size=1.0)
    reach = _NORMAL_LENGTH * float(np.ptp(points, axis=0).max())
    some = pick_spread(len(points), _MAX_NORMALS)
    collections = import_extra("matplotlib.collections")
    for axes, across, up, depth in drawing.panels:
        order = some[np.argsort(depth(points[some]), kind="stable")]
        feet = drawing.plan.to_millimeters(points[order])
        tips = drawing.plan.to_millimeters(points[order] + reach * vectors[order])
        pieces = np.stack([feet, tips], axis=1)[:, :, [across, up]]
        flat = drawing.plan.to_millimeters(vectors[order])[:, :2]
        each = _color_directions(flat * drawing.plan.signs[:2] / 1e3)
        axes.add_collection(collections.LineCollection(list(pieces), colors=each, linewidths=0.9))
    return drawing.figure


def draw_axis_points(model: Model) -> Figure:
    """Draw the averaged axis points, which are points moved inwards by the radius (fig. 6 e)."""
    points = take_stage(model, "axis_points")
    drawing = make_drawing(model, points, f"{len(points):,} axis points", bar=True)
    height = drawing.plan.to_millimeters(points)[:, 2]
    colors = drawing.draw_color_bar(height.min(), height.max(), "viridis", drawing.plan.name_axis(2))
    drawing.draw_points(points, colors(height), size=2.0)
    return drawing.figure


def draw_chains(model: Model) -> Figure:
    """Draw the traced chains (fig. 6 f)."""
    traced, cloud = take_stage(model, "traced"), take_stage(model, "axis_points")
    names = [f"chain {i}: {len(chain)} nodes" for i, chain in enumerate(traced)]
    title = f"{len(traced)} {'chain' if len(traced) == 1 else 'chains'} traced"
    drawing = make_drawing(model, cloud, title, make_line_entries(names))
    drawing.draw_points(cloud, GRAY)
    drawing.draw_lines(color_paths(traced))
    for i, chain in enumerate(traced):
        drawing.draw_markers(chain, "o", pick_color(i), size=3.5)
    return drawing.figure


def draw_separation(model: Model) -> Figure:
    """Draw the separation d* by node, with the cuts at its local minima (fig. 11)."""
    traced, cuts = take_stage(model, "traced"), take_stage(model, "cuts")
    values = [np.where(np.isfinite(d), 1e3 * d, np.nan) for d in take_stage(model, "separation")]
    shown = sorted(sorted(range(len(traced)), key=lambda i: -len(traced[i]))[:MAX_NAMES])
    lines, ticker = import_extra("matplotlib.lines"), import_extra("matplotlib.ticker")
    legend = [lines.Line2D([], [], marker="v", ls=":", color=INK, mfc="white", mew=1.2, ms=8, label="cut")]
    if model.chains:
        legend.append(lines.Line2D([], [], color=DIMENSION, ls="--", label="rope's diameter 2 r"))
    title = "Separation d* along the chains"
    if len(shown) < len(traced):
        title += f" (the {len(shown)} longest of {len(traced)})"
    pitch = _PANEL_HEIGHT + _PANEL_GAP
    figure, foot = make_figure(title, pitch * len(shown) - 0.25, legend)
    highest = max((float(np.nanmax(values[i])) for i in shown if np.isfinite(values[i]).any()), default=1.0)
    for row, i in enumerate(reversed(shown)):
        axes = make_panel(figure, LEFT, foot + pitch * row, WIDTH - LEFT - RIGHT, _PANEL_HEIGHT)
        color = pick_color(i)
        axes.plot(np.arange(len(values[i])), values[i], ".-", color=color, lw=1.4, ms=5)
        at = np.asarray(cuts[i], dtype=np.intp)
        axes.plot(at, values[i][at], "v", ms=8, mfc="white", mec=INK, mew=1.2, zorder=4)
        for node in at:
            axes.axvline(node, color=INK, lw=0.8, ls=":")
        if model.chains:
            axes.axhline(2e3 * model.chains[0].radius, color=DIMENSION, lw=1.0, ls="--")
        axes.set(xlim=(-1, max(len(values[i]), 2)), ylim=(0, 1.08 * highest))
        axes.xaxis.set_major_locator(ticker.MaxNLocator(integer=True, steps=[1, 2, 5, 10]))
        axes.set_ylabel("d* / mm", fontsize=FONT_SIZE)
        axes.set_title(f"chain {i}", loc="left", fontsize=FONT_SIZE, pad=3, color=color)
        if row == 0:
            axes.set_xlabel("node", fontsize=FONT_SIZE)
    return figure


def draw_segments(model: Model) -> Figure:
    """Draw the segments after the split, with the ends of ropes and of segments (fig. 12)."""
    parts, cloud = take_stage(model, "segments"), take_stage(model, "axis_points")
    title = f"{len(parts)} {'segment' if len(parts) == 1 else 'segments'} after the split"
    legend = [
        make_dot("rope's end", PALETTE[3], edge=INK),
        make_dot("segment's end", "white", edge=INK),
        make_dot("axis points", GRAY),
    ]
    drawing = make_drawing(model, cloud, title, legend)
    drawing.draw_points(cloud, GRAY)
    drawing.draw_lines(color_paths(parts))
    ends = find_ends(parts)
    drawing.draw_markers(ends, "o", "white")
    # the chain may extend a little beyond its last segment: mark the nearest end
    last = [np.linalg.norm(ends - end, axis=1).argmin() for end in find_rope_ends(model)]
    drawing.draw_markers(ends[np.array(last, dtype=np.intp)], "o", PALETTE[3])
    drawing.draw_numbers(parts)
    return drawing.figure


def _color_directions(directions: ArrayLike) -> Array:
    """Return (N, 3) colours of (N, 2) directions in the plan: hue by direction, pale if steep."""
    right, up = np.asarray(directions, dtype=np.float64).T
    hue = np.arctan2(up, right) / (2 * np.pi) % 1.0
    parts = np.stack([hue, np.minimum(np.hypot(right, up), 1.0), np.full_like(hue, 0.8)], axis=1)
    return np.asarray(import_extra("matplotlib.colors").hsv_to_rgb(parts))
