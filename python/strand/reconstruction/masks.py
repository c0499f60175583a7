"""Select views that show ropes, and doubt masks: ropes stand out from their surroundings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand._core import NotEnoughDataError
from strand.reconstruction.evidence.depth_resolution import find_depth_step, show_in_windows
from strand.reconstruction.images.mask_parts import count_mask_parts, explain_many_parts
from strand.reconstruction.images.table_plane import find_table_beside_ropes
from strand.reconstruction.stages import Run
from strand.ropes.doubt import Doubt, ModelWarning
from strand.support.checks import Array
from strand.support.robust import estimate_deviation
from strand.views.box import Box
from strand.views.depth_image import DepthImage
from strand.views.extract import Extract
from strand.views.pose import moved
from strand.views.rope_images import make_rope_images
from strand.views.view import View

_Indices = NDArray[np.intp]

_SAMPLE = 1000  # pixels of a mask that are compared with pixels to either side of them
_REACH = 3.0  # radii, and one pixel: how far to the side these are
_SIDES = ((1.0, 0.0), (0.7, 0.7), (0.0, 1.0), (-0.7, 0.7))  # columns and rows; the other side is opposite
_MIN_HEIGHT = 0.35  # radii above the surroundings; masks of other frames have 0.2, ropes 0.6 and more
_MIN_COMPARISONS = 30  # fewer comparisons say nothing
_MIN_SHARE_COMPARED = 0.03  # of the possible comparisons; in wider masks fewer pixels have a side outside
_MAX_SHARE_OF_IMAGE = 0.6  # a wide mask that covers more of the image includes the background
_LOW_HEIGHT = 0.7  # radii: pixels this low do not stand out
_MIN_SHARE_LOW = 0.9  # of the pixels are low in a mask of the background alone
_MAX_SCATTER = 0.5  # radii: heights that scatter more do not show that a mask is of the background
_MIN_AREA = 3.0  # squares of its radius, pixels: a rope covers at least this
_MIN_DEPTH_SHARE = 0.2  # of a mask's pixels: with less, depth is too thin to have neighbors
_CLEAR_RESOLUTION = 1.0  # radii: where depth resolves as much, it shows whether a mask holds ropes
_NO_RESOLUTION = 2.0  # radii: where it resolves no less, it does not
_MISPLACED_DOUBT = 2.0  # doubt: a mask that is likely wrong makes the confidence about seven times lower


@dataclass(frozen=True, eq=False)
class MisplacedMask:
    """A mask that seems to belong to another frame, or to show the background.

    Attributes
    ----------
    doubt : Doubt
    view : int
        The number of the mask's view.
    shows_background : bool
        Whether it shows no rope at all.
    """

    doubt: Doubt
    view: int
    shows_background: bool


def find_misplaced_masks(
    views: Sequence[View], numbers: Sequence[int], bounds: Box | None, radii: Array
) -> list[MisplacedMask]:
    """Find masks that seem to belong to another frame, or to show the background.

    Parameters
    ----------
    views : sequence of View
        Uncropped. Those without a mask are skipped.
    numbers : sequence of int
        The numbers of the views to look at.
    bounds : Box or None
        The extraction range, metres. Pixels of a mask outside of it are no rope.
    radii : (K,) ndarray
        The ropes' radii, ascending, metres.
    """
    found = []
    for number in numbers:
        image = _find_mask(views[number], bounds)
        if image is None:
            continue
        reason, sure, shows_background = _judge_mask(image, bounds, radii)
        if reason is not None and sure > 0.0:
            doubt = Doubt(
                "mask", _MISPLACED_DOUBT * sure, "whether its mask is right", f"view {number}: {reason}"
            )
            found.append(MisplacedMask(doubt, number, shows_background))
    return found


def refuse_empty(extract: Extract, run: Run) -> None:
    """Crop views to the extraction range, if there is one; refuse views without a point.

    Raises
    ------
    strand.NotEnoughDataError
        If no view has a point inside.
    """
    with nullcontext() if extract.bounds is None else run.stage("extract"):
        if not extract.empty:
            return
    if any(len(view.points) for view in extract.whole):
        raise NotEnoughDataError("views: no view has a point in the extraction range")
    reasons = [(k, _explain_empty_mask(view)) for k, view in enumerate(extract.whole)]
    masks = ", ".join(f"view {k} has {reason}" for k, reason in reasons if reason is not None)
    if masks:
        raise NotEnoughDataError(
            f"views: no view has a point: {masks}; 0 in a mask is no rope, every other number is rope"
        )
    raise NotEnoughDataError("views: no view has a point; are all depths 0 or not finite?")


def select_views(
    extract: Extract, filtered: Sequence[View], radius: float, run: Run, segmented: bool = False
) -> list[int]:
    """Return the numbers of the views that show ropes; warn of the others.

    Parameters
    ----------
    extract : Extract
    filtered : sequence of View
        The views inside, without outliers.
    radius : float
        The thinnest rope's, metres.
    run : Run
    segmented : bool
        Whether strand made the masks.

    Raises
    ------
    strand.NotEnoughDataError
        If no view shows ropes.
    """
    reasons: dict[int, str] = {}
    for number, (view, own, left) in enumerate(zip(extract.whole, extract.inside, filtered, strict=True)):
        unlike = _explain_unlike_mask(view, own, extract.bounds, radius, segmented)
        reason = unlike or _explain_empty_mask(view)
        if reason is None and not len(left.points):
            reason = _explain_no_points(view, own)
        if reason is not None:
            reasons[number] = reason
    if len(reasons) == len(filtered):
        if any(view.mask is not None for view in extract.whole):
            said = "; ".join(f"view {number} has {reason}" for number, reason in reasons.items())
            raise NotEnoughDataError(f"views: {said}; is the radius right, in metres?")
        raise NotEnoughDataError("views: all points are outliers; is the radius right, in metres?")
    for number, reason in reasons.items():
        run.warn("unused view", f"view {number} has {reason} and was not used", view=number)
    return [number for number in range(len(filtered)) if number not in reasons]


def _explain_empty_mask(view: View) -> str | None:
    """Say why no point lies in a view's mask; None if one does, or there is no mask."""
    mask = view.mask
    if mask is None or len(view.points):
        return None
    return "no depth inside its mask" if mask.any() else "an empty mask"


