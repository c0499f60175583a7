"""Tubes traced through oriented points and fitted together with the poses: the default method."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from strand import _core
from strand._core import EndObservation, NotEnoughDataError, TubeFit, fit_tubes
from strand.assembly import Judged, decide, explanation_cost, reopened
from strand.certainty import branches, doubt_of_margin, doubts, joins_of
from strand.config import Config, Poses
from strand.curve import Curve
from strand.ends import string_parts, with_hidden_ends
from strand.hues import Hues, colors_of
from strand.known import Known
from strand.model import Alternative, Chain, Join
from strand.orientation import started
from strand.pieces import left_over
from strand.radius import Radii, agreeing, fitted_deviation
from strand.selection import best_explaining
from strand.sightings import end_sightings
from strand.slack import as_long, bowed
from strand.stages import Found, Run
from strand.support import described
from strand.view import Array, View, checked_radius, checked_views, extraction_range, moved, rigid_motion
from strand.visibility import Sight

# arcs of the reference view with fewer nodes are too short to register other views to, if there are others
_REFERENCE_NODES = 8
# mean number of points in a cube of two radii that is enough to trace arcs; strings are fitted to all points
_ENOUGH = 20
# arcs traced where views were off by less than this, in radii, are not traced again
_SETTLED = 0.15
# of fits that others follow, in standard deviations of the unknowns
_TOLERANCE = 0.3
# so many points of each view tell its pose well enough to trace arcs
_POSED = 250
# how far splines are carried on beyond their arcs, in radii, so that the points can say where the end is
_ARC_MARGIN, _STRING_MARGIN = 1.0, 2.0

# a radius that was given is in doubt if the fit is so many standard deviations from it
_PULLED = 3.0

# how often what the last fit leaves unexplained reopens the decision, and by how much that must pay
_REOPENED, _BETTER = 1, 1.0

Bounds = tuple[Array, Array] | None


@dataclass(frozen=True, eq=False)
class Clouds:
    """What the fit works on: every view's points in the world frame as reported.

    Attributes
    ----------
    points : list of (N_v, 3) ndarray
        Metres.
    viewpoints : (V, 3) ndarray
        The cameras' centres, metres.
    reference : int
        The view that stays where it is.
    bounds : pair of (3,) ndarray or None
        The extraction range that the points were cut to, metres.
    """

    points: list[Array]
    viewpoints: Array
    reference: int
    bounds: Bounds

    @classmethod
    def of(cls, views: Sequence[View], bounds: Bounds) -> Clouds:
        """Return the views' points; the middle view is the reference."""
        viewpoints = np.array([view.viewpoint for view in views])
        return cls([view.world_points for view in views], viewpoints, len(views) // 2, bounds)

    def every(self, step: int) -> Clouds:
        """Return every n-th point of each view."""
        return replace(self, points=[cloud[::step] for cloud in self.points])

    def thinned(self, radius: float) -> Clouds:
        """Return every n-th point of each view, n as large as tracing allows."""
        count = sum(map(len, self.points))
        occupied = _core.occupied_voxels(self.points, 2.0 * radius)
        step = max(round(count / (_ENOUGH * max(occupied, 1))), 1)
        return self.every(step)


@dataclass(frozen=True, eq=False)
class Arcs:
    """Stretches of string.

    Attributes
    ----------
    nodes : list of (M, 3) ndarray
        Ordered nodes of each, metres.
    ropes : list of int
        The number of the rope that each is a piece of.
    """

    nodes: list[Array]
    ropes: list[int]

    def only(self, chosen: Iterable[object]) -> Arcs:
        """Return those for which something is true."""
        chosen = list(chosen)
        return Arcs(list(compress(self.nodes, chosen)), list(compress(self.ropes, chosen)))


def trace(clouds: Clouds, motions: Array, radii: Array, min_nodes: int, config: Config) -> Arcs:
    """Trace arcs of each radius through the points of all views at corrected poses."""
    points = [moved(cloud, motion) for cloud, motion in zip(clouds.points, motions, strict=True)]
    centres = [moved(centre[None], motion) for centre, motion in zip(clouds.viewpoints, motions, strict=True)]
    cameras = np.repeat(np.concatenate(centres), list(map(len, points)), axis=0)
    together = np.concatenate(points)
    nodes, ropes = [], []
    for rope, radius in enumerate(radii):
        arcs = _core.trace_tubes(together, cameras, radius, min_nodes=min_nodes)
        nodes += [arc for arc, _ in arcs]
        ropes += [rope] * len(arcs)
    if not nodes:
        raise NotEnoughDataError("views: the points make no tube; is the radius right, in metres?")
    return _explaining(clouds, motions, radii, Arcs(nodes, ropes), config)


def _explaining(clouds: Clouds, motions: Array, radii: Array, arcs: Arcs, config: Config) -> Arcs:
    """Return the arcs whose radius is that of the points about them, if there are several radii."""
    if len(radii) == 1:
        return arcs

    def fitted(numbers: list[int]) -> TubeFit:
        some = arcs.only([number in numbers for number in range(len(arcs.nodes))])
        curves = _splines(some, radii, config, 0.0)
        held: dict[str, Any] = {"fit_curves": False, "iterations": 0, "uncertainty": False}
        return _fit(clouds, curves, some.ropes, motions, radii, config, **held)

    return arcs.only(best_explaining(arcs.ropes, radii, fitted))


def _fit(
    clouds: Clouds,
    curves: Sequence[Array],
    ropes: Sequence[int],
    motions: Array,
    radii: Array,
    config: Config,
    **how: Any,
) -> TubeFit:
    """Fit curves and poses, with what every fit of a run has in common."""
    return fit_tubes(
        clouds.points,
        clouds.viewpoints,
        curves,
        motions,
        radii,
        radius_classes=ropes,
        pose_sd=(config.poses.rotation_sd, config.poses.translation_sd),
        # a view alone has no pose to find
        reference=clouds.reference if len(clouds.points) > 1 else None,
        min_bend=config.tubes.min_bend,
        noise=config.tubes.noise,
        **how,
    )


def registered_roughly(clouds: Clouds, radii: Array, config: Config) -> Array:
    """Corrections of the poses that put all views, best thinned, on the tubes of the reference view."""
    still = np.tile(np.eye(4), (len(clouds.points), 1, 1))
    if len(clouds.points) == 1:
        return still
    alone = Clouds(
        [clouds.points[clouds.reference]], clouds.viewpoints[clouds.reference][None], 0, clouds.bounds
    )
    try:
        arcs = trace(alone, still[:1], radii, 4, config)
    except NotEnoughDataError:
        return still
    long = [len(nodes) >= _REFERENCE_NODES for nodes in arcs.nodes]
    if any(long):
        arcs = arcs.only(long)
    fit = _fit(
        clouds.every(max(sum(map(len, clouds.points)) // (_POSED * len(clouds.points)), 1)),
        _splines(arcs, radii, config, 0.0),
        arcs.ropes,
        still,
        radii,
        config,
        fit_curves=False,
        band=(1.0, 0.5),
        iterations=10,
        tolerance=_TOLERANCE,
        uncertainty=False,
    )
    return fit.motions


def fit_arcs(
    clouds: Clouds, few: Clouds, motions: Array, radii: Radii, config: Config, *, uncertainty: bool = False
) -> tuple[TubeFit, Radii]:
    """Trace arcs and fit them with the poses, again if the poses were far off; radii that are free last.

    `few` is `clouds` thinned: arcs are traced in it.

    Returns the last fit, and those of the radii that some arc has.

    Raises
    ------
    strand.NotEnoughDataError
        If there is nothing like a tube of these radii in the points.
    """
    # which of several given radii an arc has, its points say in the end
    told_apart = len(radii.values) > 1 and not radii.free and not radii.held
    for _ in range(config.tubes.rounds):
        arcs = trace(few, motions, radii.values, 3, config)
        if not told_apart:
            radii, arcs = _present(radii, arcs)
        fit = _fit(
            clouds,
            _splines(arcs, radii.values, config, _ARC_MARGIN),
            arcs.ropes,
            motions,
            radii.values,
            config,
            iterations=12,
            tolerance=0.1 if uncertainty else _TOLERANCE,
            bounds=clouds.bounds if radii.free else None,
            uncertainty=uncertainty,
        )
        shift = _shift(few, motions, fit.motions)
        motions = fit.motions
        if shift < _SETTLED * float(radii.values.min()):
            break
    if told_apart:
        return _kinds_from_points(clouds, arcs, fit, radii, config, uncertainty)
    if not radii.free:
        return fit, radii
    fit = _with_radii(clouds, fit, arcs.ropes, fit.radii, radii.prior, config)
    kinds = agreeing(fit.radii, np.zeros(len(fit.radii)))
    if len(set(kinds)) < len(kinds):
        # strands side by side looked like a thicker rope
        first = [kinds.index(kind) for kind in range(max(kinds) + 1)]
        radii = radii.only(first)
        few = clouds.thinned(float(radii.values.min()))
        return fit_arcs(clouds, few, fit.motions, radii, config, uncertainty=uncertainty)
    return fit, radii


def _shift(clouds: Clouds, before: Array, after: Array) -> float:
    """How far corrections of the poses moved the farthest point, metres."""
    far = 0.0
    for cloud, some, other in zip(clouds.points, before, after, strict=True):
        apart = other[:3] - some[:3]
        far = max(far, float(np.linalg.norm(cloud @ apart[:, :3].T + apart[:, 3], axis=1).max()))
    return far


def _with_radii(
    clouds: Clouds, fit: TubeFit, ropes: Sequence[int], start: Array, prior: Array | None, config: Config
) -> TubeFit:
    """Fit again with radii that are unknown too, which only residuals along the rays do not bias."""
    return _fit(
        clouds,
        fit.curves,
        ropes,
        fit.motions,
        start,
        config,
        radius_prior=prior,
        along_ray=True,
        band=(0.8, 0.5),
        iterations=30,
        bounds=clouds.bounds,
        uncertainty=False,
    )


def _present(radii: Radii, arcs: Arcs) -> tuple[Radii, Arcs]:
    """Leave out the radii that no arc has."""
    present = sorted(set(arcs.ropes))
    return radii.only(present), Arcs(arcs.nodes, [present.index(rope) for rope in arcs.ropes])


def _kinds_from_points(
    clouds: Clouds, arcs: Arcs, fit: TubeFit, radii: Radii, config: Config, uncertainty: bool
) -> tuple[TubeFit, Radii]:
    """Fit each arc a radius of its own, then again with that of the known radii which is nearest to it."""
    own = radii.unsure().only(arcs.ropes)
    alone = _with_radii(clouds, fit, list(range(len(arcs.nodes))), own.values, own.prior, config)
    radii, arcs = _present(radii, Arcs(arcs.nodes, radii.nearest(alone.radii)))
    how: dict[str, Any] = {"iterations": 12, "uncertainty": uncertainty}
    return _fit(clouds, alone.curves, arcs.ropes, alone.motions, radii.values, config, **how), radii


def with_left_over(clouds: Clouds, fit: TubeFit, config: Config) -> TubeFit:
    """Fit again with the pieces of string that no arc explains, if there are any."""
    pieces = [left_over(fit, rope) for rope in range(len(fit.radii))]
    if not any(pieces):
        return fit
    found = Arcs(
        [nodes for some in pieces for nodes in some],
        [rope for rope, some in enumerate(pieces) for _ in some],
    )
    return _fit(
        clouds,
        [*fit.curves, *_splines(found, fit.radii, config, 0.5)],
        [*fit.radius_classes.tolist(), *found.ropes],
        fit.motions,
        fit.radii,
        config,
        band=(0.5, 0.4),
        iterations=8,
        tolerance=_TOLERANCE,
        uncertainty=False,
    )


def compared(
    clouds: Clouds, arcs: Arcs, before: TubeFit, sight: Sight, known: Known, hues: Hues | None, config: Config
) -> list[list[Judged]]:
    """For each kind of rope, fit and compare ways to make strings of its arcs; the best first.

    Raises
    ------
    strand.NotEnoughDataError
        If no string is long enough.
    """
    ways: list[list[Judged]] = []
    for rope, radius in enumerate(before.radii):
        mine = [nodes for nodes, number in zip(arcs.nodes, arcs.ropes, strict=True) if number == rope]
        if not mine:
            ways.append([])
            continue
        fitted = _on_sample(clouds, before, rope, known, config)
        of_mine = known if len(before.radii) == 1 else known.of_a_kind()
        ways.append(decide(mine, float(radius), config.linking, sight, fitted, of_mine, hues))
    if not any(ways):
        raise NotEnoughDataError("views: the points make no string; is the radius right, in metres?")
    return ways


def _on_sample(
    clouds: Clouds, before: TubeFit, rope: int, known: Known, config: Config
) -> Callable[[Sequence[tuple[Array, bool]]], TubeFit]:
    """Return what fits strings of one kind of rope to a sample of its points, poses as they are."""
    points = clouds if len(before.radii) == 1 else _of_rope(clouds, before, rope)
    radius = before.radii[rope : rope + 1]
    sample = points.thinned(float(radius[0]))

    def fitted(chains: Sequence[tuple[Array, bool]]) -> TubeFit:
        strings = Arcs([nodes for nodes, _ in chains], [0] * len(chains))
        curves = _splines(strings, radius, config, _STRING_MARGIN)
        fit = _fit(
            sample,
            curves,
            strings.ropes,
            before.motions,
            radius,
            config,
            band=(0.5, 0.4),
            iterations=12,
            tolerance=_TOLERANCE,
            uncertainty=False,
        )
        return fit.replace(curves=bowed(fit, curves)) if known.lengths else fit

    return fitted


def decided_again(
    ways: Sequence[Sequence[Judged]],
    arcs: Arcs,
    clouds: Clouds,
    before: TubeFit,
    sight: Sight,
    known: Known,
    hues: Hues | None,
    config: Config,
) -> list[list[Judged]] | None:
    """Fit and compare ways to make strings of other arcs; None if that pays for no kind of rope.

    Which points are of which kind of rope is found anew, so the way that was best is judged on them too.
    """
    if len(before.radii) > 1:
        motions, radii = before.motions, before.radii
        arcs = _explaining(clouds, motions, radii, arcs, config)
        how: dict[str, Any] = {"band": (0.5, 0.4), "iterations": 8, "uncertainty": False}
        before = _fit(clouds, _splines(arcs, radii, config, 0.5), arcs.ropes, motions, radii, config, **how)
    again = compared(clouds, arcs, before, sight, known, hues, config)
    if not all(ways) or not all(again):
        return None
    costs = [judged[0].cost for judged in ways]
    if len(before.radii) > 1:
        for rope, judged in enumerate(ways):
            fitted = _on_sample(clouds, before, rope, known, config)
            costs[rope] = explanation_cost(fitted(judged[0].assembly.chains), sight)
    return again if sum(judged[0].cost for judged in again) < sum(costs) - _BETTER else None


def _of_rope(clouds: Clouds, fit: TubeFit, rope: int) -> Clouds:
    """Points that arcs of one kind of rope explain."""
    mine = fit.explained & (fit.radius_classes[fit.curve] == rope)
    ends = np.cumsum([len(cloud) for cloud in clouds.points])[:-1]
    kept = [cloud[chosen] for cloud, chosen in zip(clouds.points, np.split(mine, ends), strict=True)]
    return replace(clouds, points=kept)


def chosen(ways: Sequence[Sequence[Judged]]) -> tuple[Arcs, list[bool]]:
    """Return the strings of the best way of each kind of rope, and which of them are rings."""
    chains = [
        (chain, rope) for rope, judged in enumerate(ways) if judged for chain in judged[0].assembly.chains
    ]
    nodes = [started(nodes) if ring else nodes for (nodes, ring), _ in chains]
    return Arcs(nodes, [rope for _, rope in chains]), [ring for (_, ring), _ in chains]


def all_joins(ways: Sequence[Sequence[Judged]], chains: Sequence[Chain], config: Config) -> tuple[Join, ...]:
    """Return the joins of all kinds of rope, the least certain first."""
    joins = [
        join
        for judged in filter(None, ways)
        for join in joins_of(judged, chains, judged[0].fit.radius(0), config.linking)
    ]
    return tuple(sorted(joins, key=lambda join: join.margin))


def alternatives(ways: Sequence[Sequence[Judged]]) -> tuple[Alternative, ...]:
    """Return the ways that are not the answer, the best first, but those that explain nothing."""
    others = [
        Alternative(other.cost - judged[0].cost, tuple(nodes for nodes, _ in other.assembly.chains))
        for judged in filter(None, ways)
        for other in judged[1:]
        if np.isfinite(other.cost)
    ]
    return tuple(sorted(others, key=lambda other: other.cost))


def fit_strings(
    clouds: Clouds, strings: Arcs, closed: Sequence[bool], before: TubeFit, radii: Radii, config: Config
) -> TubeFit:
    """Fit whole strings with the poses along the rays, then again to where views see them end.

    Radii that are free are first each string's own; strings whose radii agree then share one.
    """
    ropes, start = strings.ropes, before.radii
    if radii.free:
        ropes, start, radii = list(range(len(ropes))), start[ropes], radii.only(ropes)
    curves, motions = _splines(strings, before.radii, config, _STRING_MARGIN), before.motions
    ends: list[EndObservation] = []
    fit: TubeFit | None = None

    def fitted(uncertainty: bool) -> TubeFit:
        return _fit(
            clouds,
            curves,
            ropes,
            motions,
            start,
            config,
            radius_prior=radii.prior,
            along_ray=True,
            band=(0.5, 0.5),
            iterations=30 if radii.free else 20,
            tolerance=0.1 if uncertainty else _TOLERANCE,
            bounds=clouds.bounds if radii.free else None,
            end_observations=ends,
            previous=fit,
            uncertainty=uncertainty,
        )

    fit = fitted(uncertainty=radii.free)
    ends = end_sightings(
        fit,
        string_parts(fit, exclusive=True),
        closed,
        clouds.viewpoints,
        clouds.bounds,
        config.poses.translation_sd,
    )
    curves, motions, start = fit.curves, fit.motions, fit.radii
    if radii.free:
        ropes = agreeing(fit.radii, fit.radii_sd)
        first = [ropes.index(kind) for kind in range(max(ropes) + 1)]
        start, radii = start[first], radii.only(first)
    return fitted(uncertainty=True)


def seen_arcs(fit: TubeFit, config: Config) -> Arcs:
    """Cut fitted arcs to what was seen, and leave out what is too short."""
    nodes, ropes = [], []
    for number, part in enumerate(string_parts(fit, exclusive=False)):
        radius = fit.radius(number)
        if part is not None and part.length > config.tubes.min_arc * radius:
            nodes.append(part.at(part.nodes(0.5 * radius))[0])
            ropes.append(int(fit.radius_classes[number]))
    return Arcs(nodes, ropes)


def find_strings(
    views: Sequence[View],
    raw: Sequence[View],
    numbers: Sequence[int],
    bounds: Bounds,
    radii: Radii,
    known: Known,
    config: Config,
    run: Run,
) -> Found:
    """Trace, register, fit and link on filtered views that all see something.

    Parameters
    ----------
    views : sequence of View
    raw : sequence of View
        The same views with all that they saw, beyond the strings too.
    numbers : sequence of int
        What each is called in warnings.
    bounds : pair of (3,) ndarray or None
        The extraction range that they were cut to, metres.
    radii : Radii
    known : Known
        How many strings there are: gaps are bridged until no more are left. How long: bridges are too.
    config : Config
    run : Run

    Returns
    -------
    Found
        Its stages are "registered" (points at the corrected poses), "arcs" (what was seen of the strings
        before they were linked) and "fit" (the last `TubeFit`).

    Raises
    ------
    strand.NotEnoughDataError
        If there is nothing like a tube of this radius in the points.
    """
    clouds = Clouds.of(views, bounds)
    with run.stage("register"):
        few = clouds.thinned(float(radii.values.min()))
        motions = registered_roughly(few, radii.values, config)
    with run.stage("arcs"):
        fit, radii = fit_arcs(clouds, few, motions, radii, config)
        before = with_left_over(clouds, fit, config)
        arcs = seen_arcs(before, config)
    with run.stage("link"):
        poses = [motion @ view.pose for motion, view in zip(before.motions, raw, strict=True)]
        sight = Sight.of(raw, poses, views)
        colors = colors_of(views)
        hues = None if colors is None else Hues.of(before, colors)
        judged = compared(clouds, arcs, before, sight, known, hues, config)
    for reopenings in range(1 + _REOPENED):
        strings, closed = chosen(judged)
        with run.stage("fit"):
            fit = fit_strings(clouds, strings, closed, before, radii, config)
        with run.stage("ends"):
            found = string_parts(fit, exclusive=True)
            for i, control in enumerate(fit.curves):
                if closed[i]:
                    found[i] = _once_round(Curve.whole(control), _STRING_MARGIN * fit.radius(i))
            if known.lengths:
                starts = _splines(strings, before.radii, config, _STRING_MARGIN)
                found = as_long(fit, starts, found, known)
            # no decision that no fit would follow
            now = fit.replace(
                radius_classes=np.array(strings.ropes), radii=before.radii, bands=np.zeros(len(before.radii))
            )
            pieces = reopened(now, found, sight) if reopenings < _REOPENED else None
        if pieces is None:
            break
        with run.stage("link"):
            again = decided_again(judged, Arcs(*pieces), clouds, before, sight, known, hues, config)
        if again is None:
            break
        judged = again
    if radii.held:
        radii_sd = radii.sd[strings.ropes]
    else:
        radii_sd = radii.capped(fitted_deviation(fit.radii, fit.radii_sd, fit.sigma))[fit.radius_classes]
    whole = with_hidden_ends(fit, found, closed, sight)
    # joins name chains by their numbers, longest first
    chains = sorted(described(fit, whole, closed, radii_sd, config), key=lambda chain: -chain.length)
    joins = all_joins(judged, chains, config)
    open_parts = [None if ring else part for part, ring in zip(found, closed, strict=True)]
    uncertain = doubts(judged, joins, open_parts, fit, sight)
    if config.tubes.noise is not None and not 0.3 < fit.sigma / config.tubes.noise < 2.0:
        run.warnings.append(
            f"noise: {config.tubes.noise * 1e3:.3g} mm was given, but residuals scatter by "
            f"{fit.sigma * 1e3:.3g} mm"
        )
    if not radii.free and not radii.held:
        _warn_of_pulled_radii(fit, radii, run)
    _warn_of_open_poses(fit, numbers, config.poses, run)
    ends = np.cumsum([len(cloud) for cloud in clouds.points])[:-1]
    stages = {"registered": tuple(np.split(fit.points, ends)), "arcs": tuple(arcs.nodes), "fit": fit}
    poses = [motion @ view.pose for motion, view in zip(fit.motions, views, strict=True)]
    least = doubt_of_margin(config.linking.margin)
    run.warnings.extend(str(doubt) for doubt in uncertain if doubt.amount > least)
    for number, trunk, place in branches(chains, sight):
        run.warnings.append(
            f"chain {number} ends on the side of chain {trunk} at {np.round(place, 3).tolist()}: a branch?"
        )
    if bounds is not None:
        _warn_of_cut_ends(chains, bounds, run)
    return Found(chains, poses, list(fit.pose_sd), stages, joins, uncertain, alternatives(judged))


def register_views(
    views: Sequence[View],
    radius: float,
    bounds: tuple[ArrayLike, ArrayLike] | None = None,
    config: Config | None = None,
) -> tuple[Array, Array]:
    """Register all views of strings together.

    Every view's points are matched with tubes around shared curves, whose shape is found with the poses; so
    views from opposite sides do not pull into each other, and directions that the data do not fix stay at the
    reported poses.

    Parameters
    ----------
    views : sequence of View
        Views of strings alone, outliers removed. The middle one stays where it is.
    radius : float
        The strings' radius, metres.
    bounds : pair of (3,) array_like, optional
        The extraction range: low and high corner of an axis-aligned box in the world frame, metres; views are
        cropped to it.
    config : Config, optional
        Its `poses` say how well the reported poses are known.

    Returns
    -------
    poses : (V, 4, 4) ndarray
        Camera-to-world poses.
    pose_sd : (V, 6) ndarray
        Standard deviations of the corrections in the world frame: rotation vector, radians, and translation,
        metres, of the points' centroid; 0 for the middle view. Near the reported poses' own where the data
        leave a direction open.

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If there are no views, or `radius` or `bounds` are out of range.
    strand.NotEnoughDataError
        If there is nothing like a tube of this radius in the points.
    """
    config = Config() if config is None else config
    views, radius = checked_views(views), checked_radius(radius)
    if not isinstance(config, Config):
        raise TypeError(f"config: expected a Config, got {config!r}")
    if bounds is not None:
        views = [view.crop(bounds) for view in views]
    clouds = Clouds.of(views, None if bounds is None else extraction_range(bounds))
    radii = Radii.given(radius)
    few = clouds.thinned(radius)
    motions = registered_roughly(few, radii.values, config)
    fit, _ = fit_arcs(clouds, few, motions, radii, config, uncertainty=True)
    poses = [
        rigid_motion("pose", motion @ view.pose) for motion, view in zip(fit.motions, views, strict=True)
    ]
    return np.array(poses), fit.pose_sd


def _splines(arcs: Arcs, radii: Array, config: Config, margin: float) -> list[Array]:
    """Splines through arcs, carried on at both ends by a margin in radii."""
    return [
        _core.spline_through(nodes, config.tubes.spacing * radii[rope], margin * radii[rope])
        for nodes, rope in zip(arcs.nodes, arcs.ropes, strict=True)
    ]


def _once_round(curve: Curve, margin: float) -> Curve:
    """Return the stretch of a closed string's curve from `margin`, metres, to where it is there again."""
    start = curve.at([margin])[0]
    late = np.linspace(curve.length - 3.0 * margin, curve.length, 400)
    stop = late[np.linalg.norm(curve.at(late)[0] - start, axis=1).argmin()]
    return curve.part(margin, float(stop))


def _warn_of_pulled_radii(fit: TubeFit, radii: Radii, run: Run) -> None:
    """Name radii that were given and that the points pull away from farther than noise does."""
    pull = fit.radii - radii.values
    limit = _PULLED * np.hypot(radii.sd, fitted_deviation(fit.radii, fit.radii_sd, fit.sigma))
    for k in np.flatnonzero(np.abs(pull) > limit):
        run.warnings.append(
            f"radius: {radii.values[k] * 1e3:.3g} mm was given, but the string looks "
            f"{'thicker' if pull[k] > 0 else 'thinner'}"
        )


def _warn_of_cut_ends(chains: Sequence[Chain], bounds: tuple[Array, Array], run: Run) -> None:
    """Name the ends that run out of the extraction range."""
    for number, chain in enumerate(chains):
        for node, outward in ((chain.points[0], -chain.tangents[0]), (chain.points[-1], chain.tangents[-1])):
            ahead = node + 2.0 * chain.radius * outward
            # a string that lies along a face, such as near the table, does not run out there
            out = ((ahead < bounds[0]) & (outward < -0.5)) | ((ahead > bounds[1]) & (outward > 0.5))
            if not chain.closed and out.any():
                run.warnings.append(
                    f"chain {number} runs out of the extraction range at {np.round(node, 3).tolist()}: "
                    "it may go on"
                )


def _warn_of_open_poses(fit: TubeFit, numbers: Sequence[int], poses: Poses, run: Run) -> None:
    """Name the views with a direction that the data hardly fix."""
    limits = np.repeat([poses.rotation_sd, poses.translation_sd], 3)
    for number, sd in zip(numbers, fit.pose_sd, strict=True):
        if (sd > 0.8 * limits).any():
            kinds = [
                ("rotation", (sd[:3] > 0.8 * limits[:3]).any()),
                ("translation", (sd[3:] > 0.8 * limits[3:]).any()),
            ]
            what = " and ".join(name for name, is_open in kinds if is_open)
            run.warnings.append(
                f"view {number}: the data leave a direction of its {what} open; it stays as reported there"
            )
