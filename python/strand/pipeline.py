"""reconstruct(): views in, a point chain model out. Composition only."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from strand import published, tubes
from strand._core import NotEnoughDataError
from strand.arguments import flag
from strand.certainty import confidence
from strand.config import Config
from strand.known import Known, contradiction
from strand.model import Chain, Doubt, Model
from strand.orientation import oriented
from strand.outliers import without_outliers
from strand.radius import Radii, estimate_radius
from strand.stages import Run
from strand.view import Array, View, checked_views, cropped, extraction_range

# doubt: for each radius that a length is wrong by more than it may be, for each string open that is a ring
_CONTRADICTION, _OPEN = 0.4, math.log(2.0)


def reconstruct(
    views: Sequence[View],
    radius: float | Sequence[float] | None = None,
    bounds: tuple[ArrayLike, ArrayLike] | None = None,
    ropes: int | None = None,
    config: Config | None = None,
    *,
    length: float | Sequence[float] | None = None,
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
    length : float or sequence of float, optional
        How long the strings are, metres: one length that each of them has, or one for each rope in any
        order, which also says how many there are. By default bridges over gaps are then as long as what was
        seen leaves, as far as there is hidden room, and pieces are rather put together so that lengths
        agree. A string that differs by more than 2 % and a radius is warned of, and lowers the confidence.
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
        If a number is out of range, there are no views, there are not as many lengths as ropes, or the
        published method is given no radius.
    strand.NotEnoughDataError
        If no view has points in the extraction range, or they make no chain.
    """
    config = Config() if config is None else config
    keep_stages = flag("keep_stages", keep_stages)
    if progress is not None and not callable(progress):
        raise TypeError(f"progress: expected a callable or None, got {type(progress).__name__}")
    views, radii = _checked(views, radius, config, previous)
    box = None if bounds is None else extraction_range(bounds)
    known = Known.given(ropes, length, box)
    run = Run(progress)
    with run.stage("extract"):
        raw = list(views) if box is None else cropped(views, box)
    if not any(len(view.points) for view in raw):
        raise NotEnoughDataError("views: no view has a point in the extraction range")
    if radii is None:
        with run.stage("radius"):
            radii = Radii(*estimate_radius(raw), free=True)
    with run.stage("filter"):
        filtered = without_outliers(raw, float(radii.values[0]), config.filter)
    used = _used(raw, filtered, run)
    seen = [filtered[number] for number in used]
    if radii.free and len(seen) == 1:
        radii = dataclasses.replace(radii, free=False, held=True)
        run.warnings.append(
            "radius: one view alone fixes it by how wide the string looks; give it if it is known"
        )
    if config.method == "published":
        found = published.find_strings(seen, used, float(radii.values[0]), known.ropes, config, run)
    else:
        whole = [views[number] for number in used]
        try:
            found = tubes.find_strings(seen, whole, used, box, radii, known, config, run)
        except NotEnoughDataError:
            if not radii.free:
                raise
            # strands that lie side by side all along look like thicker ones
            found = tubes.find_strings(seen, whole, used, box, radii.with_parts(), known, config, run)
    kept = found.chains if known.ropes is None else found.chains[: known.ropes]
    chains = tuple(oriented(kept, () if previous is None else previous.chains))
    joins = tuple(join for join in found.joins if max(join.chains) < len(chains))
    contradictions = _contradictions(chains, found.chains[len(chains) :], known, config)
    run.warnings.extend(doubt.reason for doubt in contradictions)
    doubts = sorted([*found.doubts, *contradictions], key=lambda doubt: -doubt.amount)
    sure = confidence(doubts) if config.method == "tubes" else float("nan")
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
    return Model(
        chains,
        poses,
        run.timings,
        tuple(run.warnings),
        stages,
        pose_sd,
        sure,
        joins,
        tuple(doubts),
        found.alternatives,
    )


def _checked(
    views: Sequence[View],
    radius: float | Sequence[float] | None,
    config: Config,
    previous: Model | None,
) -> tuple[tuple[View, ...], Radii | None]:
    """Check the arguments that have no type of their own."""
    views = checked_views(views)
    radii = None if radius is None else Radii.given(radius)
    if not isinstance(config, Config):
        raise TypeError(f"config: expected a Config, got {config!r}")
    if previous is not None and not isinstance(previous, Model):
        raise TypeError(f"previous: expected a Model or None, got {previous!r}")
    if config.method == "published" and (radii is None or len(radii.values) > 1):
        raise ValueError("radius: the published method needs the strings' one radius, metres")
    return views, radii


def _used(raw: Sequence[View], filtered: Sequence[View], run: Run) -> list[int]:
    """Numbers of the views that see something; the others are named in a warning."""
    used = [number for number, view in enumerate(filtered) if len(view.points)]
    if not used:
        raise NotEnoughDataError("views: all points are outliers; is the radius right, in metres?")
    for number in sorted(set(range(len(raw))) - set(used)):
        reason = "only outliers" if len(raw[number].points) else "no points"
        run.warnings.append(f"view {number} has {reason} in the extraction range and was not used")
    return used


def _contradictions(
    chains: Sequence[Chain], left_out: Sequence[Chain], known: Known, config: Config
) -> list[Doubt]:
    """Say where the strings that were found are not as they are known to be."""
    found: list[Doubt] = []

    def contradicts(amount: float, reason: str, place: Array | None = None) -> None:
        found.append(Doubt(amount, "whether that is right", reason, place))

    if known.ropes is not None and len(chains) < known.ropes:
        amount = math.log(known.ropes / len(chains))
        contradicts(amount, f"found {len(chains)} strings, fewer than ropes = {known.ropes}")
    all_lengths = sum(chain.length for chain in [*chains, *left_out])
    for chain in left_out:
        where = np.round(chain.points[0], 3).tolist()
        reason = (
            f"left out a piece {chain.length * 1e3:.0f} mm long at {where}, more than ropes = {known.ropes}"
        )
        contradicts(-math.log1p(-chain.length / all_lengths), reason, chain.points[0])
    lengths = [chain.length for chain in chains]
    true_lengths = known.expected(lengths) if known.lengths else [None] * len(chains)
    for number, (chain, true) in enumerate(zip(chains, true_lengths, strict=True)):
        off = contradiction(chain.length, true, chain.radius)
        if true is not None and off > 0:
            more = chain.length - true
            contradicts(
                _CONTRADICTION * off,
                f"chain {number} is {chain.length * 1e3:.0f} mm long, {abs(more) * 1e3:.0f} mm "
                f"{'longer' if more > 0 else 'shorter'} than it is known to be",
            )
        if config.method == "tubes" and config.linking.rings == "always" and not chain.closed:
            contradicts(_OPEN, f"chain {number} has ends, though all strings are said to be rings")
    return found
