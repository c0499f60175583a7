"""What a file holds, in lines: a label and words each."""

from __future__ import annotations

import shutil
import textwrap
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path

import numpy as np

from strand.cli.advice import Advice
from strand.cli.outcome import printable
from strand.io.file_contents import Contents, SceneContents, SingleContents
from strand.io.recordings.recording_contents import CameraContents, RecordingContents
from strand.io.view_summary import ViewSummary
from strand.report import tables
from strand.ropes.model import VERSION, Model
from strand.views.box import metres

# columns of the labels, of an output that does not say how wide it is, and the fewest that words get
_LABEL, _WIDTH, _LEAST = 12, 80, 30
# topics and TF frames that are listed
_MOST = 60


@dataclass(frozen=True)
class Row:
    """A line of a description.

    Attributes
    ----------
    label : str
        Empty if it goes on with the label before.
    words : str
    wraps : bool
        Whether it becomes several lines where it is too long; rows of tables do not.
    """

    label: str
    words: str
    wraps: bool = True


def described(path: Path, held: Contents, would: Advice) -> str:
    """Return what a file holds, what is missing, and what `strand reconstruct` would do with it."""
    match held:
        case Model():
            rows = _model(held)
        case RecordingContents():
            rows = _recording(held)
        case SceneContents():
            rows = _scene(held)
        case SingleContents():
            rows = _single(held)
    if would.missing:
        rows.append(Row("missing", ", ".join(would.missing)))
    columns = shutil.get_terminal_size((_WIDTH, 24)).columns
    lines = [printable(f"{path}: {kind_of(held)}, {format_of(path, held)}")]
    lines += [_line(row, columns) for row in rows]
    lines += ["", f"  {printable(would.command or 'strand reconstruct')}"]
    lines += [_line(Row(label, words), columns) for label, words in would.would.items()]
    return "\n".join(lines)


def kind_of(held: Contents) -> str:
    """Return "model", "recording", "scene", "points" or "depth image"."""
    match held:
        case Model():
            return "model"
        case RecordingContents():
            return "recording"
        case SceneContents():
            return "scene"
        case SingleContents():
            return held.view.kind


def format_of(path: Path, held: Contents) -> str:
    """Say in which format it is."""
    suffix = path.suffix[1:].upper()
    match held:
        case Model():
            return f"version {VERSION}"
        case RecordingContents():
            return held.format
        case SceneContents():
            return "NPZ archive" if suffix == "NPZ" else "folder with a scene.toml"
        case SingleContents():
            return f"{suffix} file"


def _line(row: Row, columns: int) -> str:
    said = printable(row.words)
    words = [said]
    if row.wraps:
        width = max(columns - _LABEL - 2, _LEAST)
        words = textwrap.wrap(said, width, break_long_words=False, break_on_hyphens=False) or [""]
    labels = [row.label] + [""] * (len(words) - 1)
    return "\n".join(f"  {a:<{_LABEL}}{b}".rstrip() for a, b in zip(labels, words, strict=True))


def _labelled(label: str, rows: list[Row]) -> list[Row]:
    """Give the first of some rows a label."""
    return [Row(label if i == 0 else "", row.words, row.wraps) for i, row in enumerate(rows)]


def _model(held: Model) -> list[Row]:
    table = tables.describe_chains(held).splitlines() if held.chains else ["none"]
    return [
        Row("method", held.method or "not known"),
        Row("views", f"{len(held.poses)}"),
        *_labelled("chains", [Row("", line, wraps=False) for line in table]),
        Row("confidence", "not known" if np.isnan(held.confidence) else f"{held.confidence:.2f}"),
        Row("doubts", _kinds([doubt.kind for doubt in held.doubts])),
        Row("warnings", _kinds([warning.kind for warning in held.warnings])),
    ]


def _kinds(kinds: Sequence[str]) -> str:
    """Say how many there are of each kind."""
    return ", ".join(f"{count} {kind}" for kind, count in Counter(kinds).items()) or "none"


def _scene(held: SceneContents) -> list[Row]:
    views = held.views
    rows = [
        Row("name", held.name),
        Row("views", f"{_views(views)}; each with its pose"),
        *_intrinsics(views),
        *_points(views),
        Row("masks", _masks(views)),
        Row("colours", _share(sum(view.colors for view in views), len(views))),
        Row("radius", "not said" if held.radius is None else f"{held.radius * 1e3:.3g} mm"),
        Row("bounds", "not said" if held.bounds is None else f"{held.bounds}"),
    ]
    if held.bounds is not None:
        masked = any(view.labels is not None for view in views)
        rows.append(
            Row("", f"{held.points_in_bounds} points inside" + (", and in the masks" if masked else ""))
        )
    if held.true_ropes:
        rows.append(Row("truth", f"{held.true_ropes} {_plural('centreline', held.true_ropes)}"))
    return rows


