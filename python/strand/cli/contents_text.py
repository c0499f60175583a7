"""The text that `strand info` prints about a file: rows of a label and words."""

from __future__ import annotations

import shutil
import textwrap
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from strand.cli.advice import Advice
from strand.cli.terminal import escape_unprintable
from strand.io.file_contents import Contents, SceneContents, SingleContents
from strand.io.recordings.recording_contents import CameraContents, RecordingContents
from strand.io.view_summary import ViewSummary
from strand.support.checks import Array
from strand.views.box import format_point

if TYPE_CHECKING:
    from strand.ropes.model import Model

_LABEL_COLUMNS = 12  # columns of the labels
_DEFAULT_COLUMNS = 80  # columns of an output whose width is not known
_MIN_WORD_COLUMNS = 30  # columns that the words get at least
_MAX_LISTED = 60  # topics, and TF frames, that are listed


@dataclass(frozen=True)
class Row:
    """A line of the text.

    Attributes
    ----------
    label : str
        Empty if the row continues the one above.
    words : str
    wraps : bool
        Whether the row becomes several lines if it is too long; rows of tables do not.
    """

    label: str
    words: str
    wraps: bool = True


def describe_contents(path: Path, contents: Contents, advice: Advice) -> str:
    """Return the text about a file: its contents, what is missing, and the advice."""
    match contents:
        case RecordingContents():
            rows = _describe_recording(contents)
        case SceneContents():
            rows = _describe_scene(contents)
        case SingleContents():
            rows = _describe_single(contents)
        case _:
            rows = _describe_model(contents)
    if advice.missing:
        rows.append(Row("missing", ", ".join(advice.missing)))
    columns = shutil.get_terminal_size((_DEFAULT_COLUMNS, 24)).columns
    title = f"{path}: {name_kind(contents)}, {name_format(path, contents)}"
    lines = [escape_unprintable(title), *(_format_row(row, columns) for row in rows)]
    lines += ["", f"  {escape_unprintable(advice.command or 'strand reconstruct')}"]
    lines += [_format_row(Row(label, words), columns) for label, words in advice.plan.items()]
    return "\n".join(lines)


def name_kind(contents: Contents) -> str:
    """Return "model", "recording", "scene", "points" or "depth image"."""
    match contents:
        case RecordingContents():
            return "recording"
        case SceneContents():
            return "scene"
        case SingleContents():
            return contents.view.kind
        case _:
            return "model"


def name_format(path: Path, contents: Contents) -> str:
    """Return the file's format in words."""
    suffix = path.suffix[1:].upper()
    match contents:
        case RecordingContents():
            return contents.format
        case SceneContents():
            return "NPZ archive" if suffix == "NPZ" else "folder with a scene.toml"
        case SingleContents():
            return f"{suffix} file"
        case _:
            from strand.ropes.model import VERSION

            return f"version {VERSION}"


def _format_row(row: Row, columns: int) -> str:
    words = escape_unprintable(row.words)
    lines = [words]
    if row.wraps:
        width = max(columns - _LABEL_COLUMNS - 2, _MIN_WORD_COLUMNS)
        lines = textwrap.wrap(words, width, break_long_words=False, break_on_hyphens=False) or [""]
    labels = [row.label] + [""] * (len(lines) - 1)
    return "\n".join(f"  {a:<{_LABEL_COLUMNS}}{b}".rstrip() for a, b in zip(labels, lines, strict=True))


def _label_first(label: str, rows: list[Row]) -> list[Row]:
    """Return the rows with a label at the first one."""
    return [Row(label if i == 0 else "", row.words, row.wraps) for i, row in enumerate(rows)]


def _describe_model(model: Model) -> list[Row]:
    # these import the model's modules, which take longer than all that other files need
    from strand.report import tables
    from strand.ropes.summary import format_confidence

    table = tables.describe_chains(model).splitlines() if model.chains else ["none"]
    return [
        Row("method", model.method or "not known"),
        Row("views", f"{len(model.poses)}"),
        *_label_first("chains", [Row("", line, wraps=False) for line in table]),
        Row("up", _format_vector(model.up)),
        Row("table", _describe_table(model)),
        Row("labels", _describe_labels(model)),
        *_describe_stamps([model.stamp]),
        Row("confidence", "not known" if np.isnan(model.confidence) else format_confidence(model.confidence)),
        Row("doubts", _count_kinds([doubt.kind for doubt in model.doubts])),
        Row("warnings", _count_kinds([warning.kind for warning in model.warnings])),
    ]


