"""A page about a batch: answered frames, confidence, lengths, kinds of errors, frames to look at."""

from __future__ import annotations

import html
import os
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from strand._core import __version__
from strand.batch.links import Links
from strand.batch.reading import iterate_shards, read_graph
from strand.batch.shards import find_root
from strand.io.budget import MAX_BYTES
from strand.ropes.summary import format_confidence
from strand.support.checks import Array, check_path
from strand.support.files import FileFormatError, write_bytes

_COLUMNS = (
    "recording",
    "frame",
    "rope",
    "nodes",
    "arc_length",
    "closed",
    "confidence",
    "model_confidence",
    "graph",
    "seconds",
    "error",
)
_BINS = 10  # bins of a histogram
_LISTED_FRAMES = 10  # frames listed as the slowest, and as the least sure
_MAX_LISTED_KINDS = 30  # kinds of error that the page lists
_MAX_KINDS = 1000  # kinds of error that are counted separately
_MAX_GRAPHS = 30  # kinds of graph that the page lists
_MAX_KIND_LENGTH = 160  # characters of a kind
_MAX_MESSAGE_LENGTH = 1000  # characters of a message that are compared
_PATH_BEFORE = r"[^\s'\"]*[/\\]"  # a path, up to the recording
_PATH_AFTER = r"(?:[/\\][^\s'\":,()]*)?(?![.-]?\w)"  # a path, from the recording on
_NUMBER = re.compile(r"\d+(?:[.,]\d+)*(?:e[+-]?\d+)?")


@dataclass(frozen=True, eq=False)
class Summary:
    """The summary of a batch's table.

    Attributes
    ----------
    recordings : int
        Number of recordings.
    frames : int
        Number of frames; a recording that could not be opened counts as one.
    answered : int
        Number of frames without an error.
    confidence : (N,) ndarray
        Confidence of each rope, NaN where it is not known.
    lengths : (N,) ndarray
        Length of each rope along its nodes, metres.
    errors : dict of str to (int, str, str)
        Number of errors of each kind, the most frequent first, and an example: recording and error. A kind is
        an error's text without paths and numbers.
    unsure : sequence of (float, str, int or None)
        Confidence, recording and frame of the frames whose answers are least sure.
    slowest : sequence of (float, str, int or None)
        Seconds, recording and frame of the slowest frames.
    seconds : float
        Duration of all frames together.
    graphs : dict of (int, int, int) to (int, str, int or None)
        Number of frames with each number of junctions, ends and edges, the most frequent first, and an
        example: recording and frame. Empty if no ropes branch.
    """

    recordings: int
    frames: int
    answered: int
    confidence: Array
    lengths: Array
    errors: dict[str, tuple[int, str, str]]
    unsure: Sequence[tuple[float, str, int | None]]
    slowest: Sequence[tuple[float, str, int | None]]
    seconds: float
    graphs: dict[tuple[int, int, int], tuple[int, str, int | None]] = field(default_factory=dict)


def summarize(out: str | os.PathLike[str], max_bytes: int = MAX_BYTES) -> Summary:
    """Return the summary of a folder of shards, with one shard in memory at a time."""
    recordings: set[str] = set()
    confidence: list[float] = []
    lengths: list[float] = []
    kinds: Counter[str] = Counter()
    examples: dict[str, tuple[str, str]] = {}
    unsure: list[tuple[float, str, int | None]] = []
    slowest: list[tuple[float, str, int | None]] = []
    graphs: Counter[tuple[int, int, int]] = Counter()
    pictured: dict[tuple[int, int, int], tuple[str, int | None]] = {}
    frames, answered, seconds = 0, 0, 0.0
    for path, table in iterate_shards(out, _COLUMNS, max_bytes):
        for row in _read_rows(table):
            recordings.add(row["recording"])
            if row["rope"] is not None:
                confidence.append(np.nan if row["confidence"] is None else row["confidence"])
                lengths.append(row["length"])
            if row["rope"] not in (None, 0):
                continue
            frames += 1
            seconds += row["seconds"]
            slowest.append((row["seconds"], row["recording"], row["frame"]))
            if row["graph"] is not None:
                graph = _count_parts(path, read_graph(path, row["graph"], max_bytes))
                graphs[graph] += 1
                pictured.setdefault(graph, (row["recording"], row["frame"]))
            if row["error"] is None:
                answered += 1
                if row["model_confidence"] is not None:
                    unsure.append((row["model_confidence"], row["recording"], row["frame"]))
                continue
            kind = _classify_error(row["error"], row["recording"])
            if kind not in kinds and len(kinds) >= _MAX_KINDS:
                kind = row["error"].partition(":")[0]
            kinds[kind] += 1
            examples.setdefault(kind, (row["recording"], row["error"]))
        unsure = sorted(unsure, key=lambda frame: frame[:2])[:_LISTED_FRAMES]
        slowest = sorted(slowest, key=lambda frame: (-frame[0], frame[1]))[:_LISTED_FRAMES]
    errors = {kind: (count, *examples[kind]) for kind, count in kinds.most_common()}
    return Summary(
        len(recordings),
        frames,
        answered,
        np.array(confidence),
        np.array(lengths),
        errors,
        unsure,
        slowest,
        seconds,
        {graph: (count, *pictured[graph]) for graph, count in graphs.most_common()},
    )


