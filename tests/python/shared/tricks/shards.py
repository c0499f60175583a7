"""Tricks with shards of batches: small Parquet files whose pages hold far more."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from shared.tricks import MAX_BYTES, Trick
from strand.batch import load_models, load_table, make_schema
from strand.batch.shards import DIGITS
from strand.batch.summary import summarize
from strand.batch.table import SCHEMA_VERSION
from strand.batch.writing import VERSION_KEY

_NAME = f"aa/{'a' * DIGITS}-{'b' * DIGITS}-0-end.parquet"
_ROWS = 1_000_000
_FEW = 3000  # rows of no values that fit
_LENGTH = 40_000_000  # letters of a long text


def list_tricks() -> list[Trick]:
    """Return the tricks with shards."""
    readers: dict[str, Callable[[Path], Any]] = {
        "tables": lambda folder: load_table(folder, max_bytes=MAX_BYTES),
        "models": lambda folder: list(load_models(folder, max_bytes=MAX_BYTES)),
        "summaries": lambda folder: summarize(folder, MAX_BYTES),
    }
    makes: dict[str, Callable[[Path], Any]] = {
        "many rows": lambda folder: _write(folder, _ROWS),
        "many short lists": lambda folder: _write(folder, 2, nodes=[[[]] * _ROWS] * 2),
        "long texts": lambda folder: _write(folder, 2, error="a" * _LENGTH),
        "a text of a dictionary": lambda folder: _write(folder, 2000, True, error="a" * 1_000_000),
    }
    bombs = [
        Trick(f"shard of {what} for {name}", make, read, seconds=2.0)
        for what, make in makes.items()
        for name, read in readers.items()
    ]
    fits = [
        Trick(f"shard of rows that fit for {name}", lambda folder: _write(folder, _FEW), read, True)
        for name, read in readers.items()
    ]
    return bombs + fits


def _write(folder: Path, rows: int, dictionary: bool = False, **values: Any) -> None:
    """Write a shard with rows of one text each, or of the same values."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    (folder / "aa").mkdir()
    given = {"recording": "a", "version": "a", "configuration": "a", "seconds": 0.0, "warnings": []} | values
    columns = []
    for field in make_schema():
        value = given.get(field.name)
        if field.name == "nodes" and value is not None:
            columns.append(pa.array(value, field.type))
        else:
            columns.append(pa.repeat(pa.scalar(value, field.type), rows))
    with pq.ParquetWriter(
        folder / _NAME, make_schema(), compression="zstd", use_dictionary=dictionary, store_schema=False
    ) as writer:
        writer.write_table(pa.table(columns, schema=make_schema()))
        writer.add_key_value_metadata({VERSION_KEY: f"{SCHEMA_VERSION}"})