def _explain_unlike_mask(
    view: View, own: View, bounds: Box | None, radius: float, segmented: bool
) -> str | None:
    """Say why a mask with depth is unlike one of ropes of a radius, metres; None if it is not.

    `own` is the view inside the extraction range, `bounds`. Pixels outside do not count.
    """
    image, mask = view.image, view.mask
    if image is None or mask is None:
        return None
    if np.isnan(image.distance):
        return None
    across = radius * max(image.camera.focal) / image.distance
    parts = count_mask_parts(mask, across)
    if parts.largest < _MIN_AREA * across * across:
        what = "no rope in the pixels that strand found" if segmented else "a mask that shows no rope"
        return (
            f"{what}: the largest part has {parts.largest} pixels, and a rope of this "
            f"radius is {2.0 * across:.4g} wide"
        )
    # one that holds the whole image has one piece, which the ropes' own bounds may cut
    reason = None if mask.all() else explain_many_parts(parts)
    if reason is not None and bounds is not None:
        (inside,) = make_rope_images([own], [view], bounds)
        reason = explain_many_parts(count_mask_parts(inside.mask, across))
    return reason


def _explain_no_points(view: View, own: View) -> str:
    """Say why no point of a view is left after the outlier filter."""
    if not len(own.points):
        return "no points in the extraction range"
    if view.mask is not None:
        share = len(view.points) / np.count_nonzero(view.mask)
        if share < _MIN_DEPTH_SHARE:
            return f"depth in only {share:.0%} of its mask, so thinly that all of its points are outliers"
    return "only outliers in the extraction range"


def warn_of_surplus_labels(views: Sequence[View], ropes: int | None) -> Iterator[ModelWarning]:
    """Yield a warning for each mask with more labels than ropes: some may be pieces of one rope."""
    for number, view in enumerate(views):
        image = view.image
        if ropes is None or image is None or image.labels is None or image.labels.dtype == np.bool_:
            continue
        labels = len(np.unique(image.labels[image.mask]))
        if labels > ropes:
            message = f"view {number}: its mask has {labels} labels, more than ropes = {ropes}"
            yield ModelWarning("mask", message, amount=float(labels), view=number)


def _find_mask(view: View, bounds: Box | None) -> DepthImage | None:
    """Return a view's image if it has a mask; within bounds, the mask must exclude some pixels."""
    image = view.image
    if image is None or image.labels is None or (bounds is not None and image.mask.all()):
        return None
    return image if image.mask is image.labels else replace(image, labels=image.mask)


