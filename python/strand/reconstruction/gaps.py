"""Gaps in ropes through which cameras saw the background, whether strand bridged them or not."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

import strand._core as _core
from strand.geometry.polyline import find_runs
from strand.reconstruction.stages import Found, Observed
from strand.reconstruction.systematic import MIN_BEHIND, find_least_behind, measure_depth_behind
from strand.ropes.chain import Chain
from strand.ropes.doubt import Doubt
from strand.support.checks import Array

_MIN_SEEN_THROUGH = 0.6  # radii of a bridged gap that a view saw through: shorter stretches are noise
_FULL_SEEN_THROUGH = 1.2  # radii: a longer stretch raises all of the doubt
_MIN_SHARE = 0.4  # of a gap's nodes with depth that a view saw through
_BRIDGED_DOUBT = 2.4  # doubt of a join over a gap that a view saw through

_MAX_GAP = 14.0  # radii: ends that are farther from each other are ends of two ropes
_FULL_DOUBT_GAP = 10.0  # radii: nearer ends raise all of the doubt
_HEADING = (0.5, 4.5)  # radii from an end: its direction is taken between these places
_MAX_COST = 13.0  # of a join, in the unit of `Config.linking`: at this cost two ends are not in line
_FULL_DOUBT_COST = 7.0  # the same: cheaper joins raise all of the doubt
_FACING_DOUBT = 0.7  # doubt of two ends that point at each other
_MIN_CONFIRMING = 2  # views that saw through a gap, and so confirm that it is one
_PLACES = np.linspace(0.25, 0.75, 7)[:, None]  # shares of a gap: its middle, which ends do not reach


def doubt_gaps(observed: Observed, found: Found) -> Iterator[Doubt]:
    """Doubt joins over gaps that a view saw through, and ropes that end where another goes on in line.

    Parameters
    ----------
    observed : Observed
    found : Found
        The answer, with poses of the observed views.
    """
    for chain in found.chains[: observed.prior.ropes]:
        yield from _doubt_bridges(chain, observed, found.poses)
    # readings of masks have a doubt of their own, and a known number of ropes confirms their ends
    if found.branch == "tubes" and observed.prior.ropes is None:
        yield from _doubt_facing_ends(observed, found)


def _doubt_bridges(chain: Chain, observed: Observed, poses: Sequence[Array]) -> Iterator[Doubt]:
    """Doubt the gaps of a chain without points through which a view measured depths behind it."""
    # shorter gaps than those of `Chain.bridged`
    gaps = [] if chain.points_seen is None else list(find_runs(chain.points_seen == 0))
    spacing = chain.length / max(len(chain.points) - 1, 1) / chain.radius
    gaps = [(start, stop) for start, stop in gaps if (stop - start) * spacing > _MIN_SEEN_THROUGH]
    if not gaps:
        return
    through = np.zeros(len(chain.points), dtype=bool)
    shown = np.zeros(len(chain.points), dtype=bool)
    inside = np.concatenate([np.arange(start, stop) for start, stop in gaps])
    for view, pose in zip(observed.whole, poses, strict=True):
        # comparisons with NaN are false
        behind = measure_depth_behind(view, pose, chain.points[inside], chain.radius)
        measured = behind < np.inf
        shown[inside] |= measured
        if (measured & (behind > MIN_BEHIND)).any():
            through[inside] |= measured & (behind > find_least_behind(view, chain.radius))
    for start, stop in gaps:
        count = int(np.count_nonzero(through[start:stop]))
        length = count * spacing
        if length < _MIN_SEEN_THROUGH or count < _MIN_SHARE * np.count_nonzero(shown[start:stop]):
            continue
        share = (length - _MIN_SEEN_THROUGH) / (_FULL_SEEN_THROUGH - _MIN_SEEN_THROUGH)
        reason = (
            f"cameras saw through {1e3 * length * chain.radius:.0f} mm of the gap that is bridged there; "
            "the rope may end, and something else go on"
        )
        place = chain.points[(start + stop) // 2]
        yield Doubt("gap", _BRIDGED_DOUBT * min(share, 1.0), "how the rope runs", reason, place)


def _doubt_facing_ends(observed: Observed, found: Found) -> Iterator[Doubt]:
    """Doubt ends of two ropes that a short curve would join: the depth between may be wrong.

    Several views do not have the same wrong depth: a gap that two of them saw through is one.
    """
    ends = [(number, *end) for number, chain in enumerate(found.chains) for end in _find_ends(chain)]
    for k, (number, end, heading) in enumerate(ends):
        radius = found.chains[number].radius
        for other, target, back in ends[k + 1 :]:
            length = float(np.linalg.norm(target - end)) / radius
            if other == number or not 0.0 < length < _MAX_GAP:
                continue
            share = (_MAX_COST - _core.price_join(end, heading, target, back, radius)) / (
                _MAX_COST - _FULL_DOUBT_COST
            )
            share = min(share, 1.0) * min((_MAX_GAP - length) / (_MAX_GAP - _FULL_DOUBT_GAP), 1.0)
            if share <= 0.0 or _count_confirming(observed, found, end, target, radius) >= _MIN_CONFIRMING:
                continue
            reason = (
                f"another rope goes on in line with it, {length * radius * 1e3:.0f} mm away; they may be one "
                "rope, if the depth between them is wrong"
            )
            yield Doubt("gap", _FACING_DOUBT * share, "where the rope ends", reason, end)


def _count_confirming(observed: Observed, found: Found, end: Array, target: Array, radius: float) -> int:
    """Return the number of views that saw through the middle of a gap; those of points alone count too."""
    nodes = end + _PLACES * (target - end)
    count = 0
    for view, pose in zip(observed.whole, found.poses, strict=True):
        behind = measure_depth_behind(view, pose, nodes, radius)
        count += bool(view.image is None or np.mean(behind > find_least_behind(view, radius)) > 0.5)
    return count


def _find_ends(chain: Chain) -> Iterator[tuple[Array, Array]]:
    """Yield the place of each end of a chain, and the unit direction in which it leaves the rope."""
    if chain.closed:
        return
    length = chain.length
    near, far = (min(place * chain.radius, 0.5 * length) for place in _HEADING)
    for end, first, last in chain.at([[0.0, near, far], [length, length - near, length - far]]):
        way = first - last
        yield end, way / max(float(np.linalg.norm(way)), np.finfo(float).tiny)
