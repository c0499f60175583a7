"""Observe: crop the views, find the ropes among other things, fix the radius, drop outliers, check masks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from strand._core import NotEnoughDataError
from strand.config import Config
from strand.reconstruction.evidence.prior import Prior
from strand.reconstruction.finding.ropes import FoundRopes, NoRopeError, segment_views
from strand.reconstruction.finding.standing import holds_table
from strand.reconstruction.images.depth_scatter import measure_depth_scatter
from strand.reconstruction.images.mask_radius import estimate_mask_radius
from strand.reconstruction.images.pixel_errors import CONFUSING_CORRELATION, correlate_neighbors
from strand.reconstruction.images.table_plane import Plane
from strand.reconstruction.masks import (
    explain_empty_mask,
    explain_small_mask,
    find_misplaced_masks,
    refuse_background,
    warn_of_surplus_labels,
)
from strand.reconstruction.mistakes.diagnosis import refuse_empty_views
from strand.reconstruction.outliers import drop_outliers
from strand.reconstruction.radius import Radii, find_thinnest, measure_radii
from strand.reconstruction.stages import Observed, Run
from strand.reconstruction.wide_surfaces import describe_surface
from strand.ropes.chain import Chain
from strand.ropes.doubt import Doubt
from strand.support.checks import round_to_millimeters
from strand.views.box import Box
from strand.views.rope_images import rope_images
from strand.views.view import View, cropped

_MAX_SCATTER = 0.3  # radii: where depths scatter less, heights segment ropes from their table
_STRIP_SD = 0.1  # radii: standard deviation of a radius measured by the width of strips
_MIN_DEPTH_SHARE = 0.2  # of a mask's pixels: with less, depth is too thin to have neighbors

_APPARENT_RADIUS = "radius: {} it by how wide the rope looks; give it if it is known"


@dataclass(frozen=True, eq=False)
class Given:
    """What the caller gives, checked.

    Attributes
    ----------
    views : tuple of View
    radii : Radii or None
    bounds : Box or None
        The extraction range, metres.
    prior : Prior
    config : Config
    previous : tuple of Chain
        Chains of an earlier model of the same ropes.
    """

    views: tuple[View, ...]
    radii: Radii | None
    bounds: Box | None
    prior: Prior
    config: Config
    previous: tuple[Chain, ...]

    @property
    def published(self) -> bool:
        """Whether the published method is asked, which takes views as they are."""
        return self.config.method == "published"

    @property
    def masked(self) -> bool:
        """Whether a view has a mask."""
        return any(view.mask is not None for view in self.views)


@dataclass(frozen=True, eq=False)
class Scene:
    """What the views show of the ropes.

    Attributes
    ----------
    views : tuple of View
        All views, uncropped. Depth images in which strand found ropes have a mask of them.
    inside : list of View
        All views, cropped, without other things on the table.
    observed : Observed
        The views that a method uses.
    tables : tuple of (Plane or None)
        Each view's table, if strand found ropes on one.
    mask_doubts : list of Doubt
        Doubts of masks.
    """

    views: tuple[View, ...]
    inside: list[View]
    observed: Observed
    tables: tuple[Plane | None, ...]
    mask_doubts: list[Doubt]


def extract(given: Given, run: Run) -> list[View]:
    """Crop views to the extraction range, if there is one; refuse views without a point in it."""
    if given.bounds is None:
        return list(given.views)
    with run.stage("extract"):
        inside = cropped(given.views, given.bounds)
    refuse_empty_views(given.views, inside, given.bounds, given.radii)
    return inside


def observe(given: Given, inside: list[View], run: Run) -> Scene:
    """Find what views show of the ropes.

    Parameters
    ----------
    given : Given
    inside : list of View
        Its views, cropped.
    run : Run

    Raises
    ------
    strand.NotEnoughDataError
        If no view shows a rope.
    """
    views, radii = given.views, given.radii
    tables: tuple[Plane | None, ...] = ()
    found = _find_ropes_among_things(given, inside, run)
    if found is not None:
        inside = list(found.views) if given.bounds is None else cropped(found.views, given.bounds)
        # with a mask, the rest of the image still shows which space is free; so do all points
        views = tuple(
            view if view.image is None else own for view, own in zip(views, found.views, strict=True)
        )
        tables = found.tables
        if radii is None and found.radius is not None:
            radii = Radii(np.array([found.radius]), np.array([_STRIP_SD * found.radius]), free=True)
    refuse_empty_views(views, inside, None, given.radii)
    if radii is None:
        radii = _estimate_radii(given, views, inside, run)
    with run.stage("filter"):
        filtered = drop_outliers(
            inside, float(radii.values[0]), given.config.filter, widen=not given.published
        )
        numbers = _select_views(views, inside, filtered, float(radii.values.min()), run)
        misplaced = find_misplaced_masks(views, numbers, given.bounds, radii.values)
        refuse_background(misplaced, numbers)
    for mask in misplaced:
        run.warn("mask", mask.doubt.reason, amount=mask.doubt.amount, view=mask.view)
    run.warnings.extend(warn_of_surplus_labels(views, given.prior.ropes))
    if radii.free and len(numbers) == 1:
        radii = replace(radii, free=False, held=True)
        run.warn("radius", _APPARENT_RADIUS.format("one view alone fixes"))
    observed = Observed(
        [filtered[number] for number in numbers],
        [views[number] for number in numbers],
        numbers,
        given.bounds,
        radii,
        given.prior,
    )
    return Scene(views, inside, observed, tables, [mask.doubt for mask in misplaced])


def _find_ropes_among_things(given: Given, inside: list[View], run: Run) -> FoundRopes | None:
    """Find ropes on a table, if the views have no masks and their extraction range holds a table."""
    if given.published or given.masked:
        return None
    if given.bounds is not None and not _holds_clear_table(given, inside):
        return None
    with run.stage("find"):
        found = _segment_views(given, inside)
    if found.other_objects:
        first = found.other_objects[0]
        message = (
            f"left out what is no rope on the table, {len(found.other_objects)} pieces as the views show "
            f"them; the first at {round_to_millimeters(first.place)}: {first.reason}"
        )
        run.warn("thing", message, first.place, view=first.view)
    return found


def _holds_clear_table(given: Given, inside: list[View]) -> bool:
    """Tell whether bounds hold a table that ropes stand out of; noise as large as ropes hides them."""
    max_scatter = _MAX_SCATTER * find_thinnest(given.radii)
    if (
        not holds_table(given.views, inside)
        or measure_depth_scatter(given.views, inside, max_scatter) >= max_scatter
    ):
        return False
    seen = [number for number, view in enumerate(inside) if len(view.points)]
    images = rope_images([inside[k] for k in seen], [given.views[k] for k in seen], None)
    return correlate_neighbors(images) < CONFUSING_CORRELATION


def _segment_views(given: Given, inside: list[View]) -> FoundRopes:
    """Segment ropes; strands side by side look like one thing that is wide, unless the radius is known."""
    radii = given.radii
    try:
        return segment_views(given.views, None if radii is None else radii.values, given.bounds)
    except NoRopeError as error:
        if radii is None or not error.low_things or describe_surface(inside, float(radii.values.max())):
            raise
        return FoundRopes(given.views, None, (None,) * len(given.views), ())


def _estimate_radii(given: Given, views: Sequence[View], inside: list[View], run: Run) -> Radii:
    with run.stage("radius"):
        masked = [k for k, view in enumerate(views) if view.mask is not None and len(inside[k].points)]
        if not masked:
            return Radii(*measure_radii(inside), free=True)
        middle = masked[len(masked) // 2]
        (image,) = rope_images([inside[middle]], [views[middle]], given.bounds)
        radii = Radii(*estimate_mask_radius(image), free=False, held=True)
    run.warn("radius", _APPARENT_RADIUS.format("masks alone fix"))
    return radii


def _select_views(
    views: Sequence[View], inside: Sequence[View], filtered: Sequence[View], radius: float, run: Run
) -> list[int]:
    """Return the numbers of the views that show ropes; warn of the others.

    Parameters
    ----------
    views, inside, filtered : sequence of View
        Uncropped, cropped, and without outliers.
    radius : float
        The thinnest rope's, metres.
    run : Run

    Raises
    ------
    strand.NotEnoughDataError
        If no view shows ropes.
    """
    reasons: dict[int, str] = {}
    for number, (view, own, left) in enumerate(zip(views, inside, filtered, strict=True)):
        reason = explain_small_mask(view, radius) or explain_empty_mask(view)
        if reason is None and not len(left.points):
            reason = _explain_no_points(view, own)
        if reason is not None:
            reasons[number] = reason
    if len(reasons) == len(views):
        if any(view.mask is not None for view in views):
            said = "; ".join(f"view {number} has {reason}" for number, reason in reasons.items())
            raise NotEnoughDataError(f"views: {said}; is the radius right, in metres?")
        raise NotEnoughDataError("views: all points are outliers; is the radius right, in metres?")
    for number, reason in reasons.items():
        run.warn("unused view", f"view {number} has {reason} and was not used", view=number)
    return [number for number in range(len(views)) if number not in reasons]


def _explain_no_points(view: View, own: View) -> str:
    """Say why no point of a view is left after the outlier filter."""
    if not len(own.points):
        return "no points in the extraction range"
    if view.mask is not None:
        share = len(view.points) / np.count_nonzero(view.mask)
        if share < _MIN_DEPTH_SHARE:
            return f"depth in only {share:.0%} of its mask, so thinly that all of its points are outliers"
    return "only outliers in the extraction range"
