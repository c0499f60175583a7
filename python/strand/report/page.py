"""One HTML file that shows a reconstruction: in space, over each image, and in tables. It fetches nothing."""

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
from strand.report.cameras import Camera, find_seen_side, make_cameras
from strand.report.overlay import MAX_CHAINS, draw_overlay
from strand.report.sheet import pick_spread
from strand.report.space_figure import compute_deviations, make_space_figure
from strand.report.tables import count_stages
from strand.ropes.crossings import list_crossings
from strand.ropes.model import Model
from strand.support.checks import Array, check_finite_array
from strand.support.extras import import_extra
from strand.support.files import write_bytes
from strand.views.pose import moved
from strand.views.view import View, check_views

# so that the page stays below 5 MB: bytes of all depth images, and how many; rows of a table; characters of a
# cell
_IMAGE_BYTES, _MOST_IMAGES = 700_000, 16
_MOST_ROWS, _LONGEST = 100, 400
# a doubt so many radii from a chain is said to be about it
_NEAR = 5.0
# the browser itself refuses to fetch anything; plotly's scripts and styles are in the page
_POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"


def write_report(
    model: Model,
    views: Sequence[View],
    path: str | os.PathLike[str],
    *,
    title: str = "Ropes",
    given: Mapping[str, str] | None = None,
    truth: Sequence[ArrayLike] = (),
) -> None:
    """Write one HTML page about a reconstruction: whole or not at all, below 5 MB, without links to anything.

    It shows, in space and to be turned, points by view, chains by arc length or standard deviation, stretches
    that no view saw, ends, crossings, doubts, joins, cameras and the next view; the chains over each depth
    image; and tables of chains, doubts and warnings, views and stages. Where there is more than the page may
    hold, points, nodes, images and rows are left out, and the page says so.

    Parameters
    ----------
    model : Model
        With its stages (`keep_stages=True`) the points are those that the answer was made of, and the stages'
        table counts them; without them all points of the views are shown.
    views : sequence of View
        What the model was made from, in the same order.
    path : str or path-like
        The file; one that exists is replaced.
    title : str
        What the page is called.
    given : mapping of str to str, optional
        What was known of the ropes beforehand, for the page's table: "radius" and "4.2 mm", for example.
    truth : sequence of (M, 3) array_like of float
        True centrelines in the world frame, metres, to draw with the chains.

    Raises
    ------
    TypeError
        If `views` are not views, or `truth` does not hold floats.
    ValueError
        If there is not one pose in the model for each view, or a true centreline is not (M, 3) and finite.
    ImportError
        If plotly or Pillow is not installed.
    OSError
        If the file cannot be written.
    """
    views = check_views(views)
    cameras = make_cameras(model, views)
    lines = [check_finite_array(f"truth[{i}]", line, ("N", 3)) for i, line in enumerate(truth)]
    figure = make_space_figure(model, place_points(model, views), cameras, lines)
    script = gzip.compress(import_extra("plotly.offline").get_plotlyjs().encode(), mtime=0)
    sections = [
        ("Chains over the depth images", _overlays(model, cameras)),
        ("Chains", _chains(model)),
        ("Crossings", _crossings(model)),
        ("Doubts and warnings", _doubts(model)),
        ("Views", _views(model, views)),
        ("What was given", _table(["what", "value"], (given or {}).items())),
        ("Stages", _stages(model, views)),
    ]
    page = Template(files("strand.report").joinpath("page.html").read_text("utf-8")).substitute(
        policy=_POLICY,
        title=_cell(title),
        summary=_cell(_summary(model)),
        body="\n".join(f"<h2>{name}</h2>\n{content}" for name, content in sections if content),
        version=_core.__version__,
        plotly=b64encode(script).decode(),
        figure=_json(figure),
    )
    write_bytes(path, page.encode("utf-8", "replace"))


