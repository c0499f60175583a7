"""Thousands of recordings: a table of their ropes, made by processes of this machine or by a Ray cluster."""

from strand.batch.engines import EngineError
from strand.batch.reading import load_models, load_table
from strand.batch.rope_columns import write_lerobot
from strand.batch.rows import make_rows
from strand.batch.running import Counts, run
from strand.batch.settings import Settings
from strand.batch.summary import write_summary
from strand.batch.table import make_schema
from strand.batch.units import Unit, find_units
from strand.batch.writing import write_tracks

__all__ = [
    "Counts",
    "EngineError",
    "Settings",
    "Unit",
    "find_units",
    "load_models",
    "load_table",
    "make_rows",
    "make_schema",
    "run",
    "write_lerobot",
    "write_summary",
    "write_tracks",
]

__dir__ = __all__.copy