def write_summary(
    out: str | os.PathLike[str], page: str | os.PathLike[str], *, max_bytes: int = MAX_BYTES
) -> None:
    """Write an HTML page about a batch; it needs no network.

    The page shows the number of frames with an answer, the ropes' confidence and lengths, how many frames
    have which graph, the kinds of error, the least sure frames and the slowest. Recordings that exist are
    links, relative to the page. So are their reports: HTML files with a recording's name, beside it or beside
    the page, or `report.html` in a recording's folder. If writing fails, no partial page is left.

    Parameters
    ----------
    out : path
        The folder of shards.
    page : path
        The file to write or replace.
    max_bytes : int
        Half of the memory that the rows of a shard may take by its headers, 4 GiB by default.

    Raises
    ------
    FileNotFoundError
        If the folder does not exist.
    strand.FileFormatError
        If a shard is damaged, or may take more than 2 x `max_bytes`.
    OSError
        If the page cannot be written.
    ImportError
        If pyarrow is not installed.
    """
    page, folder = check_path("page", page), check_path("out", out)
    found = summarize(folder, max_bytes)
    links = Links(page, find_root(folder))
    write_bytes(page, _make_page(found, f"Ropes in {folder.absolute().name}", links).encode())


def _read_rows(table: Any) -> list[dict[str, Any]]:
    """Return a table's rows with the length of each rope instead of its nodes."""
    rows: list[dict[str, Any]] = table.drop_columns(["nodes", "arc_length"]).to_pylist()
    for row, nodes, along in zip(rows, table["nodes"], table["arc_length"], strict=True):
        if row["rope"] is not None:
            gap = np.subtract(nodes[0].as_py(), nodes[-1].as_py()) if row["closed"] else np.zeros(3)
            row["length"] = along[-1].as_py() + float(np.linalg.norm(gap))
    return rows


def _count_parts(path: Path, graph: Any) -> tuple[int, int, int]:
    """Return the numbers of junctions, ends and edges of a graph in a row."""
    try:
        ends = sum(node["kind"] == "end" for node in graph["nodes"])
        return len(graph["nodes"]) - ends, ends, len(graph["edges"])
    except (KeyError, TypeError) as error:
        raise FileFormatError.from_error(path, error) from error


def _classify_error(error: str, recording: str) -> str:
    """Return an error's kind: its text without paths of the recording's files, and without numbers."""
    kind, _, message = error[:_MAX_MESSAGE_LENGTH].partition(": ")
    names = {
        name: re.escape(name).replace("/", r"[/\\]") for name in (recording, recording.rpartition("/")[2])
    }
    # an error about a file begins with its path, which may hold spaces
    message = re.sub(rf"^(?:[^'\"]*[/\\])?{names[recording]}(?:[/\\][^'\"]*?)?: ", "", message)
    # a name without a folder and a suffix may be an ordinary word of the message
    alone = [f"|(?<!\\w){pattern}" for name, pattern in names.items() if re.search("[./]", name)]
    path = rf"(?:{_PATH_BEFORE}(?:{'|'.join(names.values())}){''.join(alone)}){_PATH_AFTER}"
    message = re.sub(path, "PATH", message)
    words = _NUMBER.sub("N", message)
    if not words:
        return kind
    return f"{kind}: {words if len(words) <= _MAX_KIND_LENGTH else words[: _MAX_KIND_LENGTH - 4] + ' ...'}"


