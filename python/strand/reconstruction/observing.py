"""Observe: crop the views, find the ropes among other things, fix the radius, drop outliers, check masks."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strand._core import NotEnoughDataError
from strand.config import Config
from strand.geometry.plane import Plane
from strand.reconstruction.evidence.prior import Prior
from strand.reconstruction.finding.ropes import FoundRopes, NoRopeError, segment_by_color, segment_in_all
from strand.reconstruction.finding.standing import holds_table
from strand.reconstruction.images.depth_scatter import SMALL_SCATTER, measure_depth_scatter
from strand.reconstruction.images.mask_radius import estimate_mask_radius
from strand.reconstruction.images.pixel_errors import CONFUSING_CORRELATION, correlate_neighbors
from strand.reconstruction.masks import (
    find_misplaced_masks,
    select_views,
    warn_of_surplus_labels,
)
from strand.reconstruction.outliers import drop_outliers
from strand.reconstruction.radius import Radii, find_thinnest, measure_radii
from strand.reconstruction.stages import Observed, Run
from strand.reconstruction.wide_surfaces import describe_surface
from strand.ropes.doubt import Doubt
from strand.ropes.model import Model
from strand.ropes.netlist import Netlist
from strand.support.checks import round_to_millimeters
from strand.views.box import Box
from strand.views.depth_image import DepthImage
from strand.views.extract import Extract
from strand.views.rope_images import make_rope_images
from strand.views.view import cropped

_ONLY_COLOR = 0.2  # doubt of ropes that colour alone shows
_LOW_STRIP = 2.0  # doubt of ropes beside a strip that may be a thinner one
_STRIP_SD = 0.1  # radii: standard deviation of a radius measured by the width of strips

_APPARENT_RADIUS = "radius: {}, so only the rope's apparent width gives it; give the radius if it is known"


@dataclass(frozen=True, eq=False)
class Hints:
    """The caller's knowledge of the ropes and choice of a method, checked.

    Attributes
    ----------
    radii : Radii or None
    bounds : Box or None
        The extraction range, metres.
    prior : Prior
    config : Config
    previous : Model or None
        An earlier model of the same ropes.
    branches : bool
        Whether ropes may branch.
    wire : float or None
        The radius of a wire, of which branching ropes are bundles, metres.
    net : Netlist or None
        The branching ropes as they should be.
    """

    radii: Radii | None
    bounds: Box | None
    prior: Prior
    config: Config
    previous: Model | None
    branches: bool = False
    wire: float | None = None
    net: Netlist | None = None


@dataclass(frozen=True, eq=False)
class Scene:
    """The ropes in the views.

    Attributes
    ----------
    extract : Extract
        All views, without other things on the table. Depth images in which strand found ropes have a mask of
        them.
    observed : Observed
        The views that a method uses.
    tables : tuple of (Plane or None)
        Each view's table, if strand found ropes on one.
    mask_doubts : list of Doubt
        Doubts of masks.
    """

    extract: Extract
    observed: Observed
    tables: tuple[Plane | None, ...]
    mask_doubts: list[Doubt]


def observe(extract: Extract, hints: Hints, run: Run) -> Scene:
    """Find the ropes in the views.

    Parameters
    ----------
    extract : Extract
        The caller's views.
    hints : Hints
    run : Run

    Raises
    ------
    strand.NotEnoughDataError
        If no view shows a rope.
    """
    published, radii = hints.config.method == "published", hints.radii
    found: FoundRopes | None = None
    pictures: dict[int, DepthImage] = {}
    if not published:
        found, pictures = _find_ropes_among_things(extract, radii, hints.previous, run)
    if found is not None:
        ropes = found.views if extract.bounds is None else cropped(found.views, extract.bounds)
        # the points of other things show free space; images show it outside their masks
        pairs = zip(extract.whole, found.views, strict=True)
        whole = tuple(view if view.image is None else masked for view, masked in pairs)
        extract = Extract(whole, extract.bounds, ropes)
        if extract.empty:
            raise NotEnoughDataError("views: no view has a point of a rope in the extraction range")
        if radii is None and found.radius is not None:
            radii = Radii(np.array([found.radius]), np.array([_STRIP_SD * found.radius]), free=True)
    if radii is None:
        radii = _estimate_radii(extract, run)
    with run.stage("filter"):
        thinnest = float(radii.values[0])
        filtered = drop_outliers(extract.inside, thinnest, hints.config.filter, published)
        numbers = select_views(extract, filtered, thinnest, run, found is not None)
        surplus = list(warn_of_surplus_labels(extract.whole, hints.prior.ropes))
        misplaced = find_misplaced_masks(extract.whole, numbers, extract.bounds, radii.values)
    if sum(mask.shows_background for mask in misplaced) == len(numbers):
        what = "masks" if found is None else "the pixels that strand found"
        raise NotEnoughDataError(
            f"views: {what} show the background alone (views {', '.join(map(str, numbers))}): nothing inside "
            "stands out from what is around it"
        )
    for mask in misplaced:
        run.warn("mask", mask.doubt.reason, amount=mask.doubt.amount, view=mask.view)
    run.warnings.extend(surplus)
    if radii.free and len(numbers) == 1:
        radii = replace(radii, free=False, held=True)
        run.warn("radius", _APPARENT_RADIUS.format("there is one view"))
    observed = Observed(
        [filtered[number] for number in numbers],
        [extract.whole[number] for number in numbers],
        numbers,
        extract.bounds,
        radii,
        hints.prior,
        pictures=pictures,
        masks_found=found is not None,
    )
    doubts = [mask.doubt for mask in misplaced]
    if found is not None and found.by_color:
        reason = "depth does not resolve their height, and colour alone shows them"
        doubts.append(Doubt("color", _ONLY_COLOR, "which pixels show ropes", reason))
        run.warn("color", reason, amount=_ONLY_COLOR)
    if found is not None and found.low_strips:
        reason = "a long strip on the table is too low for a rope of this radius: is it a thinner rope?"
        doubts.append(Doubt("left out", _LOW_STRIP, "what is there", reason, found.low_strips[0]))
        run.warn("left out", str(doubts[-1]), found.low_strips[0], _LOW_STRIP)
    return Scene(extract, observed, () if found is None else found.tables, doubts)


def _find_ropes_among_things(
    extract: Extract, radii: Radii | None, previous: Model | None, run: Run
) -> tuple[FoundRopes | None, dict[int, DepthImage]]:
    """Find ropes on a table, if the views have no masks and their extraction range holds a table.

    Also return images made of views of points, with a mask of the ropes, by the number of the view.
    """
    if any(view.mask is not None for view in extract.whole):
        return None, {}
    sizes = None if radii is None else radii.values
    earlier = () if previous is None else previous.chains
    if extract.bounds is not None and not _holds_clear_table(extract, find_thinnest(radii)):
        # colour may show ropes that are as low as the noise
        if not _has_colors(extract) or not holds_table(extract):
            return None, {}
        with run.stage("find"):
            return segment_by_color(extract, sizes, earlier), {}
    pictures: dict[int, DepthImage] = {}
    with run.stage("find"):
        try:
            found, pictures = segment_in_all(extract, sizes, earlier)
        except NoRopeError as error:
            # strands side by side look like one thing that is wide
            if radii is None or not error.low_things:
                raise
            if describe_surface(extract.inside, float(radii.values.max())) is not None:
                raise
            found = FoundRopes(extract.whole, None, (None,) * len(extract.whole), ())
    if found.other_objects:
        first = found.other_objects[0]
        message = (
            f"dropped {len(found.other_objects)} objects on the table that are no ropes, counted per view; "
            f"the first at {round_to_millimeters(first.place)}: {first.reason}"
        )
        run.warn("thing", message, first.place, view=first.view)
    return found, pictures


def _has_colors(extract: Extract) -> bool:
    return all(view.image is not None and view.image.colors is not None for view in extract.whole)


def _holds_clear_table(extract: Extract, radius: float) -> bool:
    """Tell whether bounds hold a table that ropes stand out of; noise as large as ropes hides them."""
    if not holds_table(extract):
        return False
    max_scatter = SMALL_SCATTER * radius
    if measure_depth_scatter(extract.whole, extract.inside, max_scatter) >= max_scatter:
        return False
    images = [image for image in extract.images if image is not None]
    return correlate_neighbors(images) < CONFUSING_CORRELATION


def _estimate_radii(extract: Extract, run: Run) -> Radii:
    """Estimate radii by the ropes' width: in the middle one of the masks, or in the points of all views."""
    with run.stage("radius"):
        pairs = zip(extract.inside, extract.whole, strict=True)
        masked = [(own, view) for own, view in pairs if view.mask is not None and len(own.points)]
        if not masked:
            return Radii(*measure_radii(extract.inside), free=True)
        own, view = masked[len(masked) // 2]
        (image,) = make_rope_images([own], [view], extract.bounds)
        radii = Radii(*estimate_mask_radius(image), free=False, held=True)
    run.warn("radius", _APPARENT_RADIUS.format("masks show the ropes"))
    return radii
