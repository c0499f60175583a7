"""Evidence for and against an answer as numbers, which `strand.ropes.posterior` weighs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

import strand._core as _core
from strand.geometry.lengths import measure_lengths
from strand.geometry.polyline import find_runs
from strand.ropes.chain import Chain
from strand.ropes.doubt import DOUBTS, Doubt
from strand.views.sensor import Sensor

CONTRADICTIONS = (
    "pose",
    "range",
    "depth",
    "intrinsics",
    "viewpoint",
    "residuals",
    "beneath",
    "mask",
    "radius",
    "prior",
    "ring",
    "cut end",
    "hidden end",
    "gap",
    "deadline",
)
"""Kinds of doubt about the input, and about rope that it does not show.

Simulated scenes do not show how frequent they are.
"""
COURSE_DOUBTS = tuple(kind for kind in DOUBTS if kind not in (*CONTRADICTIONS, "order"))
"""Kinds of doubt about courses; "order" is about which strand lies on top."""

_CONTRADICTION_SLOPE = 0.5  # bound per amount of a contradiction
_SMALL_DOUBT = 0.15  # doubts about courses bound no probability if they are smaller
_COURSE_SLOPE = 0.2  # bound per amount of greater ones
_STEEPNESS = 4.0  # a doubt of a quarter counts as 1 - 1/e of a certain one
_MAX_DOUBTS = 6.0  # graver doubts together count no more
_SHORT = 25.0  # radii: shorter chains are often things, or pieces of ropes
_MAX_SHORT = 3  # chains: more short ones count no more
_MAX_DEVIATION = 2.0  # radii: larger deviations of nodes count no more
_MAX_STEP = 3.0  # radii: larger steps of depth count no more
_MAX_SCATTER = 1.5  # radii: wider errors of depth count no more
_MAX_UNSEEN = 15.0  # radii: longer stretches without points count no more
_NEAR = 2.5  # radii: an end this near another strand touches it
_OWN = 6.0  # radii along the rope from its end: nearer nodes are no other strand
_MAX_ENDS = 4  # ends: more that touch a strand count no more
_MAX_BEND = 1.0  # 1 / radii: tighter bends count no more


@dataclass(frozen=True)
class Circumstances:
    """How an answer was found.

    Attributes
    ----------
    sensor : Sensor or None
        The sensor's errors as measured.
    views : int
        The number of views.
    has_images, has_masks : bool
        Whether views have images, and masks.
    has_things : bool
        Whether strand dropped things on the table.
    from_images : bool
        Whether the answer was read from images.
    knows_ropes, knows_lengths : bool
        Whether the caller gave the number of ropes, and their lengths.
    """

    sensor: Sensor | None
    views: int
    has_images: bool
    has_masks: bool
    has_things: bool
    from_images: bool
    knows_ropes: bool
    knows_lengths: bool


@dataclass(frozen=True)
class Shape:
    """Measurements of a chain, lengths in radii.

    Attributes
    ----------
    radius : float
        Metres.
    length, unseen_share, unseen_stretch : float
        Its length, the share of nodes without points, and the longest stretch of them.
    ends_at_strands : int
        How many of its ends touch another strand.
    bend : float
        The greatest curvature, 1 / radii.
    deviation : float
        Root mean variance of its nodes; 0 if it is not known.
    """

    radius: float
    length: float
    unseen_share: float
    unseen_stretch: float
    ends_at_strands: int
    bend: float
    deviation: float


def describe_shapes(chains: Sequence[Chain]) -> list[Shape]:
    """Return the shapes of an answer's chains."""
    return [
        Shape(
            chain.radius,
            chain.length / chain.radius,
            0.0 if chain.points_seen is None else float((chain.points_seen <= 0).mean()),
            _measure_unseen(chain),
            _count_ends_at_strands(chain, chains),
            _measure_bend(chain),
            _measure_deviation(chain),
        )
        for chain in chains
    ]


def measure_bound(doubts: Iterable[Doubt]) -> float:
    """Return b of the gravest doubt: an answer's probability is at most exp(-b).

    Contradictions bound it most. Other grave doubts bound it too: the scenes that set the weights may not
    show why they are grave.
    """
    bound = 0.0
    for doubt in doubts:
        if doubt.kind in CONTRADICTIONS:
            bound = max(bound, _CONTRADICTION_SLOPE * doubt.amount)
        elif doubt.kind in COURSE_DOUBTS:
            bound = max(bound, _COURSE_SLOPE * (doubt.amount - _SMALL_DOUBT))
    return bound


