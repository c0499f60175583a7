"""An interactive view in space, as plotly describes it: points by view, chains, and what is unsure."""

from __future__ import annotations

import colorsys
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strand.geometry.polyline import find_runs
from strand.report.cameras import Camera, find_seen_side
from strand.report.sheet import INK, pick_spread
from strand.ropes.chain import Chain
from strand.ropes.crossings import list_crossings
from strand.ropes.model import Model
from strand.ropes.notebook import PALETTE
from strand.support.checks import Array

# what is drawn at most, so that the page stays small: a point takes 16 bytes there, a node 80
MAX_POINTS = 40_000
MAX_NODES = 8_000
MAX_TRUE_NODES = 2_000
MAX_PLACES = 150  # of ends, crossings, doubts, joins and cameras each
MAX_GROUPS = 30  # of views and of chains, each with its own entry in the legend
_TEXT = 240  # characters of a doubt
# from so far away numbers of 32 bits do not tell parts of a millimetre, metres
_FAR = 10.0
# how deep a camera's pyramid is drawn, as a part of its distance from the ropes
_PYRAMID = 0.18
UNSEEN, DOUBT, CROSSING, NEXT, CAMERA = "#d62728", "#d62728", "#ff7f0e", "#2ca02c", "#555555"
# the height of the field that plotly's camera sees, as a part of its distance
_FIELD = 2 * np.tan(np.radians(22.5))


@dataclass(frozen=True, eq=False)
class _Line:
    """What is drawn of one chain: some of its nodes, the first one again if it is closed.

    Attributes
    ----------
    number : int
        From 1.
    chain : Chain
    points : (K, 3) ndarray
        World frame, metres.
    along, sd : (K,) ndarray
        Arc length and standard deviation in the worst direction, millimetres; NaN where that is not known.
    bridged : (K,) ndarray of bool
        Which of them no point supports.
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
    """Describe the view in space.

    Parameters
    ----------
    model : Model
        Its chains, doubts and joins.
    clouds : sequence of (N, 3) ndarray
        Points of each view, world frame, metres.
    cameras : sequence of Camera or None
        Each view's camera.
    truth : sequence of (M, 3) ndarray
        True centrelines, metres, where they are known.

    Returns
    -------
    dict
        `data` and `layout` for `Plotly.newPlot`; millimetres.
    """
    nodes = [chain.points for chain in model.chains]
    subject = np.vstack([np.empty((0, 3)), *(nodes or clouds)])
    subject = subject if len(subject) else np.zeros((1, 3))
    viewpoints = np.array([camera.viewpoint for camera in cameras if camera is not None]).reshape(-1, 3)
    distance = np.linalg.norm(viewpoints - subject.mean(axis=0), axis=1)
    towards = find_seen_side(subject, viewpoints)
    next_view = _next_view(model)
    box = np.vstack([subject, viewpoints, next_view, *clouds])
    far = np.abs(box).max() >= _FAR
    pen = Pen(np.round(subject.mean(axis=0)) if far else np.zeros(3))
    lines = _lines(model.chains)
    points = _views(pen, clouds)
    chains = _chains(pen, lines)
    stood = _cameras(pen, cameras, _PYRAMID * float(np.median(distance)) if len(distance) else 0.0)
    stood += _next(pen, next_view, subject.mean(axis=0))
    data = points + chains + _unseen(pen, lines) + _places(pen, model, towards) + _truth(pen, truth) + stood
    standing = list(range(len(data) - len(stood), len(data)))
    scene = _scene(pen, box)
    near, wide = _looks(scene, 1e3 * (subject - pen.origin), towards)
    layout: dict[str, Any] = {
        "scene": scene | {"camera": near},
        "coloraxis": _scale("arc length / mm", [line.along for line in lines], "Viridis"),
        "legend": {"itemsizing": "constant", "groupclick": "togglegroup", "x": 1.0, "y": 0.94},
        "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
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
            _recolouring(lines, [len(points) + k for k, trace in enumerate(chains) if "customdata" in trace])
        )
    layout["updatemenus"] = [_buttons(entries, row) for row, entries in enumerate(menus)]
    return {"data": data, "layout": layout}


class Pen:
    """Makes traces in millimetres from an origin, which is not the world's if that is far away."""

    def __init__(self, origin: Array) -> None:
        self.origin = origin

    def lines(
        self, lines: Sequence[Array], name: str, colour: str, width: int, **more: Any
    ) -> dict[str, Any]:
        """Make one trace of several polylines."""
        line = {"color": colour, "width": width}
        return self.trace(_with_gaps(lines), "lines", name) | {"line": line, "hoverinfo": "skip"} | more

    def markers(
        self, points: Array, name: str, marker: dict[str, Any], said: Sequence[str], **more: Any
    ) -> dict[str, Any]:
        """Make one trace of markers with texts to show under the pointer."""
        text = {"text": [_said(text) for text in said], "hoverinfo": "text"}
        edged = {"line": {"color": INK, "width": 1}} | marker
        return self.trace(points, "markers", name) | {"marker": edged} | text | more

    def trace(self, points: Array, mode: str, name: str) -> dict[str, Any]:
        """Make a trace of points, (N, 3) in metres of the world frame."""
        x, y, z = (pack_numbers(column) for column in (1e3 * (points - self.origin)).T)
        return {"type": "scatter3d", "x": x, "y": y, "z": z, "mode": mode, "name": name}


