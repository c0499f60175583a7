"""What the default method warns of: data that contradict what was given, or leave something open."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from strand._core import TubeFit
from strand.config import Config, Linking, Poses
from strand.reconstruction.evidence.branches import branches
from strand.reconstruction.evidence.confidence import doubt_of_margin
from strand.reconstruction.evidence.visibility import Visibility
from strand.reconstruction.radius import Radii, fitted_deviation
from strand.reconstruction.tubes.noise import Noise
from strand.ropes.chain import Chain
from strand.ropes.doubt import Doubt
from strand.ropes.model import ModelWarning
from strand.support.checks import round_to_millimeters
from strand.views.box import Box

# a radius that was given is in doubt if the fit is so many standard deviations from it
_PULLED = 3.0
# residuals may scatter by so many times the noise that was given
_NOISE = 0.3, 2.0
# a direction of a pose is open if its standard deviation is at least this share of the reported pose's
_OPEN = 0.8


def about_fit(
    fit: TubeFit, measured: Noise, radii: Radii, numbers: Sequence[int], config: Config
) -> Iterator[ModelWarning]:
    """Noise and radii that the points contradict, and poses that they leave open."""
    noise = config.tubes.noise
    # a curve follows errors that neighbouring pixels share, and residuals hide them
    scatter = fit.sigma if measured.correlation == 0.0 else max(measured.sd, fit.sigma)
    if noise is not None and not _NOISE[0] < scatter / noise < _NOISE[1]:
        yield ModelWarning(
            "noise",
            f"noise: {noise * 1e3:.3g} mm was given, but residuals scatter by {scatter * 1e3:.3g} mm",
            amount=scatter / noise,
        )
    if not radii.free and not radii.held:
        yield from _pulled_radii(fit, radii)
    yield from _open_poses(fit, numbers, config.poses)


def about_answer(
    chains: Sequence[Chain],
    doubts: Sequence[Doubt],
    visibility: Visibility | None,
    bounds: Box | None,
    config: Linking,
) -> Iterator[ModelWarning]:
    """Places where ropes may run otherwise, branch, or leave the extraction range."""
    least = doubt_of_margin(config.margin)
    for doubt in doubts:
        if doubt.amount > least:
            yield ModelWarning(doubt.kind, str(doubt), doubt.place, doubt.amount)
    for number, trunk, place in branches(chains, visibility):
        message = (
            f"chain {number} ends on the side of chain {trunk} at {round_to_millimeters(place)}: a branch?"
        )
        reach = float(np.linalg.norm(chains[number].points[[0, -1]] - place, axis=1).min())
        yield ModelWarning("branch", message, place, reach, (number, trunk))
    if bounds is not None:
        yield from _cut_ends(chains, bounds)


def _pulled_radii(fit: TubeFit, radii: Radii) -> Iterator[ModelWarning]:
    """Name radii that were given and that the points pull away from farther than noise does."""
    pull = fit.radii - radii.values
    limit = _PULLED * np.hypot(radii.sd, fitted_deviation(fit.radii, fit.radii_sd, fit.sigma))
    for k in np.flatnonzero(np.abs(pull) > limit):
        yield ModelWarning(
            "radius",
            f"radius: {radii.values[k] * 1e3:.3g} mm was given, but the rope looks "
            f"{'thicker' if pull[k] > 0 else 'thinner'}",
            amount=float(pull[k]),
        )


def _cut_ends(chains: Sequence[Chain], bounds: Box) -> Iterator[ModelWarning]:
    """Name the ends that run out of the extraction range."""
    for number, chain in enumerate(chains):
        for node, outward in ((chain.points[0], -chain.tangents[0]), (chain.points[-1], chain.tangents[-1])):
            ahead = bounds.coordinates(node + 2.0 * chain.radius * outward)
            # a rope that lies along a face, such as near the table, does not run out there
            across = bounds.directions(outward)
            out = ((ahead < bounds.low) & (across < -0.5)) | ((ahead > bounds.high) & (across > 0.5))
            if not chain.closed and out.any():
                where = round_to_millimeters(node)
                message = f"chain {number} runs out of the extraction range at {where}: it may go on"
                yield ModelWarning("cut end", message, node, chains=(number,))


def _open_poses(fit: TubeFit, numbers: Sequence[int], poses: Poses) -> Iterator[ModelWarning]:
    """Name the views with a direction that the data hardly fix."""
    limits = np.repeat([poses.rotation_sd, poses.translation_sd], 3)
    for number, sd in zip(numbers, fit.pose_sd, strict=True):
        if (sd > _OPEN * limits).any():
            kinds = [
                ("rotation", (sd[:3] > _OPEN * limits[:3]).any()),
                ("translation", (sd[3:] > _OPEN * limits[3:]).any()),
            ]
            what = " and ".join(name for name, is_open in kinds if is_open)
            yield ModelWarning(
                "open pose",
                f"view {number}: the data leave a direction of its {what} open; it stays as reported there",
                amount=float((sd / limits).max()),
                view=number,
            )
