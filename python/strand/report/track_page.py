"""Write an HTML page that plays tracked ropes: a 3D view with a time slider, and what happened."""

from __future__ import annotations

import gzip
import math
import os
from base64 import b64encode
from collections.abc import Sequence
from importlib.resources import files
from string import Template
from typing import Any

import numpy as np

import strand._core as _core
from strand.report.drawing import pick_spread
from strand.report.drawn_chains import pick_color
from strand.report.page import POLICY, dump_json, escape_text, format_table
from strand.report.plotly_traces import Pen
from strand.report.space_figure import make_scene, measure_width, place_cameras
from strand.report.tracks import Track, TrackedRope, check_tracks, name_rope
from strand.ropes.summary import ACT_CONFIDENCE, format_confidence
from strand.support.checks import Array, check_path, check_text
from strand.support.extras import import_extra
from strand.support.files import write_bytes

# these keep the page below 5 MB: a node takes 18 bytes
_NODES = 60  # of a rope that are drawn
_MAX_NODES = 100_000  # of all ropes and frames
_MAX_ROPES = 30
_MAX_EVENTS = 300
_HIDDEN = "#8a8a8a"  # grey: predicted parts
_ASIDE = 0.7  # of the way up: how far the first view is from straight above
_NEARER = 0.85  # of the usual distance of the first view: ropes are wider than high
_LEAST_BOX = 1e-3  # metres: side of the space around nothing


