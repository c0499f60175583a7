"""reconstruct(): views in, a point chain model out. Composition only."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from strand import published, tubes
from strand._core import NotEnoughDataError
from strand.arguments import flag
from strand.config import Config
from strand.model import Chain, Model
from strand.orientation import oriented
from strand.outliers import without_outliers
from strand.radius import Radii, estimate_radius
from strand.stages import Run
from strand.view import View, checked_views, extraction_range


def reconstruct(
    views: Sequence[View],
    radius: float | Sequence[float] | None = None,
    bounds: tuple[ArrayLike, ArrayLike] | None = None,
    ropes: int | None = None,
    config: Config | None = None,
    *,
    previous: Model | None = None,
    keep_stages: bool = False,
    progress: Callable[[str], None] | None = None,
) -> Model:
    """Turn depth-camera views of strings into ordered centrelines.

    Parameters
    ----------
    views : sequence of View
        What the cameras saw. Registration keeps the middle one of those that see something where it is.
    radius : float or sequence of float, optional
        The strings' radius, or the radii of ropes that differ, metres; estimated from the data if not given
        (not by the published method, which takes one).
    bounds : pair of (3,) array_like of float, optional
        The extraction range: low and high corner of an axis-aligned box in the world frame, metres;
        everything if not given.
    ropes : int, optional
        How many ropes there are; as many as the data show if not given. By default gaps between pieces,
        however long, are then bridged until no more are left (see `Chain.bridged`).
    config : Config, optional
        The method and its numbers; `Config()`, tubes fitted to the points, if not given.
    previous : Model, optional
        An earlier model of the same strings: chains that are near its chains run the same way. Others, and
        all without it, start at the end that lies farther back along the direction (0.83, 0.47, 0.31).
    keep_stages : bool
        Keep the arrays between the stages, in `Model.stages`: "raw", "filtered" and "registered" (a tuple of
        (N, 3) arrays, one for each view used); "arcs" (what was seen of the strings before they were linked)
        and "fit" (a `TubeFit`); or, of the published method, "normals", "axis_points" (M, 3), "traced"
        (chains before the split), "separation" (d* along each), "cuts" (its nodes that were cut at) and
        "segments".
    progress : callable, optional
        Called with each stage's name when it starts.

    Returns
    -------
    Model

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If a number is out of range, there are no views, or the published method is given no radius.
    strand.NotEnoughDataError
        If no view has points in the extraction range, or they make no chain.
    """
    config = Config() if config is None else config
    keep_stages = flag("keep_stages", keep_stages)
    if progress is not None and not callable(progress):
        raise TypeError(f"progress: expected a callable or None, got {type(progress).__name__}")
    views, radii, ropes = _checked(views, radius, ropes, config, previous)
    run = Run(progress)
    box = None if bounds is None else extraction_range(bounds)
    with run.stage("extract"):
        raw = [view if box is None else view.crop(box) for view in views]
    if not any(len(view.points) for view in raw):
        raise NotEnoughDataError("views: no view has a point in the extraction range")
    if radii is None:
        with run.stage("radius"):
            radii = Radii(*estimate_radius(raw), free=True)
    with run.stage("filter"):
        filtered = [without_outliers(view, float(radii.values[0]), config.filter) for view in raw]
    used = _used(raw, filtered, run)
    seen = [filtered[number] for number in used]
    if radii.free and len(seen) == 1:
        radii = dataclasses.replace(radii, free=False, held=True)
        run.warnings.append(
            "radius: one view alone fixes it by how wide the string looks; give it if it is known"
        )
    if config.method == "published":
        found = published.find_strings(seen, used, float(radii.values[0]), ropes, config, run)
    else:
        whole = [views[number] for number in used]
        try:
            found = tubes.find_strings(seen, whole, used, box, radii, ropes, config, run)
        except NotEnoughDataError:
            if not radii.free:
                raise
            # strands that lie side by side all along look like thicker ones
            found = tubes.find_strings(seen, whole, used, box, radii.with_parts(), ropes, config, run)
    chains = tuple(oriented(_chosen(found.chains, ropes, run), () if previous is None else previous.chains))
    joins = tuple(join for join in found.joins if max(join.chains) < len(chains))
    confidence = found.confidence
    if confidence is not None:
        confidence *= sum(chain.length for chain in chains) / sum(chain.length for chain in found.chains)
        if ropes is not None and len(chains) < ropes:
            confidence *= len(chains) / ropes
    poses = np.array([view.pose for view in views])
    pose_sd = np.full((len(views), 6), np.nan)
    poses[used], pose_sd[used] = found.poses, found.pose_sd
    stages = {}
    if keep_stages:
        stages = {
            "raw": tuple(raw[number].world_points for number in used),
            "filtered": tuple(filtered[number].world_points for number in used),
            **found.stages,
        }
    return Model(chains, poses, run.timings, tuple(run.warnings), stages, pose_sd, confidence, joins)


def _checked(
    views: Sequence[View],
    radius: float | Sequence[float] | None,
    ropes: int | None,
    config: Config,
    previous: Model | None,
) -> tuple[tuple[View, ...], Radii | None, int | None]:
    """Check the arguments that have no type of their own."""
    views = checked_views(views)
    radii = None if radius is None else Radii.given(radius)
    if ropes is not None:
        if isinstance(ropes, bool) or not isinstance(ropes, (int, np.integer)):
            raise TypeError(f"ropes: expected a whole number or None, got {ropes!r}")
        if ropes < 1:
            raise ValueError(f"ropes: expected at least 1, got {ropes}")
    if not isinstance(config, Config):
        raise TypeError(f"config: expected a Config, got {config!r}")
    if previous is not None and not isinstance(previous, Model):
        raise TypeError(f"previous: expected a Model or None, got {previous!r}")
    if config.method == "published" and (radii is None or len(radii.values) > 1):
        raise ValueError("radius: the published method needs the strings' one radius, metres")
    return views, radii, ropes


def _used(raw: Sequence[View], filtered: Sequence[View], run: Run) -> list[int]:
    """Numbers of the views that see something; the others are named in a warning."""
    used = [number for number, view in enumerate(filtered) if len(view.points)]
    if not used:
        raise NotEnoughDataError("views: all points are outliers; is the radius right, in metres?")
    for number in sorted(set(range(len(raw))) - set(used)):
        reason = "only outliers" if len(raw[number].points) else "no points"
        run.warnings.append(f"view {number} has {reason} in the extraction range and was not used")
    return used


def _chosen(chains: list[Chain], ropes: int | None, run: Run) -> tuple[Chain, ...]:
    """Keep as many strings as there are ropes."""
    if ropes is not None:
        if len(chains) < ropes:
            run.warnings.append(f"found {len(chains)} strings, fewer than ropes = {ropes}")
        for chain in chains[ropes:]:
            where = np.round(chain.points[0], 3).tolist()
            run.warnings.append(
                f"left out a piece {chain.length * 1e3:.0f} mm long at {where}, more than ropes = {ropes}"
            )
        chains = chains[:ropes]
    return tuple(chains)
