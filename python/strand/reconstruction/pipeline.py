"""reconstruct(): views in, a point chain model out. Composition only."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strand._core import NotEnoughDataError
from strand.config import Config
from strand.reconstruction.default import find_chains as find_by_default
from strand.reconstruction.evidence.confidence import confidence, contradictions, of_chains
from strand.reconstruction.evidence.prior import Prior
from strand.reconstruction.finding.ropes import FoundRopes, NoRopeError, find_ropes
from strand.reconstruction.finding.standing import holds_table
from strand.reconstruction.finding.table_edge import doubt_ends_at_edge
from strand.reconstruction.images.depth_scatter import measure_depth_scatter
from strand.reconstruction.images.mask_radius import estimate_mask_radius
from strand.reconstruction.images.pixel_errors import CONFUSING_CORRELATION, correlate_neighbors
from strand.reconstruction.masks import misplaced_masks, refuse_background, surplus_labels, why_no_rope
from strand.reconstruction.mistakes.diagnosis import explained, thinnest
from strand.reconstruction.mistakes.emptiness import mask_without_points, why_empty
from strand.reconstruction.orientation import oriented
from strand.reconstruction.outliers import without_outliers
from strand.reconstruction.published.method import find_chains as find_published
from strand.reconstruction.radius import Radii, estimate_radius
from strand.reconstruction.stages import Found, Observed, Run
from strand.reconstruction.wide_surfaces import no_ropes
from strand.ropes.doubt import Doubt, ModelWarning
from strand.ropes.model import Model
from strand.support.checks import check_bool, check_positive, round_to_millimeters
from strand.views.box import Bounds, Box, extraction_range
from strand.views.rope_images import rope_images
from strand.views.view import View, checked_views, cropped

# doubt of an answer for which something was left out
_HURRIED = 0.3
# standard deviation of a radius that was found by how wide strips are, as a part of it
_WIDTHS = 0.1
# where depths scatter by less than this, in radii, height tells ropes from their table
_WIDE = 0.3
# a mask of which less than this share has depth has little
_LITTLE = 0.2


@dataclass(frozen=True)
class _Method:
    """What is special about a method.

    Attributes
    ----------
    find : callable
        Finds the chains.
    any_radius : bool
        Whether it takes several radii and does without any; else it needs one.
    widen : bool
        Whether its outlier filter searches farther in coarse views.
    """

    find: Callable[[Observed, Config, Run], Found]
    any_radius: bool
    widen: bool


_METHODS = {
    "default": _Method(find_by_default, any_radius=True, widen=True),
    "published": _Method(find_published, any_radius=False, widen=False),
}


def reconstruct(
    views: Sequence[View],
    radius: float | Sequence[float] | None = None,
    bounds: Bounds | None = None,
    ropes: int | None = None,
    config: Config | None = None,
    *,
    length: float | Sequence[float] | None = None,
    previous: Model | None = None,
    keep_stages: bool = False,
    progress: Callable[[str], None] | None = None,
    deadline: float | None = None,
) -> Model:
    """Turn depth-camera views of ropes into ordered centrelines.

    Parameters
    ----------
    views : sequence of View
        What the cameras saw. Registration keeps the middle one of those that see something where it is, or
        the nearest to it that is used.
    radius : float or sequence of float, optional
        The ropes' radius, or the radii of ropes that differ, metres; estimated from the data if not given
        (the published method needs one).
    bounds : pair of (3,) array_like, or Box, optional
        The extraction range, metres: low and high corner of a box along the axes of the world frame, or a
        `strand.Box`, which may be turned. If it is not given or holds a table, and no view has a mask, the
        default method finds the ropes among other things on the table (see `strand.find_ropes`); where there
        is no table, everything is taken for ropes.
    ropes : int, optional
        How many ropes there are; as many as the data show if not given. The default method then bridges gaps
        of any length until no more chains are left than that (see `Chain.bridged`).
    config : Config, optional
        The method and its numbers; `Config()`, tubes fitted to the points, if not given.
    length : float or sequence of float, optional
        How long the ropes are, metres: one length that each of them has, or one for each rope in any order,
        which also says how many there are. The default method then makes bridges over gaps as long as what
        was seen leaves, where there is occluded room for that, and prefers joins with which the lengths
        agree. A rope that differs by more than 2 % and a radius is warned of, and lowers the confidence.
    previous : Model, optional
        An earlier model of the same ropes: chains that are near its chains run the same way. Others, and
        all without it, start at the end that lies farther back along the direction (0.83, 0.47, 0.31).
    keep_stages : bool
        Keep the arrays between the stages, in `Model.stages`: "raw", "filtered" and "registered" (a tuple of
        (N, 3) arrays, one for each view used); "arcs" (what was seen of the ropes before they were linked)
        and "fit" (a `TubeFit`); of an answer read from images instead of these "readings" (the nodes of all
        ropes of the readings that were compared, (M, 3) arrays); or, of the published method, "normals",
        "axis_points" (M, 3), "traced" (chains before the split), "separation" (d* along each), "cuts" (its
        nodes that were cut at) and "segments".
    progress : callable, optional
        Called with each stage's name when it starts.
    deadline : float, optional
        Seconds from the call after which nothing is begun that an answer can do without. What is left out
        then is named in a doubt and a warning of kind "deadline". There is an answer all the same: before the
        first one the call goes the shortest way to it, with fewer points, and ends when it has it. Which
        answer that is depends on the machine's speed; without a deadline it does not.

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
    strand.NoRopeError
        If there are no masks, and bounds that leave a table out are not given either, and what stands on the
        table is no rope; it is a `NotEnoughDataError`.
    """
    begun = time.monotonic()
    config = Config() if config is None else config
    keep_stages = check_bool("keep_stages", keep_stages)
    if progress is not None and not callable(progress):
        raise TypeError(f"progress: expected a callable or None, got {type(progress).__name__}")
    views, radii, method = _checked(views, radius, config, previous)
    box = None if bounds is None else extraction_range(bounds)
    prior = Prior.given(ropes, length, box, config.known)
    run = Run(progress)
    if deadline is not None:
        run.deadline = begun + check_positive("deadline", deadline)
    raw, found_radius, shown = list(views), None, None
    everything = views
    if box is not None:
        with run.stage("extract"):
            raw = cropped(views, box)
        if not any(len(view.points) for view in raw):
            raise NotEnoughDataError(f"views: {why_empty(views, box, radii)}")
    with explained(views, box, radii):
        among_things = method.any_radius and not any(view.mask is not None for view in views)
        if among_things and (box is None or _holds_a_table(views, raw, thinnest(radii))):
            with run.stage("find"):
                shown = _ropes_among_things(views, radii, box)
            raw, found_radius = list(shown.views), shown.radius
            if box is not None:
                raw = cropped(raw, box)
            # what else points show says which space is free; of images the mask says it
            views = tuple(
                view if view.image is None else own for view, own in zip(views, shown.views, strict=True)
            )
            run.warnings.extend(_left_out(shown))
        if not any(len(view.points) for view in raw):
            raise NotEnoughDataError(f"views: {why_empty(views, None, radii)}")
        if radii is None and found_radius is not None:
            radii = Radii(np.array([found_radius]), np.array([_WIDTHS * found_radius]), free=True)
        elif radii is None:
            with run.stage("radius"):
                masked = [i for i, view in enumerate(views) if view.mask is not None and len(raw[i].points)]
                if masked and method.any_radius:
                    middle = masked[len(masked) // 2]
                    (image,) = rope_images([raw[middle]], [views[middle]], box)
                    radii = Radii(*estimate_mask_radius(image), free=False, held=True)
                    message = "radius: masks alone fix it by how wide the rope looks; give it if it is known"
                    run.warnings.append(ModelWarning("radius", message))
                else:
                    radii = Radii(*estimate_radius(raw), free=True)
        with run.stage("filter"):
            filtered = without_outliers(raw, float(radii.values[0]), config.filter, method.widen)
            used = _used(views, raw, filtered, float(radii.values.min()), run)
            misplaced = misplaced_masks(views, used, box, radii.values)
            if len(misplaced) == len(used):
                refuse_background(views, used, box, radii.values)
        run.warnings.extend(
            ModelWarning(doubt.kind, doubt.reason, None, doubt.amount, view=number)
            for doubt, number in misplaced
        )
        run.warnings.extend(surplus_labels(views, prior.ropes))
        if radii.free and len(used) == 1:
            radii = replace(radii, free=False, held=True)
            message = "radius: one view alone fixes it by how wide the rope looks; give it if it is known"
            run.warnings.append(ModelWarning("radius", message))
        seen, whole = [filtered[number] for number in used], [views[number] for number in used]
        found = method.find(Observed(seen, whole, used, box, radii, prior), config, run)
    kept = found.chains if prior.ropes is None else found.chains[: prior.ropes]
    chains = tuple(oriented(kept, () if previous is None else previous.chains))
    against = contradictions(chains, found.chains[len(chains) :], prior, found.all_rings)
    if shown is not None:
        against += doubt_ends_at_edge(chains, everything, shown.tables)
    run.warnings.extend(
        ModelWarning(doubt.kind, doubt.reason, doubt.place, doubt.amount, about) for doubt, about in against
    )
    hurried = _hurried(run)
    doubts = sorted(
        [
            *(found.doubts or ()),
            *(doubt for doubt, _ in against),
            *(doubt for doubt, _ in misplaced),
            *hurried,
        ],
        key=lambda doubt: -doubt.amount,
    )
    if found.doubts is not None:
        own = of_chains(chains, doubts, against)
        chains = tuple(
            replace(chain, confidence=sure, doubts=about)
            for chain, (sure, about) in zip(chains, own, strict=True)
        )
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
        for kept in stages.values():
            for array in kept if isinstance(kept, tuple) else (kept,):
                if isinstance(array, np.ndarray):
                    array.setflags(write=False)
    return Model(
        chains,
        poses,
        run.timings,
        tuple(run.warnings),
        stages,
        pose_sd,
        confidence=float("nan") if found.doubts is None else confidence(doubts),
        joins=tuple(join for join in found.joins if max(join.chains) < len(chains)),
        doubts=tuple(doubts),
        alternatives=found.alternatives,
        method=config.method,
        branch=found.branch,
        sensor=found.sensor,
    )


def _checked(
    views: Sequence[View],
    radius: float | Sequence[float] | None,
    config: Config,
    previous: Model | None,
) -> tuple[tuple[View, ...], Radii | None, _Method]:
    """Check the arguments that have no type of their own; return the method too."""
    views = checked_views(views)
    if not isinstance(config, Config):
        raise TypeError(f"config: expected a Config, got {config!r}")
    radii = None if radius is None else Radii.given(radius, config.known)
    if previous is not None and not isinstance(previous, Model):
        raise TypeError(f"previous: expected a Model or None, got {type(previous).__name__}")
    method = _METHODS[config.method]
    if not method.any_radius and (radii is None or len(radii.values) > 1):
        raise ValueError(
            f"radius: the {config.method} method needs the ropes' one radius, metres "
            "(--radius on the command line)"
        )
    return views, radii, method


def _ropes_among_things(views: tuple[View, ...], radii: Radii | None, box: Box | None) -> FoundRopes:
    """Find ropes on a table; strands side by side look like one, and are told from it by their radius."""
    try:
        return find_ropes(views, None if radii is None else radii.values.tolist(), box)
    except NoRopeError as error:
        shown = views if box is None else cropped(views, box)
        if radii is None or not error.low_things or no_ropes(shown, float(radii.values.max())) is not None:
            raise
        return FoundRopes(views, None, (None,) * len(views), ())


def _holds_a_table(views: Sequence[View], raw: Sequence[View], radius: float) -> bool:
    """Tell whether bounds hold a table that ropes stand out of: noise that is wide for them hides them."""
    wide = _WIDE * radius
    if not holds_table(views, raw) or measure_depth_scatter(views, raw, wide) >= wide:
        return False
    seen = [k for k, view in enumerate(raw) if len(view.points)]
    images = rope_images([raw[k] for k in seen], [views[k] for k in seen], None)
    return correlate_neighbors(images) < CONFUSING_CORRELATION


def _left_out(found: FoundRopes) -> list[ModelWarning]:
    """Return a warning that names what stands on the table and was left out, if anything was."""
    if not found.other_objects:
        return []
    first = found.other_objects[0]
    message = (
        f"left out what is no rope on the table, {len(found.other_objects)} pieces as the views show them; "
        f"the first at {round_to_millimeters(first.place)}: {first.reason}"
    )
    return [ModelWarning("thing", message, first.place, view=first.view)]


def _used(
    views: Sequence[View], raw: Sequence[View], filtered: Sequence[View], radius: float, run: Run
) -> list[int]:
    """Numbers of the views that see something of ropes; the others are named in a warning."""
    reasons: dict[int, str] = {}
    for number, (view, own, left) in enumerate(zip(views, raw, filtered, strict=True)):
        reason = why_no_rope(view, radius) or mask_without_points(view)
        if reason is None and not len(left.points):
            reason = _why_nothing(view, own)
        if reason is not None:
            reasons[number] = reason
    if len(reasons) == len(views):
        if any(view.mask is not None for view in views):
            said = "; ".join(f"view {number} has {reason}" for number, reason in reasons.items())
            raise NotEnoughDataError(f"views: {said}; is the radius right, in metres?")
        raise NotEnoughDataError("views: all points are outliers; is the radius right, in metres?")
    for number, reason in reasons.items():
        message = f"view {number} has {reason} and was not used"
        run.warnings.append(ModelWarning("unused view", message, view=number))
    return [number for number in range(len(views)) if number not in reasons]


def _hurried(run: Run) -> list[Doubt]:
    """Return the doubt that what was left out for the deadline raises, if anything was; warn of it too."""
    if not run.left_out:
        return []
    doubt = Doubt("deadline", _HURRIED, "whether that is right", f"left out: {', '.join(run.left_out)}")
    run.warnings.append(ModelWarning(doubt.kind, doubt.reason, None, doubt.amount))
    return [doubt]


def _why_nothing(view: View, own: View) -> str:
    """Say why nothing of a view is left after the outlier filter."""
    if not len(own.points):
        return "no points in the extraction range"
    if view.mask is not None:
        share = len(view.points) / np.count_nonzero(view.mask)
        if share < _LITTLE:
            return f"depth in only {share:.0%} of its mask, too thinly to be told from outliers"
    return "only outliers in the extraction range"
