"""Warnings about a fit of tubes: given numbers that the points contradict, and poses that they leave open."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from strand._core import TubeFit
from strand.config import Config, Poses
from strand.reconstruction.radius import Radii, add_noise_deviation
from strand.reconstruction.tubes.noise import Noise
from strand.ropes.doubt import ModelWarning

_MAX_PULL = 3.0  # standard deviations: farther from the given radius, the fitted one contradicts it
_NOISE_RANGE = (0.3, 2.0)  # times the given noise: how widely residuals may scatter
_OPEN_SHARE = 0.8  # of the reported pose's standard deviation: directions with as much left are open


def warn_about_fit(
    fit: TubeFit, measured: Noise, radii: Radii, numbers: Sequence[int], config: Config
) -> Iterator[ModelWarning]:
    """Yield warnings about given noise and radii that the points contradict, and about open poses."""
    given = config.tubes.noise
    # a curve follows errors that neighboring pixels share, so that residuals do not show them
    scatter = fit.sigma if measured.correlation == 0.0 else max(measured.sd, fit.sigma)
    if given is not None and not _NOISE_RANGE[0] < scatter / given < _NOISE_RANGE[1]:
        yield ModelWarning(
            "noise",
            f"noise: {given * 1e3:.3g} mm was given, but residuals scatter by {scatter * 1e3:.3g} mm",
            amount=scatter / given,
        )
    if not radii.free and not radii.held:
        yield from _warn_about_radii(fit, radii)
    yield from _warn_about_poses(fit, numbers, config.poses)


def _warn_about_radii(fit: TubeFit, radii: Radii) -> Iterator[ModelWarning]:
    """Yield warnings about given radii that the fitted ones miss by more than noise explains."""
    pull = fit.radii - radii.values
    limit = _MAX_PULL * np.hypot(radii.sd, add_noise_deviation(fit.radii, fit.radii_sd, fit.sigma))
    for k in np.flatnonzero(np.abs(pull) > limit):
        yield ModelWarning(
            "radius",
            f"radius: {radii.values[k] * 1e3:.3g} mm was given, but the rope looks "
            f"{'thicker' if pull[k] > 0 else 'thinner'}",
            amount=float(pull[k]),
        )


def _warn_about_poses(fit: TubeFit, numbers: Sequence[int], poses: Poses) -> Iterator[ModelWarning]:
    """Yield warnings about views with a direction that the points hardly fix."""
    limits = np.repeat([poses.rotation_sd, poses.translation_sd], 3)
    for number, sd in zip(numbers, fit.pose_sd, strict=True):
        is_open = sd > _OPEN_SHARE * limits
        if is_open.any():
            parts = [("rotation", is_open[:3].any()), ("translation", is_open[3:].any())]
            names = " and ".join(name for name, open_part in parts if open_part)
            yield ModelWarning(
                "open pose",
                f"view {number}: the points leave a direction of its {names} open; "
                "its pose stays as reported in that direction",
                amount=float((sd / limits).max()),
                view=number,
            )
