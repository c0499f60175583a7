"""The frames of a LeRobot data set, as those of a bag: each row of the data set is one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from strand.io.lerobot.data_set import DataSet
from strand.io.lerobot.layout import INFO
from strand.io.recordings.depth_messages import MILLIMETER
from strand.io.recordings.frame_options import FrameOptions, check_poses
from strand.io.recordings.frames import Frame, UndecodedFrame
from strand.support.files import FileFormatError
from strand.support.lazy import lazy_property
from strand.support.stamps import SECOND
from strand.views.view import View

_VIEWS = 2  # views in memory: a caller may still hold the one before
_STAMP = 8  # bytes of the time of a frame


class DataSetFrames:
    """The frames of a data set; the attributes and errors are those of `strand.Recording`."""

    def __init__(self, path: Path, options: FrameOptions) -> None:
        if options.world is not None:
            raise ValueError(
                "world: a LeRobot data set has no TF; expected poses, or the only camera's frame"
            )
        self.path = path
        self.frame_id = "world"  # LeRobot names no frames
        self._data = DataSet(path, options.max_bytes)
        self._closed = False
        self.episodes = self._data.episodes.ranges
        self.topics = choose_depth_keys(self._data, options.topics)
        self._poses = check_poses(options.poses, self.topics, None)
        if options.intrinsics is None:
            reason = "LeRobot stores no intrinsics; give intrinsics (--intrinsics)"
            raise FileFormatError(path / INFO, reason, self.topics[0])
        self._intrinsics, self._scale = options.intrinsics, options.depth_scale
        self.color_topics, self.color_troubles = _choose_colors(self._data, self.topics, options.color_topics)
        self.files = self._data.list_files([*self.topics, *(key for key in self.color_topics if key)])

    def close(self) -> None:
        """Close the files."""
        self._closed = True
        self._data.close()

    @property
    def most_frames(self) -> int:
        """The number of frames."""
        return self._data.episodes.count

    @lazy_property
    def stamps(self) -> NDArray[np.int64]:
        """(F,) Times of the frames since the first one, nanoseconds."""
        self._data.budget.take(self.path, _STAMP * self.most_frames)
        stamps = np.array([self._data.find_stamp(k) for k in range(self.most_frames)], dtype=np.int64)
        stamps.setflags(write=False)
        return stamps

    def read_undecoded(self, start: int, stop: int | None, step: int) -> Iterator[UndecodedFrame]:
        """Yield some of the frames, not decoded."""
        self._require_open()
        for number in range(self.most_frames)[start:stop:step]:
            yield UndecodedFrame(number, (), (), 0)

    def decode(self, frame: UndecodedFrame) -> Frame:
        """Decode a frame; raise FileFormatError if an image of it is damaged."""
        self._require_open()
        stamp = self._data.find_stamp(frame.number)
        views = tuple(self._make_view(k, frame.number, stamp) for k in range(len(self.topics)))
        return Frame(frame.number, stamp, views, (stamp,) * len(views))

    def _make_view(self, k: int, number: int, stamp: int) -> View:
        key, color_key, budget = self.topics[k], self.color_topics[k], self._data.budget.copy()
        size = self._data.layout.features[key].size
        assert size is not None
        pixels = size[0] * size[1]
        with budget.hold_view(self.path, pixels, _VIEWS * len(self.topics), key):
            if color_key is not None:
                budget.take_image(self.path, "color", _VIEWS * pixels)
            depth, scale = self._data.read_depth(key, number)
            if depth.dtype.kind != "f" and self._scale is not None:
                scale = self._scale
            colors = None if color_key is None else self._data.read_color(color_key, number)
            return View.from_depth(
                depth,
                self._intrinsics,
                self._poses[k],
                colors,
                depth_scale=MILLIMETER if scale is None else scale,
                stamp=stamp / SECOND,
            )

    def _require_open(self) -> None:
        if self._closed:
            raise ValueError(f"{self.path}: the recording is closed")


def choose_depth_keys(data: DataSet, patterns: Sequence[str] | None) -> tuple[str, ...]:
    """Return the depth features that match the patterns; without patterns, the only one."""
    shown = data.depth_keys
    listed = ", ".join(shown) or f"none; it has {', '.join(data.color_keys) or 'no images'}"
    if not shown:
        raise FileFormatError(
            data.folder / INFO, f"no feature is a depth map (is_depth_map): {listed}"[:2000]
        )
    if patterns is None:
        if len(shown) == 1:
            return shown
        raise ValueError(f"topics: several show depth, give one for each camera to use: {listed}")
    keys: dict[str, None] = {}
    for pattern in patterns:
        matching = [key for key in shown if key == pattern or fnmatchcase(key, pattern)]
        if not matching:
            raise ValueError(f"topics: no depth feature {pattern}; {data.folder} has {listed}")
        keys |= dict.fromkeys(matching)
    return tuple(keys)


def _choose_colors(
    data: DataSet, depths: Sequence[str], named: Sequence[str] | None
) -> tuple[tuple[str | None, ...], dict[str, str]]:
    """Return the colour feature of each depth feature, and why others have none.

    LeRobot does not align colours with depth, so strand takes those alone that the caller names.
    """
    features = data.layout.features
    if named is None:
        troubles = {}
        for depth in depths:
            same = [key for key in data.color_keys if features[key].size == features[depth].size]
            if same:
                troubles[depth] = (
                    f"{same[0]}: LeRobot does not say whether colours have the pixels of the depth image; "
                    "name the feature if they do"
                )
        return (None,) * len(depths), troubles
    if len(named) not in (0, len(depths)):
        raise ValueError(
            f"color_topics: expected one for each of {len(depths)} topics, or none, got {len(named)}"
        )
    for depth, key in zip(depths, named, strict=False):
        if key not in data.color_keys:
            has = ", ".join(data.color_keys) or "none"
            raise ValueError(f"color_topics: {data.folder}: no colour feature {key}; it has {has}")
        if features[key].size != features[depth].size:
            raise ValueError(
                f"color_topics: {data.folder}: {key}: expected the size of {depth}, "
                f"{features[depth].size}, got {features[key].size}"
            )
    return tuple(named) if named else (None,) * len(depths), {}