def measure_evidence(
    doubts: Iterable[Doubt], shapes: Sequence[Shape], found: Circumstances
) -> dict[str, float]:
    """Return the evidence about courses by name: each kind of doubt, from 0 to 1, and measurements.

    Parameters
    ----------
    doubts : iterable of Doubt
    shapes : sequence of Shape
        Those of the answer's chains, or of one of them.
    found : Circumstances
    """
    amounts: dict[str, float] = dict.fromkeys((*COURSE_DOUBTS, "order"), 0.0)
    for doubt in doubts:
        if doubt.kind in amounts:
            amounts[doubt.kind] += doubt.amount
    together = min(sum(amounts[kind] for kind in COURSE_DOUBTS), _MAX_DOUBTS)
    radius = min(shape.radius for shape in shapes)
    lengths = [shape.length for shape in shapes]
    evidence = {
        kind: 1.0 - math.exp(-_STEEPNESS * amount) for kind, amount in amounts.items() if amount > 0.0
    }
    evidence |= {
        "doubts": together,
        "root of doubts": math.sqrt(together),
        "shortest": math.log(max(min(lengths), 1.0)),
        "short chains": float(min(sum(length < _SHORT for length in lengths), _MAX_SHORT)),
        "unseen share": max(shape.unseen_share for shape in shapes),
        "unseen stretch": min(max(shape.unseen_stretch for shape in shapes), _MAX_UNSEEN) / _MAX_UNSEEN,
        "ends at strands": float(min(sum(shape.ends_at_strands for shape in shapes), _MAX_ENDS)),
        "bend": min(max(shape.bend for shape in shapes), _MAX_BEND),
        "deviation": min(max(shape.deviation for shape in shapes), _MAX_DEVIATION),
        "one view": float(found.views == 1),
        "no image": float(not found.has_images),
        "masks": float(found.has_masks),
        "things": float(found.has_things),
        "images": float(found.from_images),
        "ropes given": float(found.knows_ropes),
        "lengths given": float(found.knows_lengths),
    }
    if found.sensor is not None:
        evidence["scatter"] = min(found.sensor.sd / radius, _MAX_SCATTER)
        evidence["step"] = min(found.sensor.step / radius, _MAX_STEP)
    return evidence


def _measure_deviation(chain: Chain) -> float:
    """Return the root mean variance of a chain's nodes, radii; 0 if it is not known."""
    if chain.covariance is None:
        return 0.0
    variance = np.trace(chain.covariance, axis1=1, axis2=2).mean()
    return math.sqrt(max(float(variance), 0.0)) / chain.radius


def _measure_unseen(chain: Chain) -> float:
    """Return the longest stretch without points, radii."""
    if chain.points_seen is None:
        return 0.0
    runs = find_runs(chain.points_seen <= 0)
    spacing = chain.length / len(chain.points) / chain.radius
    return max((end - start for start, end in runs), default=0) * spacing


def _measure_bend(chain: Chain) -> float:
    """Return the greatest curvature, 1 / radii."""
    steps = np.diff(chain.points, axis=0)
    ways = steps / measure_lengths(steps)[:, None]
    cosine = float(np.einsum("ij,ij->i", ways[:-1], ways[1:]).min(initial=1.0))
    return math.acos(max(cosine, -1.0)) * chain.radius * len(chain.points) / chain.length


def _count_ends_at_strands(chain: Chain, chains: Sequence[Chain]) -> int:
    """Return how many ends of one of the chains touch another strand, of the same rope or of another."""
    if chain.closed:
        return 0
    others = [one.points for one in chains if one is not chain]
    count = 0
    for end, far in (
        (chain.points[:1], chain.arc_length > _OWN * chain.radius),
        (chain.points[-1:], chain.arc_length < chain.length - _OWN * chain.radius),
    ):
        (square,) = _core.find_squared_distances(end, np.concatenate([chain.points[far], *others]))
        count += bool(square < (_NEAR * chain.radius) ** 2)
    return count
