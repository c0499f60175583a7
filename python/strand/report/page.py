"""Write an HTML page about a reconstruction: a 3D view, the chains over each image, and tables."""

from __future__ import annotations

import gzip
import json
import os
from base64 import b64encode
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib.resources import files
from string import Template
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import strand._core as _core
from strand.report.cameras import Camera, make_cameras
from strand.report.drawing import pick_spread
from strand.report.drawn_chains import compute_deviations
from strand.report.overlay import MAX_CHAINS, draw_overlay
from strand.report.space_figure import make_space_figure
from strand.report.tables import count_stages, describe_ends
from strand.ropes.crossings import NOT_LISTED
from strand.ropes.model import Model, list_model_crossings
from strand.ropes.summary import format_confidence, say_whether_to_act
from strand.support.checks import Array, check_clouds, check_instance, check_path, check_text
from strand.support.extras import import_extra
from strand.support.files import write_bytes
from strand.views.pose import moved
from strand.views.view import View, check_views

# these keep the page below 5 MB
_IMAGE_BYTES = 700_000  # of all depth images together
_MAX_IMAGES = 16  # depth images
_MAX_ROWS = 100  # rows of a table
_MAX_TEXT = 400  # characters of a cell
_LONG_TEXT = 40  # characters: a longer text gets a wide cell on a narrow page
_MAX_LENGTHS = 6  # chains whose length is in the summary
_DOUBT_DISTANCE = 5.0  # radii from a chain: nearer doubts are listed with it
POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
"""The browser refuses to fetch anything; pages include plotly's script."""


def write_report(
    model: Model,
    views: Sequence[View],
    path: str | os.PathLike[str],
    *,
    title: str = "Ropes",
    given: Mapping[str, str] | None = None,
    truth: Sequence[ArrayLike] = (),
) -> None:
    """Write a self-contained HTML page of at most 5 MB about a reconstruction.

    - A 3D view shows the points by view, and the chains by arc length or standard deviation. It also shows
      unseen stretches, ends, crossings, doubts, joins, cameras and the next view.
    - The chains are drawn over each depth image.
    - Tables list the chains, crossings, doubts and warnings, views and stages.

    The page needs no network. If there are too many points, nodes, images or rows, the page shows a part of
    them and says so.

    Parameters
    ----------
    model : Model
        If it has stages, the page shows the points that strand used and counts them, else all points of the
        views.
    views : sequence of View
        The views of the model, in the same order.
    path : str or path-like
        The file. An existing one is replaced when the new one is complete.
    title : str
    given : mapping of str to str, optional
        Rows for the table of given values, such as {"radius": "4.2 mm"}.
    truth : sequence of (M, 3) array_like of float
        True centrelines in the world frame, metres, to draw with the chains.

    Raises
    ------
    TypeError
        If `views` are not views, or `truth` does not hold floats.
    ValueError
        If the model has another number of poses than views, or a true centreline is not (M, 3) and finite.
    ImportError
        If plotly or Pillow is not installed.
    OSError
        If the file cannot be written.
    """
    views, path = check_views(views), check_path("path", path)
    title = check_text("title", title)
    rows = {} if given is None else dict(check_instance("given", given, dict))
    cameras = make_cameras(model, views)
    lines = check_clouds("truth", truth)
    figure = make_space_figure(model, place_points(model, views), cameras, lines)
    script = gzip.compress(import_extra("plotly.offline").get_plotlyjs().encode(), mtime=0)
    sections = [
        ("Chains over the depth images", _draw_overlays(model, cameras)),
        ("Chains", _tabulate_chains(model)),
        ("Crossings", _tabulate_crossings(model)),
        ("Doubts and warnings", _tabulate_doubts(model)),
        ("Views", _tabulate_views(model, views)),
        ("Given values", format_table(["quantity", "value"], rows.items())),
        ("Stages", _tabulate_stages(model, views)),
    ]
    page = Template(files("strand.report").joinpath("page.html").read_text("utf-8")).substitute(
        policy=POLICY,
        title=escape_text(title),
        summary=escape_text(_summarize(model)),
        body="\n".join(f"<h2>{name}</h2>\n{content}" for name, content in sections if content),
        version=_core.__version__,
        plotly=b64encode(script).decode(),
        figure=dump_json(figure),
    )
    write_bytes(path, page.encode("utf-8", "replace"))


def place_points(model: Model, views: Sequence[View]) -> list[Array]:
    """Return the points of each view in its registered pose, world frame, metres."""
    if "registered" in model.stages:
        return [np.asarray(points) for points in model.stages["registered"]]
    return [moved(view.points, pose) for view, pose in zip(views, model.poses, strict=True)]


