"""The rows of a unit: its frames read, reconstructed and written as rows, errors included."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

from strand._core import __version__
from strand.batch.frames import FrameInput, iterate_frames
from strand.batch.settings import Settings
from strand.batch.table import Row, make_record_batch
from strand.batch.units import Unit, describe_error
from strand.reconstruction.finding.ropes import NoRopeError
from strand.reconstruction.pipeline import reconstruct
from strand.ropes.crossings import list_crossings
from strand.ropes.model import Model


def make_rows(unit: Unit, settings: Settings) -> Any:
    """Reconstruct the frames of a unit, and return their rows.

    An error in a recording or a frame becomes a row. Within a unit, each frame's ropes have the same order
    of nodes as in the frames before.

    Parameters
    ----------
    unit : Unit
    settings : Settings

    Returns
    -------
    pyarrow.RecordBatch
        With the columns of `make_schema()`. It depends on the recording and the settings only, except for
        the column `seconds`.

    Raises
    ------
    ImportError
        If a package that reads the recording is missing.
    """
    return make_record_batch(list(_iterate_rows(unit, settings)), __version__, settings.digest)


def make_error_row(unit: Unit, settings: Settings, error: str) -> Any:
    """Return the single row of a unit that has no result."""
    return make_record_batch(
        [Row(unit.recording, None, None, 0.0, error=error)], __version__, settings.digest
    )


def _iterate_rows(unit: Unit, settings: Settings) -> Iterator[Row]:
    if unit.error is not None:
        yield Row(unit.recording, None, None, 0.0, error=unit.error)
        return
    frames, previous = iterate_frames(unit, settings), None
    # the number of the next frame; None until the recording is open
    number: int | None = None
    while True:
        begun = time.perf_counter()
        try:
            item = next(frames, None)
        except ImportError:
            raise
        except Exception as error:
            seconds = time.perf_counter() - begun
            yield Row(unit.recording, number, None, seconds, error=describe_error(error))
            return
        if item is None:
            break
        frame, (number, read) = None, item
        try:
            frame = read()
            model = _reconstruct_frame(frame, settings, previous)
        except ImportError:
            raise
        except Exception as error:
            seconds = time.perf_counter() - begun
            yield _make_unanswered_row(unit, number, None if frame is None else frame.time, seconds, error)
        else:
            previous = model
            yield from _make_model_rows(unit, number, frame.time, model, time.perf_counter() - begun)
        number += settings.every
    if number is None and unit.start == 0:
        yield Row(unit.recording, None, None, 0.0, error="FileFormatError: no frame")


def _make_unanswered_row(
    unit: Unit, number: int, stamp: float | None, seconds: float, error: Exception
) -> Row:
    """Return the row of a frame without a model; a frame without ropes is not an error."""
    if isinstance(error, NoRopeError):
        return Row(unit.recording, number, stamp, seconds, warnings=[f"no rope: {error}"])
    return Row(unit.recording, number, stamp, seconds, error=describe_error(error))


def _reconstruct_frame(frame: FrameInput, settings: Settings, previous: Model | None) -> Model:
    return reconstruct(
        frame.views,
        frame.radius if settings.radius is None else settings.radius,
        frame.bounds if settings.bounds is None else settings.bounds,
        settings.ropes,
        settings.config,
        length=settings.length,
        previous=previous,
        deadline=settings.deadline,
    )


def _make_model_rows(
    unit: Unit, number: int, stamp: float | None, model: Model, seconds: float
) -> Iterator[Row]:
    """Yield a row for each chain of a model, or one row if it has none."""
    crossings = list_crossings(model.chains, model.up, model.doubts, model.confidence)
    warnings = [
        ({k for k in warning.chains if k < len(model.chains)}, f"{warning.kind}: {warning.message}")
        for warning in model.warnings
    ]
    for rope, chain in enumerate(model.chains) if model.chains else [(None, None)]:
        yield Row(
            unit.recording,
            number,
            stamp,
            seconds,
            rope,
            chain,
            model.confidence,
            [text for about, text in warnings if rope in about or not about],
            [crossing for crossing in crossings if crossing.over[0] == rope],
            up=model.up,
            table=model.table,
        )