def _describe_stamps(stamps: Sequence[float | None]) -> list[Row]:
    """Return a row with the first and the last stamp, if there are any."""
    known = [stamp for stamp in stamps if stamp is not None]
    if not known:
        return []
    words = f"{min(known):.3f} s" + (f" to {max(known):.3f} s" if len(known) > 1 else "")
    return [
        Row("stamps", words + ("" if len(known) == len(stamps) else f"; {len(known)} of {len(stamps)} views"))
    ]


def _format_vector(vector: Array) -> str:
    """Return the coordinates of a unit vector in words."""
    return f"({', '.join(f'{x:.3g}' for x in np.round(vector, 3) + 0.0)})"


def _describe_table(model: Model) -> str:
    if model.table is None:
        return "none"
    return f"normal {_format_vector(model.table.normal)}, offset {model.table.offset:.4g} m"


def _describe_labels(model: Model) -> str:
    """Return the label of each chain, or that no chain has one."""
    labels = [chain.label for chain in model.chains]
    if all(label is None for label in labels):
        return "none"
    return ", ".join("none" if label is None else f"{label}" for label in labels)


def _count_kinds(kinds: Sequence[str]) -> str:
    return ", ".join(f"{count} {kind}" for kind, count in Counter(kinds).items()) or "none"


def _describe_scene(scene: SceneContents) -> list[Row]:
    views = scene.views
    rows = [
        Row("name", scene.name),
        Row("views", f"{_count_views(views)}; each with its pose"),
        *_describe_intrinsics(views),
        *_describe_points(views),
        Row("masks", _describe_masks(views)),
        Row("colours", _describe_share(sum(view.colors for view in views), len(views))),
        *_describe_stamps([view.stamp for view in views]),
        Row("radius", "not given" if scene.radius is None else f"{scene.radius * 1e3:.3g} mm"),
        Row("bounds", "not given" if scene.bounds is None else f"{scene.bounds}"),
    ]
    if scene.bounds is not None:
        masked = any(view.labels is not None for view in views)
        rows.append(
            Row("", f"{scene.points_in_bounds} points inside" + (", and in the masks" if masked else ""))
        )
    if scene.true_ropes:
        rows.append(Row("truth", f"{scene.true_ropes} {_inflect('centreline', scene.true_ropes)}"))
    return rows


def _describe_single(file: SingleContents) -> list[Row]:
    view = file.view
    rows = [Row("image", _format_size(view))] if view.kind == "depth image" else []
    rows += _describe_points([view], "units" if file.whole else "m")
    if view.kind == "points":
        rows.append(Row("colours", "yes" if view.colors else "none"))
        viewpoint = "not given" if file.viewpoint is None else f"{format_point(file.viewpoint)} m"
        rows.append(Row("viewpoint", viewpoint))
    return rows


