"""Draw figures of a reconstruction, stage by stage."""

from __future__ import annotations

import os
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strand._core import NotEnoughDataError
from strand.report.drawing import (
    FONT_SIZE,
    GRAY,
    INK,
    LEFT,
    MAX_NAMES,
    MAX_POINTS,
    RIGHT,
    WIDTH,
    Plan,
    make_dot,
    make_drawing,
    make_figure,
    make_line_entries,
    make_panel,
    make_stroke,
)
from strand.report.drawn_chains import (
    close_path,
    color_paths,
    compute_deviations,
    find_ends,
    find_junctions,
    find_rope_ends,
)
from strand.report.published_figures import (
    draw_axis_points,
    draw_chains,
    draw_normals,
    draw_segments,
    draw_separation,
)
from strand.report.tables import find_branch, take_stage
from strand.ropes.chain import Chain
from strand.ropes.model import Model, list_model_crossings
from strand.ropes.notebook import PALETTE
from strand.support.checks import Array, check_clouds, check_finite_array, check_instance, check_path
from strand.support.extras import import_extra
from strand.support.files import write_bytes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# the figures of each method, in the order of its stages
_FIGURES = {
    "tubes": ("raw", "filtered", "registered", "arcs", "ropes", "residuals", "uncertainty", "cameras"),
    "images": ("raw", "filtered", "registered", "ropes", "uncertainty", "cameras"),
    "harness": ("raw", "filtered", "registered", "arcs", "ropes", "residuals", "uncertainty", "cameras"),
    "published": (
        *("raw", "filtered", "normals", "registered", "axis-points", "chains"),
        *("separation", "segments", "strings", "cameras"),
    ),
}
_DOUBT_MARKER = "X"
_DOUBT_COLOR = "#ffd92f"
_MAX_LENGTHS = 4  # chains whose length is in a title
_DEVIATION_HEIGHT = 1.5  # panel of standard deviations, inches
_SUPPORT_HEIGHT = 0.7  # panel of the number of points below it, inches
_SUPPORT_GAP = 0.12  # between these two panels, inches
_CHAIN_GAP = 0.55  # between the panels of two chains, inches


