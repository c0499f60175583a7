"""Sheets: a plan and an elevation of points and polylines on one scale, with legend and colour bar.

The plan looks along the world axis that points most towards the cameras; the elevation below it
shows the same points from the side, on the same scale. What is nearer is drawn over what is farther.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np

from strand.ropes.notebook import PALETTE
from strand.support.checks import Array
from strand.support.extras import import_extra

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from strand.ropes.model import Model

DPI = 150
WIDTH = 8.0  # inches
MAX_HEIGHT = 7.0  # inches, of the panels together
LEFT, RIGHT, TOP, BOTTOM, GAP, LEGEND_ROW = 0.75, 0.25, 0.45, 0.6, 0.2, 0.25
BAR = 0.9  # inches kept for a colour bar

GREY = "#c0c0c0"
DIMENSION = "#777777"
INK = "#202020"
MAX_POINTS = 15_000
MAX_NAMES = 8  # legend entries of chains, and panels of separations and uncertainties


@dataclass(frozen=True)
class Plan:
    """Which world axes lie to the right, upwards and towards the reader in the plan.

    Attributes
    ----------
    axes : tuple of int
        Indices of the world axes, 0 to 2.
    signs : tuple of int
        1, or -1 where the world axis points the other way.
    """

    axes: tuple[int, int, int]
    signs: tuple[int, int, int]

    @classmethod
    def towards(cls, viewpoints: Array, points: Array) -> Plan:
        """Plan seen from the side of the points on which most of the cameras stand."""
        rays = viewpoints - points.mean(axis=0)
        lengths = np.linalg.norm(rays, axis=1, keepdims=True)
        side = (rays / np.maximum(lengths, 1e-300)).mean(axis=0)
        axis = int(np.abs(side).argmax())
        front = bool(side[axis] > 0)
        if axis == 2:
            return cls((0, 1, 2), (1, 1, 1) if front else (1, -1, -1))
        if axis == 1:
            return cls((0, 2, 1), (1, -1, 1) if front else (1, 1, -1))
        return cls((1, 2, 0), (1, 1, 1) if front else (-1, 1, -1))

    def of(self, points: Array) -> Array:
        """(N, 3) Millimetres along the world axes to the right, upwards and towards the reader."""
        return 1e3 * np.reshape(points, (-1, 3))[:, self.axes]

    def depth(self, points: Array) -> Array:
        """(N,) How far towards the reader, in the plan."""
        return np.asarray(self.signs[2] * points[:, self.axes[2]])

    def label(self, which: int) -> str:
        """Name of one of the three axes."""
        return f"{'xyz'[self.axes[which]]} / mm"


@dataclass(frozen=True)
class Sheet:
    """A figure with a plan and, mostly, an elevation below it.

    Attributes
    ----------
    figure : matplotlib.figure.Figure
        What is written.
    plan : Plan
        The directions.
    panels : tuple of (Axes, int, int, (N, 3) array to (N,) array)
        Each panel with the columns of `Plan.of` that it shows, and the points' depth in it.
    bar : Axes or None
        Where a colour bar goes.
    """

    figure: Figure
    plan: Plan
    panels: tuple[tuple[Axes, int, int, Callable[[Array], Array]], ...]
    bar: Axes | None

    def points(self, points: Array, colours: Any, size: float = 1.5) -> None:
        """Draw points, the farther ones first; `colours` is one colour, or one for each point."""
        keep = pick_spread(len(points), MAX_POINTS)
        for axes, across, up, depth in self.panels:
            order = keep[np.argsort(depth(points[keep]), kind="stable")]
            where = self.plan.of(points[order])
            each = colours if isinstance(colours, str) else colours[order]
            # smoothed edges would make the file several times as big
            axes.scatter(
                where[:, across], where[:, up], s=size, c=each, marker="o", linewidths=0, antialiaseds=False
            )

    def lines(self, lines: Iterable[tuple[Array, Any]], width: float = 2.2) -> None:
        """Draw polylines so that the nearer strand crosses over the farther one.

        Each comes with one colour, or with one for each of its pieces.
        """
        pieces, colours = [], []
        for points, colour in lines:
            pieces += list(pairwise(points))
            colours += [colour] * (len(points) - 1) if isinstance(colour, str) else list(colour)
        if not pieces:
            return
        middles = np.asarray(pieces).mean(axis=1)
        for axes, across, up, depth in self.panels:
            for rank, i in enumerate(np.argsort(depth(middles), kind="stable")):
                ends = self.plan.of(np.asarray(pieces[i]))
                x, y, z = ends[:, across], ends[:, up], 3 + 1e-6 * rank
                axes.plot(x, y, color="white", lw=2.2 * width, solid_capstyle="butt", zorder=z)
                axes.plot(x, y, color=colours[i], lw=width, solid_capstyle="round", zorder=z)

    def markers(self, points: Array, marker: str, colour: str, size: float = 7.0) -> None:
        """Draw markers over everything else."""
        where = self.plan.of(points)
        for axes, across, up, _ in self.panels:
            x, y = where[:, across], where[:, up]
            axes.plot(x, y, marker, ms=size, mfc=colour, mec=INK, mew=0.8, zorder=5)

    def numbers(self, lines: Sequence[Array]) -> None:
        """Write each polyline's number beside its middle, in the plan."""
        axes, across, up, _ = self.panels[0]
        for i, points in enumerate(lines, 1):
            where = self.plan.of(points)[:, [across, up]]
            middle = len(where) // 2
            along = (where[min(middle + 1, len(where) - 1)] - where[middle - 1]) * self.plan.signs[:2]
            beside = np.array([-along[1], along[0]]) / max(float(np.hypot(*along)), 1e-12)
            axes.annotate(
                f"{i}",
                (float(where[middle, 0]), float(where[middle, 1])),
                xytext=(11 * beside[0], 11 * beside[1]),
                textcoords="offset points",
                ha="center",
                va="center",
                fontsize=10,
                color=INK,
                zorder=6,
            )

    def scale(self, low: float, high: float, colours: str, label: str) -> Callable[[Array], Array]:
        """Draw the colour bar; return what turns values into colours."""
        matplotlib = import_extra("matplotlib")
        mapping = matplotlib.cm.ScalarMappable(matplotlib.colors.Normalize(low, high), colours)
        bar = self.figure.colorbar(mapping, cax=self.bar)
        bar.set_label(label, fontsize=10)
        bar.ax.tick_params(labelsize=9)
        return lambda values: np.asarray(mapping.to_rgba(values))


