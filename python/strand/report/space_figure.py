"""Describe an interactive 3D figure for plotly: points, chains, crossings, doubts and cameras."""

from __future__ import annotations

import colorsys
from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand._core import NotEnoughDataError
from strand.geometry.polyline import find_runs
from strand.report.cameras import Camera
from strand.report.drawing import INK
from strand.report.drawn_chains import compute_deviations
from strand.report.drawn_points import choose_points
from strand.report.plotly_traces import Pen, join_with_gaps, pack_numbers
from strand.ropes.chain import Chain
from strand.ropes.model import Model, list_model_crossings
from strand.ropes.notebook import PALETTE
from strand.ropes.seen_side import find_seen_side
from strand.support.checks import Array

# these keep the page small: a point takes 16 bytes, a node 80
MAX_POINTS = 40_000  # points that are drawn
MAX_NODES = 8_000  # nodes of all chains that are drawn
MAX_TRUE_NODES = 2_000  # nodes of all true centrelines that are drawn
MAX_PLACES = 150  # ends, crossings, doubts, joins and cameras, each
MAX_GROUPS = 30  # entries in the legend for views, and for chains
_MAX_OFFSET = 10.0  # metres from the origin: farther away, 32-bit numbers lose parts of a millimetre
_PYRAMID_DEPTH = 0.18  # depth of a camera's pyramid, of its distance from the ropes
_FIELD_HEIGHT = 2 * np.tan(np.radians(22.5))  # height of the field of plotly's camera, of its distance
_STEEP_Z = 0.95  # directions with a larger z count as vertical
UNSEEN = "#9467bd"  # violet: stretches without points
DOUBT = "#d62728"  # red: doubts
CROSSING = "#ff7f0e"  # orange: crossings
NEXT_VIEW = "#2ca02c"  # green: the next view
CAMERA = "#555555"  # grey: cameras


@dataclass(frozen=True, eq=False)
class _Line:
    """The drawn nodes of a chain; a closed chain repeats the first one at the end.

    Attributes
    ----------
    number : int
        Number of the chain, from 0.
    chain : Chain
    points : (K, 3) ndarray
        World frame, metres.
    along, sd : (K,) ndarray
        Arc length, and standard deviation in the worst direction (NaN if not known), millimetres.
    bridged : (K,) ndarray of bool
        Whether a node has no points.
    """

    number: int
    chain: Chain
    points: Array
    along: Array
    sd: Array
    bridged: NDArray[np.bool_]


