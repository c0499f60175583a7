"""find_ropes(): views of a table with ropes and other things in, views of the ropes alone out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from strand._core import NotEnoughDataError
from strand.reconstruction.finding.standing import table_in, tabletop
from strand.reconstruction.finding.strips import LeftOut, rope_strips
from strand.reconstruction.finding.widths import strip_lengths, strip_radius
from strand.reconstruction.images.rope_image import RopeImage, rope_images
from strand.reconstruction.radius import Radii
from strand.support.checks import Array
from strand.views.box import Bounds, Box, extraction_range
from strand.views.view import View, checked_views, masked

# ropes show at least so many radii of length in some view
_SHORTEST = 14.0
# a table in an extraction range takes this share of an image's pixels; of so many, where there is no image;
# points that are looked at first
_PART, _PIXELS, _LOOK = 0.04, 200_000, 30_000


class NoRopeError(NotEnoughDataError):
    """What stands on the table is no rope.

    Attributes
    ----------
    low_things : bool
        Whether as much as a rope stands there no higher than ropes do: strands that lie side by side look
        like one thing that is wide.
    """

    def __init__(self, message: str, low_things: bool = False) -> None:
        super().__init__(message)
        self.low_things = low_things


@dataclass(frozen=True, eq=False)
class FoundRopes:
    """Ropes among other things.

    Attributes
    ----------
    views : tuple of View
        The same views, of the ropes alone: depth images with a mask, and points without those of other
        things. Views that show no table, and those that have a mask, are as they were.
    radius : float or None
        The half width of most strips, metres; None if there is no table.
    tables : tuple of ((3,) ndarray, float) or None
        For each view the table's unit normal n towards the camera, world frame, and n.x, metres; None where
        it shows none.
    left_out : tuple of LeftOut
        What stands on the table and is no rope.
    """

    views: tuple[View, ...]
    radius: float | None
    tables: tuple[tuple[Array, float] | None, ...]
    left_out: tuple[LeftOut, ...]


def find_ropes(
    views: Sequence[View],
    radius: float | Sequence[float] | None = None,
    bounds: Bounds | None = None,
) -> FoundRopes:
    """Tell ropes on a table from the table and from other things on it.

    In each view the plane that most points lie on is the table, however it is tilted. What stands above it is
    a rope where it is a strip of one width, and thin or low; the width is the one that the longest strips
    have, for their width. Everything else is left out.

    Parameters
    ----------
    views : sequence of View
    radius : float or sequence of float, optional
        The ropes' radius, or the radii of ropes that differ, metres; found by how wide strips are if not
        given.
    bounds : pair of (3,) array_like, or Box, optional
        Where ropes are sought on the table, metres, as for `strand.reconstruct`; anywhere if not given. The
        table is found by all that a view shows.

    Returns
    -------
    FoundRopes

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If there are no views, the radius is not positive or the bounds are no box.
    strand.NoRopeError
        If there is a table, and no rope on it.
    """
    views = checked_views(views)
    box = None if bounds is None else extraction_range(bounds)
    given = None if radius is None else Radii.given(radius).values
    asked = [k for k, view in enumerate(views) if view.mask is None and len(view.points)]
    images = rope_images([views[k] for k in asked], [views[k] for k in asked], None)
    tops = {k: top for k, image in zip(asked, images, strict=True) if (top := tabletop(image)) is not None}
    found = list(views)
    tables: list[tuple[Array, float] | None] = [None] * len(views)
    if not tops:
        return FoundRopes(tuple(views), None, tuple(tables), ())
    inside = {k: True if box is None else _held(top.image, box) for k, top in tops.items()}
    widths = strip_radius([replace(top.image, mask=top.image.mask & inside[k]) for k, top in tops.items()])
    thin, thick = (widths, widths) if given is None else (float(given.min()), float(given.max()))
    left_out: list[LeftOut] = []
    shown = []
    for k, top in tops.items():
        mask, others = rope_strips(top, thin, thick, k)
        left_out += [thing for thing in others if box is None or box.holds(thing.place)]
        shown.append(replace(top.image, mask=mask & inside[k]))
        tables[k] = (top.normal, top.offset)
        found[k] = _only(views[k], shown[-1])
    own = strip_radius(shown)
    longest = max(float(strip_lengths(image, own).max(initial=0.0)) for image in shown)
    if longest < _SHORTEST * own or not any(len(found[k].points) for k in tops):
        low_things = any(_area(image) > 2.0 * _SHORTEST * thin**2 for image in shown)
        raise NoRopeError(f"views: {_why_none(left_out, longest, own, box)}", low_things)
    return FoundRopes(tuple(found), widths, tuple(tables), tuple(left_out))


def on_table(views: Sequence[View], within: Sequence[View]) -> bool:
    """Tell whether an extraction range holds a table: most of what one view shows in it lies on one.

    Parameters
    ----------
    views : sequence of View
        Without masks.
    within : sequence of View
        The same views, cropped.
    """
    most = max(range(len(views)), key=lambda k: len(within[k].points))
    view, own = views[most], within[most]
    size = _PIXELS if view.image is None else view.image.depth.size
    # a quick look first
    if len(own.points) < _PART * size or table_in(own.points[:: max(len(own.points) // _LOOK, 1)]) is None:
        return False
    (image,) = rope_images([own], [view], None)
    top = tabletop(image)
    if top is None:
        return False
    return bool(2 * np.count_nonzero(image.mask & top.image.mask) < np.count_nonzero(image.mask))


def _held(image: RopeImage, box: Box) -> NDArray[np.bool_]:
    """(H, W) Which pixels show what is in an extraction range."""
    rows, columns = np.nonzero(image.depth > 0)
    found = np.zeros_like(image.mask)
    found[rows, columns] = box.holds(image.world(rows, columns, image.depth[rows, columns]))
    return found


def _only(view: View, image: RopeImage) -> View:
    """Return a view with what a mask shows alone."""
    if view.image is not None:
        return masked(view, image.mask)
    columns, rows = np.rint(image.projected(view.world_points)).astype(np.int64).T
    height, width = image.mask.shape
    inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    inside[inside] = image.mask[rows[inside], columns[inside]]
    colors = None if view.colors is None else view.colors[inside]
    return View(view.points[inside], view.pose, colors=colors)


def _area(image: RopeImage) -> float:
    """Area of what a mask shows as it is seen, square metres."""
    return float(np.sum(image.depth[image.mask] ** 2) / (image.focal[0] * image.focal[1]))


def _why_none(left_out: list[LeftOut], longest: float, radius: float, box: Box | None) -> str:
    """Say what there is instead of a rope."""
    strips = (
        f"the longest strip of one width is {1e3 * longest:.0f} mm long and {2e3 * radius:.0f} mm wide"
        if longest > 0.0
        else "nothing that stands on it is a strip of one width"
    )
    count = len(left_out)
    things = f", and {count} thing{'s were' if count > 1 else ' was'} left out" if count else ""
    bounds = "bounds around it" if box is None else "bounds that leave the table out"
    return f"no rope on the table: {strips}{things}; if there is one, give {bounds}, or masks"
