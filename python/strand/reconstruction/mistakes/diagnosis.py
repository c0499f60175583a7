"""Name usual mistakes in the caller's input, which the data show whatever the answer is."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from strand._core import NotEnoughDataError
from strand.reconstruction.finding.ropes import segment_views
from strand.reconstruction.finding.standing import holds_table
from strand.reconstruction.mistakes.agreement import distance_between_views, shows_more_than_ropes
from strand.reconstruction.mistakes.emptiness import explain_emptiness
from strand.reconstruction.mistakes.field_of_view import (
    doubt_far_depths,
    doubt_points_all_around,
    doubt_principal_point,
    doubt_shared_viewpoint,
)
from strand.reconstruction.mistakes.flatness import doubt_bent_tables
from strand.reconstruction.mistakes.undo import MISTAKES
from strand.reconstruction.radius import Radii, find_thinnest, guess_radius
from strand.ropes.doubt import Doubt
from strand.views.box import Box
from strand.views.view import View

_MAX_DISTANCE = 0.8  # radii: views that agree show ropes this close to each other
_FARTHEST = 10.0  # radii: larger distances count as this
_MIN_GAIN = 2.0  # a mistake is named if undoing it brings views this many times closer
_NAMED = 20.0  # doubt: a named mistake is certain, and stands first
_NO_DOUBT = 2.0  # radii: views this close raise no doubt of their poses
_DOUBT_PER_RADIUS = 0.4  # of the distance between views
_MAX_DOUBT = 1.5  # of the distance between views
_OUT_OF_SIGHT = 0.8  # doubt if no view shows the ropes of another
_THINNER = (0.42, 0.75)  # range of the apparent radius over the given one that is named; noise looks thinner
_WIDER = (1.33, 2.4)  # range of the apparent radius over the given one that is named


def find_mistakes(
    whole: Sequence[View], views: Sequence[View], inside: Sequence[View], bounds: Box | None, radius: float
) -> list[Doubt]:
    """Find the usual mistakes that views show by themselves.

    Parameters
    ----------
    whole : sequence of View
        Uncropped, without masks of ropes that strand found.
    views : sequence of View
        The same views. Their points in bounds are ropes.
    inside : sequence of View
        The same views, cropped to bounds.
    bounds : Box or None
        The extraction range, metres.
    radius : float
        The thinnest rope's, metres.

    Returns
    -------
    list of Doubt
        The likeliest mistake first.
    """
    far = doubt_far_depths(inside if any(len(view.points) for view in inside) else whole, radius)
    around = doubt_points_all_around(whole) or doubt_shared_viewpoint(whole)
    found = [doubt for doubt in (far, doubt_bent_tables(whole), around) if doubt is not None]
    distance = math.nan
    if len(views) > 1:
        distance = distance_between_views(views, bounds, _FARTHEST * radius, inside)
    agree = distance <= _MAX_DISTANCE * radius
    # views of more than ropes do not show how far these are from each other, whatever is undone
    unknown = shows_more_than_ropes(inside) or (bounds is None and math.isnan(distance))
    if len(views) > 1 and not found and not unknown and not agree and not holds_table(whole, inside):
        found += _explain_distance(views, bounds, radius, distance)
    # views that agree have the right intrinsics
    off_center = None if agree else doubt_principal_point(whole)
    return found if off_center is None else [*found, off_center]


def _explain_distance(
    views: Sequence[View], bounds: Box | None, radius: float, distance: float
) -> list[Doubt]:
    """Name the mistake without which views agree; without one, doubt the poses of views that are far apart.

    If no view shows the ropes of another, they may show different ropes, but hardly ever do.
    """
    without = [_distance_without(mistake.undo(views), bounds, radius) for mistake in MISTAKES]
    least = min(range(len(MISTAKES)), key=without.__getitem__)
    shown = f"views show the ropes {_format_distance(distance, radius)} apart"
    if not math.isfinite(distance):
        shown = "no view has the ropes of another in sight"
    if without[least] < _MAX_DISTANCE * radius and not without[least] > distance / _MIN_GAIN:
        mistake = MISTAKES[least]
        reason = f"{mistake.advice}; {shown}, {1e3 * without[least]:.1f} mm without that"
        return [Doubt(mistake.kind, _NAMED, "where the ropes are", reason)]
    amount = min(_DOUBT_PER_RADIUS * (distance / radius - _NO_DOUBT), _MAX_DOUBT)
    if math.isinf(distance):
        amount = _OUT_OF_SIGHT
    if not amount > 0.0:
        return []
    asked = "are poses camera-to-world, in metres, of angles in radians, and each of its own image?"
    return [Doubt("pose", amount, "where the ropes are", f"{shown}; {asked}")]


def _distance_without(views: Sequence[View | None], bounds: Box | None, radius: float) -> float:
    """Return the distance between views without a mistake, metres; infinite if they cannot show it."""
    if any(view is None for view in views):
        return math.inf
    farthest = _FARTHEST * radius
    known = [view for view in views if view is not None]
    distance = distance_between_views(known, bounds, farthest, opposite=farthest)
    return math.inf if math.isnan(distance) else distance


def _format_distance(distance: float, radius: float) -> str:
    return f"{1e3 * distance:.1f} mm" + (" or more" if distance >= 0.99 * _FARTHEST * radius else "")


def refuse_empty_views(
    views: Sequence[View], inside: Sequence[View], bounds: Box | None, radii: Radii | None
) -> None:
    """Raise an error that explains why no view has a point.

    Parameters
    ----------
    views : sequence of View
        Uncropped.
    inside : sequence of View
        The same views, cropped to bounds.
    bounds : Box or None
        The extraction range that they were cropped to, metres.
    radii : Radii or None
        As given by the caller.

    Raises
    ------
    strand.NotEnoughDataError
        If no view has a point.
    """
    if not any(len(view.points) for view in inside):
        mistakes = find_mistakes(views, views, inside, bounds, find_thinnest(radii))
        raise NotEnoughDataError(f"views: {explain_emptiness(views, bounds, mistakes)}")


@contextmanager
def explaining_errors(
    views: Sequence[View], inside: Sequence[View], bounds: Box | None, radii: Radii | None
) -> Iterator[None]:
    """Add the likely mistake, or the radius that the ropes seem to have, to an error of too little data.

    Parameters
    ----------
    views, inside, bounds, radii
        As for `refuse_empty_views`.

    Raises
    ------
    strand.NotEnoughDataError
        The error of what is done within, with a longer message.
    """
    try:
        yield
    except NotEnoughDataError as error:
        mistakes = find_mistakes(views, views, inside, bounds, find_thinnest(radii))
        reason = mistakes[0].reason if mistakes else _explain_radius(views, inside, bounds, radii)
        if reason is None:
            raise
        raise type(error)(f"{error}; {reason}") from error


def _explain_radius(
    views: Sequence[View], inside: Sequence[View], bounds: Box | None, radii: Radii | None
) -> str | None:
    """Say which radius the ropes seem to have; None if it is near a given one, or unknown."""
    if radii is None:
        return None
    has_masks = any(view.mask is not None for view in views)
    if has_masks or (bounds is not None and not holds_table(views, inside)):
        apparent = guess_radius([view for view in inside if len(view.points)] or views)
    else:
        try:
            apparent = segment_views(tuple(views), None, bounds).radius
        except NotEnoughDataError:
            apparent = None
    if apparent is None:
        return None
    ratio = apparent / float(radii.values[np.abs(np.log(apparent / radii.values)).argmin()])
    if not any(low < ratio < high for low, high in (_THINNER, _WIDER)):
        return None
    given = ", ".join(f"{1e3 * value:.1f}" for value in radii.values)
    return f"the ropes look {1e3 * apparent:.1f} mm in radius, {given} mm was given"
