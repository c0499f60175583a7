"""Write rows to Parquet files."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from typing import BinaryIO

from strand._core import __version__
from strand.batch.rows import make_model_rows
from strand.batch.table import SCHEMA_VERSION, Row, make_record_batch, make_schema
from strand.support.checks import check_instance, check_path, check_text
from strand.support.extras import import_extra
from strand.support.files import replace_file
from strand.support.pages import seal_footer
from strand.tracking.track import Track

VERSION_KEY = "strand.schema"
"""Key of the schema's version in a file's metadata."""

_AT_ONCE = 200  # rows that are written at once; a row takes some 40 kB of memory

# nodes hardly repeat, so dictionaries only cost time; zstd takes twice the time of snappy to save a tenth;
# Parquet's own types hold all of the schema
_OPTIONS = {
    "compression": "snappy",
    "use_dictionary": False,
    "store_schema": False,
    "write_statistics": ["recording"],
    "write_page_checksum": True,
}


def write_rows(
    rows: Iterable[Row], file: BinaryIO, configuration: str, digest: str | None = None
) -> tuple[int, int]:
    """Write rows to a Parquet file, with the schema's version and the input's digest in its metadata.

    Some 200 rows are in memory at a time.

    Parameters
    ----------
    rows : iterable of Row
    file : binary file
        Open for reading too.
    configuration : str
        Digest of the settings.
    digest : str, optional
        Digest of the recording.

    Returns
    -------
    written : int
        Number of rows.
    errors : int
        Number of rows with an error.
    """
    written = errors = 0
    parquet = import_extra("pyarrow.parquet").ParquetWriter(file, make_schema(), **_OPTIONS)
    try:
        for part in _split(rows):
            parquet.write_batch(make_record_batch(part, __version__, configuration))
            written += len(part)
            errors += sum(row.error is not None for row in part)
        parquet.add_key_value_metadata({VERSION_KEY: f"{SCHEMA_VERSION}", "strand.input": digest or ""})
    finally:  # also of an incomplete file, which the writer would end after the file is closed
        parquet.close()
    seal_footer(file)
    return written, errors


def _split(rows: Iterable[Row]) -> Iterator[Sequence[Row]]:
    remaining = iter(rows)
    while part := list(islice(remaining, _AT_ONCE)):
        yield part


def write_tracks(tracks: Iterable[Track], path: str | os.PathLike[str], recording: str = "") -> int:
    """Write the answers of a `strand.Tracker` to a Parquet file with the columns of `make_schema()`.

    Parameters
    ----------
    tracks : iterable of Track
        They are numbered from 0; some 200 rows are in memory at a time.
    path : path
        An existing file is replaced when the new one is complete.
    recording : str
        Name of the recording in the rows.

    Returns
    -------
    int
        The number of rows. Their `configuration` is empty, and their `seconds` are 0.

    Raises
    ------
    ImportError
        If pyarrow is not installed.
    OSError
        If the file cannot be written.
    """
    import_extra("pyarrow.parquet")
    path, recording = check_path("path", path), check_text("recording", recording)
    check_instance("tracks", tracks, Iterable)  # type: ignore[type-abstract]
    rows = (
        row
        for number, given in enumerate(tracks)
        for track in (check_instance(f"tracks[{number}]", given, Track),)
        for row in make_model_rows(recording, number, track.time, track.model, 0.0, track)
    )
    with replace_file(path) as file:
        return write_rows(rows, file, "")[0]
