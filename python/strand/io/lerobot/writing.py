"""Write a data set beside another one, with further columns; videos and images are copied as they are."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.io.budget import Budget
from strand.io.lerobot.data_set import DataSet
from strand.io.lerobot.episodes import list_episode_files
from strand.io.lerobot.layout import INFO, STATS
from strand.io.lerobot.tables import open_table
from strand.support.extras import import_extra
from strand.support.files import FileFormatError, open_file, read_json, write_json

_ROWS = 64  # rows that are read at once
_GROUP = 1 << 26  # bytes of rows that are written at once, at most
_QUANTILES = (0.01, 0.1, 0.5, 0.9, 0.99)  # those that LeRobot keeps
_Make = Callable[[NDArray[np.int64]], dict[str, Any]]  # from the numbers of rows to Arrow arrays


@dataclass(frozen=True, eq=False)
class Column:
    """A new feature of a data set.

    Attributes
    ----------
    values : (F, ...) ndarray
        The value of each frame, of one or two dimensions.
    names : list of str or None
        The names of the dimensions in `meta/info.json`.
    """

    values: NDArray[Any]
    names: list[str] | None = None

    def describe(self) -> dict[str, Any]:
        """Return the feature's entry in `meta/info.json`."""
        return {"dtype": str(self.values.dtype), "shape": list(self.values.shape[1:]), "names": self.names}

    def make_array(self, frames: NDArray[np.int64]) -> Any:
        """Return the values of some frames as an Arrow array; a shape of (1,) is a number, as in LeRobot."""
        arrow = import_extra("pyarrow")
        values = self.values[frames]
        flat = arrow.array(values.ravel())
        if values.shape[1:] == (1,):
            return flat
        if values.ndim == 2:
            return arrow.FixedSizeListArray.from_arrays(flat, values.shape[1])
        count, rows, width = values.shape
        inner = arrow.ListArray.from_arrays(np.arange(count * rows + 1, dtype=np.int32) * width, flat)
        return arrow.ListArray.from_arrays(np.arange(count + 1, dtype=np.int32) * rows, inner)

    def compute_stats(self, frames: slice = slice(None)) -> dict[str, list[Any]]:
        """Return the statistics of some frames, over all dimensions but the last, as LeRobot makes them."""
        chosen = self.values[frames]
        flat = chosen.reshape(-1, chosen.shape[-1]).astype(np.float64)
        stats = {"min": flat.min(0), "max": flat.max(0), "mean": flat.mean(0), "std": flat.std(0)}
        found = {name: value.tolist() for name, value in stats.items()} | {"count": [len(chosen)]}
        quantiles = np.quantile(flat, _QUANTILES, axis=0)
        return found | {
            f"q{round(100 * q):02d}": row.tolist() for q, row in zip(_QUANTILES, quantiles, strict=True)
        }


def check_new_folder(out: Path, folder: Path) -> None:
    """Raise an error if a new data set cannot be written at `out`, beside the data set in `folder`."""
    if os.path.lexists(out):
        raise FileExistsError(
            f"{out}: expected a new folder, which is never overwritten, got an existing path"
        )
    inside = Path(os.path.realpath(out))
    if Path(os.path.realpath(folder)) in inside.parents:
        raise ValueError(f"out: expected a folder beside the data set {folder}, got {out} inside of it")
    if not out.absolute().parent.is_dir():
        raise FileNotFoundError(f"{out}: expected an existing folder around the new one")


def write_columns(data: DataSet, out: Path, columns: Mapping[str, Column]) -> None:
    """Write a copy of a data set with further columns; `out` appears when it is complete."""
    check_new_folder(out, data.folder)
    for key in columns:
        if key in data.layout.features:
            raise ValueError(f"feature: the data set has {key} already")
    import_extra("pyarrow.parquet")
    target = out.absolute()
    temporary = target.with_name(f".strand-{secrets.token_hex(8)}.tmp")
    temporary.mkdir()
    try:
        _write(data, temporary, columns)
        if os.path.lexists(target):
            raise FileExistsError(f"{out}: another program has made it meanwhile")
        temporary.rename(target)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise


