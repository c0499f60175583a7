"""Thousands of recordings: a table of their ropes, by this machine's processes or by a Ray cluster."""

from strand.batch.engines import EngineError
from strand.batch.reading import load, load_models
from strand.batch.running import Done, run
from strand.batch.settings import Settings
from strand.batch.summary import write_summary
from strand.batch.table import schema
from strand.batch.units import Unit, find
from strand.batch.work import rows_of

__all__ = [
    "Done",
    "EngineError",
    "Settings",
    "Unit",
    "find",
    "load",
    "load_models",
    "rows_of",
    "run",
    "schema",
    "write_summary",
]

__dir__ = __all__.copy