def _single(held: SingleContents) -> list[Row]:
    view = held.view
    rows = [Row("image", _size(view))] if view.kind == "depth image" else []
    rows += _points([view], "units" if held.whole else "m")
    if view.kind == "points":
        rows.append(Row("colours", "yes" if view.colors else "none"))
        seen_from = "not said"
        if held.viewpoint is not None:
            seen_from = f"{metres(held.viewpoint)} m"
        rows.append(Row("viewpoint", seen_from))
    return rows


def _recording(held: RecordingContents) -> list[Row]:
    rows = []
    if held.start is not None:
        begun = datetime.fromtimestamp(held.start // 10**9, timezone.utc)
        rows.append(Row("recorded", f"{begun:%Y-%m-%d %H:%M:%S} UTC, {held.seconds:.1f} s"))
    shown = held.topics[:_MOST]
    names, kinds = (
        max((len(text) for text in column), default=0)
        for column in ([one.topic for one in shown], [one.kind for one in shown])
    )
    table = []
    for one in shown:
        rate = "" if one.rate is None else f" {one.rate:8.1f} Hz"
        words = f"{one.topic:<{names}}  {one.kind:<{kinds}}  {one.messages:>6}{rate}"
        table.append(Row("", words, wraps=False))
    if len(held.topics) > _MOST:
        table.append(Row("", f"and {len(held.topics) - _MOST} more"))
    rows += _labelled("topics", table or [Row("", "none")])
    for camera in held.cameras:
        rows += _camera(camera)
    frames = ", ".join(held.tf_frames[:_MOST]) + (", ..." if len(held.tf_frames) > _MOST else "")
    rows.append(Row("TF frames", frames or "none"))
    if held.tf_trouble is not None:
        rows.append(Row("", f"trouble: {held.tf_trouble}"))
    return rows


def _camera(camera: CameraContents) -> list[Row]:
    frames = f"{camera.messages} {_plural('frame', camera.messages)}"
    rows = [Row("depth", f"{camera.topic}: {frames}, in the TF frame {camera.frame or 'that none names'}")]
    view = camera.view
    if view is None:
        size = "" if camera.size is None else f"{camera.size[0]} x {camera.size[1]} pixels; "
        return [*rows, Row("", f"{size}cannot be read: {camera.trouble}")]
    rows.append(Row("first frame", _size(view)))
    return [*rows, *_intrinsics([view]), *_points([view])]


def _views(views: Sequence[ViewSummary]) -> str:
    """Say how many there are of each kind and size."""
    counts = Counter((view.kind, _size(view)) for view in views)
    return "; ".join(
        f"{count} of points" if kind == "points" else f"{count} {_plural(kind, count)} of {size}"
        for (kind, size), count in counts.items()
    )


def _size(view: ViewSummary) -> str:
    return view.kind if view.size is None else f"{view.size[0]} x {view.size[1]} pixels"


def _intrinsics(views: Sequence[ViewSummary]) -> list[Row]:
    """Return the pinhole of the first image, if there is one, and how many views have others."""
    known = [view.intrinsics for view in views if view.intrinsics is not None]
    if not known:
        return []
    numbers = ", ".join(f"{name} {x:.6g}" for name, x in zip(("fx", "fy", "cx", "cy"), known[0], strict=True))
    others = sum(one != known[0] for one in known)
    return [Row("intrinsics", numbers + (f"; {others} views have others" if others else ""))]


def _points(views: Sequence[ViewSummary], unit: str = "m") -> list[Row]:
    """Return how many points there are, what is missing, and how far away they are."""
    said = f"{sum(view.points for view in views)}"
    pixels = sum(view.size[0] * view.size[1] for view in views if view.size is not None)
    for count, what in (
        (sum(view.no_return or 0 for view in views), "without a return"),
        (sum(view.not_finite for view in views), "not finite"),
    ):
        if count:
            said += f"; {count} {what}" + (f", {100 * count / pixels:.1f} % of the pixels" if pixels else "")
    rows = [Row("points", said)]
    reach = [view.distance for view in views if view.distance is not None]
    corners = [view.corners for view in views if view.corners is not None]
    if len(views) == len(corners) == 1:
        # whether they are seen from the origin is not known
        rows.append(Row("corners", f"{metres(corners[0][0])} to {metres(corners[0][1])} m"))
    elif reach:
        nearest, farthest = min(near for near, _ in reach), max(far for _, far in reach)
        rows.append(Row("distance", f"{nearest:.4g} to {farthest:.4g} {unit}"))
    return rows


def _masks(views: Sequence[ViewSummary]) -> str:
    labels = [view.labels for view in views if view.labels is not None]
    if not labels:
        return "none"
    inside = sum(view.points_in_mask or 0 for view in views)
    most = f"up to {max(labels)} {_plural('label', max(labels))}"
    return f"{_share(len(labels), len(views))}; {most}; {inside} points inside"


def _share(count: int, whole: int) -> str:
    """Say how many of all views have something."""
    return "none" if not count else f"{count} of {whole} {_plural('view', whole)}"


def _plural(word: str, count: int) -> str:
    return word if count == 1 else f"{word}s"
