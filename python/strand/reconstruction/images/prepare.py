"""Depth images as the kernels read and fit them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from strand._core import RopeImages
from strand.geometry.plane import Plane
from strand.reconstruction.images.fat_masks import MAX_SHARE, MIN_WIDER, measure_excess, slim_fat_masks
from strand.reconstruction.images.finer_grid import magnify_thin_ropes
from strand.views.box import Box
from strand.views.depth_image import DepthImage

_CORRECTED = 0.5  # pixels: the kernels read masks that are wider than their radius by less


@dataclass(frozen=True, eq=False)
class PreparedViews:
    """Views as the kernels take them.

    Attributes
    ----------
    images : RopeImages
    taken : list of DepthImage
        The images that were prepared. Their pixels are those of readings.
    given : list of DepthImage
        The same in the pixels of the views.
    factor : int
        Pixels of the first along each side of a pixel of the others.
    wider : float
        Pixels of a view that its mask is wider on each side than the ropes' radius says.
    excess : float
        What is left of that after masks were slimmed.
    """

    images: RopeImages
    taken: list[DepthImage]
    given: list[DepthImage]
    factor: int
    wider: float
    excess: float


def prepare_images(
    images: Sequence[DepthImage], radius: float, mask_radii: Sequence[float | None] | None = None
) -> RopeImages:
    """Prepare images for readings and fits of ropes of one radius, metres.

    Masks that are wider than the ropes are read at radii of their own, pixels.

    Raises
    ------
    strand.NotEnoughDataError
        If a mask shows no rope with depth.
    """
    return RopeImages(
        [image.blocked_depth for image in images],
        [image.mask for image in images],
        [image.camera for image in images],
        [image.pose for image in images],
        radius,
        mask_radii,
    )


def prepare_views(
    given: list[DepthImage], masked: bool, table: Plane | None, bounds: Box | None, radius: float
) -> PreparedViews:
    """Prepare images on a grid that is fine enough for ropes of one radius, metres.

    Masks that a segmenter made, if they are wider than the ropes, are cut to what stands out of the table,
    or read at their own radius.

    Raises
    ------
    strand.NotEnoughDataError
        If a mask shows no rope with depth.
    """
    taken, factor = magnify_thin_ropes(given, radius)
    images = prepare_images(taken, radius)
    wider = measure_excess(taken, images.shown, radius) / factor
    if masked and (wider > MIN_WIDER or (images.shown > images.radii + _CORRECTED).any()):
        slimmed = slim_fat_masks(given, table, bounds, radius)
        if any(one is not image for one, image in zip(slimmed, given, strict=True)):
            given = slimmed
            taken, factor = magnify_thin_ropes(given, radius)
            images = prepare_images(taken, radius)
        own: list[float | None] = [
            float(shown) if read + _CORRECTED < shown < MAX_SHARE * read else None
            for shown, read in zip(images.shown, images.radii, strict=True)
        ]
        if any(own):
            images = prepare_images(taken, radius, own)
    excess = measure_excess(taken, images.radii, radius) / factor
    return PreparedViews(
        images, taken, given, factor, wider if wider > MIN_WIDER and masked else excess, excess
    )