def place_points(model: Model, views: Sequence[View]) -> list[Array]:
    """Points of each view in its corrected pose, world frame, metres."""
    if "registered" in model.stages:
        return [np.asarray(points) for points in model.stages["registered"]]
    return [moved(view.points, pose) for view, pose in zip(views, model.poses, strict=True)]


def _summary(model: Model) -> str:
    count = len(model.chains)
    lengths = ", ".join(f"{chain.length * 1e3:.0f} mm" for chain in model.chains[:6])
    said = [f"{count} {'chain' if count == 1 else 'chains'}"]
    if count:
        said[0] += f" ({lengths}{', …' if count > 6 else ''})"
    unknown = np.isnan(model.confidence)
    said.append("confidence not known" if unknown else f"confidence {model.confidence:.2f}")
    said.append(_counted(len(model.doubts), "doubt"))
    said.append(_counted(len(model.warnings), "warning"))
    if model.alternatives:
        said.append(f"{_counted(len(model.alternatives), 'other way')} to join the segments fitted too")
    said.append(f"method {model.method or 'not known'}")
    return "; ".join(said) + "."


def _counted(count: int, what: str) -> str:
    return f"{count or 'no'} {what}{'' if count == 1 else 's'}"


def _overlays(model: Model, cameras: Sequence[Camera | None]) -> str:
    shown = [i for i in pick_spread(len(cameras), _MOST_IMAGES).tolist() if cameras[i] is not None]
    figures = []
    for i in shown:
        camera = cameras[i]
        assert camera is not None
        drawn = draw_overlay(camera, model, _IMAGE_BYTES // len(shown))
        made = ", made of its points" if camera.imagined else ""
        figures.append(f"<figure>{drawn}<figcaption>view {i}{made}</figcaption></figure>")
    some = "" if len(shown) == len(cameras) else f" {len(shown)} of {len(cameras)} views are shown."
    if len(model.chains) > MAX_CHAINS:
        some += f" The {MAX_CHAINS} longest of {len(model.chains)} chains are drawn."
    return (
        f'<div class="views">{"".join(figures)}</div><p class="note">Brighter is nearer to the camera than '
        "the plane that most of the image lies in; black is no return. A chain is thin where something hides "
        "it from the camera, and dashed where no view saw it. Numbers stand where chains start; red rings "
        f"are doubts.{some}</p>"
    )


def _chains(model: Model) -> str:
    rows = []
    for i, chain in enumerate(model.chains[: _MOST_ROWS + 1]):
        sd, seen = compute_deviations(chain), chain.points_seen
        near = [
            doubt.kind
            for doubt in model.doubts[:_MOST_ROWS]
            if doubt.place is not None and chain.nearest(doubt.place[None]).distance[0] < _NEAR * chain.radius
        ]
        rows.append(
            (
                f"{i}",
                f"{chain.length * 1e3:.1f}",
                f"{chain.radius * 1e3:.2f}" + (f" ± {chain.radius_sd * 1e3:.2f}" if chain.radius_sd else ""),
                f"{len(chain.points)}",
                "closed" if chain.closed else "open",
                "" if np.isnan(chain.confidence) else f"{chain.confidence:.2f}",
                _millimetres(chain.points[0]),
                _millimetres(chain.points[-1]),
                "" if seen is None else f"{100 * np.mean(seen > 0):.0f} %",
                "" if sd is None else f"{1e3 * np.median(sd):.2f} / {1e3 * sd.max():.2f}",
                ", ".join(dict.fromkeys(near)),
            )
        )
    head = ["chain", "length / mm", "radius / mm", "nodes", "ends", "confidence"]
    return _table(
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


def _crossings(model: Model) -> str:
    """Crossings as the cameras see them; nothing without any."""
    if not model.chains:
        return ""
    nodes = np.concatenate([chain.points for chain in model.chains])
    towards = find_seen_side(nodes, model.poses[:, :3, 3])
    met = list_crossings(model.chains, towards, model.doubts)
    rows = [
        (
            *(f"chain {chain} at {1e3 * s:.0f} mm" for chain, s in (one.over, one.under)),
            f"{1e3 * one.height:.2f}" + ("" if np.isnan(one.height_sd) else f" ± {1e3 * one.height_sd:.2f}"),
            f"{1e3 * one.gap:.2f}",
            f"{np.degrees(one.angle):.0f}°",
            f"{one.sign:+d}",
            f"{one.probability:.3f}",
            _millimetres(one.place),
        )
        for one in met[: _MOST_ROWS + 1]
    ]
    head = ["over", "under", "height / mm", "gap / mm", "angle", "sign", "probability", "where / mm"]
    table = _table(head, rows, len(met))
    side = ", ".join(f"{x:.2f}" for x in towards)
    seen = f"Seen from the cameras' side, against ({side}). Probability: that the order is right."
    return table and f'{table}<p class="note">{seen}</p>'


def _doubts(model: Model) -> str:
    """Doubts, the weightiest first, then warnings that no doubt has said."""
    said = {str(doubt) for doubt in model.doubts}
    rows = [
        ("doubt", doubt.kind, f"{doubt.amount:.3f}", f"unsure {doubt.about}: {doubt.reason}", doubt.place)
        for doubt in sorted(model.doubts, key=lambda doubt: -doubt.amount)
    ] + [
        ("warning", warning.kind, "", warning.message, warning.place)
        for warning in sorted(model.warnings, key=lambda warning: -(warning.amount or 0.0))
        if warning.message not in said
    ]
    if not rows:
        return "<p>None.</p>"
    cells = [(*row[:4], "" if row[4] is None else _millimetres(row[4])) for row in rows]
    return _table(["", "kind", "weight", "what", "where / mm"], cells)


def _views(model: Model, views: Sequence[View]) -> str:
    rows = []
    for i, (view, pose) in enumerate(zip(views, model.poses, strict=True)):
        if i > _MOST_ROWS:
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
                _millimetres(pose[:3, 3]),
                f"{shift:.2f} mm, {turned:.2f}°",
            )
        )
    head = ["view", "what", "points", "not finite", "camera / mm", "camera moved by registration"]
    return _table(head, rows, len(views))


