"""Reading a batch back: one table, or models frame by frame."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from strand.batch.shards import VERSION_KEY, names
from strand.batch.table import SCHEMA_VERSION, schema
from strand.ropes.chain import Chain
from strand.ropes.doubt import ModelWarning
from strand.ropes.model import Model
from strand.support.checks import check_path, check_sequence, check_text
from strand.support.extras import import_extra
from strand.support.files import FileFormatError

# warnings that always name chains; of others it cannot be told whether they are about all or about none
_ABOUT_CHAINS = ("branch", "cut end")


def load(out: str | os.PathLike[str], columns: Sequence[str] | None = None) -> Any:
    """Read a batch's table.

    Parameters
    ----------
    out : path
        The folder of shards.
    columns : sequence of str, optional
        Which columns; all if not given. Without nodes and covariances a table is a hundred times smaller.

    Returns
    -------
    pyarrow.Table
        In the order of recordings, frames and ropes.

    Raises
    ------
    FileNotFoundError
        If there is no such folder.
    ValueError
        If there is no such column.
    strand.FileFormatError
        If a shard is damaged.
    ImportError
        If pyarrow is not installed.
    """
    pa, wanted = import_extra("pyarrow"), _columns(columns)
    read = [one for _, one in tables(out, [*dict.fromkeys(["recording", "frame", *wanted])])]
    # each shard has frames of one recording in order, so shards are put in order instead of rows
    read.sort(key=_place)
    if not read:
        return schema().empty_table().select(wanted)
    return pa.concat_tables(read).select(wanted)


def load_models(out: str | os.PathLike[str]) -> Iterator[tuple[str, int, Model]]:
    """Go through a batch's models, one shard in memory at a time; frames with an error are left out.

    Parameters
    ----------
    out : path
        The folder of shards.

    Yields
    ------
    recording : str
    frame : int
    model : Model
        With its chains, their covariances and confidences, its own confidence and its warnings: what the
        table holds. It has no poses, curves, doubts, joins and alternatives. Recordings come in no special
        order, and each one's frames in theirs. A warning's chains are those in whose rows it is, the lowest
        number first; it has no place, amount and view.

    Raises
    ------
    FileNotFoundError
        If there is no such folder.
    strand.FileFormatError
        If a shard is damaged.
    ImportError
        If pyarrow is not installed.
    """
    for path, table in tables(out, _columns(None)):
        rows: list[dict[str, Any]] = []
        for row in table.to_pylist():
            if rows and row["frame"] != rows[0]["frame"]:
                yield from _model(path, rows)
                rows = []
            rows.append(row)
        yield from _model(path, rows)


def tables(out: str | os.PathLike[str], columns: Sequence[str]) -> Iterator[tuple[Path, Any]]:
    """Go through the paths and tables of all shards, in the order of their names."""
    pa, pq = import_extra("pyarrow"), import_extra("pyarrow.parquet")
    wanted, folder = schema(), check_path("out", out)
    for name in sorted(names(folder), key=_in_order):
        path = folder / name
        try:
            file = pq.ParquetFile(path, page_checksum_verification=True)
            _require_schema(path, file.metadata.metadata)
            if not file.schema_arrow.equals(wanted):
                # checksums are of the rows, not of what says how they are read
                raise FileFormatError(path, "truncated, damaged or no shard (its columns are others)")
            table = file.read(columns=list(columns), use_threads=False)
            if len(table) != file.metadata.num_rows:
                raise FileFormatError(path, f"expected {file.metadata.num_rows} rows, got {len(table)}")
            yield path, table.select(columns).cast(pa.schema([wanted.field(one) for one in columns]))
        except (pa.ArrowException, KeyError, UnicodeDecodeError, OSError) as error:
            # what is wrong with a disk has a number; pyarrow's own errors have none
            if isinstance(error, OSError) and error.errno is not None:
                raise
            raise FileFormatError(path, f"truncated, damaged or no shard ({error})") from error


def _require_schema(path: Path, said: dict[bytes, bytes] | None) -> None:
    version = (said or {}).get(VERSION_KEY.encode(), b"none").decode("utf-8", "replace")
    if version != f"{SCHEMA_VERSION}":
        reason = f"expected a shard of version {SCHEMA_VERSION} of the schema, got {version}"
        raise FileFormatError(path, reason, VERSION_KEY)


def _in_order(name: str) -> tuple[str, int]:
    """Sort a recording's stretches by their first frame."""
    recording, _, start, _ = name.split("-", 3)
    return recording, int(start)


def _place(table: Any) -> tuple[str, int]:
    frame = table["frame"][0].as_py() if len(table) else None
    return (table["recording"][0].as_py() if len(table) else ""), -1 if frame is None else frame


def _columns(columns: Sequence[str] | None) -> list[str]:
    if columns is None:
        return list(schema().names)
    wanted = [check_text("columns", one) for one in check_sequence("columns", columns, "names")]
    for one in wanted:
        if one not in schema().names:
            raise ValueError(f"columns: expected some of {', '.join(schema().names)}, got {one!r}")
    return wanted


def _model(path: Path, rows: Sequence[dict[str, Any]]) -> Iterator[tuple[str, int, Model]]:
    """Make the model of a frame's rows, if it has no error."""
    if not rows or rows[0]["error"] is not None:
        return
    try:
        chains = tuple(_chain(row) for row in rows if row["rope"] is not None)
        warnings = tuple(_warnings(rows))
        sure = rows[0]["model_confidence"]
        model = Model(
            chains, np.empty((0, 4, 4)), warnings=warnings, confidence=float("nan") if sure is None else sure
        )
    except (TypeError, ValueError) as error:
        raise FileFormatError.from_error(path, error) from error
    yield rows[0]["recording"], rows[0]["frame"], model


def _warnings(rows: Sequence[dict[str, Any]]) -> Iterator[ModelWarning]:
    """Go through the warnings of a frame's rows: of equal ones in one row each is a warning of its own."""
    ropes: dict[tuple[str, int], list[int]] = {}
    for row in rows:
        times: Counter[str] = Counter()
        for words in row["warnings"]:
            ropes.setdefault((words, times[words]), []).append(row["rope"])
            times[words] += 1
    for (words, _), about in ropes.items():
        kind, message = words.split(": ", 1)
        # what is about no chain is in the rows of all
        named = kind in _ABOUT_CHAINS or len(about) < len(rows)
        yield ModelWarning(kind, message, chains=tuple(about) if named else ())


def _chain(row: dict[str, Any]) -> Chain:
    covariance = row["covariance"]
    return Chain(
        np.array(row["nodes"]),
        row["radius"],
        row["closed"],
        covariance=None if covariance is None else np.array(covariance).reshape(-1, 3, 3),
        confidence=float("nan") if row["confidence"] is None else row["confidence"],
    )
