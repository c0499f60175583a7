"""find_ropes(): views of a table with ropes and other things in, views of the ropes alone out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

import strand._core as _core
from strand._core import NotEnoughDataError
from strand.geometry.plane import Plane
from strand.reconstruction.finding.in_color import RESOLVED, ShownInColor, find_in_color, match_labels
from strand.reconstruction.finding.low_strips import find_low_strips
from strand.reconstruction.finding.standing import find_tabletop
from strand.reconstruction.finding.strips import OtherObject, segment_ropes
from strand.reconstruction.finding.widths import estimate_strip_radius, measure_strip_lengths
from strand.reconstruction.images.above_table import segment_above_table
from strand.reconstruction.images.mask_radius import estimate_mask_radius, estimate_radius_by_area
from strand.reconstruction.radius import Radii
from strand.ropes.chain import Chain
from strand.support.checks import Array
from strand.views.box import Bounds, Box, make_box
from strand.views.cloud_images import fill_thinned
from strand.views.depth_image import DepthImage
from strand.views.extract import Extract, extract_views
from strand.views.view import View, masked

_BESIDE = 4  # pixels around a mask of colour: heights are blurred that far
_MAX_SPECKS = 10  # pieces; with more, and without a long one, depth shows specks rather than ropes
_MAX_SHORT_SPECKS = 4  # the same, if none is a clear strip
_SHORT = 25.0  # radii: length of a clear strip
_MIN_SHARE = 0.3  # of the length of all pieces: a long one has more
_SPECKS = "depth shows many short pieces on the table and no long one, as noise and patterns do"
_MIN_MISSED = 20.0  # radii: colour misses a rope if a longer strip stands on the table without it
_SAME_RADIUS = 0.1  # logarithm of radii: two measures of one radius differ by less
_MIN_LENGTH = 14.0  # radii: some view shows a strip of a rope that is longer


class NoRopeError(NotEnoughDataError):
    """No rope stands on the table.

    Attributes
    ----------
    low_things : bool
        Whether things as large as a rope and no higher stand on the table. Strands side by side look like one
        wide thing.
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
        The views with the ropes alone: depth images have a mask, and points of other things are dropped.
        Views with a mask and views that show no table stay as they are.
    radius : float or None
        The ropes' radius, metres, by the strips' width, area and height; None if there is no table. With a
        given radius, the half width of most strips.
    tables : tuple of ((3,) ndarray, float) or None
        Each view's table: its unit normal n towards the camera, world frame, and n.x, metres. None where a
        view shows no table.
    other_objects : tuple of OtherObject
        The things on the table that are no rope, once for each view that shows them.
    by_color : bool
        Whether colour alone shows the ropes, because depth does not resolve their height.
    low_strips : tuple of (3,) ndarray
        The middles of long strips on the table that are too low for the radius, world frame, metres: they
        may be thinner ropes. Once for each view that shows them.
    """

    views: tuple[View, ...]
    radius: float | None
    tables: tuple[Plane | None, ...]
    other_objects: tuple[OtherObject, ...]
    by_color: bool = False
    low_strips: tuple[Array, ...] = ()


def find_ropes(
    views: Sequence[View],
    radius: float | Sequence[float] | None = None,
    bounds: Bounds | None = None,
) -> FoundRopes:
    """Segment ropes on a table from the table and from other things on it.

    The table is the plane that most points of a view lie on. It may be tilted. A thing on it is a rope where
    it is a strip of one width, and thin or low. Ropes have the width that the longest strips have, relative
    to their width.

    Where all views have colours, these show the ropes too (see `strand.rope_mask`). Colour gives the mask if
    the table's depths scatter by more than half a rope's radius, or if no other long strip stands on it.

    Parameters
    ----------
    views : sequence of View
    radius : float or sequence of float, optional
        The ropes' radius, or the radii of ropes that differ, metres. Without it, the strips' widths give it.
    bounds : pair of (3,) array_like, or Box, optional
        The extraction range as for `strand.reconstruct`, metres. Ropes are sought inside it, the table in the
        whole view. Without bounds, ropes are sought on all of the table.

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
        If there is a table without a rope on it.

    Examples
    --------
    >>> import strand
    >>> scene = strand.synthetic.cluttered_scene(4)
    >>> found = strand.find_ropes(scene.views)
    >>> model = strand.reconstruct(found.views, found.radius)
    """
    extract = extract_views(views, None if bounds is None else make_box(bounds))
    found, _ = segment_in_all(extract, None if radius is None else Radii.from_caller(radius).values)
    return found


def segment_in_all(
    extract: Extract, radii: Array | None, earlier: Sequence[Chain] = ()
) -> tuple[FoundRopes, dict[int, DepthImage]]:
    """Segment ropes of (K,) radii, metres, by colour where it shows them, else by height.

    With chains of an earlier frame, colour is sought near them first. Also return images made of views of
    points, as `segment_views` does.
    """
    shown = _find_in_colors(extract, earlier)
    if shown is None:
        by_height, pictures, width = segment_views(extract, radii)
        if _shows_specks(by_height, width):
            raise NoRopeError(f"views: {_SPECKS}; give colours, or masks")
        return by_height, pictures
    scatter = max(one.scatter for one in shown)
    if not any(one.mask.any() for one in shown):
        reasons = "; ".join(dict.fromkeys(one.why for one in shown))
        try:
            by_height, pictures, width = segment_views(extract, radii)
        except NoRopeError as error:
            raise NoRopeError(f"{error}; colours show none either: {reasons}", error.low_things) from None
        unclear = by_height.radius is not None and (
            not _is_resolved(scatter, width, radii) or _shows_specks(by_height, width)
        )
        if unclear:
            raise NoRopeError(f"views: depth resolves no rope on the table, and colours show none: {reasons}")
        return by_height, pictures
    by_color = _take_colors(extract, shown, radii)
    shaded = any(one.shaded for one in shown)
    if not shaded and (by_color.by_color or not any(one.missed for one in shown)):
        return by_color, {}
    try:
        by_height, pictures, width = segment_views(extract, radii)
    except NoRopeError:
        return replace(by_color, by_color=True), {}
    if by_height.radius is None:
        return by_color, {}
    if shaded:
        # shadows beside ropes are as thin as these; a rope's height tells them apart
        resolved = _is_resolved(scatter, width, radii) and not _shows_specks(by_height, width)
        return (by_height, pictures) if resolved else (replace(by_color, by_color=True), {})
    if _shows_specks(by_height, width):
        return by_color, {}
    radius = _find_strip_radius(shown)
    for high, colored in zip(by_height.views, by_color.views, strict=True):
        if high.image is not None and high.mask is not None and colored.mask is not None:
            near = _core.measure_edge_distances(np.asarray(~colored.mask), _BESIDE + 1) <= _BESIDE
            missed = replace(high.image, labels=high.mask & ~near)
            if measure_strip_lengths(missed, radius).max(initial=0.0) > _MIN_MISSED * radius:
                return by_height, pictures
    return by_color, {}


def segment_by_color(
    extract: Extract, radii: Array | None, earlier: Sequence[Chain] = ()
) -> FoundRopes | None:
    """Segment ropes by colour, if all views have colours and some of these show ropes."""
    shown = _find_in_colors(extract, earlier)
    if shown is None or not any(one.mask.any() for one in shown):
        return None
    return _take_colors(extract, shown, radii)


def _shows_specks(found: FoundRopes, width: float) -> bool:
    """Tell whether what stands on the table is many pieces, the longest of which is a small share of all.

    `width` is the strips' half width, metres.
    """
    for view in found.views:
        if view.image is not None and view.mask is not None and found.radius is not None:
            lengths = measure_strip_lengths(view.image)
            specks = lengths[1:][lengths[1:] > 0.0]
            longest = float(specks.max(initial=0.0))
            most = _MAX_SPECKS if longest > _SHORT * width else _MAX_SHORT_SPECKS
            if len(specks) > most and longest < _MIN_SHARE * specks.sum():
                return True
    return False


def _is_resolved(scatter: float, radius: float, radii: Array | None) -> bool:
    """Tell whether depths scatter so little that heights show ropes of known radii, or of a radius."""
    return scatter <= RESOLVED * (radius if radii is None else float(radii.min()))


def _find_in_colors(extract: Extract, earlier: Sequence[Chain]) -> list[ShownInColor] | None:
    """Find ropes in the views' colours; None if a view has no colours or shows no table."""
    found = []
    for view in extract.whole:
        one = find_in_color(view.image, earlier)
        if one is None:
            return None
        found.append(one)
    return found


