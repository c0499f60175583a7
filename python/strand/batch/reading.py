"""Reading a batch: as one table, or as the models of its frames."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from strand.batch.shards import list_shards
from strand.batch.table import SCHEMA_VERSION, make_schema
from strand.batch.writing import VERSION_KEY
from strand.geometry.plane import Plane
from strand.io.budget import MAX_BYTES
from strand.io.models import parse_harness
from strand.ropes.chain import Chain
from strand.ropes.doubt import ModelWarning
from strand.ropes.harness import Harness
from strand.ropes.model import Model
from strand.ropes.seen_side import USUAL_UP
from strand.support.checks import check_integer, check_path, check_sequence, check_text
from strand.support.extras import import_extra
from strand.support.files import FileFormatError, decode_json, open_file, parse_json
from strand.support.pages import check_seal, measure_footer, measure_pages
from strand.tracking.track import TrackedRope

# kinds of warning that always name chains; a warning of another kind in all rows may be about none
_KINDS_WITH_CHAINS = ("branch", "cut end")


def load_table(
    out: str | os.PathLike[str], columns: Sequence[str] | None = None, *, max_bytes: int = MAX_BYTES
) -> Any:
    """Read a batch's table.

    Parameters
    ----------
    out : path
        The folder of shards.
    columns : sequence of str, optional
        The columns to read; all by default. Without nodes and covariances, a table is a hundred times
        smaller.
    max_bytes : int
        Half of the memory that the table may take by the headers of the shards, 4 GiB by default.

    Returns
    -------
    pyarrow.Table
        In the order of recordings, frames and ropes.

    Raises
    ------
    FileNotFoundError
        If the folder does not exist.
    ValueError
        If the schema has no such column.
    strand.FileFormatError
        If a shard is damaged, or the table may take more than 2 x `max_bytes`.
    ImportError
        If pyarrow is not installed.
    """
    pa, wanted = import_extra("pyarrow"), _check_columns(columns)
    read = [*dict.fromkeys(["recording", "frame", *wanted])]
    tables = [table for _, table in iterate_shards(out, read, max_bytes, whole=True)]
    # a shard holds frames of one recording in order, so it is enough to sort the shards
    tables.sort(key=_get_first_frame)
    if not tables:
        return make_schema().empty_table().select(wanted)
    return pa.concat_tables(tables).select(wanted)


def load_models(
    out: str | os.PathLike[str], *, max_bytes: int = MAX_BYTES
) -> Iterator[tuple[str, int, Model]]:
    """Yield a batch's models, with one shard in memory at a time; skip frames with an error.

    Parameters
    ----------
    out : path
        The folder of shards.
    max_bytes : int
        Half of the memory that the rows of a shard may take by its headers, 4 GiB by default.

    Yields
    ------
    recording : str
    frame : int
    model : Model
        It has the table's contents: chains with covariances, confidences, labels, colours and hidden ends,
        the model's confidence, `up`, `table`, warnings, time as `stamp`, and `harness` if the ropes branch.
        Tracked ropes are `TrackedRope`.
        It has no poses, curves, doubts, joins and alternatives. A warning names the chains in whose rows it
        stands, and has no place, amount or view.

    Raises
    ------
    FileNotFoundError
        If the folder does not exist.
    strand.FileFormatError
        If a shard is damaged, or may take more than 2 x `max_bytes`.
    ImportError
        If pyarrow is not installed.

    Notes
    -----
    The recordings come in no particular order; the frames of each are in order.
    """
    for path, table in iterate_shards(out, _check_columns(None), max_bytes):
        rows: list[dict[str, Any]] = []
        for row in table.to_pylist():
            if rows and row["frame"] != rows[0]["frame"]:
                yield from _make_model(path, rows, max_bytes)
                rows = []
            rows.append(row)
        yield from _make_model(path, rows, max_bytes)


def iterate_shards(
    out: str | os.PathLike[str], columns: Sequence[str], max_bytes: int, whole: bool = False
) -> Iterator[tuple[Path, Any]]:
    """Yield the path and the table of each shard, in the order of their names.

    By the headers of their pages, all tables together (`whole`) or the Python objects of each take at most
    2 x `max_bytes`; this is checked before pyarrow decodes them.
    """
    pa, pq = import_extra("pyarrow"), import_extra("pyarrow.parquet")
    schema, folder = make_schema(), check_path("out", out)
    left = 2 * check_integer("max_bytes", max_bytes, 1)
    for name in sorted(list_shards(folder), key=_get_sort_key):
        path = folder / name
        try:
            with open_file(path) as opened:
                size = os.fstat(opened.fileno()).st_size
                length, memory = measure_footer(opened, size)
                _require_memory(path, memory, left, max_bytes)
                check_seal(opened, size, length)
                file = pq.ParquetFile(
                    opened, page_checksum_verification=True, thrift_container_size_limit=max(length, 1)
                )
                _check_version(path, file.metadata.metadata)
                if not file.schema_arrow.equals(schema):
                    # checksums protect the rows, but not their types
                    raise FileFormatError(path, "truncated, damaged or not a shard (other columns)")
                leaves = [file.schema.column(k).path.partition(".")[0] for k in range(len(file.schema))]
                wanted = [k for k, leaf in enumerate(leaves) if leaf in columns]
                memory += measure_pages(opened, file.metadata, wanted, not whole, left - memory)
                _require_memory(path, memory, left, max_bytes)
                table = file.read(columns=list(columns), use_threads=False)
            left -= table.nbytes if whole else 0
            if len(table) != file.metadata.num_rows:
                raise FileFormatError(path, f"expected {file.metadata.num_rows} rows, got {len(table)}")
            yield path, table.select(columns).cast(pa.schema([schema.field(name) for name in columns]))
        except FileFormatError:
            raise
        except (pa.ArrowException, KeyError, ValueError, OSError) as error:
            # errors of the disk have a number; those of pyarrow have none
            if isinstance(error, OSError) and error.errno is not None:
                raise
            raise FileFormatError(path, f"truncated, damaged or not a shard ({error})") from error


def _require_memory(path: Path, memory: int, left: int, max_bytes: int) -> None:
    if memory > left:
        need = -(-(2 * max_bytes - left + memory) // 2)
        reason = (
            f"may take {memory} bytes of memory, but {left} are left of 2 x max_bytes={max_bytes}; "
            f"give {need} or more as max_bytes (--summary-max-bytes)"
        )
        raise FileFormatError(path, reason)


def _check_version(path: Path, metadata: dict[bytes, bytes] | None) -> None:
    version = (metadata or {}).get(VERSION_KEY.encode(), b"none").decode("utf-8", "replace")
    if version != f"{SCHEMA_VERSION}":
        reason = f"expected a shard with version {SCHEMA_VERSION} of the schema, got {version}"
        raise FileFormatError(path, reason, VERSION_KEY)


def _get_sort_key(name: str) -> tuple[str, int]:
    """Return a shard's recording and first frame."""
    recording, _, start, _ = name.split("-", 3)
    return recording, int(start)