def pack_numbers(values: ArrayLike) -> dict[str, Any]:
    """Return numbers as plotly reads them from text: 32 bits each, in base 64."""
    array = np.ascontiguousarray(values, dtype="<f4")
    entry = {"dtype": "f4", "bdata": b64encode(array.tobytes()).decode()}
    return entry if array.ndim == 1 else {**entry, "shape": ", ".join(map(str, array.shape))}


def compute_deviations(chain: Chain) -> Array | None:
    """(M,) Standard deviation of each node in its worst direction, metres; None if it is not known."""
    if chain.covariance is None:
        return None
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(chain.covariance)[:, -1], 0.0)))


def _with_gaps(parts: Sequence[Array]) -> Array:
    """Rows of several parts, a row of NaN after each."""
    columns = parts[0].shape[1:] if parts else (3,)
    gap = np.full((1, *columns), np.nan)
    return np.concatenate([np.empty((0, *columns)), *(rows for part in parts for rows in (part, gap))])


def _said(text: str) -> str:
    """Return a text that plotly shows as it is: markup escaped, in lines that fit."""
    lines = [""]
    for word in text[:_TEXT].split():
        if lines[-1] and len(lines[-1]) + len(word) > 60:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return "<br>".join(escape(line) for line in lines)


def _groups(count: int) -> list[list[int]]:
    """Split so many things into groups of neighbours, each with one entry in the legend."""
    parts = np.array_split(np.arange(count), max(min(count, MAX_GROUPS), 1))
    return [part.tolist() for part in parts if len(part)]


def _views(pen: Pen, clouds: Sequence[Array]) -> list[dict[str, Any]]:
    """Points, neighbouring views in neighbouring colours."""
    total = sum(map(len, clouds))
    share = min(MAX_POINTS / max(total, 1), 1.0)
    groups = _groups(len(clouds))
    traces = []
    for k, group in enumerate(groups):
        points = np.vstack([clouds[i] for i in group])
        kept = points[pick_spread(len(points), int(share * len(points)))]
        name = f"view {group[0]}" if len(group) == 1 else f"views {group[0]} to {group[-1]}"
        some = f"{len(points):,}" if len(kept) == len(points) else f"{len(kept):,} of {len(points):,}"
        marker = {"color": _hue(k / max(len(groups) - 1, 1)), "size": 1.6, "opacity": 0.4}
        trace = pen.trace(kept, "markers", f"{name}: {some} points")
        traces.append(trace | {"marker": marker, "hoverinfo": "skip"})
    return traces


def _hue(part: float) -> str:
    red, green, blue = (round(255 * c) for c in colorsys.hls_to_rgb(0.62 - 0.5 * part, 0.55, 0.6))
    return f"rgb({red},{green},{blue})"


def _lines(chains: Sequence[Chain]) -> list[_Line]:
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