def _take_colors(extract: Extract, shown: Sequence[ShownInColor], radii: Array | None) -> FoundRopes:
    """Return the views with the masks that their colours show."""
    images = [view.image for view in extract.whole if view.image is not None]
    views = tuple(
        masked(view, replace(image, labels=labels))
        for view, image, labels in zip(extract.whole, images, match_labels(shown, images), strict=True)
    )
    radius = _find_strip_radius(shown)
    resolved = any(_is_resolved(one.scatter, radius, radii) for one in shown if one.mask.any())
    if radii is None:
        radius = _measure_by_color(views, radius)
    return FoundRopes(views, radius, tuple(one.plane for one in shown), (), by_color=not resolved)


def _find_strip_radius(shown: Sequence[ShownInColor]) -> float:
    """Return the radius, metres, by the half width of the strips in the views' colours."""
    return _core.find_median([one.radius for one in shown if one.mask.any()])


def _measure_by_color(views: Sequence[View], width: float) -> float:
    """Return the ropes' radius, metres, by the area of single strands in masks of colour.

    The strips' half width is too small: edges are ragged, and the middle may lie between pixels.
    """
    found = list(_measure_masks(views, lambda image: estimate_radius_by_area(image)[0]))
    return _core.find_median(found) if found else width


def _measure_by_height(views: Sequence[View], width: float) -> float:
    """Return the ropes' radius, metres, given the half width of strips that stand on the table.

    Noise makes these strips wider or narrower. Where area and height of the ropes contradict the half width,
    they give the radius.
    """
    found = list(_measure_masks(views, lambda image: float(estimate_mask_radius(image)[0][0])))
    if not found or abs(np.log(np.median(found) / width)) < _SAME_RADIUS:
        return width
    return _core.find_median(found)