def write_figures(
    model: Model, directory: str | os.PathLike[str], truth: Sequence[ArrayLike] = ()
) -> list[Path]:
    """Draw the result of each stage to a PNG file.

    - All methods: raw, filtered and registered points, the chains with their doubts, and the cameras.
    - Tubes: the observed arcs, the residuals of the fit, and the uncertainty of the nodes too.
    - Images: the uncertainty of the nodes too.
    - Harnesses: the figures of tubes, with edges for chains, and the junctions marked.
    - The published method: normals, axis points and traced chains (fig. 6), the separation d* with the cuts
      (fig. 11) and the segments (fig. 12) too; its chains are called strings (fig. 13).

    Parameters
    ----------
    model : Model
        Made with `keep_stages=True`.
    directory : str or path-like
        The folder for the files, made if needed. Files of the same names are replaced.
    truth : sequence of (M, 3) array_like of float
        True centrelines in the world frame, metres, to draw with the chains.

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
    centerlines = check_clouds("truth", truth)
    directory = check_path("directory", directory)
    names = _FIGURES[find_branch(model)]
    directory.mkdir(parents=True, exist_ok=True)
    paths = []
    for number, name in enumerate(names, 1):
        ropes = name in ("ropes", "strings")
        figure = draw_ropes(model, centerlines) if ropes else _DRAW[name](model)
        paths.append(directory / f"{number}-{name}.png")
        _write(figure, paths[-1])
    return paths


def plot_over_points(model: Model, points: ArrayLike, path: str | os.PathLike[str]) -> None:
    """Draw a model's chains over points, in plan, to a PNG file.

    Parameters
    ----------
    model : Model
        With or without its stages.
    points : (N, 3) array_like of float
        Points in the world frame, metres.
    path : str or path-like
        The file; an existing one is replaced.

    Raises
    ------
    ImportError
        If matplotlib is not installed.
    OSError
        If the file cannot be written.
    """
    cloud, path = check_finite_array("points", points, ("N", 3)), check_path("path", path)
    check_instance("model", model, Model)
    names = [f"chain {i}: {chain.length * 1e3:.0f} mm" for i, chain in enumerate(model.chains)]
    entries = [make_dot("points", GRAY), *make_line_entries(names)]
    drawing = make_drawing(model, cloud, "Chains over the points", entries, elevation=False)
    drawing.draw_points(cloud, GRAY, size=2.0)
    paths = [close_path(chain) for chain in model.chains]
    drawing.draw_lines(color_paths(paths), width=2.6)
    drawing.draw_markers(find_rope_ends(model), "o", PALETTE[3])
    _write(drawing.figure, path)


def draw_raw(model: Model) -> Figure:
    """Draw the points inside the extraction range, in the poses of the views (fig. 6 a)."""
    return _draw_by_view(model, take_stage(model, "raw"), "Raw points inside the extraction range")


def draw_filtered(model: Model) -> Figure:
    """Draw the points that the outlier filter kept (fig. 6 b)."""
    return _draw_by_view(model, take_stage(model, "filtered"), "Points after outlier removal")


def draw_registered(model: Model) -> Figure:
    """Draw the points in the registered poses (fig. 6 d)."""
    return _draw_by_view(model, take_stage(model, "registered"), "Registered points")


def draw_ropes(model: Model, truth: Sequence[ArrayLike] = ()) -> Figure:
    """Draw the model's chains, coloured by arc length, over the registered points (fig. 13).

    Nodes that no point supports, where a rope bridges a gap, are dotted. Crossings as seen in the plan, and
    places of doubts, are marked.
    """
    cloud = np.vstack(take_stage(model, "registered"))
    count = len(model.chains)
    lengths = ", ".join(f"{chain.length * 1e3:.0f} mm" for chain in model.chains[:_MAX_LENGTHS])
    what = "chain" if model.harness is None else "edge"
    title = f"{count} {what}{'' if count == 1 else 's'}: {lengths}{', …' if count > _MAX_LENGTHS else ''}"
    legend = [make_dot("registered points", GRAY), make_dot("rope's end", PALETTE[3], edge=INK)]
    bridged = np.vstack(
        [np.empty((0, 3)), *(chain.points[_find_bare_nodes(chain)] for chain in model.chains)]
    )
    if len(bridged):
        legend.append(make_dot("node without points", "white", edge=INK, size=3.5))
    crossed = _find_crossings(model, cloud)
    if len(crossed):
        legend.append(make_dot("crossing", "none", edge=INK, marker="s"))
    junctions = find_junctions(model)
    if len(junctions):
        legend.append(make_dot("junction", INK))
    unsure = _find_doubts(model)
    if len(unsure):
        legend.append(_make_doubt_entry())
    centerlines = check_clouds("truth", truth)
    if centerlines:
        legend.append(
            import_extra("matplotlib.lines").Line2D([], [], color=INK, lw=0.9, ls="--", label="truth")
        )
    drawing = make_drawing(model, cloud, title, legend, bar=True)
    drawing.draw_points(cloud, GRAY)
    longest = max((chain.length for chain in model.chains), default=0.0)
    colors = drawing.draw_color_bar(0.0, max(1e3 * longest, 1e-9), "cool", "arc length / mm")
    lines = []
    for chain in model.chains:
        path = close_path(chain)
        steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
        lines.append((path, colors(1e3 * (np.cumsum(steps) - steps / 2))))
    drawing.draw_lines(lines, width=3.0)
    drawing.draw_markers(bridged, "o", "white", size=2.5)
    for line in centerlines:
        where = drawing.plan.to_millimeters(line)
        for axes, across, up, _ in drawing.panels:
            axes.plot(where[:, across], where[:, up], color=INK, lw=0.9, ls="--", zorder=4)
    drawing.draw_markers(find_rope_ends(model), "o", PALETTE[3])
    drawing.draw_markers(crossed, "s", "none", size=15.0)
    drawing.draw_markers(junctions, "o", INK, size=5.0)
    if model.harness is not None:
        drawing.draw_numbers([chain.points for chain in model.chains], first=0)
    drawing.draw_markers(unsure, _DOUBT_MARKER, _DOUBT_COLOR)
    return drawing.figure


def draw_cameras(model: Model) -> Figure:
    """Draw the cameras in their registered poses, their directions, the next view, chains and doubts.

    A camera whose z axis does not point at the chains is drawn without a direction: its view may hold
    points in the world frame.
    """
    lines = [close_path(chain) for chain in check_instance("model", model, Model).chains]
    nodes = np.vstack([np.empty((0, 3)), *lines])
    centers, ahead = model.poses[:, :3, 3], model.poses[:, :3, 2]
    away = np.linalg.norm(centers - nodes.mean(axis=0), axis=1) if len(nodes) else np.ones(len(centers))
    inwards = ((nodes.mean(axis=0) - centers) * ahead).sum(axis=1) if len(nodes) else np.zeros(len(centers))
    looking = inwards > 0.5 * away
    tips = (centers + 0.25 * away[:, None] * ahead)[looking]
    try:
        advised = model.next_view(count=1)[0].position[None]
    except NotEnoughDataError:  # nothing to look at
        advised = np.empty((0, 3))
    unsure, count = _find_doubts(model), len(centers)
    legend = [make_dot("camera", PALETTE[0], edge=INK)]
    if len(tips):
        legend.append(make_stroke("the way it looks", PALETTE[0]))
    if len(lines):
        legend.append(make_stroke("chain", INK))
    if len(advised):
        legend.append(make_dot("next view", PALETTE[2], edge=INK))
    if len(unsure):
        legend.append(_make_doubt_entry())
    title = f"{count} {'camera' if count == 1 else 'cameras'}, "
    title += f"{len(lines)} {'chain' if len(lines) == 1 else 'chains'}"
    drawing = make_drawing(model, np.vstack([nodes, centers, tips, advised]), title, legend)
    drawing.draw_lines([(line, INK) for line in lines], width=1.4)
    drawing.draw_lines(
        [(np.stack(ray), PALETTE[0]) for ray in zip(centers[looking], tips, strict=True)], width=1.2
    )
    drawing.draw_markers(centers, "o", PALETTE[0])
    drawing.draw_markers(advised, "D", PALETTE[2])
    drawing.draw_markers(unsure, _DOUBT_MARKER, _DOUBT_COLOR)
    return drawing.figure


def draw_arcs(model: Model) -> Figure:
    """Draw the observed arcs and their ends before they are linked."""
    parts, cloud = take_stage(model, "arcs"), np.vstack(take_stage(model, "registered"))
    legend = [make_dot("arc's end", "white", edge=INK), make_dot("registered points", GRAY)]
    drawing = make_drawing(model, cloud, f"{len(parts)} {'arc' if len(parts) == 1 else 'arcs'} seen", legend)
    drawing.draw_points(cloud, GRAY)
    drawing.draw_lines(color_paths(parts))
    drawing.draw_markers(find_ends(parts), "o", "white")
    drawing.draw_numbers(parts)
    return drawing.figure


def draw_residuals(model: Model) -> Figure:
    """Draw the distances of the points from the fitted surface.

    A patch of one colour is an error of the tubes or the poses. Noise alone gives a mix of colours.
    """
    fit = take_stage(model, "fit")
    share = 100.0 * float(np.mean(fit.explained))
    title = f"Residuals: sd {fit.sigma * 1e3:.2f} mm, {share:.1f} % of {len(fit.points):,} points explained"
    legend = [] if fit.explained.all() else [make_dot("point that no tube explains", INK)]
    drawing = make_drawing(model, fit.points, title, legend, bar=True, elevation=False)
    limit = max(3e3 * fit.sigma, 1e-6)
    colors = drawing.draw_color_bar(-limit, limit, "coolwarm", "residual / mm (above 0: outside)")
    explained = np.flatnonzero(fit.explained)
    # in random order: in order of depth, points with positive noise would cover the others
    some = np.random.default_rng(0).permutation(explained)[:MAX_POINTS]
    axes, across, up, _ = drawing.panels[0]
    where = drawing.plan.to_millimeters(fit.points[some])
    each = colors(1e3 * fit.residual[some])
    axes.scatter(where[:, across], where[:, up], s=4.0, c=each, linewidths=0, antialiaseds=False)
    drawing.draw_points(fit.points[~fit.explained], INK, size=4.0)
    return drawing.figure


def draw_uncertainty(model: Model) -> Figure:
    """Draw the standard deviation of the nodes in their worst direction, and their numbers of points."""
    lengths = [chain.length for chain in check_instance("model", model, Model).chains]
    shown = sorted(sorted(range(len(lengths)), key=lambda i: -lengths[i])[:MAX_NAMES])
    title = "Standard deviation of the nodes, and the points that see them"
    if len(shown) < len(model.chains):
        title += f" (the {len(shown)} longest of {len(model.chains)})"
    legend = [make_stroke("in the worst direction", PALETTE[0])]
    if any(_find_bare_nodes(model.chains[i]).any() for i in shown):
        legend.append(make_dot("node without points", PALETTE[3]))
    pitch = _DEVIATION_HEIGHT + _SUPPORT_GAP + _SUPPORT_HEIGHT + _CHAIN_GAP
    figure, foot = make_figure(title, max(pitch * len(shown) - 0.25, 1.0), legend)
    ticker = import_extra("matplotlib.ticker")
    deviations = {
        i: 1e3 * values for i in shown if (values := compute_deviations(model.chains[i])) is not None
    }
    highest = max((float(values.max()) for values in deviations.values()), default=1.0)
    farthest = max((1e3 * model.chains[i].length for i in shown), default=1.0)
    for row, i in enumerate(reversed(shown)):
        chain, bottom = model.chains[i], foot + pitch * row
        s, without = 1e3 * chain.arc_length, _find_bare_nodes(chain)
        below = make_panel(figure, LEFT, bottom, WIDTH - LEFT - RIGHT, _SUPPORT_HEIGHT)
        raised = bottom + _SUPPORT_HEIGHT + _SUPPORT_GAP
        above = make_panel(figure, LEFT, raised, WIDTH - LEFT - RIGHT, _DEVIATION_HEIGHT)
        assert chain.points_seen is not None
        below.fill_between(s, chain.points_seen, step="mid", color=GRAY, lw=0)
        below.plot(s[without], np.zeros(int(without.sum())), "o", ms=3, color=PALETTE[3], clip_on=False)
        above.plot(s, deviations[i], color=PALETTE[0], lw=1.6)
        above.plot(s[without], deviations[i][without], "o", ms=3, color=PALETTE[3])
        for axes in (above, below):
            axes.set(xlim=(-0.01 * farthest, 1.01 * farthest))
        above.set(ylim=(0, 1.08 * highest))
        above.yaxis.set_major_locator(ticker.MaxNLocator(4, steps=[1, 2, 5, 10]))
        below.set(ylim=(0, None))
        above.tick_params(labelbottom=False)
        above.set_ylabel("sd / mm", fontsize=FONT_SIZE)
        below.set_ylabel("points", fontsize=FONT_SIZE)
        above.set_title(f"rope {i}", loc="left", fontsize=FONT_SIZE, pad=3)
        if row == 0:
            below.set_xlabel("arc length / mm", fontsize=FONT_SIZE)
    return figure


def _find_bare_nodes(chain: Chain) -> NDArray[np.bool_]:
    """Return (M,) whether a node has no points; all False if not known."""
    if chain.points_seen is None:
        return np.zeros(len(chain.points), dtype=bool)
    return np.asarray(chain.points_seen == 0)


def _draw_by_view(model: Model, clouds: Sequence[Array], title: str) -> Figure:
    points = np.vstack(clouds)
    view = np.repeat(np.arange(len(clouds)), [len(cloud) for cloud in clouds])
    # neighbouring views have similar colours, which shows their order
    colors = import_extra("matplotlib").colormaps["turbo"](np.linspace(0.08, 0.92, len(clouds)))
    legend = [make_dot(f"view {i}", color) for i, color in enumerate(colors[: 2 * MAX_NAMES])]
    if len(clouds) > len(legend):
        legend.append(make_dot(f"and {len(clouds) - len(legend)} more", "none"))
    drawing = make_drawing(model, points, f"{title}: {len(points):,}", legend)
    drawing.draw_points(points, colors[view])
    return drawing.figure


def _find_doubts(model: Model) -> Array:
    """Return (N, 3) the places of the doubts that have one."""
    return np.array([d.place for d in model.doubts if d.place is not None]).reshape(-1, 3)


def _make_doubt_entry() -> Any:
    return import_extra("matplotlib.lines").Line2D(
        [], [], ls="", marker=_DOUBT_MARKER, mfc=_DOUBT_COLOR, mec=INK, label="doubt"
    )


def _find_crossings(model: Model, cloud: Array) -> Array:
    """Return (K, 3) the places of the crossings in the plan."""
    plan = Plan.from_viewpoints(model.poses[:, :3, 3], cloud if len(cloud) else np.zeros((1, 3)))
    towards = plan.signs[2] * np.eye(3)[plan.axes[2]]
    met = list_model_crossings(model, towards)
    return np.vstack([np.empty((0, 3)), *(crossing.place for crossing in met or ())])


def _write(figure: Figure, path: Path) -> None:
    data = BytesIO()
    canvas = import_extra("matplotlib.backends.backend_agg").FigureCanvasAgg(figure)
    canvas.print_png(data)
    write_bytes(path, data.getvalue())


_DRAW = {
    "raw": draw_raw,
    "filtered": draw_filtered,
    "normals": draw_normals,
    "registered": draw_registered,
    "arcs": draw_arcs,
    "axis-points": draw_axis_points,
    "chains": draw_chains,
    "separation": draw_separation,
    "segments": draw_segments,
    "residuals": draw_residuals,
    "uncertainty": draw_uncertainty,
    "cameras": draw_cameras,
}