def _summarize(model: Model) -> str:
    count = len(model.chains)
    lengths = ", ".join(f"{chain.length * 1e3:.0f} mm" for chain in model.chains[:_MAX_LENGTHS])
    what = "chain" if model.harness is None else "edge"
    parts = [f"{count} {what}{'' if count == 1 else 's'}"]
    if count:
        parts[0] += f" ({lengths}{', …' if count > _MAX_LENGTHS else ''})"
    parts.append(_count(len(model.doubts), "doubt"))
    parts.append(_count(len(model.warnings), "warning"))
    if model.alternatives:
        parts.append(f"{_count(len(model.alternatives), 'other way')} to join the segments fitted too")
    parts.append(f"method {model.method or 'not known'}")
    return f"{say_whether_to_act(model.confidence)} {'; '.join(parts)}."


def _count(count: int, what: str) -> str:
    return f"{count or 'no'} {what}{'' if count == 1 else 's'}"


def _draw_overlays(model: Model, cameras: Sequence[Camera | None]) -> str:
    shown = [i for i in pick_spread(len(cameras), _MAX_IMAGES).tolist() if cameras[i] is not None]
    figures = []
    for i in shown:
        camera = cameras[i]
        assert camera is not None
        drawn = draw_overlay(camera, model, _IMAGE_BYTES // len(shown))
        made = ", drawn from its points" if camera.imagined else ""
        figures.append(f"<figure>{drawn}<figcaption>view {i}{made}</figcaption></figure>")
    some = "" if len(shown) == len(cameras) else f" {len(shown)} of {len(cameras)} views are shown."
    if len(model.chains) > MAX_CHAINS:
        some += f" The {MAX_CHAINS} longest of {len(model.chains)} chains are drawn."
    numbered = (
        "the starts of chains" if model.harness is None else "the middles of edges, white dots junctions"
    )
    return (
        f'<div class="views">{"".join(figures)}</div><p class="note">Brighter pixels are nearer than the '
        "plane that fits most of the image; black pixels have no return. A chain is thin where something "
        "hides it from the camera, and dashed where no view saw it. Colours show "
        f"the arc length, as in the view in space. Numbers mark {numbered}; orange crosses mark "
        f"crossings, red rings doubts.{some}</p>"
    )


def _tabulate_chains(model: Model) -> str:
    rows = []
    for i, chain in enumerate(model.chains[: _MAX_ROWS + 1]):
        sd, seen = compute_deviations(chain), chain.points_seen
        near = [
            doubt.kind
            for doubt in model.doubts[:_MAX_ROWS]
            if doubt.place is not None
            and chain.nearest(doubt.place[None]).distance[0] < _DOUBT_DISTANCE * chain.radius
        ]
        rows.append(
            (
                f"{i}",
                f"{chain.length * 1e3:.1f}",
                f"{chain.radius * 1e3:.2f}" + (f" ± {chain.radius_sd * 1e3:.2f}" if chain.radius_sd else ""),
                f"{len(chain.points)}",
                describe_ends(model, i),
                "" if np.isnan(chain.confidence) else format_confidence(chain.confidence),
                _format_millimeters(chain.points[0]),
                _format_millimeters(chain.points[-1]),
                "" if seen is None else f"{100 * np.mean(seen > 0):.0f} %",
                "" if sd is None else f"{1e3 * np.median(sd):.2f} / {1e3 * sd.max():.2f}",
                ", ".join(dict.fromkeys(near)),
            )
        )
    head = ["chain", "length / mm", "radius / mm", "nodes", "ends", "confidence"]
    return format_table(
        [
            *head,
            "first node / mm",
            "last node / mm",
            "nodes seen",
            "sd / mm: median / greatest",
            "doubts near it",
        ],
        rows,
    )


def _tabulate_crossings(model: Model) -> str:
    """Return the table of crossings, seen from above; empty without any."""
    if not model.chains:
        return ""
    met = list_model_crossings(model)
    if met is None:
        return f'<p class="note">The {NOT_LISTED}.</p>'
    rows = [
        (
            *(f"chain {chain} at {1e3 * s:.0f} mm" for chain, s in (one.over, one.under)),
            f"{1e3 * one.height:.2f}" + ("" if np.isnan(one.height_sd) else f" ± {1e3 * one.height_sd:.2f}"),
            f"{1e3 * one.gap:.2f}",
            f"{np.degrees(one.angle):.0f}°",
            f"{one.sign:+d}",
            f"{one.probability:.3f}",
            _format_millimeters(one.place),
        )
        for one in met[: _MAX_ROWS + 1]
    ]
    head = ["over", "under", "height / mm", "gap / mm", "angle", "sign", "probability", "where / mm"]
    table = format_table(head, rows, len(met))
    side = ", ".join(f"{x:.2f}" for x in model.up)
    seen = f"The direction of view is against ({side}). The probability is that of the order."
    return table and f'{table}<p class="note">{seen}</p>'


def _tabulate_doubts(model: Model) -> str:
    """Return the table of doubts, the heaviest first, and of warnings without a doubt."""
    doubted = {str(doubt) for doubt in model.doubts}
    rows = [
        ("doubt", doubt.kind, f"{doubt.amount:.3f}", f"unsure {doubt.about}: {doubt.reason}", doubt.place)
        for doubt in sorted(model.doubts, key=lambda doubt: -doubt.amount)
    ] + [
        ("warning", warning.kind, "", warning.message, warning.place)
        for warning in sorted(model.warnings, key=lambda warning: -(warning.amount or 0.0))
        if warning.message not in doubted
    ]
    if not rows:
        return "<p>None.</p>"
    cells = [(*row[:4], "" if row[4] is None else _format_millimeters(row[4])) for row in rows]
    return format_table(["", "kind", "weight", "what", "where / mm"], cells)


def _tabulate_views(model: Model, views: Sequence[View]) -> str:
    rows = []
    for i, (view, pose) in enumerate(zip(views, model.poses, strict=True)):
        if i > _MAX_ROWS:
            break
        if view.image is None:
            what = "points"
        else:
            height, width = view.image.depth.shape
            masked = "" if view.image.labels is None else ", masked"
            what = f"depth image, {width} x {height}{masked}"
        motion = pose @ np.linalg.inv(view.pose)
        turned = np.degrees(np.arccos(np.clip((np.trace(motion[:3, :3]) - 1) / 2, -1, 1)))
        shift = 1e3 * float(np.linalg.norm(pose[:3, 3] - view.viewpoint))
        rows.append(
            (
                f"{i}",
                what,
                f"{len(view.points):,}",
                f"{view.dropped:,}",
                _format_millimeters(pose[:3, 3]),
                f"{shift:.2f} mm, {turned:.2f}°",
            )
        )
    head = ["view", "what", "points", "not finite", "camera / mm", "camera moved by registration"]
    return format_table(head, rows, len(views))


def _tabulate_stages(model: Model, views: Sequence[View]) -> str:
    if model.stages:
        rows = [
            (
                s.name,
                *("" if n is None else f"{n:,}" for n in (s.points_in, s.points_out)),
                _format_milliseconds(s.seconds),
            )
            for s in count_stages(views, model)
        ]
    else:
        rows = [(name, "", "", _format_milliseconds(seconds)) for name, seconds in model.timings.items()]
    total = ("total", "", "", _format_milliseconds(sum(model.timings.values())))
    return format_table(["stage", "points in", "points out", "ms"], [*rows, total] if rows else [])


def _format_millimeters(place: Array) -> str:
    return ", ".join(f"{1e3 * value:.0f}" for value in place)


def _format_milliseconds(seconds: float) -> str:
    return f"{1e3 * seconds:.1f}"


def format_table(
    head: Sequence[str], rows: Iterable[Sequence[str]], count: int | None = None, most: int = _MAX_ROWS
) -> str:
    """Return a table of escaped texts with at most so many rows; empty without rows."""
    rows = list(rows)
    if not rows:
        return ""
    count = len(rows) if count is None else count
    lines = ["".join(f"<th>{escape_text(name)}</th>" for name in head)]
    lines += ["".join(map(_make_cell, row)) for row in rows[:most]]
    more = f'<p class="note">and {count - most:,} more</p>' if count > most else ""
    return f"<table>{''.join(f'<tr>{line}</tr>' for line in lines)}</table>{more}"


def _make_cell(text: str) -> str:
    wide = ' class="text"' if len(text) > _LONG_TEXT else ""
    return f"<td{wide}>{escape_text(text)}</td>"


def escape_text(text: str) -> str:
    """Return text that is safe inside an element, cut to the length of a cell."""
    return escape(text if len(text) <= _MAX_TEXT else f"{text[:_MAX_TEXT]} …")


def dump_json(value: dict[str, Any]) -> str:
    """Return JSON that is safe inside a script element."""
    return json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