def make_space_figure(
    model: Model, clouds: Sequence[Array], cameras: Sequence[Camera | None], truth: Sequence[Array] = ()
) -> dict[str, Any]:
    """Return `data` and `layout` for `Plotly.newPlot`, in millimetres.

    Parameters
    ----------
    model : Model
    clouds : sequence of (N, 3) ndarray
        Points of each view, world frame, metres.
    cameras : sequence of Camera or None
        Camera of each view.
    truth : sequence of (M, 3) ndarray
        True centrelines, world frame, metres.
    """
    nodes = [chain.points for chain in model.chains]
    subject = np.vstack([np.empty((0, 3)), *(nodes or clouds)])
    subject = subject if len(subject) else np.zeros((1, 3))
    viewpoints = np.array([camera.viewpoint for camera in cameras if camera is not None]).reshape(-1, 3)
    distance = np.linalg.norm(viewpoints - subject.mean(axis=0), axis=1)
    towards, up = _find_direction(subject, cameras)
    next_view = _find_next_view(model)
    box = np.vstack([subject, viewpoints, next_view, *clouds])
    far = np.abs(box).max() >= _MAX_OFFSET
    pen = Pen(np.round(subject.mean(axis=0)) if far else np.zeros(3))
    lines = _thin_chains(model.chains)
    points = _draw_views(pen, clouds, model)
    chains = _draw_chains(pen, lines)
    stood = _draw_cameras(pen, cameras, _PYRAMID_DEPTH * float(np.median(distance)) if len(distance) else 0.0)
    stood += _draw_next_view(pen, next_view, subject.mean(axis=0))
    data = (
        points
        + chains
        + _draw_unseen(pen, lines)
        + _draw_places(pen, model)
        + _draw_truth(pen, truth)
        + stood
    )
    standing = list(range(len(data) - len(stood), len(data)))
    scene = make_scene(pen, box)
    near, wide = place_cameras(scene, 1e3 * (subject - pen.origin), towards, up)
    layout: dict[str, Any] = {
        "scene": scene | {"camera": near},
        "coloraxis": _make_color_axis("arc length / mm", [line.along for line in lines], "Viridis"),
        "legend": {"itemsizing": "constant", "groupclick": "togglegroup", "x": 1.0, "y": 0.94},
        "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
        "meta": {"width": measure_width(subject, near)},
    }
    menus: list[list[tuple[str, str, list[Any]]]] = [
        [
            ("ropes", "update", [{"visible": "legendonly"}, {"scene.camera": near}, standing]),
            ("ropes and cameras", "update", [{"visible": True}, {"scene.camera": wide}, standing]),
        ]
    ]
    if points:
        which = list(range(len(points)))
        menus.append(
            [
                ("points", "restyle", [{"visible": True}, which]),
                ("no points", "restyle", [{"visible": "legendonly"}, which]),
            ]
        )
    if any(np.isfinite(line.sd).any() for line in lines):
        menus.append(
            _make_color_buttons(
                lines, [len(points) + k for k, trace in enumerate(chains) if "customdata" in trace]
            )
        )
    layout["updatemenus"] = [_make_menu(entries, row) for row, entries in enumerate(menus)]
    return {"data": data, "layout": layout}


def _find_direction(subject: Array, cameras: Sequence[Camera | None]) -> tuple[Array, Array | None]:
    """Return (3,) directions towards the middle one of the cameras, and up in its image; None without any."""
    there = [camera for camera in cameras if camera is not None]
    viewpoints = np.array([camera.viewpoint for camera in there]).reshape(-1, 3)
    side = find_seen_side(subject, viewpoints)
    rays = viewpoints - subject.mean(axis=0)
    lengths = np.linalg.norm(rays, axis=1, keepdims=True)
    if not len(there) or not lengths.min() > 0.0:
        return side, None
    rays = rays / lengths
    middle = int((rays @ side).argmax())
    return rays[middle], -there[middle].pose[:3, 1]


def _split_groups(count: int) -> list[list[int]]:
    """Split `count` things into groups of neighbours, one for each entry of the legend."""
    parts = np.array_split(np.arange(count), max(min(count, MAX_GROUPS), 1))
    return [part.tolist() for part in parts if len(part)]


def _draw_views(pen: Pen, clouds: Sequence[Array], model: Model) -> list[dict[str, Any]]:
    """Draw the points, most of them near ropes; neighbouring views have similar colours."""
    total = sum(map(len, clouds))
    share = min(MAX_POINTS / max(total, 1), 1.0)
    groups = _split_groups(len(clouds))
    traces = []
    for k, group in enumerate(groups):
        points = np.vstack([clouds[i] for i in group])
        kept = choose_points(points, model, int(share * len(points)))
        name = f"view {group[0]}" if len(group) == 1 else f"views {group[0]} to {group[-1]}"
        some = f"{len(points):,}" if len(kept) == len(points) else f"{len(kept):,} of {len(points):,}"
        marker = {"color": _pick_hue(k / max(len(groups) - 1, 1)), "size": 1.6, "opacity": 0.4}
        trace = pen.make_trace(kept, "markers", f"{name}: {some} points")
        traces.append(trace | {"marker": marker, "hoverinfo": "skip"})
    return traces


def _pick_hue(part: float) -> str:
    red, green, blue = (round(255 * c) for c in colorsys.hls_to_rgb(0.62 - 0.5 * part, 0.55, 0.6))
    return f"rgb({red},{green},{blue})"