def write_track_report(
    tracks: Sequence[Track],
    path: str | os.PathLike[str],
    *,
    title: str = "Tracked ropes",
    numbers: Sequence[int] | None = None,
) -> None:
    """Write a self-contained HTML page of at most 5 MB that plays tracked ropes.

    A slider and a button move the time. Each rope has a colour; predicted parts are dashed and grey. A table
    lists the events, and a click on one goes to its time. The page needs no network. If there are too many
    frames, ropes or events, the page shows a part of them and says so.

    Parameters
    ----------
    tracks : sequence of Track
        The answers of a `strand.Tracker`, in order.
    path : str or path-like
        The file. An existing one is replaced when the new one is complete.
    title : str
    numbers : sequence of int, optional
        The frames' numbers; by default from 0 on.

    Raises
    ------
    ValueError
        If there is another number of numbers than tracks.
    ImportError
        If plotly is not installed.
    OSError
        If the file cannot be written.
    """
    path, title = check_path("path", path), check_text("title", title)
    tracks, numbers = check_tracks(tracks, numbers)
    latest = {rope.number: rope for track in tracks for rope in track.ropes}
    ropes = [latest[number] for number in sorted(latest)][:_MAX_ROPES]
    shown = pick_spread(len(tracks), _MAX_NODES // (_NODES * max(len(ropes), 1))).tolist()
    nodes, hidden, states = _collect([tracks[k] for k in shown], [rope.number for rope in ropes])
    pen, layout = _make_layout(nodes, tracks[-1].up if tracks else np.array([0.0, 0.0, 1.0]))
    times = np.array([track.time for track in tracks])
    begun = float(times[0]) if len(times) else 0.0
    happened = [
        (event, number) for track, number in zip(tracks, numbers, strict=True) for event in track.events
    ]
    script = gzip.compress(import_extra("plotly.offline").get_plotlyjs().encode(), mtime=0)
    names = sorted({state for own in states for state in own if state})
    film = {
        "nodes": _NODES,
        "frames": [numbers[k] for k in shown],
        "times": [float(times[k]) - begun for k in shown],
        "states": names,
        "ropes": [
            {
                "name": f"rope {rope.number}",
                "color": pick_color(rope.number),
                "nodes": _pack(1e3 * (own - pen.origin), "<f4"),
                "hidden": _pack(unseen, "u1"),
                "states": [names.index(state) if state else -1 for state in there],
            }
            for rope, own, unseen, there in zip(ropes, nodes, hidden, states, strict=True)
        ],
        "events": [
            min(int(np.searchsorted(times[shown], event.time - 1e-9)), len(shown) - 1)
            for event, _ in happened[:_MAX_EVENTS]
        ],
    }
    rows = [
        (f"{number}", f"{event.time - begun:.3f}", str(event).split(": ", 1)[-1])
        for event, number in happened[:_MAX_EVENTS]
    ]
    table = format_table(["frame", "time / s", "what"], rows, len(happened), _MAX_EVENTS)
    page = Template(files("strand.report").joinpath("track_page.html").read_text("utf-8")).substitute(
        policy=POLICY,
        title=escape_text(title),
        summary=escape_text(_summarize(tracks, ropes, len(latest), len(shown), begun)),
        body=f'<h2>Events</h2>\n<div id="events">{table or "<p>None.</p>"}</div>',
        version=_core.__version__,
        plotly=b64encode(script).decode(),
        figure=dump_json({"data": _make_traces(pen, ropes), "layout": layout}),
        film=dump_json(film),
    )
    write_bytes(path, page.encode("utf-8", "replace"))


def _collect(
    tracks: Sequence[Track], numbers: Sequence[int]
) -> tuple[list[Array], list[Array], list[list[str]]]:
    """Return (F, K, 3) nodes, (F, K) whether they are predicted, and the states, for each rope.

    NaN and an empty state stand for a rope that is not there.
    """
    nodes = [np.full((len(tracks), _NODES, 3), np.nan) for _ in numbers]
    hidden = [np.zeros((len(tracks), _NODES)) for _ in numbers]
    states = [[""] * len(tracks) for _ in numbers]
    for k, track in enumerate(tracks):
        for rope in track.ropes:
            if rope.number in numbers:
                i = numbers.index(rope.number)
                at = np.linspace(0.0, len(rope.points) - 1.0, _NODES)
                own = np.arange(len(rope.points))
                nodes[i][k] = np.stack([np.interp(at, own, axis) for axis in rope.points.T], axis=1)
                hidden[i][k] = rope.predicted[np.rint(at).astype(int)]
                states[i][k] = rope.state
    return nodes, hidden, states


def _make_layout(nodes: Sequence[Array], up: Array) -> tuple[Pen, dict[str, Any]]:
    """Return a pen with its origin, and axes and a point of view for all frames."""
    places = np.concatenate([np.empty((0, 3)), *(own.reshape(-1, 3) for own in nodes)])
    places = places[np.isfinite(places).all(axis=1)]
    if not len(places):
        places = np.array([[-_LEAST_BOX] * 3, [_LEAST_BOX] * 3])
    far = np.abs(places).max() >= 10.0
    pen = Pen(np.round(places.mean(axis=0)) if far else np.zeros(3))
    scene = make_scene(pen, places)
    # the ropes' longest direction on the table runs across the page
    flat = places - places.mean(axis=0)
    flat -= np.outer(flat @ up, up)
    side = np.cross(up, np.linalg.eigh(flat.T @ flat)[1][:, -1])
    towards = up + _ASIDE * (side if side[1] < 0 else -side)
    near, _ = place_cameras(scene, 1e3 * (places - pen.origin), towards / np.linalg.norm(towards))
    for axis, middle in near["center"].items():
        near["eye"][axis] = middle + _NEARER * (near["eye"][axis] - middle)
    near["up"] = dict(zip("xyz", up.tolist(), strict=True))
    width = measure_width(places, near) / _NEARER
    return pen, {
        "scene": scene | {"camera": near},
        "legend": {"itemsizing": "constant", "groupclick": "togglegroup", "x": 1.0, "y": 0.94},
        "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
        "meta": {"width": width},
    }


def _make_traces(pen: Pen, ropes: Sequence[TrackedRope]) -> list[dict[str, Any]]:
    """Return three traces for each rope, whose places the page fills: seen, predicted, first end."""
    nothing = np.full((1, 3), np.nan)
    traces = []
    for rope in ropes:
        name, color = name_rope(rope), pick_color(rope.number)
        shared = {"legendgroup": name, "showlegend": False}
        traces += [
            pen.draw_lines([nothing], name, color, 9, legendgroup=name),
            pen.draw_lines([nothing], name, _HIDDEN, 9, **shared),
            pen.draw_markers(nothing, name, {"color": "white", "size": 7}, ["first end"], **shared),
        ]
    return traces


def _pack(values: Array, kind: str) -> str:
    return b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()


def _say_whether_to_act(rope: TrackedRope) -> str:
    """Return the last state of a rope, its confidence, and whether to act on it."""
    if math.isnan(rope.confidence):
        return f"{rope.state} at the end, confidence not known"
    may = rope.state == "tracking" and rope.confidence >= ACT_CONFIDENCE
    advice = "act on it where it is seen" if may else "do not act on it"
    return f"{rope.state} at the end, confidence {format_confidence(rope.confidence)}: {advice}"


def _summarize(
    tracks: Sequence[Track], ropes: Sequence[TrackedRope], count: int, shown: int, begun: float
) -> str:
    parts = [f"{len(tracks)} frames in {tracks[-1].time - begun:.2f} s" if tracks else "no frames"]
    if shown < len(tracks):
        parts.append(f"{shown} of them are shown")
    parts += [f"{name_rope(rope)}, {_say_whether_to_act(rope)}" for rope in ropes]
    if count > len(ropes):
        parts.append(f"and {count - len(ropes)} more ropes that are not drawn")
    return "; ".join(parts) + "."
