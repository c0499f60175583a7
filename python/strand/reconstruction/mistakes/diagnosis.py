"""Name usual mistakes in the caller's input, which the data show whatever the answer is."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

import strand._core as _core
from strand._core import NotEnoughDataError
from strand.reconstruction.finding.ropes import segment_views
from strand.reconstruction.finding.standing import holds_table
from strand.reconstruction.mistakes.agreement import compare_views, explain_distance
from strand.reconstruction.mistakes.field_of_view import (
    doubt_far_depths,
    doubt_points_all_around,
    doubt_principal_point,
    doubt_shared_viewpoint,
)
from strand.reconstruction.mistakes.flatness import doubt_bent_tables
from strand.reconstruction.mistakes.undo import IN_MILLIMETERS, MISTAKES
from strand.reconstruction.mistakes.units import doubt_gray_levels
from strand.reconstruction.radius import Radii, find_thinnest, guess_radius
from strand.ropes.doubt import Doubt
from strand.support.checks import Array
from strand.views.box import Box, format_point
from strand.views.extract import Extract
from strand.views.pose import moved
from strand.views.view import View

_SAMPLE = 20_000  # points of each view that are looked at
_MIN_SHARE = 1e-3  # of these points lie in the range once the likely mistake is undone
_BOUNDS_IN_MILLIMETERS = "bounds look like millimetres: give them in metres"
_OTHER_MASKS = "points outside of the masks do lie there: are the masks those of these frames?"
# a message names the apparent radius within these ranges; noise looks thinner still
_THINNER_RANGE = (0.42, 0.75)  # apparent radius over the given one
_WIDER_RANGE = (1.33, 2.4)  # apparent radius over the given one


def find_mistakes(extract: Extract, radius: float, views: Sequence[View] | None = None) -> list[Doubt]:
    """Find the usual mistakes that views show by themselves.

    Parameters
    ----------
    extract : Extract
        The views as the caller gave them, without masks of ropes that strand found.
    radius : float
        The thinnest rope's, metres.
    views : sequence of View, optional
        The same views, uncropped, with points of ropes alone in bounds, if they are known.

    Returns
    -------
    list of Doubt
        The likeliest mistake first.
    """
    whole = extract.whole
    focal = max((max(view.image.camera.focal) for view in whole if view.image is not None), default=None)
    far = doubt_far_depths(whole if extract.empty else extract.inside, radius, focal)
    gray = doubt_gray_levels(whole)
    around = doubt_points_all_around(whole) or doubt_shared_viewpoint(whole)
    off_center = doubt_principal_point(whole)
    found = [doubt for doubt in (gray, far, doubt_bent_tables(whole), around) if doubt is not None]
    views = whole if views is None else views
    agreement = compare_views(views, extract.inside, extract.bounds, radius)
    if not found and agreement.known and not agreement.agrees:
        disagreement = explain_distance(views, extract.bounds, radius, agreement.distance)
        # tables are farther from each other than ropes
        found += [] if disagreement and holds_table(extract) else disagreement
    # views that agree have the right intrinsics
    return found if off_center is None or agreement.agrees else [*found, off_center]


@contextmanager
def explain_errors(extract: Extract, radii: Radii | None) -> Iterator[None]:
    """Add the likely cause to an error of too little data: a mistake, or a wrong radius.

    Parameters
    ----------
    extract : Extract
        The caller's views.
    radii : Radii or None
        As the caller gave them.

    Raises
    ------
    strand.NotEnoughDataError
        The error of what is done within, with a longer message.
    """
    try:
        yield
    except NotEnoughDataError as error:
        mistakes = find_mistakes(extract, find_thinnest(radii))
        reason = mistakes[0].reason if mistakes else None
        if extract.empty:
            reason = _explain_emptiness(extract, reason) or reason
        elif radii is not None:
            reason = _explain_extent(extract, radii) or reason or _explain_radius(extract, radii)
        if reason is None:
            raise
        raise type(error)(f"{error}; {reason}") from error


def _explain_extent(extract: Extract, radii: Radii) -> str | None:
    """Say that a rope of the greatest radius does not fit into what the views show; None if it does."""
    points = np.concatenate([_sample_points(view) for view in extract.inside])
    extent, greatest = float(np.linalg.norm(np.ptp(points, axis=0))), float(radii.values.max())
    if 2.0 * greatest < extent:
        return None
    wide = f"radius: a rope {2.0 * greatest:.3g} m wide"
    return f"{wide} does not fit into points {extent:.2g} m across; is it in metres?"


def _explain_radius(extract: Extract, radii: Radii) -> str | None:
    """Say which radius the ropes seem to have; None if it is near a given one, or unknown."""
    has_masks = any(view.mask is not None for view in extract.whole)
    if has_masks or (extract.bounds is not None and not holds_table(extract)):
        apparent = guess_radius([view for view in extract.inside if len(view.points)])
    else:
        try:
            apparent = segment_views(extract, None)[0].radius
        except NotEnoughDataError:
            apparent = None
    if apparent is None:
        return None
    ratio = apparent / float(radii.values[np.abs(np.log(apparent / radii.values)).argmin()])
    if not any(low < ratio < high for low, high in (_THINNER_RANGE, _WIDER_RANGE)):
        return None
    given = ", ".join(f"{1e3 * value:.1f}" for value in radii.values)
    return f"the ropes look {1e3 * apparent:.1f} mm in radius, {given} mm was given"


def _explain_emptiness(extract: Extract, mistake: str | None) -> str | None:
    """Say where the points and the extraction range are, and which mistake would explain that.

    Parameters
    ----------
    extract : Extract
        Views without a point inside.
    mistake : str or None
        The likely mistake that the views show by themselves.

    Returns
    -------
    str or None
        None if the views have no points outside either.
    """
    views, bounds = extract.whole, extract.bounds
    clouds = [view.points[:: max(len(view.points) // _SAMPLE, 1)] for view in views]
    if bounds is None or not any(map(len, clouds)):
        return None
    placed = np.concatenate([view.world_points for view in views])
    low, high = format_point(placed.min(axis=0)), format_point(placed.max(axis=0))
    return (
        f"the points lie between {low} and {high} m, the range is {bounds}; "
        f"{mistake or _find_likely_mistake(views, clouds, bounds)}"
    )


def _find_likely_mistake(views: Sequence[View], clouds: Sequence[Array], bounds: Box) -> str:
    """Name the mistake without which most points lie in bounds."""
    inside = {
        mistake.advice: _count_inside(
            [_sample_points(view) for view in mistake.undo(views) if view is not None], bounds
        )
        for mistake in (*MISTAKES, IN_MILLIMETERS)
    }
    inside[_BOUNDS_IN_MILLIMETERS] = _count_inside(
        [1e3 * moved(c, v.pose) for c, v in zip(clouds, views, strict=True)], bounds
    )
    inside[_OTHER_MASKS] = _count_inside(
        [_sample_outside_mask(c, v) for c, v in zip(clouds, views, strict=True)], bounds
    )
    likely = max(inside, key=inside.__getitem__)
    if inside[likely] > _MIN_SHARE * sum(map(len, clouds)):
        return likely
    return "are bounds, poses and units those of one world frame, in metres?"


def _count_inside(clouds: Sequence[Array], bounds: Box) -> int:
    return int(np.count_nonzero(bounds.holds(np.concatenate([np.empty((0, 3)), *clouds]))))


def _sample_points(view: View) -> Array:
    """Return some of a view's points, world frame, metres."""
    return moved(view.points[:: max(len(view.points) // _SAMPLE, 1)], view.pose)


def _sample_outside_mask(cloud: Array, view: View) -> Array:
    """Return as many points of a whole masked image as its cloud has, world frame, metres."""
    image = view.image
    if image is None or image.labels is None or not len(cloud):
        return np.empty((0, 3))
    points = _core.unproject(image.depth, *image.camera)
    return moved(points[:: max(len(points) // len(cloud), 1)], view.pose)
