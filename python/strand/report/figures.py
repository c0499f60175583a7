"""Figures of a reconstruction, stage by stage."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strand.report.sheet import (
    DIMENSION,
    GREY,
    INK,
    LEFT,
    MAX_NAMES,
    MAX_POINTS,
    RIGHT,
    WIDTH,
    Plan,
    make_dot,
    make_figure,
    make_line_entries,
    make_panel,
    make_sheet,
    make_stroke,
    pick_spread,
)
from strand.report.tables import find_stage_names
from strand.ropes.chain import Chain
from strand.ropes.crossings import list_crossings
from strand.ropes.model import Model
from strand.ropes.notebook import PALETTE
from strand.support.checks import Array
from strand.support.extras import import_extra
from strand.support.files import write_bytes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_NORMALS = 800
# marker and colour of a doubt's place
_DOUBT = ("X", "#ffd92f")


def write_figures(
    model: Model, directory: str | os.PathLike[str], truth: Sequence[ArrayLike] = ()
) -> list[Path]:
    """Draw what every stage made, one PNG file a figure.

    Raw points, filtered points, registered points, the arcs seen, the chains with what is doubted, the
    residuals of the fit, the uncertainty of the nodes, and the cameras. By the published method raw points,
    filtered points, normals, registered points, axis points and traced chains (fig. 6 a-f), the separation d*
    over the nodes with the cuts (fig. 11), the segments with their ends (fig. 12), the strings (fig. 13), and
    the cameras.

    Parameters
    ----------
    model : Model
        Made with `keep_stages=True`.
    directory : str or path-like
        Where the files go; made if it does not exist. Files of the same names are replaced.
    truth : sequence of (M, 3) array_like of float
        True centrelines in the world frame, metres, to draw with the ropes.

    Returns
    -------
    list of Path
        The files, in the order of the stages.

    Raises
    ------
    ValueError
        If the model was made without its stages.
    ImportError
        If matplotlib is not installed.
    OSError
        If a file cannot be written.
    """
    centrelines = tuple(np.asarray(line, dtype=np.float64) for line in truth)
    figures: dict[str, Callable[[], Figure]]
    if find_stage_names(model) == "published":
        figures = {
            "1-raw.png": lambda: draw_raw(model),
            "2-filtered.png": lambda: draw_filtered(model),
            "3-normals.png": lambda: draw_normals(model),
            "4-registered.png": lambda: draw_registered(model),
            "5-axis-points.png": lambda: draw_axis_points(model),
            "6-chains.png": lambda: draw_chains(model),
            "7-separation.png": lambda: draw_separation(model),
            "8-segments.png": lambda: draw_segments(model),
            "9-strings.png": lambda: draw_ropes(model, centrelines),
            "10-cameras.png": lambda: draw_cameras(model),
        }
    elif find_stage_names(model) == "images":
        figures = {
            "1-raw.png": lambda: draw_raw(model),
            "2-filtered.png": lambda: draw_filtered(model),
            "3-registered.png": lambda: draw_registered(model),
            "4-ropes.png": lambda: draw_ropes(model, centrelines),
            "5-uncertainty.png": lambda: draw_uncertainty(model),
            "6-cameras.png": lambda: draw_cameras(model),
        }
    else:
        figures = {
            "1-raw.png": lambda: draw_raw(model),
            "2-filtered.png": lambda: draw_filtered(model),
            "3-registered.png": lambda: draw_registered(model),
            "4-arcs.png": lambda: draw_arcs(model),
            "5-ropes.png": lambda: draw_ropes(model, centrelines),
            "6-residuals.png": lambda: draw_residuals(model),
            "7-uncertainty.png": lambda: draw_uncertainty(model),
            "8-cameras.png": lambda: draw_cameras(model),
        }
    directory = Path(directory)
    directory.mkdir(parents=True, exist_ok=True)
    for name, draw in figures.items():
        _write(draw(), directory / name)
    return [directory / name for name in figures]


def plot_over_points(model: Model, points: ArrayLike, path: str | os.PathLike[str]) -> None:
    """Draw a model's chains over the points they came from, in plan, to one PNG file.

    Parameters
    ----------
    model : Model
        With or without its stages.
    points : (N, 3) array_like of float
        Points in the world frame, metres.
    path : str or path-like
        The file; one that exists is replaced.

    Raises
    ------
    ImportError
        If matplotlib is not installed.
    OSError
        If the file cannot be written.
    """
    cloud = np.asarray(points, dtype=np.float64)
    names = [f"chain {i}: {chain.length * 1e3:.0f} mm" for i, chain in enumerate(model.chains)]
    entries = [make_dot("points", GREY), *make_line_entries(names)]
    sheet = make_sheet(model, cloud, "Chains over the points", entries, elevation=False)
    sheet.points(cloud, GREY, size=2.0)
    paths = [_closed(chain.points, chain.closed) for chain in model.chains]
    sheet.lines(_coloured(paths), width=2.6)
    sheet.markers(_rope_ends(model), "o", PALETTE[3])
    _write(sheet.figure, Path(path))


def draw_raw(model: Model) -> Figure:
    """Points inside the extraction range, as the views' poses place them (fig. 6 a)."""
    return _by_view(model, model.stages["raw"], "Raw points inside the extraction range")


