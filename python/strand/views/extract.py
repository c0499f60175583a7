"""Views, whole and cropped to the extraction range."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from strand.support.lazy import lazy_property
from strand.views.box import Box
from strand.views.depth_image import DepthImage
from strand.views.rope_images import make_image, make_rope_images
from strand.views.view import View, check_views, cropped


@dataclass(frozen=True, eq=False)
class Extract:
    """Views, whole and cropped; each image is made once.

    Attributes
    ----------
    whole : tuple of View
    bounds : Box or None
        The extraction range, metres.
    ropes : tuple of View or None
        The same views in the extraction range with the points of ropes alone, if they are known.
    """

    whole: tuple[View, ...]
    bounds: Box | None
    ropes: tuple[View, ...] | None = None

    @lazy_property
    def inside(self) -> tuple[View, ...]:
        """The views, cropped, with the points of ropes alone if they are known."""
        if self.ropes is not None:
            return self.ropes
        return self.whole if self.bounds is None else cropped(self.whole, self.bounds)

    @property
    def empty(self) -> bool:
        """Whether no view has a point inside."""
        return not any(map(_has_points, self.inside))

    @lazy_property
    def images(self) -> list[DepthImage | None]:
        """Each view's image with its mask, or one of its points inside; None for a view without these."""
        return [
            make_rope_images([own], [view], None)[0] if len(own.points) else None
            for own, view in zip(self.inside, self.whole, strict=True)
        ]

    @lazy_property
    def whole_images(self) -> list[DepthImage | None]:
        """Each view's image without a mask; None for a view with a mask or without points."""
        return [make_image(view) if view.mask is None and _has_points(view) else None for view in self.whole]


def extract_views(views: Sequence[View], bounds: Box | None) -> Extract:
    """Check views, and return them with their extraction range."""
    return Extract(check_views(views), bounds)


def _has_points(view: View) -> bool:
    """Tell whether a view has points; those of an image without a mask need not be un-projected for that."""
    measured = view.measured
    if isinstance(measured, DepthImage) and measured.labels is None and measured.occluders is None:
        # row by row, as one of the first rows has depth
        return any((row > 0.0).any() for row in measured.depth)
    return len(view.points) > 0
