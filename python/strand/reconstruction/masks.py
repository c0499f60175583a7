"""Whether masks can be right: ropes stand out from what is around them, and there are so many of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand._core import NotEnoughDataError
from strand.reconstruction.images.table_plane import find_table_beside_ropes
from strand.ropes.doubt import Doubt, ModelWarning
from strand.support.checks import Array
from strand.support.robust import robust_deviation
from strand.views.box import Box
from strand.views.depth_image import DepthImage
from strand.views.pose import moved
from strand.views.view import View

_Indices = NDArray[np.intp]

# so many pixels of a mask are compared with what lies this many radii, and a pixel, to either side of them
_PIXELS, _REACH = 1000, 3.0
# steps to one side, in columns and rows; the other side is opposite
_SIDES = ((1.0, 0.0), (0.7, 0.7), (0.0, 1.0), (-0.7, 0.7))
# what is inside must stand so many radii before what is around: on a table 0.6 at a depth error of 1.4 radii,
# 1 to 2 else; masks of other frames have 0.2 at most
_LEAST_HEIGHT = 0.35
# fewer comparisons say nothing; a mask with less than this share of them is wide, and one that is wide and
# covers more than this share of the image holds the background
_FEWEST, _WIDE, _MOST = 30, 0.03, 0.6
# a mask in which this share of the pixels stands out by less than so many radii is of the background alone,
# where heights have a standard deviation of less than so many
_NOTHING, _FLAT, _TOLD = 0.9, 0.7, 0.5
# a rope covers at least so many squares of its radius, pixels
_SPECK = 3.0
# confidence of an answer from a mask that is likely wrong: a factor of about one in seven
_DOUBT = 2.0


def misplaced_masks(
    views: Sequence[View], numbers: Sequence[int], bounds: Box | None, radii: Array
) -> list[tuple[Doubt, int]]:
    """Name masks that seem to be of another frame, or of the background.

    Parameters
    ----------
    views : sequence of View
        As they were given; those without a mask have none that is wrong.
    numbers : sequence of int
        The numbers of the views to look at.
    bounds : Box or None
        The extraction range, metres; what of a mask lies outside is no rope.
    radii : (K,) ndarray
        The ropes' radii, ascending, metres.

    Returns
    -------
    list of (Doubt, int)
        Each with the number of its view.
    """
    found: list[tuple[Doubt, int]] = []
    for number in numbers:
        image = _masked_image(views[number], bounds)
        reason = None if image is None else _why_misplaced(image, bounds, radii)[0]
        if reason is not None:
            said = f"view {number}: {reason}"
            found.append((Doubt("mask", _DOUBT, "whether its mask is right", said), number))
    return found


def refuse_background(
    views: Sequence[View], numbers: Sequence[int], bounds: Box | None, radii: Array
) -> None:
    """Refuse masks of which depth says that they all show the background alone; arguments as above.

    Raises
    ------
    strand.NotEnoughDataError
        If there is no rope in any of them.
    """
    images = [_masked_image(views[number], bounds) for number in numbers]
    if all(image is not None and _why_misplaced(image, bounds, radii)[1] for image in images):
        raise NotEnoughDataError(
            f"views: {_named(numbers)} of the background: nothing inside stands out from what is around it"
        )


def why_no_rope(view: View, radius: float) -> str | None:
    """Say why a view's mask shows no rope with depth; None if it may show one, or there is no mask.

    Parameters
    ----------
    view : View
    radius : float
        The thinnest rope's, metres.
    """
    image, mask = view.image, view.mask
    if image is None or mask is None:
        return None
    depths = image.depth[mask]
    seen = depths[depths > 0]
    if not len(seen):
        return None
    across = radius * max(image.camera.focal) / float(np.median(seen))
    largest = _core.largest_blob(mask)
    if largest >= _SPECK * across**2:
        return None
    return (
        f"a mask that shows no rope: its largest part has {largest} pixels, and a rope of this radius is "
        f"{2.0 * across:.1f} wide"
    )


def _named(numbers: Sequence[int]) -> str:
    if len(numbers) == 1:
        return f"the mask of view {numbers[0]} is"
    return f"the masks of views {', '.join(map(str, numbers[:-1]))} and {numbers[-1]} are"


def surplus_labels(views: Sequence[View], ropes: int | None) -> Iterator[ModelWarning]:
    """Name views whose mask has labels for more ropes than there are: some may be pieces of one."""
    for number, view in enumerate(views):
        if ropes is None or view.image is None or view.image.labels is None:
            continue
        labels = len(np.unique(view.image.labels[view.image.mask]))
        if labels > ropes:
            message = f"view {number}: its mask has {labels} labels, more than ropes = {ropes}"
            yield ModelWarning("mask", message, amount=float(labels), view=number)


def _masked_image(view: View, bounds: Box | None) -> DepthImage | None:
    """Return a view's image if it has a mask; None if there is none, or one of everything in bounds."""
    image = view.image
    # within an extraction range a mask of everything is as good as none
    if image is None or image.labels is None or (bounds is not None and image.mask.all()):
        return None
    return image.masked(image.mask)


