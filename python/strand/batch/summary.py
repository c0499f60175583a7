"""A page about a batch: success, confidence, lengths, errors by kind, what was slowest."""

from __future__ import annotations

import html
import os
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from strand._core import __version__
from strand.batch.reading import tables
from strand.support.checks import Array
from strand.support.files import write_bytes

_COLUMNS = ("recording", "frame", "rope", "nodes", "arc_length", "closed", "confidence", "seconds", "error")
_BINS = 10
_SLOWEST = 10
# kinds of error that a page lists, that are told apart, and characters of each
_LISTED, _KINDS, _LONG, _READ = 30, 1000, 160, 1000
# a recording below it, in a path that is written out, and what is below the recording
_ABOVE, _BELOW = r"[^\s'\"]*[/\\]", r"(?:[/\\][^\s'\":,()]*)?(?![.-]?\w)"
_NUMBER = re.compile(r"\d+(?:[.,]\d+)*(?:e[+-]?\d+)?")


@dataclass(frozen=True, eq=False)
class Summary:
    """What a batch's table says in short.

    Attributes
    ----------
    recordings : int
    frames, answered : int
        How many frames there are, recordings that could not be opened among them; how many have no error.
    confidence : (N,) ndarray
        Of each rope, NaN where it is not known.
    lengths : (N,) ndarray
        Of each rope along its nodes, metres.
    errors : dict of str to (int, str)
        For each kind, with what it says but for paths and numbers, how often it is there, the most frequent
        first, and one of them with its recording.
    slowest : sequence of (float, str, int or None)
        Seconds, recording and frame of the slowest frames.
    seconds : float
        Of all frames together.
    """

    recordings: int
    frames: int
    answered: int
    confidence: Array
    lengths: Array
    errors: dict[str, tuple[int, str]]
    slowest: Sequence[tuple[float, str, int | None]]
    seconds: float


def summarised(out: str | os.PathLike[str]) -> Summary:
    """Return what a folder of shards says in short; one shard is in memory at a time."""
    recordings: set[str] = set()
    confidence: list[float] = []
    lengths: list[float] = []
    kinds: Counter[str] = Counter()
    examples: dict[str, str] = {}
    slowest: list[tuple[float, str, int | None]] = []
    frames, answered, seconds = 0, 0, 0.0
    for _, table in tables(out, _COLUMNS):
        for row in _rows(table):
            recordings.add(row["recording"])
            if row["rope"] is not None:
                confidence.append(np.nan if row["confidence"] is None else row["confidence"])
                lengths.append(row["length"])
            if row["rope"] not in (None, 0):
                continue
            frames += 1
            seconds += row["seconds"]
            slowest.append((row["seconds"], row["recording"], row["frame"]))
            if row["error"] is None:
                answered += 1
                continue
            kind = _kind(row["error"], row["recording"])
            if kind not in kinds and len(kinds) >= _KINDS:
                kind = row["error"].partition(":")[0]
            kinds[kind] += 1
            examples.setdefault(kind, f"{row['recording']}: {row['error']}")
        slowest = sorted(slowest, key=lambda one: (-one[0], one[1]))[:_SLOWEST]
    errors = {kind: (count, examples[kind]) for kind, count in kinds.most_common()}
    return Summary(
        len(recordings),
        frames,
        answered,
        np.array(confidence),
        np.array(lengths),
        errors,
        slowest,
        seconds,
    )


def write_summary(out: str | os.PathLike[str], page: str | os.PathLike[str]) -> None:
    """Write an HTML page about a batch, whole or not at all; it needs no network.

    It says how many frames have an answer, how sure and how long the ropes are, which kinds of error there
    are, and which frames were slowest.

    Parameters
    ----------
    out : path
        The folder of shards.
    page : path
        The file; one that exists is replaced.

    Raises
    ------
    FileNotFoundError
        If there is no such folder.
    strand.FileFormatError
        If a shard is damaged.
    OSError
        If the page cannot be written.
    ImportError
        If pyarrow is not installed.
    """
    write_bytes(page, _page(summarised(out), f"Ropes in {Path(out).absolute().name}").encode())


def _rows(table: Any) -> list[dict[str, Any]]:
    """Return a table's rows with each rope's length in place of its nodes."""
    rows: list[dict[str, Any]] = table.drop_columns(["nodes", "arc_length"]).to_pylist()
    for row, nodes, along in zip(rows, table["nodes"], table["arc_length"], strict=True):
        if row["rope"] is not None:
            gap = np.subtract(nodes[0].as_py(), nodes[-1].as_py()) if row["closed"] else np.zeros(3)
            row["length"] = along[-1].as_py() + float(np.linalg.norm(gap))
    return rows


