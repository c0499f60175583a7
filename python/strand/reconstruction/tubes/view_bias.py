"""Doubt errors that all pixels of a view share: fitted tubes contradict what was given, or each other."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

import strand._core as _core
from strand._core import EndObservation, TubeFit
from strand.reconstruction.evidence.confidence import to_normal_deviate
from strand.reconstruction.radius import Radii, guess_radius
from strand.reconstruction.stages import Found, Observed
from strand.ropes.doubt import Doubt
from strand.views.pose import moved_by_each
from strand.views.view import View

# Amounts are doubts as in `Doubt.amount`.
_MAX_CORRELATION = 0.3  # pixels: errors that reach farther move fitted radii
_RADIUS = 20.0  # per share that a given radius is off
_MAX_RADIUS = 0.6  # for a radius that is off by less than `_FAR_SHARE`
_RADIUS_SHARE = 0.008  # share that a radius may be off
_RADIUS_SIGMAS = 2.0  # standard deviations of the fitted radius that it may be off
_PULL = 0.4  # squares of noise over radius: how far noise pulls a fitted radius
_PULL_SIGMAS = 0.1  # squares of noise over radius: how exactly that is known
_FAR_SHARE = 0.25  # a radius that is farther off is guessed by how wide the ropes look
_FAR_RADIUS = 3.0  # for a radius that is that far off by its looks too
_END = 0.4  # per normal deviate by which views disagree about an end, beyond chance
_END_DEVIATE = 1.65  # normal deviate that is chance
_END_SD = 0.1  # radii: deviation of an end's place, beside its own
_END_NOISE = 0.8  # residuals: deviation of an end's place, beside its own
_RESIDUALS = 10.0  # per radius that mean residuals of stretches scatter beyond what is usual
_USUAL_SCATTER = 0.04  # radii: scatter that is usual
_STRETCH = 1.0  # spans of a curve: length of the stretches
_MIN_POINTS = 20  # of a stretch


def find_bias_doubts(observed: Observed, found: Found) -> list[Doubt]:
    """Return doubts about an answer of tubes; there are none about other answers."""
    fit = found.stages.get("fit")
    if not isinstance(fit, TubeFit):
        return []
    doubts = [*_doubt_residuals(fit), *_doubt_ends(fit, found.ends)]
    if found.sensor is None or found.sensor.correlation <= _MAX_CORRELATION:
        doubts += _doubt_radii(fit, observed.radii, observed.views)
    return doubts


def _doubt_radii(fit: TubeFit, radii: Radii, views: Sequence[View]) -> Iterator[Doubt]:
    """Doubt given radii that the points contradict: depth scale or focal length may be wrong too."""
    if radii.free or radii.held or len(fit.radii) != len(radii.values):
        return
    for fitted, sd, given, given_sd in zip(fit.radii, fit.radii_sd, radii.values, radii.sd, strict=True):
        # the fit is a weighted mean of the given radius and of what the points alone show
        known = 1.0 - (min(sd, (1.0 - 1e-3) * given_sd) / given_sd) ** 2
        alone = (fitted - given) / known / given
        alone_sd = given_sd / given * math.sqrt((1.0 - known) / known)
        wide = (fit.sigma / given) ** 2
        off = alone - _PULL * wide
        limit = math.hypot(_RADIUS_SHARE, _RADIUS_SIGMAS * alone_sd) + _PULL_SIGMAS * wide
        amount = min(_RADIUS * max(abs(off) - limit, 0.0), _MAX_RADIUS)
        if abs(off) > _FAR_SHARE:
            looks = guess_radius(views)
            if looks is not None and abs(looks / given - 1.0) > _FAR_SHARE:
                off, amount = looks / given - 1.0, _FAR_RADIUS
        reason = (
            f"the ropes look {1e3 * max(given * (1.0 + off), 0.0):.2f} mm in radius, "
            f"{'thicker' if off > 0 else 'thinner'} than the given {1e3 * given:.2f} mm; the radius, the "
            "depth's scale or the focal length may be wrong"
        )
        yield Doubt("radius", amount, "where the ropes are", reason)


def _doubt_residuals(fit: TubeFit) -> Iterator[Doubt]:
    """Doubt fits whose residuals are correlated along stretches of rope: views disagree there."""
    count, mean, square = _core.average_residuals(fit, _STRETCH)
    enough = count >= _MIN_POINTS
    if not enough.any():
        return
    count, mean, square = count[enough], mean[enough], square[enough]
    # part of the squared mean that the points' own scatter makes
    chance = np.maximum(square - mean**2, 0.0) / count
    excess = float(np.average(mean**2 - chance, weights=count))
    uneven = math.sqrt(max(excess, 0.0)) / float(fit.radii.min())
    reason = f"mean residuals of views along the ropes scatter by {uneven:.2f} radii more than chance"
    yield Doubt("residuals", _RESIDUALS * max(uneven - _USUAL_SCATTER, 0.0), "where the ropes are", reason)


def _doubt_ends(fit: TubeFit, ends: Sequence[EndObservation]) -> Iterator[Doubt]:
    """Doubt ends that views see in different places: depth next to them may be of something else."""
    for end in sorted({one.end for one in ends}):
        own = [one for one in ends if one.end == end]
        radius = fit.radius(end // 2)
        found = np.array([[one.place] for one in own])
        places = moved_by_each(found, fit.motions[[one.view for one in own]])[:, 0]
        common = _END_SD**2 + (_END_NOISE * fit.sigma / radius) ** 2
        precision = np.array([1.0 / ((one.sd / radius) ** 2 + common) for one in own])
        middle = precision @ places / precision.sum()
        offset = (places - middle) @ own[0].outward / radius
        rare = to_normal_deviate(float(precision @ offset**2), len(own) - 1)
        reason = (
            f"views see it in places up to {np.ptp(offset):.1f} radii from each other; depth around it may "
            "not be the rope's"
        )
        yield Doubt("residuals", _END * max(rare - _END_DEVIATE, 0.0), "where the rope ends", reason, middle)
