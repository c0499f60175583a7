"""Mistakes in what was given that the data show by themselves, whatever the answer is."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from strand._core import NotEnoughDataError
from strand.reconstruction.finding.ropes import find_ropes
from strand.reconstruction.finding.standing import holds_table
from strand.reconstruction.mistakes.agreement import apart, more_than_ropes
from strand.reconstruction.mistakes.distance import too_far
from strand.reconstruction.mistakes.field_of_view import seen_all_around, seen_from_one_place
from strand.reconstruction.mistakes.flatness import bent_tables
from strand.reconstruction.mistakes.principal_point import off_centre
from strand.reconstruction.mistakes.undo import MISTAKES
from strand.reconstruction.radius import Radii, apparent_radius
from strand.ropes.doubt import Doubt
from strand.views.box import Box
from strand.views.view import View, cropped

# views that are right show ropes so many radii apart at most; as far as this counts
_AGREE, _FARTHEST = 0.8, 10.0
# a mistake is named if views are so many times farther apart with it than without
_NEARER = 2.0
# doubt of what is named, which is certain and told first; of views that are farther apart than this, radii,
# for each radius more, and the most; of views that see nothing in common
_NAMED, _CLEARLY, _APART, _MOST, _OUT_OF_SIGHT = 20.0, 2.0, 0.4, 1.5, 0.8
# a radius is named that is this much of what was given; noise looks thinner still
_OFF = (0.42, 0.75, 1.33, 2.4)
# radius by which views are compared where none is known, metres
_USUAL = 0.005


def suspected(
    whole: Sequence[View],
    views: Sequence[View],
    bounds: Box | None,
    radius: float,
    shown: Sequence[View] | None = None,
) -> list[Doubt]:
    """Say which usual mistakes the views that were given look like.

    Parameters
    ----------
    whole : sequence of View
        With all that they saw.
    views : sequence of View
        The same views. Their points, in bounds, are ropes.
    bounds : Box or None
        The extraction range, metres.
    radius : float
        The thinnest rope's, metres.
    shown : sequence of View, optional
        The same views with the points of ropes alone, if they are known.

    Returns
    -------
    list of Doubt
        What is contradicted by most is first.
    """
    around = seen_all_around(whole) or seen_from_one_place(whole)
    signs = too_far(shown or whole, radius), bent_tables(whole), around
    found = [doubt for doubt in signs if doubt is not None]
    inside = shown or (views if bounds is None else cropped(views, bounds))
    far = apart(views, bounds, _FARTHEST * radius, inside) if len(views) > 1 else math.nan
    # views of more than ropes say nothing of how far apart these are, whatever is undone
    silent = more_than_ropes(inside) or (bounds is None and math.isnan(far))
    if len(views) > 1 and not found and not silent and not far <= _AGREE * radius:
        # tables are not as near each other as ropes
        found += [] if holds_table(whole, inside) else _of_views_apart(views, bounds, radius, far)
    # views that agree have intrinsics that are right
    elsewhere = None if far <= _AGREE * radius else off_centre(whole)
    return found if elsewhere is None else [*found, elsewhere]


def _of_views_apart(views: Sequence[View], bounds: Box | None, radius: float, far: float) -> list[Doubt]:
    """Name the mistake without which views agree; doubt poses if there is none, and views are far apart.

    Views of which none has another's ropes in sight may look at different ropes, but hardly do.
    """
    without = [_apart(mistake.undone(views), bounds, radius) for mistake in MISTAKES]
    least = min(range(len(MISTAKES)), key=without.__getitem__)
    shown = f"views show the ropes {_length(far, radius)} apart"
    if not math.isfinite(far):
        shown = "no view has the ropes of another in sight"
    if without[least] < _AGREE * radius and not without[least] > far / _NEARER:
        mistake = MISTAKES[least]
        reason = f"{mistake.suspected}; {shown}, {1e3 * without[least]:.1f} mm without that"
        return [Doubt(mistake.kind, _NAMED, "where the ropes are", reason)]
    amount = _OUT_OF_SIGHT if math.isinf(far) else min(_APART * (far / radius - _CLEARLY), _MOST)
    if not amount > 0.0:
        return []
    asked = "are poses camera-to-world, in metres, of angles in radians, and each of its own image?"
    return [Doubt("pose", amount, "where the ropes are", f"{shown}; {asked}")]


def _apart(views: Sequence[View | None], bounds: Box | None, radius: float) -> float:
    """How far apart views are, metres; infinite if some are missing or none sees what another one does."""
    if any(view is None for view in views):
        return math.inf
    most = _FARTHEST * radius
    far = apart([view for view in views if view is not None], bounds, most, opposite=most)
    return math.inf if math.isnan(far) else far


def _length(far: float, radius: float) -> str:
    return f"{1e3 * far:.1f} mm" + (" or more" if far >= 0.99 * _FARTHEST * radius else "")


def thinnest(radii: Radii | None) -> float:
    """Return the least radius that was given, or a usual one, metres."""
    return _USUAL if radii is None else float(radii.values.min())


@contextmanager
def explained(views: Sequence[View], bounds: Box | None, radii: Radii | None) -> Iterator[None]:
    """Let an error for want of a rope say what the views look like, and the radius that ropes seem to have.

    Parameters
    ----------
    views : sequence of View
        With all that they saw.
    bounds : Box or None
        The extraction range, metres.
    radii : Radii or None
        If they were given.

    Raises
    ------
    strand.NotEnoughDataError
        That of what is done within, with a longer message.
    """
    try:
        yield
    except NotEnoughDataError as error:
        reasons = [doubt.reason for doubt in suspected(views, views, bounds, thinnest(radii))[:1]]
        if not reasons and radii is not None:
            reasons = _of_radius(views, bounds, radii)
        if not reasons:
            raise
        raise type(error)(f"{error}; {reasons[0]}") from error


def _of_radius(views: Sequence[View], bounds: Box | None, radii: Radii) -> list[str]:
    """Say which radius ropes look like, if they look like none that was given."""
    inside = views if bounds is None else cropped(views, bounds)
    has_masks = any(view.mask is not None for view in views)
    if has_masks or (bounds is not None and not holds_table(views, inside)):
        looks = apparent_radius([view for view in inside if len(view.points)] or views)
    else:
        try:
            looks = find_ropes(views, bounds=bounds).radius
        except NotEnoughDataError:
            looks = None
    if looks is None:
        return []
    ratio = looks / float(radii.values[np.abs(np.log(looks / radii.values)).argmin()])
    if not (_OFF[0] < ratio < _OFF[1] or _OFF[2] < ratio < _OFF[3]):
        return []
    given = ", ".join(f"{1e3 * value:.1f}" for value in radii.values)
    return [f"the ropes look {1e3 * looks:.1f} mm in radius, {given} mm was given"]