def _thin_chains(chains: Sequence[Chain]) -> list[_Line]:
    every = max(ceil(sum(len(chain.points) for chain in chains) / MAX_NODES), 1)
    lines = []
    for number, chain in enumerate(chains):
        kept = np.unique(np.append(np.arange(0, len(chain.points), every), len(chain.points) - 1))
        along, sd = 1e3 * chain.arc_length[kept], compute_deviations(chain)
        if chain.closed:
            kept, along = np.append(kept, 0), np.append(along, 1e3 * chain.length)
        known = np.full(len(kept), np.nan) if sd is None else 1e3 * sd[kept]
        lines.append(_Line(number, chain, chain.points[kept], along, known, chain.bridged[kept]))
    return lines


def _draw_chains(pen: Pen, lines: Sequence[_Line]) -> list[dict[str, Any]]:
    """Draw the seen parts of the chains, and empty lines for the legend, which needs one colour each."""
    traces = []
    for group in _split_groups(len(lines)):
        members = [lines[i] for i in group]
        first, last = members[0], members[-1]
        name = f"chain {first.number}: {first.chain.length * 1e3:.0f} mm"
        if first is not last:
            name = f"chains {first.number} to {last.number}"
        shared = {"legendgroup": name, "showlegend": False, "hoverinfo": None}
        trace = pen.draw_lines([_hide_bridges(line) for line in members], name, INK, 9, **shared)
        trace["line"] = {
            "color": _round_values([line.along for line in members]),
            "coloraxis": "coloraxis",
            "width": 9,
        }
        about = [np.column_stack([np.full(len(m.along), m.number), m.along, m.sd]) for m in members]
        known = any(np.isfinite(line.sd).any() for line in members)
        traces.append(
            trace
            | {
                "customdata": pack_numbers(join_with_gaps(about)),
                "hovertemplate": "chain %{customdata[0]:.0f} at %{customdata[1]:.0f} mm"
                + ("<br>standard deviation %{customdata[2]:.2f} mm" if known else "")
                + "<br>x %{x:.1f}, y %{y:.1f}, z %{z:.1f} mm<extra></extra>",
            }
        )
        traces.append(pen.draw_lines([np.full((1, 3), np.nan)], name, INK, 5, legendgroup=name))
    return traces


def _hide_bridges(line: _Line) -> Array:
    """Return (K, 3) the nodes of a chain, with NaN for bridged nodes between bridged nodes."""
    points, bridged = line.points.copy(), line.bridged
    beside = np.concatenate([[True], bridged, [True]])
    points[bridged & beside[:-2] & beside[2:]] = np.nan
    return points


def _round_values(parts: Sequence[Array]) -> list[float | None]:
    """Return the values of several lines in few digits, None for NaN, and 0 for the gap after each line."""
    values = [value for part in parts for value in (*part.tolist(), 0.0)]
    return [None if np.isnan(value) else float(f"{value:.4g}") for value in values]


def _draw_unseen(pen: Pen, lines: Sequence[_Line]) -> list[dict[str, Any]]:
    """Draw the stretches without points, extended to the next nodes."""
    stretches = [
        line.points[max(start - 1, 0) : stop + 1] for line in lines for start, stop in find_runs(line.bridged)
    ]
    if not stretches:
        return []
    trace = pen.draw_lines(stretches, "stretch that no view saw", UNSEEN, 5)
    trace["line"]["dash"] = "dot"
    return [trace | {"mode": "lines+markers", "marker": {"symbol": "square", "size": 3, "color": UNSEEN}}]