def _get_first_frame(table: Any) -> tuple[str, int]:
    frame = table["frame"][0].as_py() if len(table) else None
    return (table["recording"][0].as_py() if len(table) else ""), -1 if frame is None else frame


def _check_columns(columns: Sequence[str] | None) -> list[str]:
    names = list(make_schema().names)
    if columns is None:
        return names
    wanted = [check_text("columns", name) for name in check_sequence("columns", columns, "names")]
    for name in wanted:
        if name not in names:
            raise ValueError(f"columns: expected some of {', '.join(names)}, got {name!r}")
    return wanted


def _make_model(
    path: Path, rows: Sequence[dict[str, Any]], max_bytes: int
) -> Iterator[tuple[str, int, Model]]:
    """Yield the model of a frame's rows, if they hold no error."""
    if not rows or rows[0]["error"] is not None:
        return
    try:
        chains = tuple(_make_chain(row) for row in rows if row["rope"] is not None)
        graph = rows[0]["graph"]
        harness = None if graph is None else _make_harness(read_graph(path, graph, max_bytes), chains)
        chains = chains if harness is None else tuple(edge.chain for edge in harness.edges)
        warnings = tuple(_make_warnings(rows))
        confidence, table = rows[0]["model_confidence"], rows[0]["table"]
        model = Model(
            chains,
            np.empty((0, 4, 4)),
            warnings=warnings,
            confidence=float("nan") if confidence is None else confidence,
            up=USUAL_UP if rows[0]["up"] is None else rows[0]["up"],
            table=None if table is None else Plane(np.array(table[:3]), table[3]),
            stamp=rows[0]["time"],
            harness=harness,
        )
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise FileFormatError.from_error(path, error) from error
    yield rows[0]["recording"], rows[0]["frame"], model


def _make_warnings(rows: Sequence[dict[str, Any]]) -> Iterator[ModelWarning]:
    """Yield the warnings of a frame's rows; equal texts in one row are separate warnings."""
    ropes: dict[tuple[str, int], list[int]] = {}
    for row in rows:
        repeats: Counter[str] = Counter()
        for text in row["warnings"]:
            ropes.setdefault((text, repeats[text]), []).append(row["rope"])
            repeats[text] += 1
    for (text, _), about in ropes.items():
        kind, message = text.split(": ", 1)
        # a warning about no chain is in all rows
        has_chains = kind in _KINDS_WITH_CHAINS or len(about) < len(rows)
        yield ModelWarning(kind, message, chains=tuple(about) if has_chains else ())


def read_graph(path: Path, text: str, max_bytes: int) -> Any:
    """Return the JSON of a graph in a row, in at most 2 x `max_bytes` of memory."""
    return parse_json(path, decode_json(path, text.encode(), max_bytes, "graph"), "graph")


def _make_harness(graph: dict[str, Any], chains: Sequence[Chain]) -> Harness:
    """Return the graph in a frame's first row; its edges have the deviations of the radii too."""
    edges = [
        {name: edge[name] for name in ("id", "start", "stop", "wires")}
        for edge in check_sequence("edges", graph["edges"], "edges")
    ]
    measured = tuple(
        replace(chain, radius_sd=edge["radius_sd"])
        for chain, edge in zip(chains, graph["edges"], strict=True)
    )
    return parse_harness({"nodes": graph["nodes"], "edges": edges}, measured)


def _make_chain(row: dict[str, Any]) -> Chain:
    covariance = row["covariance"]
    motion: dict[str, Any] = {}
    if row["state"] is not None:
        motion = {name: row[name] for name in ("generation", "state", "length_sd")}
        motion |= {name: np.array(row[name]) for name in ("velocity", "seen", "predicted", "age")}
        motion |= {"number": row["rope"], "s": np.array(row["arc_length"])}
    return (TrackedRope if motion else Chain)(
        np.array(row["nodes"]),
        row["radius"],
        row["closed"],
        **motion,
        covariance=None if covariance is None else np.array(covariance).reshape(-1, 3, 3),
        confidence=float("nan") if row["confidence"] is None else row["confidence"],
        label=row["label"],
        color=None if row["color"] is None else np.array(row["color"]),
        hidden_ends=tuple(row["hidden_ends"]),
    )