def _stages(model: Model, views: Sequence[View]) -> str:
    if model.stages:
        rows = [
            (
                s.name,
                *("" if n is None else f"{n:,}" for n in (s.points_in, s.points_out)),
                _milliseconds(s.seconds),
            )
            for s in count_stages(views, model)
        ]
    else:
        rows = [(name, "", "", _milliseconds(seconds)) for name, seconds in model.timings.items()]
    total = ("total", "", "", _milliseconds(sum(model.timings.values())))
    return _table(["stage", "points in", "points out", "ms"], [*rows, total] if rows else [])


def _millimetres(place: Array) -> str:
    return ", ".join(f"{1e3 * value:.0f}" for value in place)


def _milliseconds(seconds: float) -> str:
    return f"{1e3 * seconds:.1f}"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]], count: int | None = None) -> str:
    """Make a table of escaped texts; nothing without rows."""
    rows = list(rows)
    if not rows:
        return ""
    count = len(rows) if count is None else count
    lines = ["".join(f"<th>{_cell(name)}</th>" for name in head)]
    lines += ["".join(f"<td>{_cell(text)}</td>" for text in row) for row in rows[:_MOST_ROWS]]
    more = f'<p class="note">and {count - _MOST_ROWS:,} more</p>' if count > _MOST_ROWS else ""
    return f"<table>{''.join(f'<tr>{line}</tr>' for line in lines)}</table>{more}"


def _cell(text: str) -> str:
    return escape(text if len(text) <= _LONGEST else f"{text[:_LONGEST]} …")


def _json(value: dict[str, Any]) -> str:
    """JSON that may stand in a script element."""
    return json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