def _draw_places(pen: Pen, model: Model) -> list[dict[str, Any]]:
    """Draw ends, junctions, crossings, doubts and joins."""
    nodes = () if model.harness is None else model.harness.nodes
    named = [(node.position, f"{node.kind} {node.id}", node.kind) for node in nodes]
    junctions = [(place, text) for place, text, kind in named if kind == "junction"]
    ends = [(place, text) for place, text, kind in named if kind == "end"]
    if model.harness is None:
        ends = [
            (place, f"chain {i} {what}")
            for i, chain in enumerate(model.chains)
            if not chain.closed
            for place, what in ((chain.points[0], "starts"), (chain.points[-1], "ends"))
        ]
    met = list_model_crossings(model)
    crossed = [(crossing.place, str(crossing)) for crossing in met or ()]
    doubts = [
        (doubt.place, f"{doubt.kind}, weight {doubt.amount:.3f}: {doubt}")
        for doubt in model.doubts
        if doubt.place is not None
    ]
    joins = [
        (join.place, f"two segments joined; the second best way costs {join.margin:.2f} more")
        for join in model.joins
    ]
    traces = []
    for name, found, marker, visible in (
        ("end", ends, {"color": "white", "symbol": "circle", "size": 7}, True),
        ("junction", junctions, {"color": INK, "symbol": "circle", "size": 7}, True),
        ("doubt", doubts, {"color": DOUBT, "symbol": "circle-open", "size": 22}, True),
        ("crossing", crossed, {"color": CROSSING, "symbol": "square-open", "size": 12}, True),
        ("join", joins, {"color": PALETTE[4], "symbol": "diamond-open", "size": 8}, "legendonly"),
    ):
        if found:
            places, texts = zip(*found[:MAX_PLACES], strict=True)
            entry = f"{name}s: {len(found)}" if len(found) > 1 else name
            traces.append(pen.draw_markers(np.array(places), entry, marker, texts, visible=visible))
    return traces


def _draw_truth(pen: Pen, truth: Sequence[Array]) -> list[dict[str, Any]]:
    if not truth:
        return []
    every = max(ceil(sum(map(len, truth)) / MAX_TRUE_NODES), 1)
    return [
        pen.draw_lines([line[::every] for line in truth], "true centreline", INK, 3, visible="legendonly")
    ]


def _draw_cameras(pen: Pen, cameras: Sequence[Camera | None], depth: float) -> list[dict[str, Any]]:
    """Draw a pyramid from each camera to the corners of its image."""
    there = [(i, camera) for i, camera in enumerate(cameras) if camera is not None][:MAX_PLACES]
    if not there:
        return []
    lines = []
    for _, camera in there:
        corners = camera.find_corners(depth)
        lines += [np.vstack([corners, corners[:1]]), *(np.stack([camera.viewpoint, c]) for c in corners)]
    shared = {"legendgroup": "cameras", "visible": "legendonly"}
    texts = [f"camera of view {i}" for i, _ in there]
    viewpoints = np.array([camera.viewpoint for _, camera in there])
    marker = {"color": CAMERA, "size": 4}
    return [
        pen.draw_lines(lines, "cameras", CAMERA, 2, **shared),
        pen.draw_markers(viewpoints, "", marker, texts, showlegend=False, **shared),
    ]


def _find_next_view(model: Model) -> Array:
    """Return (1, 3) the place of the next view, or (0, 3) without one."""
    try:
        return model.next_view(count=1)[0].position[None]
    except NotEnoughDataError:  # no chains or no views
        return np.empty((0, 3))


def _draw_next_view(pen: Pen, place: Array, target: Array) -> list[dict[str, Any]]:
    if not len(place):
        return []
    shared = {"legendgroup": "next", "visible": "legendonly"}
    ray = pen.draw_lines([np.vstack([place, target])], "", NEXT_VIEW, 2, showlegend=False, **shared)
    marker = {"color": NEXT_VIEW, "symbol": "diamond", "size": 7}
    return [
        pen.draw_markers(
            place, "next view", marker, ["the most informative place for the next camera"], **shared
        ),
        ray,
    ]


def make_scene(pen: Pen, box: Array) -> dict[str, Any]:
    """Return axes around everything, on one scale."""
    low, high = 1e3 * (box.min(axis=0) - pen.origin), 1e3 * (box.max(axis=0) - pen.origin)
    margin = 0.02 * float((high - low).max()) + 1.0
    low, high = low - margin, high + margin
    scene: dict[str, Any] = {
        "aspectmode": "manual",
        "aspectratio": _name_axes((high - low) / (high - low).max()),
        "dragmode": "orbit",
    }
    for k, name in enumerate("xyz"):
        title = f"{name} / mm" if not pen.origin[k] else f"({name} − {pen.origin[k]:.0f} m) / mm"
        shown = {"title": {"text": title}, "showspikes": False, "gridcolor": "#dddddd"}
        scene[f"{name}axis"] = {"range": [float(low[k]), float(high[k])], **shown}
    return scene


