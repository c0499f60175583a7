"""Find out what a LeRobot data set contains, from its description and its first frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from strand.io.lerobot.data_set import DataSet
from strand.io.lerobot.layout import Feature
from strand.io.recordings.data_set_frames import choose_depth_keys
from strand.io.recordings.depth_messages import MILLIMETER
from strand.io.recordings.recording_contents import CameraContents, RecordingContents, Topic
from strand.io.view_summary import summarize_view
from strand.support.files import FileFormatError
from strand.views.view import View

_MAX_CAMERAS = 32  # cameras whose first image is decoded


def read_data_set_contents(path: Path, patterns: Sequence[str] | None, max_bytes: int) -> RecordingContents:
    """Return the content of a data set; `patterns` select its depth features as in `strand.Recording`."""
    data = DataSet(path, max_bytes)
    try:
        keys = data.depth_keys if patterns is None else choose_depth_keys(data, patterns)
        layout, frames = data.layout, data.episodes.count
        rate = layout.rate if frames > 1 else None
        return RecordingContents(
            f"LeRobot data set {layout.version}",
            None,
            frames / layout.rate,
            tuple(
                Topic(key, _name_kind(data, feature), frames, rate)
                for key, feature in sorted(layout.features.items())
            ),
            tuple(_read_camera(data, key) for key in keys[:_MAX_CAMERAS]),
            (),
            None,
            len(data.episodes.ranges),
        )
    finally:
        data.close()


def _name_kind(data: DataSet, feature: Feature) -> str:
    """Return the kind of a feature in words."""
    if feature.kind not in ("video", "image"):
        return feature.kind
    words = f"{'depth' if feature.depth else 'colour'} {feature.kind}"
    if feature.key in data.codes:
        words += f" ({data.codes[feature.key].describe()})"
    return words


def _read_camera(data: DataSet, key: str) -> CameraContents:
    size, count, budget = data.layout.features[key].size, data.episodes.count, data.budget.copy()
    assert size is not None
    found = CameraContents(key, count, None, (size[1], size[0]), None, None)
    try:
        with budget.hold_view(data.folder, size[0] * size[1]):
            depth, scale = data.read_depth(key, 0)
            # any pinhole will do, as no points are computed
            view = View.from_depth(depth, np.eye(3), depth_scale=MILLIMETER if scale is None else scale)
            summary = summarize_view(view)
    except FileFormatError as error:
        return replace(found, trouble=error.reason)
    except (OSError, TypeError, ValueError) as error:
        return replace(found, trouble=str(error))
    return replace(found, view=replace(summary, intrinsics=None))
