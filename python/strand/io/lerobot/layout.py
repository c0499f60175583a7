"""The layout of a LeRobot data set: its features and the paths of its files, from `meta/info.json`."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from strand.support.files import JSON_BYTES, FileFormatError, read_json

INFO = "meta/info.json"
STATS = "meta/stats.json"
EPISODES = "meta/episodes"
_CONVERTER = "python -m lerobot.scripts.convert_dataset_v21_to_v30"
_DATA = "data/chunk-000"  # a folder of every data set, damaged ones too
_DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_VIDEO_PATH = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
_FIELD = re.compile(r"\{(\w+)(?::0?([0-9])d)?\}")  # a name, and at most nine digits
_IMAGES = ("video", "image")
_MAX_RATE = 1e6  # frames per second
_MAX_FEATURES = 10_000


@dataclass(frozen=True)
class Feature:
    """A column of a data set, or a camera.

    Attributes
    ----------
    key : str
    kind : str
        "video", "image", or the type of the numbers.
    size : (int, int) or None
        Height and width of images, pixels.
    depth : bool
        Whether the images are depth images.
    info : dict
        What the data set says about videos and units.
    """

    key: str
    kind: str
    size: tuple[int, int] | None
    depth: bool
    info: dict[str, Any]

    @property
    def shows_color(self) -> bool:
        """Whether the feature is a colour image."""
        return self.kind in _IMAGES and not self.depth


@dataclass(frozen=True)
class Layout:
    """The content of `meta/info.json`.

    Attributes
    ----------
    folder : Path
    version : str
    rate : float
        Frames per second.
    features : dict of str to Feature
    content : dict
        The whole file.
    """

    folder: Path
    version: str
    rate: float
    features: dict[str, Feature]
    content: dict[str, Any]

    def find_data(self, chunk: int, file: int) -> Path:
        """Return the path of a table of frames."""
        return self._find("data_path", _DATA_PATH, chunk, file, "")

    def find_video(self, key: str, chunk: int, file: int) -> Path:
        """Return the path of a camera's video."""
        return self._find("video_path", _VIDEO_PATH, chunk, file, key)

    def _find(self, name: str, default: str, chunk: int, file: int, key: str) -> Path:
        values: dict[str, Any] = {"chunk_index": chunk, "file_index": file, "video_key": key}
        template = self.content.get(name) or default

        def fill(match: re.Match[str]) -> str:
            value = values.get(match[1])
            if value is None:
                raise FileFormatError(self.folder / INFO, f"expected {name} as {default}, got {template!r}")
            return str(value) if match[2] is None else f"{value:0{match[2]}d}"

        filled = _FIELD.sub(fill, template) if isinstance(template, str) else ""
        place = PurePosixPath(filled)
        if not filled or place.is_absolute() or ".." in place.parts or set(filled) & set("\\\0{}:"):
            raise FileFormatError(
                self.folder / INFO, f"expected a path below the folder, such as {default}", name
            )
        return self.folder / place


def is_data_set(path: str | os.PathLike[str]) -> bool:
    """Tell whether a path is the folder of a LeRobot data set, maybe a damaged one."""
    return os.path.exists(os.path.join(path, INFO)) or os.path.isdir(os.path.join(path, _DATA))


def read_layout(folder: Path, max_bytes: int) -> Layout:
    """Return the layout of a data set; FileFormatError says which versions are read."""
    path = folder / INFO
    content = read_json(path, min(max_bytes, JSON_BYTES))
    if not isinstance(content, dict) or not isinstance(content.get("codebase_version"), str):
        raise FileFormatError(path, "expected the codebase_version of a LeRobot data set, got none")
    version = content["codebase_version"]
    if not re.fullmatch(r"v3(\.\d{1,9})*", version):
        reason = f"expected a LeRobot data set of version 3, got {version[:20]!r}"
        if version.startswith("v2"):
            reason += f"; LeRobot converts it: {_CONVERTER} --repo-id=NAME --root={folder}"
        raise FileFormatError(path, reason)
    rate = content.get("fps")
    if isinstance(rate, bool) or not isinstance(rate, (int, float)) or not 0 < rate <= _MAX_RATE:
        raise FileFormatError(path, f"expected frames per second, got {rate!r}"[:200], "fps")
    features = content.get("features")
    if not isinstance(features, dict) or len(features) > _MAX_FEATURES:
        raise FileFormatError(path, f"expected at most {_MAX_FEATURES} features by their names", "features")
    return Layout(
        folder,
        version,
        float(rate),
        {key: _read_feature(path, key, features[key]) for key in features},
        content,
    )


def _read_feature(path: Path, key: str, content: Any) -> Feature:
    if not isinstance(content, dict) or not isinstance(content.get("dtype"), str):
        raise FileFormatError(path, "expected a feature with a dtype and a shape", key[:200])
    kind, shape = content["dtype"], content.get("shape")
    if kind not in _IMAGES:
        return Feature(key, kind, None, False, {})
    if "/" in key or "\\" in key or key in ("", ".", ".."):
        raise FileFormatError(path, "expected a name without / and \\", key[:200])
    more = [one if isinstance(one, dict) else {} for one in (content.get("info"), content.get("video_info"))]
    info = more[1] | more[0]
    if (
        not isinstance(shape, list)
        or not 2 <= len(shape) <= 3
        or not all(type(side) is int and 0 < side < 1 << 20 for side in shape)
    ):
        raise FileFormatError(path, f"expected the height, width and channels, got {shape!r}"[:200], key)
    depth = bool(info.get("is_depth_map") or info.get("video.is_depth_map"))
    return Feature(key, kind, _find_size(shape, content.get("names")), depth, info)


def _find_size(shape: list[int], names: Any) -> tuple[int, int]:
    """Return the height and width; the channels come last, unless names or sizes say that they come first."""
    if (
        isinstance(names, list)
        and "height" in names[:3]
        and "width" in names[:3]
        and len(names) == len(shape)
    ):
        return shape[names.index("height")], shape[names.index("width")]
    first = len(shape) == 3 and shape[0] in (1, 3) and shape[2] not in (1, 3)
    return (shape[1], shape[2]) if first else (shape[0], shape[1])