def place_cameras(
    scene: dict[str, Any], subject: Array, towards: Array, up: Array | None = None
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the places of plotly's camera that show the ropes, and everything.

    By default, z is up, or y for a view along z.
    Its unit is the longest axis, its origin the middle of the box.
    """
    low, high = np.array([scene[f"{name}axis"]["range"] for name in "xyz"]).T
    unit = float((high - low).max())
    middle = (subject.min(axis=0) + subject.max(axis=0)) / 2
    extent = max(float(np.linalg.norm(np.ptp(subject, axis=0))) / unit, 0.02)
    if up is None:
        up = np.array([0.0, 0.0, 1.0]) if abs(towards[2]) < _STEEP_Z else np.array([0.0, 1.0, 0.0])
    near = _make_camera((middle - (low + high) / 2) / unit, towards, 1.15 * extent / _FIELD_HEIGHT, up)
    aside = towards + 0.7 * np.cross(up, towards)
    across = float(np.linalg.norm((high - low) / unit))
    return near, _make_camera(np.zeros(3), aside / np.linalg.norm(aside), 1.1 * across / _FIELD_HEIGHT, up)


def measure_width(subject: Array, camera: dict[str, Any]) -> float:
    """Return how wide plotly's camera sees the ropes, as a share of the extent that fits its height."""
    eye, center, up = (np.array([camera[name][axis] for axis in "xyz"]) for name in ("eye", "center", "up"))
    across = np.cross(up, eye - center)
    low, high = subject.min(axis=0), subject.max(axis=0)
    aside = np.abs((subject - (low + high) / 2) @ across).max() / max(np.linalg.norm(across), 1e-12)
    return float(2.0 * aside / max(np.linalg.norm(high - low), 1e-12))


def _make_camera(center: Array, towards: Array, distance: float, up: Array) -> dict[str, Any]:
    return {
        "center": _name_axes(center),
        "eye": _name_axes(center + distance * towards),
        "up": _name_axes(up),
    }


def _name_axes(vector: Array) -> dict[str, float]:
    return dict(zip("xyz", vector.tolist(), strict=True))


def _make_color_axis(title: str, values: Sequence[Array], colors: str) -> dict[str, Any]:
    highest = max((float(v) for part in values for v in part if np.isfinite(v)), default=1.0)
    bar = {"orientation": "h", "thickness": 12, "len": 0.4, "x": 0.25, "y": 0.0, "nticks": 5}
    bar["title"] = {"text": title, "side": "top"}
    return {"colorscale": colors, "cmin": 0.0, "cmax": max(highest, 1e-6), "colorbar": bar}


def _make_color_buttons(lines: Sequence[_Line], traces: list[int]) -> list[tuple[str, str, list[Any]]]:
    """Return buttons that color the chains by arc length or by standard deviation."""
    entries = []
    for name, colors, values in (
        ("arc length", "Viridis", [line.along for line in lines]),
        ("standard deviation", "Portland", [line.sd for line in lines]),
    ):
        each = [_round_values([values[i] for i in group]) for group in _split_groups(len(lines))]
        scale = {"coloraxis": _make_color_axis(f"{name} / mm", values, colors)}
        entries.append((name, "update", [{"line.color": each}, scale, traces]))
    return entries


def _make_menu(entries: Sequence[tuple[str, str, list[Any]]], row: int) -> dict[str, Any]:
    names = ("label", "method", "args")
    return {
        "type": "buttons",
        "direction": "right",
        "x": 0.005,
        "y": 0.99 - 0.065 * row,
        "xanchor": "left",
        "yanchor": "top",
        "buttons": [dict(zip(names, entry, strict=True)) for entry in entries],
    }