def _make_page(summary: Summary, title: str, links: Links) -> str:
    share = summary.answered / max(summary.frames, 1)
    parts = [
        f"<p>{summary.recordings} recordings, {summary.frames} frames, {summary.answered} of them answered "
        f"({share:.1%}), {len(summary.lengths)} ropes, {summary.seconds:.0f} s of work.</p>",
        "<h2>Confidence</h2>",
        _make_histogram(summary.confidence, np.linspace(0.0, 1.0, _BINS + 1), 1.0, ""),
        "<h2>Lengths</h2>",
        _make_length_section(summary.lengths),
        *(("<h2>Graphs</h2>", _make_graph_section(summary, links)) if summary.graphs else ()),
        "<h2>Errors</h2>",
        _make_error_section(summary, links),
        "<h2>Least sure frames</h2>",
        _make_frame_section("confidence", format_confidence, summary.unsure, links),
        "<h2>Slowest frames</h2>",
        _make_frame_section("seconds", "{:.3f}".format, summary.slowest, links),
    ]
    frame = Template(resources.files("strand.batch").joinpath("summary.html").read_text(encoding="utf-8"))
    return frame.substitute(title=html.escape(title), body="\n".join(parts), version=__version__)


def _make_length_section(lengths: Array) -> str:
    if not len(lengths):
        return "<p>No ropes.</p>"
    longest = float(lengths.max())
    return _make_histogram(lengths, np.linspace(0.0, max(longest, 1e-3), _BINS + 1), 1e3, " mm")


def _make_histogram(values: Array, edges: Array, scale: float, unit: str) -> str:
    known = values[~np.isnan(values)]
    if not len(known):
        return "<p>Not known for any rope.</p>"
    counts, _ = np.histogram(known, edges)
    most = int(counts.max())
    digits = 0 if scale > 1 else 1
    rows = [
        f'<tr><td class="n">{low * scale:.{digits}f} to {high * scale:.{digits}f}{unit}</td>'
        f'<td class="n">{count}</td><td><meter max="{most}" value="{count}"></meter></td></tr>'
        for low, high, count in zip(edges, edges[1:], counts, strict=False)
    ]
    without = len(values) - len(known)
    note = f'<p class="note">Not known for {without} ropes.</p>' if without else ""
    return f"<table>{''.join(rows)}</table>{note}"


def _make_graph_section(summary: Summary, links: Links) -> str:
    rows = []
    for parts, (count, recording, frame) in [*summary.graphs.items()][:_MAX_GRAPHS]:
        example = links.make_cell(recording) + ("" if frame is None else f", frame {frame}")
        rows.append((*map(str, parts), f"{count}", example))
    numbers = ("junctions", "ends", "edges", "frames")
    listed = _make_table((*numbers, "for example"), rows, numbers)
    more = len(summary.graphs) - len(rows)
    return f'{listed}<p class="note">{more} more kinds of graph.</p>' if more else listed


def _make_error_section(summary: Summary, links: Links) -> str:
    if not summary.errors:
        return "<p>None.</p>"
    rows = [
        (html.escape(kind), f"{count}", f"{links.make_cell(recording)}: {html.escape(error)}")
        for kind, (count, recording, error) in [*summary.errors.items()][:_MAX_LISTED_KINDS]
    ]
    listed = _make_table(("kind", "frames", "for example"), rows, numbers=("frames",))
    others = sum(count for count, *_ in list(summary.errors.values())[_MAX_LISTED_KINDS:])
    if not others:
        return listed
    more = len(summary.errors) - _MAX_LISTED_KINDS
    return f'{listed}<p class="note">{more} more kinds, in {others} frames.</p>'


def _make_frame_section(
    head: str, show: Callable[[float], str], frames: Sequence[tuple[float, str, int | None]], links: Links
) -> str:
    if not frames:
        return "<p>None.</p>"
    rows = [
        (show(value), links.make_cell(recording), "" if frame is None else f"{frame}")
        for value, recording, frame in frames
    ]
    return _make_table((head, "recording", "frame"), rows, numbers=(head, "frame"))


def _make_table(heads: Sequence[str], rows: Sequence[Sequence[str]], numbers: Sequence[str]) -> str:
    """Return a table of cells of HTML; `numbers` names the columns that are set flush right."""
    kinds = [' class="n"' if head in numbers else "" for head in heads]

    def make_row(tag: str, cells: Sequence[str]) -> str:
        styled = zip(kinds, cells, strict=True)
        return f"<tr>{''.join(f'<{tag}{kind}>{cell}</{tag}>' for kind, cell in styled)}</tr>"

    return f"<table>{make_row('th', heads)}{''.join(make_row('td', row) for row in rows)}</table>"
