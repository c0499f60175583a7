"""The rows of a unit: its frames read, reconstructed and written as rows, errors included."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

from strand._core import __version__
from strand.batch.following import Follower, find_times, mask_frame
from strand.batch.frames import FrameInput, iterate_frames
from strand.batch.settings import Settings
from strand.batch.table import Row, make_record_batch
from strand.batch.units import SCENE, Unit, describe_error
from strand.reconstruction.finding.ropes import NoRopeError
from strand.reconstruction.pipeline import reconstruct
from strand.ropes.model import Model, list_model_crossings
from strand.support.checks import check_instance
from strand.tracking.track import Track

_SINGLE_SCENE = (
    "ValueError: a scene is one frame; to track ropes, name the folder of the scenes of all frames"
)


def make_rows(unit: Unit, settings: Settings) -> Any:
    """Reconstruct the frames of a unit, or follow the ropes through them, and return their rows.

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
    check_instance("unit", unit, Unit)
    check_instance("settings", settings, Settings)
    return make_record_batch(list(iterate_rows(unit, settings)), __version__, settings.digest)


def make_error_row(unit: Unit, error: str) -> Row:
    """Return the single row of a unit that has no result."""
    return Row(unit.recording, None, None, 0.0, error=error)


def iterate_rows(unit: Unit, settings: Settings) -> Iterator[Row]:
    """Yield the rows of `make_rows`."""
    if unit.error is not None:
        yield make_error_row(unit, unit.error)
        return
    if settings.track and unit.kind == SCENE:
        yield make_error_row(unit, _SINGLE_SCENE)
        return
    frames, previous, follower = iterate_frames(unit, settings), None, Follower(settings)
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
        stamp, track, (number, read) = None, None, item
        try:
            frame = read()
            stamp = frame.time
            if settings.track:
                stamp = max(find_times(number, frame, settings))
                track = follower.update(number, mask_frame(frame, settings))
                model = track.model
            else:
                previous = model = _reconstruct_frame(frame, settings, previous)
        except ImportError:
            raise
        except Exception as error:
            seconds = time.perf_counter() - begun
            yield make_unanswered_row(unit.recording, number, stamp, seconds, error)
        else:
            seconds = time.perf_counter() - begun
            yield from make_model_rows(unit.recording, number, stamp, model, seconds, track)
        number += settings.every
    if number is None and unit.start == 0:
        yield make_error_row(unit, "FileFormatError: no frame")


def make_unanswered_row(
    recording: str, number: int, stamp: float | None, seconds: float, error: Exception
) -> Row:
    """Return the row of a frame without a model; a frame without ropes is not an error."""
    if isinstance(error, NoRopeError):
        return Row(recording, number, stamp, seconds, warnings=[f"no rope: {error}"])
    return Row(recording, number, stamp, seconds, error=describe_error(error))


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
        branches=settings.branches,
        wire=settings.wire,
    )


def make_model_rows(
    recording: str,
    number: int,
    stamp: float | None,
    model: Model,
    seconds: float,
    track: Track | None = None,
) -> Iterator[Row]:
    """Yield a row for each chain of a model, or one row if it has none; the model may be that of a track."""
    crossings = list_model_crossings(model)
    warnings = [
        ({k for k in warning.chains if k < len(model.chains)}, f"{warning.kind}: {warning.message}")
        for warning in model.warnings
    ]
    if track is not None and not track.ropes:
        why = f": {track.reason}" if track.reason else ""
        warnings.append((set(), f"no rope: the tracker has found none so far{why}"))
    for rope, chain in enumerate(model.chains) if model.chains else [(None, None)]:
        yield Row(
            recording,
            number,
            stamp,
            seconds,
            rope,
            chain,
            model.confidence,
            [text for about, text in warnings if rope in about or not about],
            None if crossings is None else [one for one in crossings if one.over[0] == rope],
            up=model.up,
            table=model.table,
            track=track,
            harness=model.harness if rope in (None, 0) else None,
        )