def _chains(pen: Pen, lines: Sequence[_Line]) -> list[dict[str, Any]]:
    """Draw what was seen of the chains, with entries apart: the legend knows no lines of many colours."""
    traces = []
    for group in _groups(len(lines)):
        members = [lines[i] for i in group]
        first, last = members[0], members[-1]
        name = f"chain {first.number}: {first.chain.length * 1e3:.0f} mm"
        if first is not last:
            name = f"chains {first.number} to {last.number}"
        shared = {"legendgroup": name, "showlegend": False, "hoverinfo": None}
        trace = pen.lines([_seen(line) for line in members], name, INK, 9, **shared)
        trace["line"] = {
            "color": _rounded([line.along for line in members]),
            "coloraxis": "coloraxis",
            "width": 9,
        }
        about = [np.column_stack([np.full(len(m.along), m.number), m.along, m.sd]) for m in members]
        known = any(np.isfinite(line.sd).any() for line in members)
        traces.append(
            trace
            | {
                "customdata": pack_numbers(_with_gaps(about)),
                "hovertemplate": "chain %{customdata[0]:.0f} at %{customdata[1]:.0f} mm"
                + ("<br>standard deviation %{customdata[2]:.2f} mm" if known else "")
                + "<br>x %{x:.1f}, y %{y:.1f}, z %{z:.1f} mm<extra></extra>",
            }
        )
        traces.append(pen.lines([np.full((1, 3), np.nan)], name, INK, 5, legendgroup=name))
    return traces


def _seen(line: _Line) -> Array:
    """(K, 3) A chain's nodes, those NaN that have bridged ones on both sides."""
    points, bridged = line.points.copy(), line.bridged
    beside = np.concatenate([[True], bridged, [True]])
    points[bridged & beside[:-2] & beside[2:]] = np.nan
    return points


def _rounded(parts: Sequence[Array]) -> list[float | None]:
    """Return numbers of several lines in few digits, None for NaN, with one for each gap after a line."""
    values = [value for part in parts for value in (*part.tolist(), 0.0)]
    return [None if np.isnan(value) else float(f"{value:.4g}") for value in values]


def _unseen(pen: Pen, lines: Sequence[_Line]) -> list[dict[str, Any]]:
    """Stretches that no point supports, each to the nodes beside it."""
    stretches = [
        line.points[max(start - 1, 0) : stop + 1] for line in lines for start, stop in find_runs(line.bridged)
    ]
    if not stretches:
        return []
    trace = pen.lines(stretches, "stretch that no view saw", UNSEEN, 7)
    trace["line"]["dash"] = "dot"
    return [trace]


def _places(pen: Pen, model: Model, towards: Array) -> list[dict[str, Any]]:
    """Mark ends, crossings, doubts and joins."""
    ends = [
        (place, f"chain {i} {what}")
        for i, chain in enumerate(model.chains)
        if not chain.closed
        for place, what in ((chain.points[0], "starts"), (chain.points[-1], "ends"))
    ]
    met = list_crossings(model.chains, towards, model.doubts)
    crossed = [(crossing.place, str(crossing)) for crossing in met]
    doubts = [
        (doubt.place, f"{doubt.kind}, weight {doubt.amount:.3f}: {doubt}")
        for doubt in model.doubts
        if doubt.place is not None
    ]
    joins = [
        (join.place, f"two segments joined; the next best way costs {join.margin:.2f} more")
        for join in model.joins
    ]
    traces = []
    for name, found, marker, visible in (
        ("end", ends, {"color": "white", "symbol": "circle", "size": 7}, True),
        ("crossing", crossed, {"color": CROSSING, "symbol": "circle-open", "size": 14}, True),
        ("doubt", doubts, {"color": DOUBT, "symbol": "diamond-open", "size": 18}, True),
        ("join", joins, {"color": PALETTE[4], "symbol": "square-open", "size": 8}, "legendonly"),
    ):
        if found:
            places, said = zip(*found[:MAX_PLACES], strict=True)
            named = f"{name}s: {len(found)}" if len(found) > 1 else name
            traces.append(pen.markers(np.array(places), named, marker, said, visible=visible))
    return traces


def _truth(pen: Pen, truth: Sequence[Array]) -> list[dict[str, Any]]:
    if not truth:
        return []
    every = max(ceil(sum(map(len, truth)) / MAX_TRUE_NODES), 1)
    return [pen.lines([line[::every] for line in truth], "true centreline", INK, 3, visible="legendonly")]


def _cameras(pen: Pen, cameras: Sequence[Camera | None], depth: float) -> list[dict[str, Any]]:
    """Pyramids from each camera to the corners of its image."""
    there = [(i, camera) for i, camera in enumerate(cameras) if camera is not None][:MAX_PLACES]
    if not there:
        return []
    lines = []
    for _, camera in there:
        corners = camera.corners(depth)
        lines += [np.vstack([corners, corners[:1]]), *(np.stack([camera.viewpoint, c]) for c in corners)]
    shared = {"legendgroup": "cameras", "visible": "legendonly"}
    said = [f"camera of view {i}" for i, _ in there]
    viewpoints = np.array([camera.viewpoint for _, camera in there])
    marker = {"color": CAMERA, "size": 4}
    return [
        pen.lines(lines, "cameras", CAMERA, 2, **shared),
        pen.markers(viewpoints, "", marker, said, showlegend=False, **shared),
    ]