def draw_filtered(model: Model) -> Figure:
    """Points that the outlier removal kept (fig. 6 b)."""
    return _by_view(model, model.stages["filtered"], "Points after outlier removal")


def draw_registered(model: Model) -> Figure:
    """Points in the registered poses (fig. 6 d)."""
    return _by_view(model, model.stages["registered"], "Registered points")


def draw_normals(model: Model) -> Figure:
    """Points, some of them with their outward unit normals (fig. 6 c)."""
    points, vectors = np.vstack(model.stages["filtered"]), np.vstack(model.stages["normals"])
    key = {"right": (1, 0), "up": (0, 1), "left": (-1, 0), "down": (0, -1)}
    key["towards the reader"] = (0, 0)
    key_colours = _direction_colours(np.array(list(key.values())))
    legend = [make_stroke(name, colour) for name, colour in zip(key, key_colours, strict=True)]
    sheet = make_sheet(model, points, f"Normals at {len(points):,} points", legend)
    sheet.points(points[pick_spread(len(points), MAX_POINTS // 3)], GREY, size=1.0)
    reach = 0.03 * float(np.ptp(points, axis=0).max())
    some = pick_spread(len(points), MAX_NORMALS)
    collections = import_extra("matplotlib.collections")
    for axes, across, up, depth in sheet.panels:
        order = some[np.argsort(depth(points[some]), kind="stable")]
        feet, tips = sheet.plan.of(points[order]), sheet.plan.of(points[order] + reach * vectors[order])
        pieces = np.stack([feet, tips], axis=1)[:, :, [across, up]]
        each = _direction_colours(sheet.plan.of(vectors[order])[:, :2] * sheet.plan.signs[:2] / 1e3)
        axes.add_collection(collections.LineCollection(list(pieces), colors=each, linewidths=0.9))
    return sheet.figure


def draw_axis_points(model: Model) -> Figure:
    """Points moved inwards onto the ropes' axes, and averaged (fig. 6 e)."""
    points = model.stages["axis_points"]
    sheet = make_sheet(model, points, f"{len(points):,} axis points", bar=True)
    height = sheet.plan.of(points)[:, 2]
    colours = sheet.scale(height.min(), height.max(), "viridis", sheet.plan.label(2))
    sheet.points(points, colours(height), size=2.0)
    return sheet.figure


def draw_chains(model: Model) -> Figure:
    """Chains as they were traced (fig. 6 f)."""
    traced, cloud = model.stages["traced"], model.stages["axis_points"]
    names = [f"chain {i}: {len(chain)} nodes" for i, chain in enumerate(traced)]
    title = f"{len(traced)} {'chain' if len(traced) == 1 else 'chains'} traced"
    sheet = make_sheet(model, cloud, title, make_line_entries(names))
    sheet.points(cloud, GREY)
    sheet.lines(_coloured(traced))
    for i, chain in enumerate(traced):
        sheet.markers(chain, "o", PALETTE[i % len(PALETTE)], size=3.5)
    return sheet.figure


def draw_separation(model: Model) -> Figure:
    """Separation d* over the node index, with the cuts at its local minima (fig. 11)."""
    traced, cuts = model.stages["traced"], model.stages["cuts"]
    values = [np.where(np.isfinite(d), 1e3 * d, np.nan) for d in model.stages["separation"]]
    shown = sorted(sorted(range(len(traced)), key=lambda i: -len(traced[i]))[:MAX_NAMES])
    lines, ticker = import_extra("matplotlib.lines"), import_extra("matplotlib.ticker")
    legend = [lines.Line2D([], [], marker="v", ls=":", color=INK, mfc="white", mew=1.2, ms=8, label="cut")]
    if model.chains:
        legend.append(lines.Line2D([], [], color=DIMENSION, ls="--", label="rope's diameter 2 r"))
    title = "Separation d* along the chains"
    if len(shown) < len(traced):
        title += f" (the {len(shown)} longest of {len(traced)})"
    panel, gap = 1.6, 0.5
    figure, foot = make_figure(title, (panel + gap) * len(shown) - 0.25, legend)
    highest = max((float(np.nanmax(values[i])) for i in shown if np.isfinite(values[i]).any()), default=1.0)
    for row, i in enumerate(reversed(shown)):
        axes = make_panel(figure, LEFT, foot + (panel + gap) * row, WIDTH - LEFT - RIGHT, panel)
        colour = PALETTE[i % len(PALETTE)]
        axes.plot(np.arange(len(values[i])), values[i], ".-", color=colour, lw=1.4, ms=5)
        at = np.asarray(cuts[i], dtype=np.intp)
        axes.plot(at, values[i][at], "v", ms=8, mfc="white", mec=INK, mew=1.2, zorder=4)
        for node in at:
            axes.axvline(node, color=INK, lw=0.8, ls=":")
        if model.chains:
            axes.axhline(2e3 * model.chains[0].radius, color=DIMENSION, lw=1.0, ls="--")
        axes.set(xlim=(-1, max(len(values[i]), 2)), ylim=(0, 1.08 * highest))
        axes.xaxis.set_major_locator(ticker.MaxNLocator(integer=True, steps=[1, 2, 5, 10]))
        axes.set_ylabel("d* / mm", fontsize=10)
        axes.set_title(f"chain {i}", loc="left", fontsize=10, pad=3, color=colour)
        if row == 0:
            axes.set_xlabel("node", fontsize=10)
    return figure


def draw_segments(model: Model) -> Figure:
    """Segments that the split left, with the ropes' ends and the ends at crossings (fig. 12)."""
    parts, cloud = model.stages["segments"], model.stages["axis_points"]
    title = f"{len(parts)} {'segment' if len(parts) == 1 else 'segments'} after the split"
    legend = [
        make_dot("rope's end", PALETTE[3], edge=INK),
        make_dot("segment's end", "white", edge=INK),
        make_dot("axis points", GREY),
    ]
    sheet = make_sheet(model, cloud, title, legend)
    sheet.points(cloud, GREY)
    sheet.lines(_coloured(parts))
    ends = _ends(parts)
    sheet.markers(ends, "o", "white")
    # a rope may go on a little beyond its last segment
    last = [np.linalg.norm(ends - end, axis=1).argmin() for end in _rope_ends(model)]
    sheet.markers(ends[np.array(last, dtype=np.intp)], "o", PALETTE[3])
    sheet.numbers(parts)
    return sheet.figure


def draw_ropes(model: Model, truth: Sequence[Array] = ()) -> Figure:
    """Draw the model's chains, coloured by arc length, over the registered points (fig. 13).

    Nodes that no point supports, where a rope bridges a gap, are dotted. Crossings as seen in the plan, and
    places of doubts, are marked.
    """
    cloud = np.vstack(model.stages["registered"])
    count = len(model.chains)
    lengths = ", ".join(f"{chain.length * 1e3:.0f} mm" for chain in model.chains[:4])
    title = f"{count} {'chain' if count == 1 else 'chains'}: {lengths}{', …' if count > 4 else ''}"
    legend = [make_dot("registered points", GREY), make_dot("rope's end", PALETTE[3], edge=INK)]
    bridged = np.vstack([np.empty((0, 3)), *(chain.points[_bridged(chain)] for chain in model.chains)])
    if len(bridged):
        legend.append(make_dot("node without points", "white", edge=INK))
    crossed = _crossed(model, cloud)
    if len(crossed):
        legend.append(make_dot("crossing", "none", edge=INK))
    unsure = _doubted(model)
    if len(unsure):
        legend.append(_doubt_entry())
    if truth:
        legend.append(
            import_extra("matplotlib.lines").Line2D([], [], color=INK, lw=0.9, ls="--", label="truth")
        )
    sheet = make_sheet(model, cloud, title, legend, bar=True)
    sheet.points(cloud, GREY)
    longest = max((chain.length for chain in model.chains), default=0.0)
    colours = sheet.scale(0.0, max(1e3 * longest, 1e-9), "cool", "arc length / mm")
    lines = []
    for chain in model.chains:
        path = _closed(chain.points, chain.closed)
        steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
        lines.append((path, colours(1e3 * (np.cumsum(steps) - steps / 2))))
    sheet.lines(lines, width=3.0)
    sheet.markers(bridged, "o", "white", size=2.5)
    for line in truth:
        where = sheet.plan.of(line)
        for axes, across, up, _ in sheet.panels:
            axes.plot(where[:, across], where[:, up], color=INK, lw=0.9, ls="--", zorder=4)
    sheet.markers(_rope_ends(model), "o", PALETTE[3])
    sheet.markers(crossed, "o", "none", size=16.0)
    sheet.markers(unsure, *_DOUBT)
    return sheet.figure


def draw_cameras(model: Model) -> Figure:
    """Draw where the cameras stood in their registered poses, which way they looked, and the next view.

    Chains and places of doubts are drawn too. Poses whose z axis does not lead to the chains, as of points in
    the world frame, have no direction.
    """
    lines = [_closed(chain.points, chain.closed) for chain in model.chains]
    nodes = np.vstack([np.empty((0, 3)), *lines])
    centres, ahead = model.poses[:, :3, 3], model.poses[:, :3, 2]
    away = np.linalg.norm(centres - nodes.mean(axis=0), axis=1) if len(nodes) else np.ones(len(centres))
    inwards = ((nodes.mean(axis=0) - centres) * ahead).sum(axis=1) if len(nodes) else np.zeros(len(centres))
    looking = inwards > 0.5 * away
    tips = (centres + 0.25 * away[:, None] * ahead)[looking]
    try:
        advised = model.next_view()[None]
    except ValueError:  # nothing to look at
        advised = np.empty((0, 3))
    unsure, count = _doubted(model), len(centres)
    legend = [make_dot("camera", PALETTE[0], edge=INK)]
    if len(tips):
        legend.append(make_stroke("the way it looks", PALETTE[0]))
    if len(lines):
        legend.append(make_stroke("chain", INK))
    if len(advised):
        legend.append(make_dot("next view", PALETTE[2], edge=INK))
    if len(unsure):
        legend.append(_doubt_entry())
    title = f"{count} {'camera' if count == 1 else 'cameras'}, "
    title += f"{len(lines)} {'chain' if len(lines) == 1 else 'chains'}"
    sheet = make_sheet(model, np.vstack([nodes, centres, tips, advised]), title, legend)
    sheet.lines([(line, INK) for line in lines], width=1.4)
    sheet.lines([(np.stack(ray), PALETTE[0]) for ray in zip(centres[looking], tips, strict=True)], width=1.2)
    sheet.markers(centres, "o", PALETTE[0])
    sheet.markers(advised, "D", PALETTE[2])
    sheet.markers(unsure, *_DOUBT)
    return sheet.figure


def draw_arcs(model: Model) -> Figure:
    """Arcs that the views saw of the ropes, with their ends, before they were linked."""
    parts, cloud = model.stages["arcs"], np.vstack(model.stages["registered"])
    legend = [make_dot("arc's end", "white", edge=INK), make_dot("registered points", GREY)]
    sheet = make_sheet(model, cloud, f"{len(parts)} {'arc' if len(parts) == 1 else 'arcs'} seen", legend)
    sheet.points(cloud, GREY)
    sheet.lines(_coloured(parts))
    sheet.markers(_ends(parts), "o", "white")
    sheet.numbers(parts)
    return sheet.figure


def draw_residuals(model: Model) -> Figure:
    """Distances of the points from the fitted surface: what is left after the fit, and where.

    A patch of one colour is something that the tubes or the poses do not describe; noise alone is mixed.
    """
    fit = model.stages["fit"]
    share = 100.0 * float(np.mean(fit.explained))
    title = f"Residuals: sd {fit.sigma * 1e3:.2f} mm, {share:.1f} % of {len(fit.points):,} points explained"
    legend = [] if fit.explained.all() else [make_dot("point that no tube explains", INK)]
    sheet = make_sheet(model, fit.points, title, legend, bar=True, elevation=False)
    limit = max(3e3 * fit.sigma, 1e-6)
    colours = sheet.scale(-limit, limit, "coolwarm", "residual / mm (above 0: outside)")
    explained = np.flatnonzero(fit.explained)
    # in no order: the nearer points are those that noise carries outwards, and would hide the others
    some = np.random.default_rng(0).permutation(explained)[:MAX_POINTS]
    axes, across, up, _ = sheet.panels[0]
    where = sheet.plan.of(fit.points[some])
    each = colours(1e3 * fit.residual[some])
    axes.scatter(where[:, across], where[:, up], s=4.0, c=each, linewidths=0, antialiaseds=False)
    sheet.points(fit.points[~fit.explained], INK, size=4.0)
    return sheet.figure


def draw_uncertainty(model: Model) -> Figure:
    """Draw the nodes' standard deviation in their worst direction, and how many points see them."""
    shown = sorted(sorted(range(len(model.chains)), key=lambda i: -model.chains[i].length)[:MAX_NAMES])
    title = "Standard deviation of the nodes, and the points that see them"
    if len(shown) < len(model.chains):
        title += f" (the {len(shown)} longest of {len(model.chains)})"
    legend = [make_stroke("in the worst direction", PALETTE[0])]
    if any(_bridged(model.chains[i]).any() for i in shown):
        legend.append(make_dot("node without points", PALETTE[3]))
    upper, lower, between, gap = 1.5, 0.7, 0.12, 0.55
    pitch = upper + between + lower + gap
    figure, foot = make_figure(title, max(pitch * len(shown) - 0.25, 1.0), legend)
    ticker = import_extra("matplotlib.ticker")
    deviations = {i: 1e3 * _deviations(model.chains[i]) for i in shown}
    highest = max((float(values.max()) for values in deviations.values()), default=1.0)
    farthest = max((1e3 * model.chains[i].length for i in shown), default=1.0)
    for row, i in enumerate(reversed(shown)):
        chain, bottom = model.chains[i], foot + pitch * row
        s, without = 1e3 * chain.arc_length, _bridged(chain)
        below = make_panel(figure, LEFT, bottom, WIDTH - LEFT - RIGHT, lower)
        above = make_panel(figure, LEFT, bottom + lower + between, WIDTH - LEFT - RIGHT, upper)
        assert chain.points_seen is not None
        below.fill_between(s, chain.points_seen, step="mid", color=GREY, lw=0)
        below.plot(s[without], np.zeros(int(without.sum())), "o", ms=3, color=PALETTE[3], clip_on=False)
        above.plot(s, deviations[i], color=PALETTE[0], lw=1.6)
        above.plot(s[without], deviations[i][without], "o", ms=3, color=PALETTE[3])
        for axes in (above, below):
            axes.set(xlim=(-0.01 * farthest, 1.01 * farthest))
        above.set(ylim=(0, 1.08 * highest))
        above.yaxis.set_major_locator(ticker.MaxNLocator(4, steps=[1, 2, 5, 10]))
        below.set(ylim=(0, None))
        above.tick_params(labelbottom=False)
        above.set_ylabel("sd / mm", fontsize=10)
        below.set_ylabel("points", fontsize=10)
        above.set_title(f"rope {i}", loc="left", fontsize=10, pad=3)
        if row == 0:
            below.set_xlabel("arc length / mm", fontsize=10)
    return figure


def _deviations(chain: Chain) -> Array:
    """(M,) Standard deviation of each node in its worst direction, metres."""
    assert chain.covariance is not None
    variances = np.linalg.eigvalsh(chain.covariance)[:, -1]
    return np.asarray(np.sqrt(np.maximum(variances, 0.0)))


def _bridged(chain: Chain) -> NDArray[np.bool_]:
    """(M,) Which nodes no point supports, as far as that is known."""
    if chain.points_seen is None:
        return np.zeros(len(chain.points), dtype=bool)
    return np.asarray(chain.points_seen == 0)


def _by_view(model: Model, clouds: Sequence[Array], title: str) -> Figure:
    points = np.vstack(clouds)
    view = np.repeat(np.arange(len(clouds)), [len(cloud) for cloud in clouds])
    # neighbouring views in neighbouring colours: the order of the views shows
    colours = import_extra("matplotlib").colormaps["turbo"](np.linspace(0.08, 0.92, len(clouds)))
    legend = [make_dot(f"view {i}", colour) for i, colour in enumerate(colours[: 2 * MAX_NAMES])]
    if len(clouds) > len(legend):
        legend.append(make_dot(f"and {len(clouds) - len(legend)} more", "none"))
    sheet = make_sheet(model, points, f"{title}: {len(points):,}", legend)
    sheet.points(points, colours[view])
    return sheet.figure


def _direction_colours(directions: ArrayLike) -> Array:
    """Colour (N, 2) parts of unit vectors in the plan: hue by direction, pale if steep."""
    right, up = np.asarray(directions, dtype=np.float64).T
    hue = np.arctan2(up, right) / (2 * np.pi) % 1.0
    parts = np.stack([hue, np.minimum(np.hypot(right, up), 1.0), np.full_like(hue, 0.8)], axis=1)
    return np.asarray(import_extra("matplotlib.colors").hsv_to_rgb(parts))


def _coloured(paths: Iterable[Array]) -> list[tuple[Array, str]]:
    return [(path, PALETTE[i % len(PALETTE)]) for i, path in enumerate(paths)]


def _ends(paths: Iterable[Array]) -> Array:
    """(2 N, 3) First and last points of N paths."""
    return np.array([end for path in paths for end in (path[0], path[-1])]).reshape(-1, 3)


def _doubted(model: Model) -> Array:
    """(N, 3) Places of the doubts that have one."""
    return np.array([d.place for d in model.doubts if d.place is not None]).reshape(-1, 3)


def _doubt_entry() -> Any:
    marker, colour = _DOUBT
    return import_extra("matplotlib.lines").Line2D(
        [], [], ls="", marker=marker, mfc=colour, mec=INK, label="doubt"
    )


def _rope_ends(model: Model) -> Array:
    return _ends(chain.points for chain in model.chains if not chain.closed)


def _crossed(model: Model, cloud: Array) -> Array:
    """(K, 3) Places of the crossings that the plan shows."""
    plan = Plan.towards(model.poses[:, :3, 3], cloud if len(cloud) else np.zeros((1, 3)))
    towards = plan.signs[2] * np.eye(3)[plan.axes[2]]
    met = list_crossings(model.chains, towards, model.doubts)
    return np.vstack([np.empty((0, 3)), *(crossing.place for crossing in met)])


def _closed(points: Array, closed: bool) -> Array:
    return np.vstack([points, points[:1]]) if closed else points


def _write(figure: Figure, path: Path) -> None:
    data = BytesIO()
    canvas = import_extra("matplotlib.backends.backend_agg").FigureCanvasAgg(figure)
    canvas.print_png(data)
    write_bytes(path, data.getvalue())