def make_sheet(
    model: Model,
    points: Array,
    title: str,
    legend: Sequence[Any] = (),
    bar: bool = False,
    elevation: bool = True,
) -> Sheet:
    """Set up a figure whose panels show all of the points on one scale."""
    if len(points) == 0:
        points = np.zeros((1, 3))
    plan = Plan.towards(model.poses[:, :3, 3], points)
    flat = plan.of(points)
    margin = 0.04 * max(float(np.ptp(flat[:, :2], axis=0).max()), 1.0)
    low, high = flat.min(axis=0) - margin, flat.max(axis=0) + margin
    across, up, deep = high - low
    tall = up + (deep if elevation else 0.0)
    room = WIDTH - LEFT - RIGHT - (BAR if bar else 0.0)
    scale = min(room / across, MAX_HEIGHT / tall)  # inches per millimetre
    figure, foot = make_figure(title, scale * tall + (GAP if elevation else 0.0), legend)
    left = LEFT + (room - scale * across) / 2
    locators = import_extra("matplotlib.ticker")

    def panel(bottom: float, rows: float, column: int) -> Axes:
        axes = make_panel(figure, left, bottom, scale * across, scale * rows)
        for name, k in (("xlim", 0), ("ylim", column)):
            axes.set(**{name: (low[k], high[k]) if plan.signs[k] > 0 else (high[k], low[k])})
        axes.set_ylabel(plan.label(column), fontsize=10)
        ticks = min(max(2, int(scale * rows / 0.3)), 8)
        axes.yaxis.set_major_locator(locators.MaxNLocator(ticks, steps=[1, 2, 5, 10]))
        return axes

    shown = []
    bottom = foot
    if elevation:
        # seen from below the plan
        shown.append((panel(foot, deep, 2), 0, 2, lambda p: -plan.signs[1] * p[:, plan.axes[1]]))
        bottom += scale * deep + GAP
    shown.insert(0, (panel(bottom, up, 1), 0, 1, plan.depth))
    shown[0][0].tick_params(labelbottom=not elevation)
    shown[-1][0].set_xlabel(plan.label(0), fontsize=10)
    colours = (
        make_panel(figure, left + scale * across + 0.2, foot, 0.16, bottom + scale * up - foot)
        if bar
        else None
    )
    return Sheet(figure, plan, tuple(shown), colours)


def make_figure(title: str, panels: float, legend: Sequence[Any]) -> tuple[Figure, float]:
    """Make a figure with room for so many inches of panels; return it and where they begin."""
    names = [entry.get_label() for entry in legend]
    columns, foot = 1, BOTTOM
    if names:
        widths = [0.55 + 0.085 * len(name) for name in names]  # inches, at the legend's font size
        columns = len(names) if sum(widths) < WIDTH else max(int(WIDTH / max(widths)), 1)
        foot += LEGEND_ROW * ceil(len(names) / columns)
    height = TOP + panels + foot
    figure: Figure = import_extra("matplotlib.figure").Figure(
        figsize=(WIDTH, height), dpi=DPI, facecolor="white"
    )
    figure.suptitle(title, fontsize=12, y=1 - 0.14 / height, va="top")
    if names:
        figure.legend(
            handles=list(legend),
            loc="lower center",
            ncols=columns,
            fontsize=9,
            frameon=False,
            columnspacing=1.4,
            handletextpad=0.5,
            borderaxespad=0.2,
        )
    return figure, foot


def make_panel(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Add axes at a place in inches."""
    across, up = figure.get_size_inches()
    axes = figure.add_axes((left / across, bottom / up, width / across, height / up))
    axes.tick_params(labelsize=9)
    axes.grid(color="#e8e8e8", lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    return axes


def make_dot(label: str, colour: Any, edge: Any = None) -> Any:
    """Make a legend's entry for points."""
    lines = import_extra("matplotlib.lines")
    edge = colour if edge is None else edge
    return lines.Line2D([], [], ls="", marker="o", ms=7, mfc=colour, mec=edge, mew=0.8, label=label)


def make_stroke(label: str, colour: Any) -> Any:
    """Make a legend's entry for lines."""
    return import_extra("matplotlib.lines").Line2D([], [], color=colour, lw=2.2, label=label)


def make_line_entries(names: Sequence[str]) -> list[Any]:
    """Make a legend's entries for several lines in the palette's colours."""
    entries = [make_stroke(name, PALETTE[i % len(PALETTE)]) for i, name in enumerate(names[:MAX_NAMES])]
    if len(names) > MAX_NAMES:
        entries.append(make_stroke(f"and {len(names) - MAX_NAMES} more", "none"))
    return entries


def pick_spread(count: int, most: int) -> np.ndarray[Any, np.dtype[np.intp]]:
    """Pick the indices of at most so many of `count` things, spread without a pattern."""
    if count <= most:
        return np.arange(count)
    return np.sort(np.random.default_rng(0).permutation(count)[:most])