def _describe_recording(recording: RecordingContents) -> list[Row]:
    rows = []
    if recording.start is not None:
        begun = datetime.fromtimestamp(recording.start // 10**9, timezone.utc)
        rows.append(Row("recorded", f"{begun:%Y-%m-%d %H:%M:%S} UTC, {recording.seconds:.1f} s"))
    listed = recording.topics[:_MAX_LISTED]
    name_columns = max((len(topic.topic) for topic in listed), default=0)
    kind_columns = max((len(topic.kind) for topic in listed), default=0)
    table = []
    for topic in listed:
        rate = "" if topic.rate is None else f" {topic.rate:8.1f} Hz"
        words = f"{topic.topic:<{name_columns}}  {topic.kind:<{kind_columns}}  {topic.messages:>6}{rate}"
        table.append(Row("", words, wraps=False))
    if len(recording.topics) > _MAX_LISTED:
        table.append(Row("", f"and {len(recording.topics) - _MAX_LISTED} more"))
    rows += _label_first("topics", table or [Row("", "none")])
    for camera in recording.cameras:
        rows += _describe_camera(camera, recording.episodes is None)
    if recording.episodes is not None:
        return [Row("episodes", f"{recording.episodes}"), *rows]
    frames = ", ".join(recording.tf_frames[:_MAX_LISTED])
    frames += ", ..." if len(recording.tf_frames) > _MAX_LISTED else ""
    rows.append(Row("TF frames", frames or "none"))
    if recording.tf_trouble is not None:
        rows.append(Row("", f"problem: {recording.tf_trouble}"))
    return rows


def _describe_camera(camera: CameraContents, of_ros: bool) -> list[Row]:
    frames = f"{camera.messages} {_inflect('frame', camera.messages)}"
    tf_frame = f", in the TF frame {camera.frame}" if camera.frame else ", without a TF frame"
    rows = [Row("depth", f"{camera.topic}: {frames}{tf_frame if of_ros else ''}")]
    view = camera.view
    if view is None:
        size = "" if camera.size is None else f"{camera.size[0]} x {camera.size[1]} pixels; "
        return [*rows, Row("", f"{size}cannot be read: {camera.trouble}")]
    rows.append(Row("first frame", _format_size(view)))
    return [*rows, *_describe_intrinsics([view]), *_describe_points([view])]


def _count_views(views: Sequence[ViewSummary]) -> str:
    """Return the number of views of each kind and size, in words."""
    counts = Counter((view.kind, _format_size(view)) for view in views)
    return "; ".join(
        f"{count} of points" if kind == "points" else f"{count} {_inflect(kind, count)} of {size}"
        for (kind, size), count in counts.items()
    )


def _format_size(view: ViewSummary) -> str:
    return view.kind if view.size is None else f"{view.size[0]} x {view.size[1]} pixels"


def _describe_intrinsics(views: Sequence[ViewSummary]) -> list[Row]:
    """Return a row with the first image's intrinsics, and the number of views with others."""
    known = [view.intrinsics for view in views if view.intrinsics is not None]
    if not known:
        return []
    numbers = ", ".join(f"{name} {x:.6g}" for name, x in zip(("fx", "fy", "cx", "cy"), known[0], strict=True))
    others = sum(one != known[0] for one in known)
    return [Row("intrinsics", numbers + (f"; {others} views have others" if others else ""))]


def _describe_points(views: Sequence[ViewSummary], unit: str = "m") -> list[Row]:
    """Return rows with the number of points, of missing points, and the distances or corners."""
    words = f"{sum(view.points for view in views)}"
    pixels = sum(view.size[0] * view.size[1] for view in views if view.size is not None)
    for count, what in (
        (sum(view.no_return or 0 for view in views), "without a return"),
        (sum(view.not_finite for view in views), "not finite"),
    ):
        if count:
            words += f"; {count} {what}" + (f", {100 * count / pixels:.1f} % of the pixels" if pixels else "")
    rows = [Row("points", words)]
    distances = [view.distance for view in views if view.distance is not None]
    corners = [view.corners for view in views if view.corners is not None]
    if len(views) == len(corners) == 1:
        # the camera is maybe not at the origin, so distances from there would say nothing
        rows.append(Row("corners", f"{format_point(corners[0][0])} to {format_point(corners[0][1])} m"))
    elif distances:
        nearest, farthest = min(near for near, _ in distances), max(far for _, far in distances)
        rows.append(Row("distance", f"{nearest:.4g} to {farthest:.4g} {unit}"))
    return rows


def _describe_masks(views: Sequence[ViewSummary]) -> str:
    labels = [view.labels for view in views if view.labels is not None]
    if not labels:
        return "none"
    inside = sum(view.points_in_mask or 0 for view in views)
    most = f"up to {max(labels)} {_inflect('label', max(labels))}"
    return f"{_describe_share(len(labels), len(views))}; {most}; {inside} points inside"


def _describe_share(count: int, views: int) -> str:
    return "none" if not count else f"{count} of {views} {_inflect('view', views)}"


def _inflect(word: str, count: int) -> str:
    return word if count == 1 else f"{word}s"