def _next_view(model: Model) -> Array:
    """(1, 3) Where a camera would tell most, or (0, 3)."""
    try:
        return model.next_view()[None]
    except ValueError:  # nothing to look at, or from nowhere
        return np.empty((0, 3))


def _next(pen: Pen, place: Array, target: Array) -> list[dict[str, Any]]:
    if not len(place):
        return []
    shared = {"legendgroup": "next", "visible": "legendonly"}
    ray = pen.lines([np.vstack([place, target])], "", NEXT, 2, showlegend=False, **shared)
    marker = {"color": NEXT, "symbol": "diamond", "size": 7}
    return [pen.markers(place, "next view", marker, ["where the next camera would tell most"], **shared), ray]


def _scene(pen: Pen, box: Array) -> dict[str, Any]:
    """Axes around all that is drawn, on one scale."""
    low, high = 1e3 * (box.min(axis=0) - pen.origin), 1e3 * (box.max(axis=0) - pen.origin)
    margin = 0.02 * float((high - low).max()) + 1.0
    low, high = low - margin, high + margin
    scene: dict[str, Any] = {
        "aspectmode": "manual",
        "aspectratio": _xyz((high - low) / (high - low).max()),
        "dragmode": "orbit",
    }
    for k, name in enumerate("xyz"):
        title = f"{name} / mm" if not pen.origin[k] else f"({name} − {pen.origin[k]:.0f} m) / mm"
        shown = {"title": {"text": title}, "showspikes": False, "gridcolor": "#dddddd"}
        scene[f"{name}axis"] = {"range": [float(low[k]), float(high[k])], **shown}
    return scene


def _looks(scene: dict[str, Any], subject: Array, towards: Array) -> tuple[dict[str, Any], dict[str, Any]]:
    """Where plotly's camera is to see the ropes, and to see everything.

    It counts in units of the longest axis, from the middle of the box.
    """
    low, high = np.array([scene[f"{name}axis"]["range"] for name in "xyz"]).T
    unit = float((high - low).max())
    middle = (subject.min(axis=0) + subject.max(axis=0)) / 2
    extent = max(float(np.linalg.norm(np.ptp(subject, axis=0))) / unit, 0.02)
    up = np.array([0.0, 0.0, 1.0]) if abs(towards[2]) < 0.95 else np.array([0.0, 1.0, 0.0])
    near = _looking((middle - (low + high) / 2) / unit, towards, 1.15 * extent / _FIELD, up)
    aside = towards + 0.7 * np.cross(up, towards)
    across = float(np.linalg.norm((high - low) / unit))
    return near, _looking(np.zeros(3), aside / np.linalg.norm(aside), 1.1 * across / _FIELD, up)


def _looking(centre: Array, towards: Array, distance: float, up: Array) -> dict[str, Any]:
    return {"center": _xyz(centre), "eye": _xyz(centre + distance * towards), "up": _xyz(up)}


def _xyz(vector: Array) -> dict[str, float]:
    return dict(zip("xyz", vector.tolist(), strict=True))


def _scale(title: str, values: Sequence[Array], colours: str) -> dict[str, Any]:
    highest = max((float(v) for part in values for v in part if np.isfinite(v)), default=1.0)
    bar = {"title": {"text": title}, "orientation": "h", "thickness": 12, "len": 0.4, "x": 0.25, "y": 0.0}
    return {"colorscale": colours, "cmin": 0.0, "cmax": max(highest, 1e-6), "colorbar": bar}


def _recolouring(lines: Sequence[_Line], traces: list[int]) -> list[tuple[str, str, list[Any]]]:
    """Buttons that colour the chains by one quantity or another."""
    entries = []
    for name, colours, values in (
        ("arc length", "Viridis", [line.along for line in lines]),
        ("standard deviation", "Portland", [line.sd for line in lines]),
    ):
        each = [_rounded([values[i] for i in group]) for group in _groups(len(lines))]
        scale = {"coloraxis": _scale(f"{name} / mm", values, colours)}
        entries.append((name, "update", [{"line.color": each}, scale, traces]))
    return entries


def _buttons(entries: Sequence[tuple[str, str, list[Any]]], row: int) -> dict[str, Any]:
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