def _show_points(
    image: DepthImage, bounds: Box | None, rows: _Indices, columns: _Indices, z: Array
) -> NDArray[np.bool_]:
    """(N,) Tell which pixels have depths z, metres, and show points in the extraction range."""
    inside = z > 0
    if bounds is not None:
        world = moved(image.camera.cast_rays(rows, columns) * z[:, None], image.pose)
        inside &= bounds.holds(world)
    return inside


def _judge_mask(image: DepthImage, bounds: Box | None, radii: Array) -> tuple[str | None, float, bool]:
    """Say why a mask likely belongs to another image, if it does.

    Say also how clearly depth would show otherwise, from 0 to 1, and whether it shows background alone.
    """
    count = len(image.mask_pixels)
    some = slice(None, None, max(count // _SAMPLE, 1))
    rows, columns = np.divmod(image.mask_pixels[some], image.mask.shape[1])
    z = image.mask_depths[some]
    inside = _show_points(image, bounds, rows, columns, z)
    if not inside.any():
        return None, 0.0, False
    share = float(inside.mean()) * count / image.mask.size
    rows, columns, z = rows[inside], columns[inside], z[inside]
    heights = _measure_above_sides(image, bounds, rows, columns, z, _REACH * radii[-1])
    few = len(heights) < _MIN_SHARE_COMPARED * len(_SIDES) * inside.sum()
    if few and share > _MAX_SHARE_OF_IMAGE:
        return f"its mask holds {share:.0%} of the image, and the background with it", 1.0, False
    if len(heights) < _MIN_COMPARISONS:
        # next to the image's border there is nothing on the other side
        heights = _measure_above_table(image, rows, columns, z, float(radii[0]))
    if len(heights) < _MIN_COMPARISONS:
        return None, 0.0, False
    height = _core.find_median(heights) / radii[0]
    if height >= _MIN_HEIGHT:
        return None, 0.0, False
    scatter = estimate_deviation(heights / radii[0] - height)
    low = float(np.mean(heights < _LOW_HEIGHT * radii[0]))
    reason = (
        f"what is inside its mask stands {height:.1f} radii before what is around it, as no rope does; "
        "is it the mask of this frame?"
    )
    resolution = max(scatter, find_depth_step(image) / float(radii[0]))
    pixels = float(radii[0]) * max(image.camera.focal) / image.distance
    sure = min(
        (_NO_RESOLUTION - resolution) / (_NO_RESOLUTION - _CLEAR_RESOLUTION),
        show_in_windows(pixels),
    )
    shows_background = scatter < _MAX_SCATTER and low > _MIN_SHARE_LOW and sure > 1.0
    return reason, min(max(sure, 0.0), 1.0), shows_background


def _measure_above_table(
    image: DepthImage, rows: _Indices, columns: _Indices, z: Array, radius: float
) -> Array:
    """(N,) Return the heights of pixels at depths z above the table, metres; none if there is no table."""
    table = find_table_beside_ropes(image, radius)
    if table is None:
        return np.empty(0)
    return table.measure_heights(image.lift(rows, columns, z))


def _measure_above_sides(
    image: DepthImage, bounds: Box | None, rows: _Indices, columns: _Indices, own: Array, reach: float
) -> Array:
    """(M,) Return how far pixels of ropes lie before the mean of both sides, where neither is rope; metres.

    The mean of both sides cancels the tilt of a table. The pixels' own depths are given, and how far to the
    side they are compared, metres.
    """
    height, width = image.depth.shape
    step = 1.0 + reach * max(image.camera.focal) / _core.find_median(own)
    aside = np.rint(step * np.array(_SIDES)).astype(np.intp)
    # both ways to each side: (2, S, N)
    ways = np.stack([-aside, aside])
    u, v = columns + ways[..., :1], rows + ways[..., 1:]
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    pixels = np.where(inside, v * width + u, 0)
    beside = image.depth.take(pixels)
    rope = image.mask.take(pixels)
    if bounds is not None:
        # what lies outside the range is no rope
        rope &= _show_points(image, bounds, v.ravel(), u.ravel(), beside.ravel()).reshape(rope.shape)
    seen = (inside & (beside > 0) & ~rope).all(axis=0)
    return np.asarray((0.5 * beside.sum(axis=0) - own)[seen])
