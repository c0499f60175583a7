"""Ropes as columns of a LeRobot data set: their points, what is seen of them, and their confidence."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from strand.io.budget import MAX_BYTES
from strand.io.lerobot.data_set import DataSet
from strand.io.lerobot.writing import Column, check_new_folder, write_columns
from strand.ropes.chain import Chain
from strand.ropes.model import Model
from strand.support.checks import check_instance, check_integer, check_path, check_text
from strand.tracking.track import TrackedRope

POINTS = 64  # points of a rope in a data set
FEATURE = "observation.rope"
"""Name of the feature."""

_MAX_POINTS = 10_000
_Rope = tuple[NDArray[np.float32], NDArray[np.bool_] | None, float]


class RopeColumns:
    """Collects the ropes of a data set's frames, as `write_lerobot` writes them.

    Parameters
    ----------
    path : path
        The data set.
    out : path
        The new one, which must not exist.
    points : int
    ropes : int, optional
    feature : str
    max_bytes : int
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        out: str | os.PathLike[str],
        *,
        points: int = POINTS,
        ropes: int | None = None,
        feature: str = FEATURE,
        max_bytes: int = MAX_BYTES,
    ) -> None:
        self._points = check_integer("points", points, 2, _MAX_POINTS)
        self._most = None if ropes is None else check_integer("ropes", ropes, 1)
        self._feature = check_text("feature", feature)
        if "/" in self._feature:
            raise ValueError(f"feature: expected a name without /, got {feature!r}")
        self._out = check_path("out", out)
        self._data = DataSet(check_path("data_set", path), check_integer("max_bytes", max_bytes, 1))
        check_new_folder(self._out, self._data.folder)
        self._frames: dict[int, dict[int, _Rope]] = {}

    def add(self, frame: int, model: Model) -> None:
        """Keep the ropes of a frame, by their numbers if they are tracked."""
        count = self._data.episodes.count
        if not 0 <= frame < count:
            raise ValueError(f"models: frame {frame}: the data set has {count} frames, 0 to {count - 1}")
        if frame in self._frames:
            raise ValueError(f"models: frame {frame} comes twice")
        self._data.budget.take(self._data.folder, 2048 + len(model.chains) * 32 * self._points)
        self._frames[frame] = {
            chain.number if isinstance(chain, TrackedRope) else k: self._convert(chain)
            for k, chain in enumerate(model.chains)
        }

    def write(self) -> None:
        """Write the new data set."""
        most = max((len(ropes) for ropes in self._frames.values()), default=0)
        count = max(most, 1) if self._most is None else self._most
        frames, n = self._data.episodes.count, self._points
        self._data.budget.take(self._data.folder, frames * count * (16 * n + 8))
        points = np.zeros((count, frames, n, 3), np.float32)
        seen = np.zeros((count, frames, n), np.bool_)
        valid = np.zeros((count, frames, 1), np.bool_)
        confidence = np.zeros((count, frames, 1), np.float32)
        known = False
        for episode in self._data.episodes.ranges:
            inside = [frame for frame in episode if frame in self._frames]
            places = self._choose_places(inside, count)
            for frame in inside:
                for number, (shape, shown, share) in self._frames[frame].items():
                    if (place := places.get(number)) is None:
                        continue
                    points[place, frame], valid[place, frame], confidence[place, frame] = shape, True, share
                    if shown is not None:
                        seen[place, frame], known = shown, True
        columns: dict[str, Column] = {}
        for k in range(count):
            name = self._feature if count == 1 else f"{self._feature}{k}"
            columns[name] = Column(points[k], ["point", "xyz"])
            columns[f"{name}.valid"] = Column(valid[k])
            columns[f"{name}.confidence"] = Column(confidence[k])
            if known:
                columns[f"{name}.seen"] = Column(seen[k])
        write_columns(self._data, self._out, columns)

    def _convert(self, chain: Chain) -> _Rope:
        nodes = chain.resample(max(self._points, 3) if chain.closed else self._points)
        confidence = 0.0 if np.isnan(chain.confidence) else float(chain.confidence)
        seen = None if nodes.points_seen is None else nodes.points_seen[: self._points] > 0
        if isinstance(chain, TrackedRope):
            share = np.linspace(0.0, chain.length, self._points)
            steps = np.abs(chain.s[None] - share[:, None]).argmin(axis=1)
            seen = chain.seen[steps]
        return nodes.points[: self._points].astype(np.float32), seen, confidence

    def _choose_places(self, frames: list[int], count: int) -> dict[int, int]:
        """Return the places of the ropes that most frames of an episode have, in order of their numbers."""
        often = Counter(number for frame in frames for number in self._frames[frame])
        chosen = sorted(often, key=lambda number: (-often[number], number))[:count]
        return {number: k for k, number in enumerate(sorted(chosen))}


def write_lerobot(
    models: Iterable[tuple[int, Model]],
    data_set: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    points: int = POINTS,
    ropes: int | None = None,
    feature: str = FEATURE,
    max_bytes: int = MAX_BYTES,
) -> None:
    """Write a copy of a LeRobot data set with the ropes of each frame as further features.

    `feature` has the points of the rope, `feature.valid` whether there is one, `feature.confidence` its
    confidence, and `feature.seen`, if known, whether each point is seen. Frames without a rope have zeros.
    With several ropes, their numbers from 0 follow the name. Statistics of the new features are added; videos
    and images are copied as they are.

    Parameters
    ----------
    models : iterable of (int, Model)
        The number of a frame, its `index` in the data set, and its ropes: of `strand.reconstruct`,
        `strand.batch.load_models` or `Track.model`.
    data_set : path
        The folder of the data set, which stays as it is.
    out : path
        The new folder, which must not exist; it appears when it is complete.
    points : int
        Number of points of a rope, at equal distances along it; world frame, metres.
    ropes : int, optional
        Number of ropes that have columns; by default as many as a frame has at most. In each episode, these
        are the ropes that are in the most frames, in order of their numbers.
    feature : str
        Name of the feature.
    max_bytes : int
        Memory limit for the data set's tables and the ropes, bytes; 4 GiB by default.

    Raises
    ------
    OSError
        If `out` exists, or a file cannot be read or written.
    TypeError, ValueError
        If an argument has the wrong type, `out` is inside the data set, or a frame is not in it or comes
        twice.
    strand.FileFormatError
        If the data set is damaged, of another version, or larger than the limit.
    ImportError
        If pyarrow is not installed.
    """
    columns = RopeColumns(data_set, out, points=points, ropes=ropes, feature=feature, max_bytes=max_bytes)
    for i, given in enumerate(check_instance("models", models, Iterable)):  # type: ignore[type-abstract]
        pair = check_instance(f"models[{i}]", given, tuple)
        if len(pair) != 2:
            raise ValueError(f"models[{i}]: expected a frame's number and its model, got {len(pair)} values")
        frame = check_integer(f"models[{i}]: frame", pair[0])
        columns.add(frame, check_instance(f"models[{i}]", pair[1], Model))
    columns.write()
