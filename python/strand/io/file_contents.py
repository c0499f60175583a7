"""Find out what a file contains: a scene, a single view, a recording, or a model."""

from __future__ import annotations

import errno
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from strand.io.budget import Budget
from strand.io.lerobot.layout import is_data_set
from strand.io.point_cloud import PointCloud
from strand.io.recordings.bags import is_bag
from strand.io.recordings.data_set_contents import read_data_set_contents
from strand.io.recordings.recording_contents import RecordingContents, read_recording_contents
from strand.io.scenes import load_scene
from strand.io.view_files import SUFFIXES, read_view_file
from strand.io.view_summary import ViewSummary, summarize_view
from strand.support.checks import Array, check_integer
from strand.support.files import JSON_BYTES, FileFormatError
from strand.views.box import Box, make_box
from strand.views.view import View, cropped

if TYPE_CHECKING:
    from strand.ropes.model import Model

_MAX_ENTRIES = 10_000  # entries of a folder that are counted


@dataclass(frozen=True, eq=False)
class SceneContents:
    """The content of a scene.

    Attributes
    ----------
    name : str
    views : tuple of ViewSummary
    bounds : Box or None
        The extraction range, if the scene gives one.
    points_in_bounds : int or None
        Points of all views inside the bounds and the masks; None without bounds.
    radius : float or None
        The ropes' radius, metres, if the scene gives one.
    true_ropes : int
        Number of true centrelines.
    """

    name: str
    views: tuple[ViewSummary, ...]
    bounds: Box | None
    points_in_bounds: int | None
    radius: float | None
    true_ropes: int


@dataclass(frozen=True, eq=False)
class SingleContents:
    """The content of a file of one view.

    Attributes
    ----------
    view : ViewSummary
        If `whole`, distances are in the unit of the file, which is not known.
    whole : bool
        Whether the file is a depth image of whole numbers.
    viewpoint : (3,) ndarray or None
        The camera's position, metres, if the file gives one.
    """

    view: ViewSummary
    whole: bool
    viewpoint: Array | None


Contents: TypeAlias = "SceneContents | SingleContents | RecordingContents | Model"


def read_contents(
    path: Path, topics: Sequence[str] | None = None, *, max_bytes: int, outside: bool = False
) -> Contents:
    """Return the content of any file or folder that `strand reconstruct` takes, or of a model file.

    Little more than the index of a recording is read. `topics` selects its topics with depth, as in
    `strand.Recording`; by default, all are read. `max_bytes` and `outside` are those of `strand.load_scene`.
    """
    max_bytes = check_integer("max_bytes", max_bytes, 1)
    if is_data_set(path):
        return read_data_set_contents(path, topics, max_bytes)
    if is_bag(path):
        return read_recording_contents(path, topics, max_bytes)
    if topics is not None:
        raise ValueError(f"topics: only recordings have topics, and {path} is not a recording")
    suffix = path.suffix.lower()
    if suffix == ".json" and not path.is_dir():
        from strand.io.models import load_model  # a model's modules take a quarter of `strand info`'s time

        return load_model(path, max_bytes=min(max_bytes, JSON_BYTES))
    if suffix in SUFFIXES and not path.is_dir():
        return _read_single_contents(path, max_bytes)
    if path.is_dir() and not (path / "scene.toml").exists():
        raise FileNotFoundError(errno.ENOENT, f"No such file; {_count_files(path)}", str(path / "scene.toml"))
    scene = load_scene(path, max_bytes=max_bytes, outside=outside)
    bounds = None if scene.bounds is None else make_box(scene.bounds)
    inside = None
    if bounds is not None:
        inside = sum(len(view.points) for view in cropped(scene.views, bounds))
    views = tuple(summarize_view(view) for view in scene.views)
    return SceneContents(scene.name, views, bounds, inside, scene.radius, len(scene.truth))


def _count_files(folder: Path) -> str:
    """Say for a message how many files of each suffix a folder has."""
    names = [entry.suffix.lower() or "other" for entry in islice(folder.iterdir(), _MAX_ENTRIES)]
    found = ", ".join(f"{count} {suffix}" for suffix, count in Counter(names).most_common(8))
    return f"the folder has {found or 'no files'}"


def _read_single_contents(path: Path, max_bytes: int) -> SingleContents:
    budget = Budget(max_bytes)
    seen = read_view_file(path, budget)
    try:
        if isinstance(seen, PointCloud):
            with budget.hold_cloud(path, seen.numbers):
                view = seen.make_view(np.eye(4))
            none = len(seen.points) - view.dropped - len(view.points)
            return SingleContents(summarize_view(view, none), False, seen.viewpoint)
        whole = seen.dtype.kind == "u"
        # any pinhole will do, as no points are computed
        with budget.hold_view(path, seen.size):
            view = View.from_depth(seen, np.eye(3), depth_scale=1.0 if whole else None)
        image = summarize_view(view)
    except FileFormatError:
        raise
    except (TypeError, ValueError) as error:
        raise FileFormatError.from_error(path, error) from error
    return SingleContents(replace(image, intrinsics=None), whole, None)
