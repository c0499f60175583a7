"""The work: a pure function from one unit to its rows, errors included."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

from strand._core import __version__
from strand.batch.frames import Seen, frames
from strand.batch.settings import Settings
from strand.batch.table import Row, record_batch
from strand.batch.units import Unit, in_words
from strand.reconstruction.finding.ropes import NoRopeError
from strand.reconstruction.pipeline import reconstruct
from strand.ropes.crossings import list_crossings
from strand.ropes.model import Model


def rows_of(unit: Unit, settings: Settings) -> Any:
    """Return a unit's rows.

    What is wrong with a recording or a frame is a row with its error. Along a unit each frame's ropes run the
    way of those before.

    Parameters
    ----------
    unit : Unit
    settings : Settings

    Returns
    -------
    pyarrow.RecordBatch
        Of `strand.batch.schema()`. It depends on the recording and the settings alone, but for the column
        `seconds`.

    Raises
    ------
    ImportError
        If a package is missing that reading the recording needs: no recording would be read without it.
    """
    return record_batch(list(_rows(unit, settings)), __version__, settings.digest)


def lost(unit: Unit, settings: Settings, why: str) -> Any:
    """Return the row of a unit that ends whatever process works on it."""
    return record_batch([Row(unit.recording, None, None, 0.0, error=why)], __version__, settings.digest)


def _rows(unit: Unit, settings: Settings) -> Iterator[Row]:
    if unit.error is not None:
        yield Row(unit.recording, None, None, 0.0, error=unit.error)
        return
    found, previous = frames(unit, settings), None
    # the frame that comes next; none before the recording is open, or if it has no other
    number: int | None = None
    while True:
        begun = time.perf_counter()
        try:
            look = next(found, None)
        except ImportError:
            raise
        except Exception as error:
            yield Row(unit.recording, number, None, time.perf_counter() - begun, error=in_words(error))
            return
        if look is None:
            break
        seen, number = None, look[0]
        try:
            seen = look[1]()
            model = _model(seen, settings, previous)
        except ImportError:
            raise
        except Exception as error:
            spent = time.perf_counter() - begun
            yield _unanswered(unit, number, None if seen is None else seen.time, spent, error)
        else:
            previous = model
            yield from _ropes(unit, number, seen.time, model, time.perf_counter() - begun)
        number += settings.every
    if number is None and unit.start == 0:
        yield Row(unit.recording, None, None, 0.0, error="FileFormatError: no frame")


def _unanswered(unit: Unit, number: int, when: float | None, seconds: float, error: Exception) -> Row:
    """Return the row of a frame without a model: that there is no rope is an answer, all else an error."""
    if isinstance(error, NoRopeError):
        return Row(unit.recording, number, when, seconds, warnings=[f"no rope: {error}"])
    return Row(unit.recording, number, when, seconds, error=in_words(error))


def _model(seen: Seen, settings: Settings, previous: Model | None) -> Model:
    return reconstruct(
        seen.views,
        seen.radius if settings.radius is None else settings.radius,
        seen.bounds if settings.bounds is None else settings.bounds,
        settings.ropes,
        settings.config,
        length=settings.length,
        previous=previous,
        deadline=settings.deadline,
    )


def _ropes(unit: Unit, number: int, when: float | None, model: Model, seconds: float) -> Iterator[Row]:
    """Go through the rows of a model: one for each chain, or one if there is none."""
    crossings = list_crossings(model.chains, (0, 0, 1), model.doubts)
    warned = [
        ({number for number in one.chains if number < len(model.chains)}, f"{one.kind}: {one.message}")
        for one in model.warnings
    ]
    for rope, chain in enumerate(model.chains) if model.chains else [(None, None)]:
        yield Row(
            unit.recording,
            number,
            when,
            seconds,
            rope,
            chain,
            model.confidence,
            [said for about, said in warned if rope in about or not about],
            [one for one in crossings if one.over[0] == rope],
        )
