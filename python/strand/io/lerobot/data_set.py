"""An open LeRobot data set: depth images and colours by the number of a frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.io.budget import Budget
from strand.io.image_parts import PNG
from strand.io.images import decode_color, decode_depth_png, decode_depth_tiff
from strand.io.lerobot.depth_codes import DepthCodes, read_codes
from strand.io.lerobot.episodes import read_episodes
from strand.io.lerobot.image_column import ImageColumn
from strand.io.lerobot.layout import INFO, read_layout
from strand.io.lerobot.tables import open_table
from strand.io.lerobot.video import Video
from strand.support.files import FileFormatError
from strand.support.stamps import count_nanoseconds

_UNITS = {"m": 1.0, "mm": 0.001}  # metres
_INDEX = ("index", "timestamp")


@dataclass(frozen=True)
class _Rows:
    """The frames of a table."""

    path: Path
    index: NDArray[np.int64]
    times: NDArray[np.float64]


class DataSet:
    """An open data set of version 3.

    Parameters
    ----------
    folder : Path
    max_bytes : int

    Attributes
    ----------
    layout : Layout
    episodes : Episodes
    budget : Budget
        What is left beside the numbers of the episodes.
    """

    def __init__(self, folder: Path, max_bytes: int) -> None:
        self.folder, self.budget = folder, Budget(max_bytes)
        self.layout = read_layout(folder, max_bytes)
        videos = [one.key for one in self.layout.features.values() if one.kind == "video"]
        self.episodes = read_episodes(self.layout, videos, self.budget)
        self.codes: dict[str, DepthCodes] = {}
        for feature in self.layout.features.values():
            if feature.depth and feature.kind == "video":
                try:
                    self.codes[feature.key] = read_codes(feature.info)
                except ValueError as error:
                    raise FileFormatError(folder / INFO, str(error), feature.key) from error
        self._depths = {key: codes.list_depths() for key, codes in self.codes.items()}
        self._rows: _Rows | None = None
        self._videos: dict[str, Video] = {}
        self._images: dict[str, ImageColumn] = {}

    def close(self) -> None:
        """Close all files."""
        for video in self._videos.values():
            video.close()
        for column in self._images.values():
            column.close()
        self._videos, self._images = {}, {}

    @property
    def depth_keys(self) -> tuple[str, ...]:
        """The features that are depth images."""
        return tuple(key for key, one in self.layout.features.items() if one.depth)

    @property
    def color_keys(self) -> tuple[str, ...]:
        """The features that are colour images."""
        return tuple(key for key, one in self.layout.features.items() if one.shows_color)

    def list_files(self, keys: Sequence[str]) -> tuple[Path, ...]:
        """Return the tables of frames, and the videos of some cameras."""
        found = {self.folder / INFO: None}
        for episode in range(len(self.episodes.ranges)):
            found[self.layout.find_data(*self.episodes.get_data(episode))] = None
            for key in keys:
                if self.layout.features[key].kind == "video":
                    chunk, file, _ = self.episodes.get_video(episode, key)
                    found[self.layout.find_video(key, chunk, file)] = None
        return tuple(found)

    def find_stamp(self, frame: int) -> int:
        """Return the time of a frame since the first one, nanoseconds.

        An episode begins where the frames of those before end, at the data set's rate.
        """
        episode = self.episodes.find(frame)
        begun = self.episodes.ranges[episode].start / self.layout.rate
        return count_nanoseconds(begun + self._find_row(episode, frame)[1])

    def read_depth(self, key: str, frame: int) -> tuple[NDArray[Any], float | None]:
        """Return a depth image and the metres of its unit; None for whole numbers without one."""
        feature, episode = self.layout.features[key], self.episodes.find(frame)
        if feature.kind == "video":
            codes = self._read_video(key, episode, frame)
            if codes.max() >= len(self._depths[key]):
                raise FileFormatError(self.folder, f"expected codes of 12 bits, got {codes.max()}", key)
            return self._depths[key][codes], 1.0
        path, data, budget = self._read_image(key, episode, frame)
        decode = decode_depth_png if data.startswith(PNG) else decode_depth_tiff
        depth = decode(path, data, budget, feature.size)
        unit = feature.info.get("depth_unit")
        if unit is None:
            return depth, 1.0 if depth.dtype.kind == "f" else None
        if unit not in _UNITS:
            raise FileFormatError(self.folder / INFO, f"expected depth_unit m or mm, got {unit!r}"[:200], key)
        return depth, _UNITS[unit]

    def read_color(self, key: str, frame: int) -> NDArray[np.uint8]:
        """Return the (H, W, 3) colours of a frame."""
        feature, episode = self.layout.features[key], self.episodes.find(frame)
        if feature.kind == "video":
            return self._read_video(key, episode, frame)
        path, data, budget = self._read_image(key, episode, frame)
        return decode_color(path, data, budget, feature.size)

    def _find_row(self, episode: int, frame: int) -> tuple[int, float]:
        """Return the row of a frame in its table, and its time in the episode, seconds."""
        path = self.layout.find_data(*self.episodes.get_data(episode))
        if self._rows is None or self._rows.path != path:
            self._rows = None
            with open_table(path, self.budget) as table:
                columns = table.read_numbers(_INDEX)
                self._rows = _Rows(
                    path, columns["index"].astype(np.int64), columns["timestamp"].astype(np.float64)
                )
                if (np.diff(self._rows.index) <= 0).any():
                    raise ValueError("frames that are not in order")
        row = int(np.searchsorted(self._rows.index, frame))
        if row == len(self._rows.index) or self._rows.index[row] != frame:
            raise FileFormatError(path, f"no row with index {frame}, a frame of episode {episode}")
        time = float(self._rows.times[row])
        if not 0.0 <= time <= 1e9:
            raise FileFormatError(path, f"expected seconds in the episode, got {time}", "timestamp")
        return row, time

    def _read_video(self, key: str, episode: int, frame: int) -> NDArray[Any]:
        chunk, file, begun = self.episodes.get_video(episode, key)
        path, feature = self.layout.find_video(key, chunk, file), self.layout.features[key]
        _, time = self._find_row(episode, frame)
        video = self._videos.get(key)
        if video is None or video.path != path:
            if video is not None:
                del self._videos[key]
                video.close()
            assert feature.size is not None
            video = Video(path, feature.size, self.layout.rate, feature.depth, self.budget.copy())
            self._videos[key] = video
        return video.read(begun + time)

    def _read_image(self, key: str, episode: int, frame: int) -> tuple[Path, bytes, Budget]:
        path = self.layout.find_data(*self.episodes.get_data(episode))
        row, _ = self._find_row(episode, frame)
        column = self._images.get(key)
        if column is None or column.path != path:
            if column is not None:
                del self._images[key]
                column.close()
            column = self._images[key] = ImageColumn(path, key, self.budget.copy())
        budget = self.budget.copy()
        data = column.read(row)
        budget.take(path, len(data))
        return path, data, budget
