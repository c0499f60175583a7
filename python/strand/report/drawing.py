"""Draw points and polylines in plan and elevation on one scale, with a legend and a colour bar.

The plan looks along the world axis that points most towards the cameras. The elevation below it shows the
same points from the side. Nearer things cover farther ones.
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

DPI = 150  # pixels per inch
WIDTH = 8.0  # width of a figure, inches
MAX_HEIGHT = 7.0  # height of all panels together, inches
LEFT = 0.75  # margin for labels, inches
RIGHT = 0.25  # margin, inches
TOP = 0.45  # margin for the title, inches
BOTTOM = 0.6  # margin for labels, inches
GAP = 0.2  # space between plan and elevation, inches
LEGEND_ROW = 0.25  # height of a row of the legend, inches
BAR = 0.9  # width kept for a colour bar, inches
FONT_SIZE = 10  # of labels, points
_ENTRY_WIDTH = 0.55  # width of a legend entry without its name, inches
_LETTER_WIDTH = 0.085  # width of a letter in the legend, inches

GRAY = "#c0c0c0"  # colour of clouds of points
DIMENSION = "#777777"  # colour of lines that show a dimension
INK = "#202020"  # colour of edges and text
MAX_POINTS = 15_000  # points that are drawn
MAX_NAMES = 8  # chains in a legend, and chains with a panel each


@dataclass(frozen=True)
class Plan:
    """The world axes that point right, up and towards the reader in the plan.

    Attributes
    ----------
    axes : tuple of int
        Indices of the world axes, 0 to 2.
    signs : tuple of int
        1, or -1 for a world axis that points the other way.
    """

    axes: tuple[int, int, int]
    signs: tuple[int, int, int]

    @classmethod
    def from_viewpoints(cls, viewpoints: Array, points: Array) -> Plan:
        """Return the plan from the side of the points where most of the cameras are."""
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

    def to_millimeters(self, points: Array) -> Array:
        """Return (N, 3) coordinates to the right, up and towards the reader, millimetres."""
        return 1e3 * np.reshape(points, (-1, 3))[:, self.axes]

    def find_depth(self, points: Array) -> Array:
        """Return (N,) positions towards the reader, metres."""
        return np.asarray(self.signs[2] * points[:, self.axes[2]])

    def name_axis(self, which: int) -> str:
        """Return the label of one of the three axes."""
        return f"{'xyz'[self.axes[which]]} / mm"


@dataclass(frozen=True)
class Drawing:
    """A figure with a plan and, optionally, an elevation below it.

    Attributes
    ----------
    figure : matplotlib.figure.Figure
    plan : Plan
    panels : tuple of (Axes, int, int, function)
        Each panel, the columns of `Plan.to_millimeters` that it shows, and a function that returns the
        depth of points in it.
    bar : Axes or None
        The place of the colour bar.
    """

    figure: Figure
    plan: Plan
    panels: tuple[tuple[Axes, int, int, Callable[[Array], Array]], ...]
    bar: Axes | None

    def draw_points(self, points: Array, colors: Any, size: float = 1.5) -> None:
        """Draw points, the farther ones first; `colors` is one colour, or one for each point."""
        keep = pick_spread(len(points), MAX_POINTS)
        for axes, across, up, depth in self.panels:
            order = keep[np.argsort(depth(points[keep]), kind="stable")]
            where = self.plan.to_millimeters(points[order])
            each = colors if isinstance(colors, str) else colors[order]
            # smoothed edges would make the file several times larger
            axes.scatter(
                where[:, across], where[:, up], s=size, c=each, marker="o", linewidths=0, antialiaseds=False
            )

    def draw_lines(self, lines: Iterable[tuple[Array, Any]], width: float = 2.2) -> None:
        """Draw polylines so that nearer strands cross over farther ones.

        Each line comes with one colour, or with one for each of its pieces.
        """
        pieces, colors = [], []
        for points, color in lines:
            pieces += list(pairwise(points))
            colors += [color] * (len(points) - 1) if isinstance(color, str) else list(color)
        if not pieces:
            return
        middles = np.asarray(pieces).mean(axis=1)
        for axes, across, up, depth in self.panels:
            for rank, i in enumerate(np.argsort(depth(middles), kind="stable")):
                ends = self.plan.to_millimeters(np.asarray(pieces[i]))
                x, y, z = ends[:, across], ends[:, up], 3 + 1e-6 * rank
                axes.plot(x, y, color="white", lw=2.2 * width, solid_capstyle="butt", zorder=z)
                axes.plot(x, y, color=colors[i], lw=width, solid_capstyle="round", zorder=z)

    def draw_markers(self, points: Array, marker: str, color: str, size: float = 7.0) -> None:
        """Draw markers over everything else."""
        where = self.plan.to_millimeters(points)
        for axes, across, up, _ in self.panels:
            x, y = where[:, across], where[:, up]
            axes.plot(x, y, marker, ms=size, mfc=color, mec=INK, mew=0.8, zorder=5)

    def draw_numbers(self, lines: Sequence[Array], first: int = 1) -> None:
        """Write each polyline's number, counted from `first`, beside its middle, in the plan."""
        axes, across, up, _ = self.panels[0]
        for i, points in enumerate(lines, first):
            where = self.plan.to_millimeters(points)[:, [across, up]]
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
                fontsize=FONT_SIZE,
                color=INK,
                zorder=6,
            )

    def draw_color_bar(self, low: float, high: float, colors: str, label: str) -> Callable[[Array], Array]:
        """Draw the colour bar; return the function that converts values to colours."""
        matplotlib = import_extra("matplotlib")
        mapping = matplotlib.cm.ScalarMappable(matplotlib.colors.Normalize(low, high), colors)
        bar = self.figure.colorbar(mapping, cax=self.bar)
        bar.set_label(label, fontsize=FONT_SIZE)
        bar.ax.tick_params(labelsize=9)
        return lambda values: np.asarray(mapping.to_rgba(values))