def _write(data: DataSet, out: Path, columns: Mapping[str, Column]) -> None:
    episodes = list_episode_files(data.folder)
    tables = [path for path in data.list_files([]) if path != data.folder / INFO]
    stats = {key: column.compute_stats() for key, column in columns.items()}
    own = [
        {key: column.compute_stats(slice(frames.start, frames.stop)) for key, column in columns.items()}
        for frames in data.episodes.ranges
    ]

    def make_values(frames: NDArray[np.int64]) -> dict[str, Any]:
        return {key: column.make_array(frames) for key, column in columns.items()}

    def make_stats(numbers: NDArray[np.int64]) -> dict[str, Any]:
        arrow = import_extra("pyarrow")
        return {
            f"stats/{key}/{name}": arrow.array([own[k][key][name] for k in numbers.tolist()])
            for key, found in stats.items()
            for name in found
        }

    made = {data.folder / INFO, data.folder / STATS, *episodes, *tables}
    for path, count, key, make in (
        *((path, data.episodes.count, "index", make_values) for path in tables),
        *((path, len(data.episodes.ranges), "episode_index", make_stats) for path in episodes),
    ):
        _rewrite_table(path, _place(data, out, path), key, count, make, data.budget.copy())
    content = dict(data.layout.content)
    content["features"] = content["features"] | {key: column.describe() for key, column in columns.items()}
    write_json(_place(data, out, data.folder / INFO), content)
    known = read_json(data.folder / STATS) if (data.folder / STATS).exists() else {}
    if not isinstance(known, dict):
        raise FileFormatError(data.folder / STATS, "expected the statistics of features by their names")
    write_json(_place(data, out, data.folder / STATS), known | stats)
    for path in _list_files(data.folder):
        if path not in made:
            open_file(path).close()
            shutil.copyfile(path, _place(data, out, path))


def _place(data: DataSet, out: Path, path: Path) -> Path:
    """Return the path of a file in the new data set, and make its folder."""
    place = out / path.relative_to(data.folder)
    place.parent.mkdir(parents=True, exist_ok=True)
    return place


def _list_files(folder: Path) -> Iterator[Path]:
    """Yield the files below a folder, links followed; names that begin with a point are skipped."""
    seen = set()
    for inside, folders, files in os.walk(folder, followlinks=True):
        real = os.path.realpath(inside)
        folders[:] = [] if real in seen else sorted(name for name in folders if not name.startswith("."))
        if real not in seen:
            yield from (Path(inside, name) for name in sorted(files) if not name.startswith("."))
        seen.add(real)


def _rewrite_table(source: Path, target: Path, key: str, count: int, make: _Make, budget: Budget) -> None:
    """Copy a table with new columns for its rows, whose numbers below `count` are in the column `key`."""
    arrow, parquet = import_extra("pyarrow"), import_extra("pyarrow.parquet")
    with open_table(source, budget) as table:
        names = table.file.schema_arrow.names
        writer = None
        try:
            for group in range(table.file.metadata.num_row_groups):
                held: list[Any] = []
                for batch in table.read_rows(group, 0, names, _ROWS):
                    numbers = batch.column(names.index(key)).to_numpy().astype(np.int64)
                    if len(numbers) and not 0 <= numbers.min() <= numbers.max() < count:
                        raise ValueError(f"column {key}: expected numbers from 0 to {count - 1}")
                    added = make(numbers)
                    part = arrow.Table.from_batches([batch])
                    for name, values in added.items():
                        if name in names:
                            raise ValueError(f"a column {name}, which info.json does not name")
                        part = part.append_column(name, values)
                    if writer is None:
                        writer = parquet.ParquetWriter(target, part.schema, compression="snappy")
                    held.append(part)
                    if sum(one.nbytes for one in held) >= _GROUP:
                        _write_group(writer, held)
                if held:
                    _write_group(writer, held)
            if writer is None:
                raise ValueError("no rows")
        finally:
            if writer is not None:
                writer.close()


def _write_group(writer: Any, held: list[Any]) -> None:
    """Write tables as one group of rows, and forget them."""
    whole = import_extra("pyarrow").concat_tables(held)
    writer.write_table(whole, row_group_size=max(len(whole), 1))
    held.clear()