def _kind(error: str, recording: str) -> str:
    """Return an error without what differs from recording to recording: paths of its files, and numbers."""
    kind, _, message = error[:_READ].partition(": ")
    names = {
        name: re.escape(name).replace("/", r"[/\\]") for name in (recording, recording.rpartition("/")[2])
    }
    # errors of files begin with the path, which may hold spaces
    message = re.sub(rf"^(?:[^'\"]*[/\\])?{names[recording]}(?:[/\\][^'\"]*?)?: ", "", message)
    # without a folder or a suffix a name may be a word of the message
    alone = [f"|(?<!\\w){pattern}" for name, pattern in names.items() if re.search("[./]", name)]
    message = re.sub(rf"(?:{_ABOVE}(?:{'|'.join(names.values())}){''.join(alone)}){_BELOW}", "PATH", message)
    words = _NUMBER.sub("N", message)
    if not words:
        return kind
    return f"{kind}: {words if len(words) <= _LONG else words[: _LONG - 4] + ' ...'}"


def _page(found: Summary, title: str) -> str:
    share = found.answered / max(found.frames, 1)
    parts = [
        f"<p>{found.recordings} recordings, {found.frames} frames, {found.answered} of them answered "
        f"({share:.1%}), {len(found.lengths)} ropes, {found.seconds:.0f} s of work.</p>",
        "<h2>Confidence</h2>",
        _histogram(found.confidence, np.linspace(0.0, 1.0, _BINS + 1), 1.0, ""),
        "<h2>Lengths</h2>",
        _lengths(found.lengths),
        "<h2>Errors</h2>",
        _errors(found),
        "<h2>Slowest frames</h2>",
        _table(
            ("seconds", "recording", "frame"),
            [
                (f"{spent:.3f}", name, "" if frame is None else f"{frame}")
                for spent, name, frame in found.slowest
            ],
            numbers=("seconds", "frame"),
        ),
    ]
    frame = Template(resources.files("strand.batch").joinpath("summary.html").read_text(encoding="utf-8"))
    return frame.substitute(title=html.escape(title), body="\n".join(parts), version=__version__)


def _lengths(lengths: Array) -> str:
    if not len(lengths):
        return "<p>No ropes.</p>"
    longest = float(lengths.max())
    return _histogram(lengths, np.linspace(0.0, max(longest, 1e-3), _BINS + 1), 1e3, " mm")


def _histogram(values: Array, edges: Array, scale: float, unit: str) -> str:
    known = values[~np.isnan(values)]
    if not len(known):
        return "<p>Not known of any rope.</p>"
    counts, _ = np.histogram(known, edges)
    most = int(counts.max())
    digits = 0 if scale > 1 else 1
    rows = [
        f'<tr><td class="n">{low * scale:.{digits}f} to {high * scale:.{digits}f}{unit}</td>'
        f'<td class="n">{count}</td><td><meter max="{most}" value="{count}"></meter></td></tr>'
        for low, high, count in zip(edges, edges[1:], counts, strict=False)
    ]
    without = len(values) - len(known)
    note = f'<p class="note">Not known of {without}.</p>' if without else ""
    return f"<table>{''.join(rows)}</table>{note}"


def _errors(found: Summary) -> str:
    if not found.errors:
        return "<p>None.</p>"
    rows = [(kind, f"{count}", example) for kind, (count, example) in found.errors.items()]
    listed = _table(("kind", "frames", "for example"), rows[:_LISTED], numbers=("frames",))
    others = sum(count for count, _ in list(found.errors.values())[_LISTED:])
    if not others:
        return listed
    return f'{listed}<p class="note">{len(rows) - _LISTED} more kinds, of {others} frames.</p>'


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]], numbers: Sequence[str]) -> str:
    """Return a table; columns of numbers, which are named, are set flush right."""
    kinds = [' class="n"' if head in numbers else "" for head in heads]

    def line(tag: str, cells: Sequence[str]) -> str:
        set_as = zip(kinds, cells, strict=True)
        return f"<tr>{''.join(f'<{tag}{kind}>{html.escape(cell)}</{tag}>' for kind, cell in set_as)}</tr>"

    return f"<table>{line('th', heads)}{''.join(line('td', row) for row in rows)}</table>"
