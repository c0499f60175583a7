"""Errors that all pixels of a view share: where fitted tubes contradict what was given, or each other."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from strand._core import EndObservation, TubeFit
from strand.reconstruction.radius import Radii, guess_radius
from strand.reconstruction.stages import Found, Observed
from strand.reconstruction.systematic import deviate
from strand.ropes.doubt import Doubt
from strand.views.pose import moved
from strand.views.view import View

# a radius that was given may be off by so much more than noise does to it, which pulls it by so many squares
# of the residuals over the radius, and is not known better than to so many of them; doubt for each share, and
# the most
_RADIUS_OFF, _RADIUS_SD, _PULL, _PULL_SD, _THICK, _THICKEST = 0.008, 2.0, 0.4, 0.1, 20.0, 0.6
# a radius that is farther off than this share is measured by how wide the ropes look; how much doubt that is
_FAR_OFF, _OTHER = 0.25, 3.0
# correlation of errors, pixels, that is as good as none
_ALIKE = 0.3
# ends that views see apart: what is not known of each beside its own deviation, radii, and of the residuals;
# the normal deviate that chance may have, and doubt for each more
_END_SD, _END_NOISE, _CHANCE, _APART = 0.1, 0.8, 1.65, 0.4
# stretches of this length, in spans of a curve, with so many points have mean residuals that scatter by so
# many radii where all is right; doubt for each radius more
_STRETCH, _POINTS, _UNEVEN, _RESIDUAL = 1.0, 20, 0.04, 10.0


def doubts(observed: Observed, found: Found) -> list[Doubt]:
    """Say where fitted tubes contradict what was given, or views each other.

    Parameters
    ----------
    observed : Observed
    found : Found
        An answer; one that was not fitted to points says nothing here.

    Returns
    -------
    list of Doubt
    """
    fit = found.stages.get("fit")
    if not isinstance(fit, TubeFit):
        return []
    said = [*_of_residuals(fit), *_of_ends(fit, found.ends)]
    # what points with correlated errors say of radii is less than how far these move
    if found.sensor is None or found.sensor.correlation <= _ALIKE:
        said += _of_radii(fit, observed.radii, observed.views)
    return said


def _of_radii(fit: TubeFit, radii: Radii, views: Sequence[View]) -> Iterator[Doubt]:
    """Doubt radii that were given and are not seen: the depth's scale or the focal length may be wrong."""
    if radii.free or radii.held or len(fit.radii) != len(radii.values):
        return
    for fitted, sd, given, given_sd in zip(fit.radii, fit.radii_sd, radii.values, radii.sd, strict=True):
        # what the points alone say, of which the fit is the mean with what was given
        known = 1.0 - (min(sd, (1.0 - 1e-3) * given_sd) / given_sd) ** 2
        alone = (fitted - given) / known / given
        alone_sd = given_sd / given * math.sqrt((1.0 - known) / known)
        wide = (fit.sigma / given) ** 2
        off = alone - _PULL * wide
        limit = math.hypot(_RADIUS_OFF, _RADIUS_SD * alone_sd) + _PULL_SD * wide
        amount = min(_THICK * max(abs(off) - limit, 0.0), _THICKEST)
        if abs(off) > _FAR_OFF:
            looks = guess_radius(views)
            if looks is not None and abs(looks / given - 1.0) > _FAR_OFF:
                off, amount = looks / given - 1.0, _OTHER
        reason = (
            f"the ropes look {1e3 * max(given * (1.0 + off), 0.0):.2f} mm in radius, "
            f"{'thicker' if off > 0 else 'thinner'} than the {1e3 * given:.2f} mm that were given; that, the "
            "depth's scale or the focal length may be wrong"
        )
        yield Doubt("radius", amount, "where the ropes are", reason)


def _of_residuals(fit: TubeFit) -> Iterator[Doubt]:
    """Doubt fits whose residuals are alike along stretches of rope: views disagree there."""
    number = np.flatnonzero(fit.inlier)
    stretch = np.floor(fit.parameter[number] / _STRETCH).astype(np.int64)
    curves = fit.view[number] * len(fit.curves) + fit.curve[number]
    each = curves * (int(stretch.max(initial=0)) + 1) + stretch
    residual = fit.residual[number]
    count = np.bincount(each)
    mean, square = (np.bincount(each, of) / np.maximum(count, 1) for of in (residual, residual**2))
    # what is left of the points' own scatter
    chance = np.maximum(square - mean**2, 0.0) / np.maximum(count, 1)
    some = count >= _POINTS
    if not some.any():
        return
    excess = float(np.average((mean**2 - chance)[some], weights=count[some]))
    uneven = math.sqrt(max(excess, 0.0)) / float(fit.radii.min())
    reason = f"mean residuals of views along the ropes scatter by {uneven:.2f} radii more than chance"
    yield Doubt("residuals", _RESIDUAL * max(uneven - _UNEVEN, 0.0), "where the ropes are", reason)


def _of_ends(fit: TubeFit, ends: Sequence[EndObservation]) -> Iterator[Doubt]:
    """Doubt ends that views see in different places: what is next to them may have been taken for them."""
    for end in sorted({one.end for one in ends}):
        own = [one for one in ends if one.end == end]
        radius = fit.radius(end // 2)
        places = np.array([moved(one.place, fit.motions[one.view]) for one in own])
        common = _END_SD**2 + (_END_NOISE * fit.sigma / radius) ** 2
        precision = np.array([1.0 / ((one.sd / radius) ** 2 + common) for one in own])
        middle = precision @ places / precision.sum()
        apart = (places - middle) @ own[0].outward / radius
        rare = deviate(float(precision @ apart**2), len(own) - 1)
        reason = f"views see it up to {np.ptp(apart):.1f} radii apart; depth around it may not be the rope's"
        yield Doubt("end", _APART * max(rare - _CHANCE, 0.0), "where the rope ends", reason, middle)
