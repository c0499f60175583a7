"""The joint fit of a harness: all strands and poses to all points; strands share the point at a junction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand._core import NotEnoughDataError, TubeFit
from strand.config import Config
from strand.geometry.curve import Curve
from strand.geometry.polyline import path_length
from strand.reconstruction.harness.flat_bundles import FlatBundles
from strand.reconstruction.harness.strands import Strand, list_pairs
from strand.reconstruction.harness.wires import Possible, choose_radii
from strand.reconstruction.tubes.clouds import Clouds
from strand.reconstruction.tubes.fitting import ROPE_MARGIN, ROUGH_TOLERANCE, fit_curves
from strand.reconstruction.tubes.tube_ends import find_extents
from strand.reconstruction.tubes.tube_nodes import make_chains
from strand.reconstruction.tubes.whole_ropes import cut_to_one_turn
from strand.ropes.chain import Chain
from strand.support.checks import Array

_RADIUS_SD = 0.2  # radii: deviation of half widths of the mask from radii
_SAME_SD = 0.003  # radii: deviation of radii that were chosen
_TUBE_SD = 0.05  # radii: deviation of radii of tubes fitted to points without noise
_NOISY = 0.1  # noise that doubles it, radii
_MASK_SD = 0.12  # radii: deviation of half widths of a strand's mask
_BY_HEIGHT = 0.75  # weight of the height of a strand that lies on the table, against that of its tube
_LYING_SD = 0.015  # radii: deviation of radii by height and tube where both agree
_DIFFER_SD = 0.25  # the same for each radius by which they differ
_BUNDLE_SD = 0.02  # radii: deviation of round bundles from those of wires packed well at least
_FAR = 2.0  # ratio of a radius and the half width of a mask that is no rope of it
_AGREE = 0.06  # radii: difference of both at most, unless correlated errors make tubes too thick
_ALONG = 0.025  # weight of a junction's place in the plan over that of strands
_HELD = 10.0  # the same of a junction whose place a tie tells
_APART = 0.9  # distance of strands that are apart, sums of their radii
_FARTHEST = 10.0  # distance from a junction at which strands tell where they meet at most, radii
_TELLING = 5.0  # length of the stretch that tells, radii
_FEWEST = 4  # nodes of a stretch that tells a bend at least
_BEYOND = 4.0  # stretch beyond a junction's first place, radii
_MAX_TIP = 6.0  # distance of a traced end from that of its curve at most, radii
_MAX_MOVE = 15.0  # distance of a junction from the end of a curve that leads to it at most, radii
_MAX_SHARE = 0.4  # of a curve's length that lies beyond a junction at most
_SAMPLES = 100  # of a curve
_SHIFTED = 4.0  # stretch at a junction that bends to the shared point, radii
_LOST = 2.5  # length that a curve may lose between junctions, radii; at a free end its margin, too
_LOST_OF_RING = 0.5  # share of its length that a ring may lose
_STILL = 1e-5  # metres: way of a junction's place in a round that ends the search
_ROUNDS = 6  # of finding a junction's place
_SAME_END = 1.0  # distance of the end of points from that of the mask where the points count, radii


@dataclass(frozen=True, eq=False)
class Fitted:
    """Strands after the joint fit.

    Attributes
    ----------
    fit : TubeFit
    sizes : list of int
        How many of the fit's points each view has.
    chains : list of Chain
        One for each strand, from its first node to its last.
    places : (J, 3) ndarray
        The junctions, metres.
    covariances : (J, 3, 3) ndarray
        Of these, m^2.
    widths : (K,) ndarray
        The radius of each strand, metres: a given one, or by its own points and mask.
    deviations : (K,) ndarray
        Of radii by points and mask, relative to them.
    """

    fit: TubeFit
    sizes: list[int]
    chains: list[Chain]
    places: Array
    covariances: Array
    widths: Array
    deviations: Array


def fit_harness(
    clouds: Clouds,
    strands: Sequence[Strand],
    beside: FlatBundles,
    places: Array,
    held: Sequence[bool],
    motions: Array,
    possible: Possible,
    config: Config,
    correlated: bool,
) -> Fitted:
    """Fit strands and poses to the points of all views.

    Wires that lie side by side are tubes of their own. Other strands need not have a given radius.

    Parameters
    ----------
    clouds : Clouds
    strands : sequence of Strand
    beside : FlatBundles
        Which strands are wires side by side.
    places : (J, 3) ndarray
        The junctions, metres.
    held : sequence of bool
        Which junctions have their places along the strands.
    motions : (V, 4, 4) ndarray
        Corrections of the poses to start from.
    possible : Possible
        The radii that strands may have.
    config : Config
    correlated : bool
        Whether errors of neighbouring pixels are alike.
    """
    try:
        return _fit(clouds, strands, beside, places, held, motions, possible, config, correlated)
    except NotEnoughDataError:
        if possible.radii is None:
            raise
        return _fit(clouds, strands, beside, places, held, motions, Possible(None, None), config, correlated)


def _fit(
    clouds: Clouds,
    strands: Sequence[Strand],
    beside: FlatBundles,
    places: Array,
    held: Sequence[bool],
    motions: Array,
    possible: Possible,
    config: Config,
    correlated: bool,
) -> Fitted:
    """Fit roughly, then each strand's radius, then all with the radii that were chosen."""
    halves = np.array([strand.half_width for strand in strands])
    # errors of near pixels are alike, so that more points say no more
    clouds = clouds.thin(clouds.find_fit_step(float(halves.min())))
    chosen = halves if possible.radii is None else _choose(possible.radii, halves)
    spans = np.where(beside.flat, beside.radius * np.sqrt(beside.wires), chosen)
    curves = [_make_spline(strand, span, config) for strand, span in zip(strands, spans, strict=True)]
    start = beside.list_radii(np.where(beside.flat, beside.radius * np.sqrt(beside.wires), chosen))
    classes = beside.classes[beside.owners].tolist()
    rough = fit_curves(
        clouds,
        beside.lay(curves),
        classes,
        motions,
        start,
        config,
        tolerance=ROUGH_TOLERANCE,
        uncertainty=False,
    )
    # the upper surface of wires side by side hardly tells their radius, but their height does
    spread = beside.list_spreads(_RADIUS_SD, _SAME_SD)
    prior = np.column_stack([start, spread * start])
    along_ray: dict[str, Any] = {"along_ray": True, "band": (0.5, 0.5), "iterations": 30}
    alone = fit_curves(
        clouds,
        rough.curves,
        classes,
        rough.motions,
        start,
        config,
        radius_prior=prior,
        uncertainty=False,
        tolerance=ROUGH_TOLERANCE,
        **along_ray,
    )
    masks = beside.list_radii(halves / np.sqrt(beside.wires))
    lying = beside.list_radii(np.where(beside.flat, np.inf, beside.lying))
    measured, relative_sd, told = _weigh_radii(masks, lying, alone, start, correlated)
    widths, deviations = beside.list_widths(measured), relative_sd[beside.classes]
    final, is_chosen, is_held = _choose_final(widths, deviations, list_pairs(strands, len(places)), possible)
    radii = beside.list_radii(final)
    # points with correlated errors would pull radii back to those of tubes
    if not (is_held or (correlated and is_chosen) or (not is_chosen and told.all())):
        deviation = _SAME_SD if is_chosen else _RADIUS_SD
        along_ray["radius_prior"] = np.column_stack([radii, deviation * radii])
    try:
        fit = fit_curves(
            clouds, alone.curves, classes, alone.motions, radii, config, uncertainty=True, **along_ray
        )
    except NotEnoughDataError:
        # radii that the points do not support leave none on a tube
        fit = fit_curves(clouds, rough.curves, classes, rough.motions, start, config, uncertainty=True)
    final = beside.list_widths(fit.radii)
    fit = _restore_lost(beside.merge(fit, np.where(beside.flat, halves, final)), curves, strands)
    parts = _cut(fit, strands)
    places, covariances, parts = _share_points(fit, parts, strands, places, held)
    closed = [strand.closed for strand in strands]
    own_sd = np.minimum(deviations, _BUNDLE_SD) if is_chosen else deviations
    radii_sd = fit.radii_sd if is_held else np.maximum(fit.radii_sd, own_sd * fit.radii)
    chains = make_chains(fit, parts, closed, radii_sd[fit.radius_classes], config)
    chains = [
        replace(_bend_to(chain, strand, places), radius=width)
        for chain, strand, width in zip(chains, strands, final.tolist(), strict=True)
    ]
    sizes = [len(points) for points in clouds.points]
    return Fitted(
        fit, sizes, chains, places, covariances, final if is_held else widths, relative_sd[beside.classes]
    )


