"""Depth images as the kernels read and fit them."""

from __future__ import annotations

from collections.abc import Sequence

from strand._core import RopeImages
from strand.views.depth_image import DepthImage


def prepare_images(images: Sequence[DepthImage], radius: float) -> RopeImages:
    """Prepare images for readings and fits of ropes of one radius, metres.

    Raises
    ------
    ValueError
        If a mask shows no rope with depth.
    """
    return RopeImages(
        [image.depth for image in images],
        [image.mask for image in images],
        [image.camera for image in images],
        [image.pose for image in images],
        radius,
    )