def _shows_rope(
    image: DepthImage, bounds: Box | None, rows: _Indices, columns: _Indices
) -> NDArray[np.bool_]:
    """Tell which pixels are in the mask, have depth, and lie in the extraction range."""
    z = image.depth[rows, columns]
    inside = (z > 0) & image.mask[rows, columns]
    if bounds is None:
        return inside
    world = moved(image.camera.rays(rows, columns) * z[:, None], image.pose)
    return np.asarray(inside & bounds.holds(world))


def _why_misplaced(image: DepthImage, bounds: Box | None, radii: Array) -> tuple[str | None, bool]:
    """Say why a mask is likely not that of its image, None if it may be; and whether it shows no rope."""
    flat = np.flatnonzero(image.mask)
    rows, columns = np.divmod(flat[:: max(len(flat) // _PIXELS, 1)], image.mask.shape[1])
    inside = _shows_rope(image, bounds, rows, columns)
    if not inside.any():
        return None, False
    share = float(inside.mean()) * len(flat) / image.mask.size
    heights = _heights(image, bounds, rows[inside], columns[inside], _REACH * radii[-1])
    if len(heights) < _WIDE * len(_SIDES) * inside.sum() and share > _MOST:
        return f"its mask holds {share:.0%} of the image, and the background with it", False
    if len(heights) < _FEWEST:
        # next to the image's border nothing is seen on the other side
        heights = _above_table(image, rows[inside], columns[inside], float(radii[0]))
    if len(heights) < _FEWEST:
        return None, False
    height = float(np.median(heights)) / radii[0]
    if height >= _LEAST_HEIGHT:
        return None, False
    spread = robust_deviation(heights / radii[0] - height)
    low = float(np.mean(heights < _FLAT * radii[0]))
    reason = (
        f"what is inside its mask stands {height:.1f} radii before what is around it, as no rope does; "
        "is it the mask of this frame?"
    )
    return reason, spread < _TOLD and low > _NOTHING


def _above_table(image: DepthImage, rows: _Indices, columns: _Indices, radius: float) -> Array:
    """(N,) How high pixels are above the plane around the mask, metres; none if there is no plane."""
    table = find_table_beside_ropes(image, radius)
    if table is None:
        return np.empty(0)
    return table.heights(image.lift(rows, columns, image.depth[rows, columns]))


def _heights(image: DepthImage, bounds: Box | None, rows: _Indices, columns: _Indices, reach: float) -> Array:
    """How far pixels lie before the mean of what is to either side of them, if no rope is there.

    The mean of both sides leaves out how far a table is tilted.

    Parameters
    ----------
    image : DepthImage
    bounds : Box or None
        The extraction range, metres.
    rows, columns : (N,) ndarray of int
        Pixels of the rope.
    reach : float
        How far to either side, metres.

    Returns
    -------
    (M,) ndarray
        Metres, for each pixel and each pair of sides that could be compared.
    """
    depth = image.depth
    height, width = depth.shape
    own = depth[rows, columns]
    step = 1.0 + reach * max(image.camera.focal) / float(np.median(own))
    heights = []
    for across, down in _SIDES:
        du, dv = round(step * across), round(step * down)
        in_image = (columns >= abs(du)) & (columns < width - abs(du)) & (rows >= dv) & (rows < height - dv)
        v, u, sides = rows[in_image], columns[in_image], np.zeros(in_image.sum())
        seen = np.ones(len(v), dtype=bool)
        for sign in (-1, 1):
            beside = depth[v + sign * dv, u + sign * du]
            seen &= (beside > 0) & ~_shows_rope(image, bounds, v + sign * dv, u + sign * du)
            sides += beside
        heights.append((0.5 * sides - own[in_image])[seen])
    return np.concatenate(heights)