def make_drawing(
    model: Model,
    points: Array,
    title: str,
    legend: Sequence[Any] = (),
    bar: bool = False,
    elevation: bool = True,
) -> Drawing:
    """Make a figure whose panels show all points on one scale."""
    if len(points) == 0:
        points = np.zeros((1, 3))
    plan = Plan.from_viewpoints(model.poses[:, :3, 3], points)
    flat = plan.to_millimeters(points)
    margin = 0.04 * max(float(np.ptp(flat[:, :2], axis=0).max()), 1.0)
    low, high = flat.min(axis=0) - margin, flat.max(axis=0) + margin
    across, up, deep = high - low
    tall = up + (deep if elevation else 0.0)
    room = WIDTH - LEFT - RIGHT - (BAR if bar else 0.0)
    scale = min(room / across, MAX_HEIGHT / tall)  # inches per millimetre
    figure, foot = make_figure(title, scale * tall + (GAP if elevation else 0.0), legend)
    left = LEFT + (room - scale * across) / 2
    locators = import_extra("matplotlib.ticker")

    def add_panel(bottom: float, rows: float, column: int) -> Axes:
        axes = make_panel(figure, left, bottom, scale * across, scale * rows)
        for name, k in (("xlim", 0), ("ylim", column)):
            axes.set(**{name: (low[k], high[k]) if plan.signs[k] > 0 else (high[k], low[k])})
        axes.set_ylabel(plan.name_axis(column), fontsize=FONT_SIZE)
        ticks = min(max(2, int(scale * rows / 0.3)), 8)
        axes.yaxis.set_major_locator(locators.MaxNLocator(ticks, steps=[1, 2, 5, 10]))
        return axes

    shown = []
    bottom = foot
    if elevation:
        # the elevation looks from below the plan
        shown.append((add_panel(foot, deep, 2), 0, 2, lambda p: -plan.signs[1] * p[:, plan.axes[1]]))
        bottom += scale * deep + GAP
    shown.insert(0, (add_panel(bottom, up, 1), 0, 1, plan.find_depth))
    shown[0][0].tick_params(labelbottom=not elevation)
    shown[-1][0].set_xlabel(plan.name_axis(0), fontsize=FONT_SIZE)
    colors = (
        make_panel(figure, left + scale * across + 0.2, foot, 0.16, bottom + scale * up - foot)
        if bar
        else None
    )
    return Drawing(figure, plan, tuple(shown), colors)


def make_figure(title: str, panels: float, legend: Sequence[Any]) -> tuple[Figure, float]:
    """Make a figure with room for `panels` inches of panels; return it and the height where they begin."""
    names = [entry.get_label() for entry in legend]
    columns, foot = 1, BOTTOM
    if names:
        widths = [_ENTRY_WIDTH + _LETTER_WIDTH * len(name) for name in names]
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
    """Add axes to a figure; lengths are in inches."""
    across, up = figure.get_size_inches()
    axes = figure.add_axes((left / across, bottom / up, width / across, height / up))
    axes.tick_params(labelsize=9)
    axes.grid(color="#e8e8e8", lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    return axes


def make_dot(label: str, color: Any, edge: Any = None, marker: str = "o", size: float = 7.0) -> Any:
    """Make a legend entry for points; the size is in points of print."""
    lines = import_extra("matplotlib.lines")
    edge = color if edge is None else edge
    return lines.Line2D([], [], ls="", marker=marker, ms=size, mfc=color, mec=edge, mew=0.8, label=label)


def make_stroke(label: str, color: Any) -> Any:
    """Make a legend entry for a line."""
    return import_extra("matplotlib.lines").Line2D([], [], color=color, lw=2.2, label=label)


def make_line_entries(names: Sequence[str]) -> list[Any]:
    """Make legend entries for several lines in the palette's colours."""
    entries = [make_stroke(name, PALETTE[i % len(PALETTE)]) for i, name in enumerate(names[:MAX_NAMES])]
    if len(names) > MAX_NAMES:
        entries.append(make_stroke(f"and {len(names) - MAX_NAMES} more", "none"))
    return entries


def pick_spread(count: int, most: int) -> np.ndarray[Any, np.dtype[np.intp]]:
    """Return the indices of at most `most` of `count` things, spread at random but reproducibly."""
    if count <= most:
        return np.arange(count)
    return np.sort(np.random.default_rng(0).permutation(count)[:most])