def _measure_masks(views: Sequence[View], measure: Callable[[DepthImage], float]) -> Iterator[float]:
    for view in views:
        if view.image is not None and view.mask is not None:
            with suppress(NotEnoughDataError):
                yield measure(view.image)


def segment_views(extract: Extract, radii: Array | None) -> tuple[FoundRopes, dict[int, DepthImage], float]:
    """Segment ropes of (K,) radii, metres, as `find_ropes` does.

    Also return images made of views without one, with a mask of the ropes, by the number of the view, and the
    half width of most strips, metres.
    """
    tops = {
        k: top
        for k, image in enumerate(extract.whole_images)
        if image is not None and (top := find_tabletop(_fill(extract, k, image), extract.bounds)) is not None
    }
    found = list(extract.whole)
    tables: list[Plane | None] = [None] * len(found)
    if not tops:
        return FoundRopes(extract.whole, None, tuple(tables), ()), {}, float("nan")
    width = estimate_strip_radius(
        [replace(top.image, labels=top.image.mask & top.inside) for top in tops.values()]
    )
    thin, thick = (width, width) if radii is None else (float(radii.min()), float(radii.max()))
    others: list[OtherObject] = []
    low_strips: list[Array] = []
    shown = []
    for k, top in tops.items():
        standing = segment_above_table(top.image, top.plane, None, thin)
        low_strips += find_low_strips(top, standing, thin)
        mask, things = segment_ropes(top, replace(top.image, labels=standing), thick, k)
        others += [thing for thing in things if extract.bounds is None or extract.bounds.holds(thing.place)]
        given = extract.whole_images[k] or top.image
        shown.append(replace(given, labels=mask & top.inside))
        tables[k] = top.plane
        found[k] = masked(found[k], shown[-1])
    own = estimate_strip_radius(shown)
    longest = max(float(measure_strip_lengths(image, own).max(initial=0.0)) for image in shown)
    if longest < _MIN_LENGTH * own or not any(len(found[k].points) for k in tops):
        low_things = any(_measure_area(image) > 2.0 * _MIN_LENGTH * thin * thin for image in shown)
        raise NoRopeError(f"views: {_explain_none(others, longest, own, extract.bounds)}", low_things)
    pictures = {k: image for k, image in zip(tops, shown, strict=True) if extract.whole[k].image is None}
    radius = _measure_by_height(found, width) if radii is None else width
    ropes = FoundRopes(tuple(found), radius, tuple(tables), tuple(others), low_strips=tuple(low_strips))
    return ropes, pictures, width


def _fill(extract: Extract, number: int, image: DepthImage) -> DepthImage:
    """Return a view's image; an image made of points is filled where these were thinned."""
    return fill_thinned(image) if extract.whole[number].image is None else image


def _measure_area(image: DepthImage) -> float:
    """Return the area that a mask shows, across the rays, square metres."""
    return float(np.sum(image.depth[image.mask] ** 2) / (image.camera.focal[0] * image.camera.focal[1]))


def _explain_none(others: list[OtherObject], longest: float, radius: float, box: Box | None) -> str:
    """Say what stands on a table instead of a rope."""
    strips = (
        f"the longest strip of one width is {1e3 * longest:.0f} mm long and {2e3 * radius:.0f} mm wide"
        if longest > 0.0
        else "nothing that stands on it is a strip of one width"
    )
    count = len(others)
    things = f", and {count} thing{'s were' if count > 1 else ' was'} dropped" if count else ""
    bounds = "bounds around it" if box is None else "bounds that exclude the table"
    return f"no rope on the table: {strips}{things}; if there is one, give {bounds}, or masks"