def _choose_final(
    widths: Array, deviations: Array, pairs: Sequence[tuple[int, int]], possible: Possible
) -> tuple[Array, bool, bool]:
    """Return the radius of each strand, whether it is one of the possible ones, and whether it is given."""
    refused = None
    for some, is_given in ((possible.given, True), (possible.bundles, False)):
        if some is None:
            continue
        choice = choose_radii(widths, pairs, some, deviations)
        if not choice.refused:
            return some[choice.numbers], True, is_given
        if is_given:
            refused = some[choice.numbers]
    return (widths, False, False) if refused is None else (refused, True, False)


def _weigh_radii(
    masks: Array, lying: Array, fit: TubeFit, radii: Array, correlated: bool
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return radii of classes, metres, their relative deviations, and whether heights tell them.

    Points with much noise make tubes too thick, as do masks that are too wide. Both leave the height of a
    strand that lies on the table as it is; one that lies on others is higher. A lower one, with errors that
    are not correlated, lies in a groove, or the table is not where it seems.
    """
    tube_sd = _TUBE_SD * (1.0 + (fit.sigma / (_NOISY * radii)) ** 2)
    share = tube_sd**-2.0 / (tube_sd**-2.0 + _MASK_SD**-2.0)
    by_mask = np.exp(share * np.log(fit.radii) + (1.0 - share) * np.log(masks))
    mask_sd = np.sqrt(1.0 / (tube_sd**-2.0 + _MASK_SD**-2.0))
    is_known = np.isfinite(lying)
    thicker = np.log(fit.radii / np.where(is_known, lying, fit.radii))
    told = is_known & (thicker > -_AGREE) & (correlated | (thicker < _AGREE))
    by_height = fit.radii * np.exp(-_BY_HEIGHT * np.maximum(thicker, 0.0))
    height_sd = _LYING_SD + _DIFFER_SD * np.abs(thicker)
    return np.where(told, by_height, by_mask), np.where(told, height_sd, mask_sd), told


def _choose(radii: Array, halves: Array) -> Array:
    """Return the radius nearest to each half width (K,), by ratio; the half width if none is near."""
    ratios = np.abs(np.log(halves[:, None] / radii[None]))
    return np.where(ratios.min(axis=1) < np.log(_FAR), radii[ratios.argmin(axis=1)], halves)


def _make_spline(strand: Strand, radius: float, config: Config) -> Array:
    """Return control points of a spline through a strand, which goes on beyond free ends."""
    nodes = strand.nodes
    for late in (False, True):
        if strand.ends[late] is None and not strand.closed:
            tip, inner = (nodes[-1], nodes[-4]) if late else (nodes[0], nodes[3])
            outward = (tip - inner) / max(float(np.linalg.norm(tip - inner)), 1e-12)
            beyond = (tip + ROPE_MARGIN * radius * outward)[None]
            nodes = np.concatenate([nodes, beyond] if late else [beyond, nodes])
    return _core.fit_spline(
        nodes, config.tubes.spacing * radius, ROPE_MARGIN * radius if strand.closed else 0.0
    )


def _restore_lost(fit: TubeFit, curves: Sequence[Array], strands: Sequence[Strand]) -> TubeFit:
    """Return a fit in which curves that lost much of their length are as they were before it.

    Where a strand bends sharply between junctions, its curve may slide out of the bends.
    """
    kept = []
    for number, (before, after, strand) in enumerate(zip(curves, fit.curves, strands, strict=True)):
        length = float(Curve.whole(before).length)
        most = (_LOST + ROPE_MARGIN * strand.ends.count(None)) * fit.radius(number)
        most = _LOST_OF_RING * length if strand.closed else most
        kept.append(before if length - float(Curve.whole(after).length) > most else after)
    return fit.replace(curves=kept)


def _cut(fit: TubeFit, strands: Sequence[Strand]) -> list[Curve]:
    """Cut rings to one turn, and free ends to where points end, or the mask does if both are far apart."""
    parts = []
    for number, (part, strand) in enumerate(zip(find_extents(fit, exclusive=True), strands, strict=True)):
        whole = Curve.whole(fit.curves[number])
        if strand.closed:
            parts.append(cut_to_one_turn(whole, ROPE_MARGIN * fit.radius(number)))
            continue
        ends = [whole.start, whole.stop]
        for late in (0, 1):
            if strand.ends[late] is not None:
                continue
            tip = _find_passing(whole, strand.nodes[-late], late, _MAX_TIP * fit.radius(number))
            ends[late] = float(whole.parameter_at(tip))
            if part is None:
                continue
            end = (part.start, part.stop)[late]
            if abs(float(whole.arc_length_at(end)) - tip) < _SAME_END * fit.radius(number):
                ends[late] = end
        parts.append(replace(whole, start=ends[0], stop=ends[1]) if ends[0] < ends[1] else whole)
    return parts


def _share_points(
    fit: TubeFit, parts: list[Curve], strands: Sequence[Strand], places: Array, held: Sequence[bool]
) -> tuple[Array, Array, list[Curve]]:
    """Return each junction's place and covariance, and curves cut to where they pass it.

    Near a junction tubes overlap, and points do not tell their axes apart. So the place is where the strands
    meet when they go on from where they are apart, with the bend that they have there.
    """
    found = np.array(places, dtype=np.float64).reshape(-1, 3)
    covariances = np.zeros((len(found), 3, 3))
    parts = list(parts)
    for number in range(len(found)):
        at = [(k, late) for k, strand in enumerate(strands) for late in (0, 1) if strand.ends[late] == number]
        radii = [fit.radius(k) for k, _ in at]
        start = found[number].copy()
        normal = np.eye(3)
        weight = _HELD if held[number] else _ALONG
        for _ in range(_ROUNDS):
            outward = [_sample_outward(parts[k], found[number], late, fit.radius(k)) for k, late in at]
            normal, right = weight * np.eye(3), weight * start
            for own in range(len(at)):
                way = _continue_inward(outward, radii, own)
                nearest = int(np.linalg.norm(way[1:-1] - found[number], axis=1).argmin()) + 1
                tangent = way[nearest + 1] - way[nearest - 1]
                tangent = tangent / max(float(np.linalg.norm(tangent)), 1e-12)
                across = np.eye(3) - np.outer(tangent, tangent)
                normal, right = normal + across, right + across @ way[nearest]
            before, found[number] = found[number].copy(), np.linalg.solve(normal, right)
            if np.linalg.norm(found[number] - before) < _STILL:
                break
        covariances[number] = np.linalg.inv(normal) * fit.sigma**2
        for k, late in at:
            s = _find_passing(parts[k], found[number], late, _MAX_MOVE * fit.radius(k))
            part = parts[k]
            length = part.length
            parts[k] = part.trimmed(0.0, s) if late else part.trimmed(s, length)
    return found, covariances, parts


def _find_passing(part: Curve, place: Array, late: int, reach: float) -> float:
    """Return the arc length at which a curve passes a place, near one end: it may cross itself."""
    reach = min(reach, _MAX_SHARE * part.length)
    s = np.linspace(part.length - reach, part.length, _SAMPLES) if late else np.linspace(0.0, reach, _SAMPLES)
    positions = part.place_at(s)
    return float(s[np.linalg.norm(positions - place, axis=1).argmin()])


def _sample_outward(part: Curve, place: Array, late: int, radius: float) -> Array:
    """Return places (M, 3) on a curve from a junction to the curve's middle, metres."""
    s = _find_passing(part, place, late, _MAX_MOVE * radius)
    return part.place_at(np.linspace(s, 0.5 * part.length, _SAMPLES))


def _continue_inward(outward: Sequence[Array], radii: Sequence[float], own: int) -> Array:
    """Return the way (M, 3) of a strand to a junction and beyond, continued from where it is apart."""
    nodes, radius = outward[own], radii[own]
    along = path_length(nodes)
    apart = np.ones(len(nodes), dtype=bool)
    for other, others in enumerate(outward):
        if other != own:
            gaps = np.sqrt(_core.find_squared_distances(nodes, others))
            apart &= gaps > _APART * (radius + radii[other])
    first = int(apart.argmax()) if apart.any() else 0
    first = min(first, int(np.searchsorted(along, _FARTHEST * radius)), len(nodes) - _FEWEST)
    used = (along >= along[first]) & (along <= along[first] + _TELLING * radius)
    if used.sum() < _FEWEST:
        used[first : first + _FEWEST] = True
    origin = along[first]
    bent = np.polynomial.polynomial.polyfit(along[used] - origin, nodes[used], 2)
    s = np.linspace(-origin - _BEYOND * radius, 0.0, _SAMPLES)
    return np.asarray(np.polynomial.polynomial.polyval(s, bent).T)


def _bend_to(chain: Chain, strand: Strand, places: Array) -> Chain:
    """Return a chain whose ends lie at its junctions."""
    points = np.array(chain.points)
    for late in (0, 1):
        number = strand.ends[late]
        if number is None:
            continue
        s = path_length(points)
        s = s[-1] - s if late else s
        share = np.clip(1.0 - s / min(_SHIFTED * chain.radius, 0.5 * s.max()), 0.0, None) ** 2
        points = points + share[:, None] * (places[number] - points[-late])
    return replace(chain, points=points, curve=None)
