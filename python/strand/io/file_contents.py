"""What a file holds: a scene, a single view's points or depth, a recording, or a model."""

from __future__ import annotations

import errno
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np

from strand.io.budget import Budget
from strand.io.models import load_model
from strand.io.point_cloud import PointCloud
from strand.io.recordings import is_recording
from strand.io.recordings.recording_contents import RecordingContents, read_recording_contents
from strand.io.scenes import load_scene
from strand.io.view_files import SUFFIXES, read_view_file
from strand.io.view_summary import ViewSummary, summarize_view
from strand.ropes.model import Model
from strand.support.checks import Array, check_integer
from strand.support.files import JSON_BYTES, FileFormatError
from strand.views.box import Box, extraction_range
from strand.views.view import View, cropped

# entries of a folder that are looked at
_MOST = 10_000


@dataclass(frozen=True, eq=False)
class SceneContents:
    """What a scene holds.

    Attributes
    ----------
    name : str
    views : tuple of Seen
        One for each view; each has a pose.
    bounds : Box or None
        The extraction range; None if the scene does not say it.
    points_in_bounds : int or None
        How many points of all views lie there, and inside their masks; None without bounds.
    radius : float or None
        The ropes' radius, metres; None if the scene does not say it.
    true_ropes : int
        How many true centrelines there are.
    """

    name: str
    views: tuple[ViewSummary, ...]
    bounds: Box | None
    points_in_bounds: int | None
    radius: float | None
    true_ropes: int


@dataclass(frozen=True, eq=False)
class SingleContents:
    """What a single file of one view holds.

    Attributes
    ----------
    view : Seen
        Of a depth image of whole numbers distances are in the file's unit, which it does not say.
    whole : bool
        Whether it is a depth image of whole numbers.
    viewpoint : (3,) ndarray or None
        Where the file says that its points were seen from, metres.
    """

    view: ViewSummary
    whole: bool
    viewpoint: Array | None


Contents = SceneContents | SingleContents | RecordingContents | Model


def read_contents(
    path: Path, topics: Sequence[str] | None = None, *, max_bytes: int, outside: bool = False
) -> Contents:
    """Return what a file or folder holds.

    Of recordings little more is read than the index. Other files are read as `strand.load_scene` and
    `strand.load_model` do.

    Parameters
    ----------
    path : Path
        What `strand reconstruct` takes, or a model's `.json` file.
    topics : sequence of str, optional
        Of a recording: the topics with depth to look at, as `strand.Recording` takes them; all if not given.
    max_bytes : int
        How many bytes of it may be in memory.
    outside : bool
        Whether a `scene.toml` may name files outside of its folder.

    Raises
    ------
    OSError
        If it is missing or cannot be read.
    strand.FileFormatError
        If it is empty, truncated, damaged, something else, or takes more than `max_bytes`.
    ValueError
        If topics are given and it is no recording, or has no such topic; the message lists those that there
        are.
    ImportError
        If reading it needs a package that is not installed.
    """
    max_bytes = check_integer("max_bytes", max_bytes, 1)
    if is_recording(path):
        return read_recording_contents(path, topics, max_bytes)
    if topics is not None:
        raise ValueError(f"topics: for recordings only, and {path} is none")
    suffix = path.suffix.lower()
    if suffix == ".json" and not path.is_dir():
        return load_model(path, max_bytes=min(max_bytes, JSON_BYTES))
    if suffix in SUFFIXES and not path.is_dir():
        return _single(path, max_bytes)
    if path.is_dir() and not (path / "scene.toml").exists():
        raise FileNotFoundError(errno.ENOENT, f"No such file; {_files_of(path)}", str(path / "scene.toml"))
    scene = load_scene(path, max_bytes=max_bytes, outside=outside)
    bounds = None if scene.bounds is None else extraction_range(scene.bounds)
    inside = None
    if bounds is not None:
        inside = sum(len(view.points) for view in cropped(scene.views, bounds))
    views = tuple(summarize_view(view) for view in scene.views)
    return SceneContents(scene.name, views, bounds, inside, scene.radius, len(scene.truth))


def _files_of(folder: Path) -> str:
    """Say what there is in a folder that is no scene."""
    names = [entry.suffix.lower() or "other" for entry in islice(folder.iterdir(), _MOST)]
    found = ", ".join(f"{count} {suffix}" for suffix, count in Counter(names).most_common(8))
    return f"the folder has {found or 'no files'}"


def _single(path: Path, max_bytes: int) -> SingleContents:
    seen = read_view_file(path, Budget(max_bytes))
    try:
        if isinstance(seen, PointCloud):
            view = seen.make_view(np.eye(4))
            none = len(seen.points) - view.dropped - len(view.points)
            return SingleContents(summarize_view(view, none), False, seen.viewpoint)
        whole = seen.dtype.kind == "u"
        # any pinhole does: no point is made
        image = summarize_view(View.from_depth(seen, np.eye(3), depth_scale=1.0 if whole else None))
    except (TypeError, ValueError) as error:
        raise FileFormatError.from_error(path, error) from error
    return SingleContents(replace(image, intrinsics=None), whole, None)
