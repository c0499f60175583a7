"""Ropes at random: smooth curves that lie on a table and cross over and under one another."""

from __future__ import annotations

import math

import numpy as np

from strand.support.checks import Array, check_integer, check_positive
from strand.synthetic.shapes import arc_lengths

# all in radii: least and greatest length of a rope, steps of a plan, rise of a strand over another,
# half the width of the bump there (and what a flat angle adds), the clearance that is checked, that beside
# each other in the plan, and the sharpest bend
_SHORTEST, _LONGEST = 45.0, 110.0
_STEP, _RISE, _RAMP, _SLOW, _CLEAR, _APART, _BEND = 0.5, 2.15, 2.5, 3.5, 2.0, 2.2, 2.5
# the shallowest crossing, degrees; how often a plan is drawn, and laid
_SHALLOWEST, _DRAWS, _LAYINGS = 35.0, 40, 12
# what there is room and time for: crossings, ropes, and metres of radius
_CROSSINGS, _ROPES, _THICKEST = 20, 8, 1.0
# strands this near along a rope do not touch, in radii of arc length
_OWN = 4.5


def random_ropes(
    crossings: int = 3, ropes: int = 1, radius: float = 0.0042, seed: int = 0
) -> tuple[Array, ...]:
    """Centrelines of ropes drawn at random, lying on the table z = 0 and crossing a given number of times.

    Plans of random bends are drawn until they cross as often as wanted, of one rope with itself or with
    another; which strand is on top is drawn for each crossing, so that knots occur. Strands touch at some
    crossings but never cut through each other: axes are nowhere nearer than 2 radii, and no bend is sharper
    than 2.5 radii.

    Parameters
    ----------
    crossings : int
        As seen from above; at most 20.
    ropes : int
        How many ropes; at most 8.
    radius : float
        Their radius, metres; at most 1.
    seed : int
        The source of chance, not negative.

    Returns
    -------
    tuple of (M, 3) ndarray
        Nodes in the world frame, metres, end to end, 1 mm or a quarter of the radius apart.

    Raises
    ------
    TypeError
        If `radius` is not a number, or another argument not a whole one.
    ValueError
        If an argument is out of range, or no draw crosses as often as wanted.
    """
    radius = check_positive("radius", radius, _THICKEST)
    crossings, ropes = (
        check_integer("crossings", crossings, 0, _CROSSINGS),
        check_integer("ropes", ropes, 1, _ROPES),
    )
    rng = np.random.default_rng(check_integer("seed", seed))
    chains: list[Array] | None = None
    for _ in range(_DRAWS):
        drawn = _plans(ropes, crossings, rng)
        if drawn is None:
            continue
        for _ in range(_LAYINGS):
            chains = _laid(*drawn, rng)
            if chains is not None:
                break
        if chains is not None:
            break
    else:
        raise ValueError(f"crossings: found no {ropes} ropes that cross {crossings} times")
    spacing = min(1e-3, 0.25 * radius)
    resampled = []
    for chain in chains:
        at = arc_lengths(chain) * radius
        s = np.linspace(0.0, at[-1], math.ceil(at[-1] / spacing) + 1)
        resampled.append(np.stack([np.interp(s, at, chain[:, k] * radius) for k in range(3)], axis=1))
    everything = np.concatenate(resampled)[:, :2]
    middle = 0.5 * (everything.min(axis=0) + everything.max(axis=0))
    for nodes in resampled:
        nodes[:, :2] -= middle
    return tuple(resampled)


def _plans(
    ropes: int, crossings: int, rng: np.random.Generator
) -> tuple[list[Array], list[tuple[int, int, float]]] | None:
    """Plane curves that meet as often as wanted, grown piece by piece; None where one cannot grow on.

    Returns (N, 2) nodes of each, in radii, and the pairs of nodes, counted through all curves,
    that meet, with the sine of their angle.
    """
    done = np.zeros((0, 2))
    met: list[tuple[int, int, float]] = []
    plans = []
    for rope in range(ropes):
        wanted = crossings if rope + 1 == ropes else int(rng.integers(0, crossings - len(met) + 1)) + len(met)
        least, most = rng.uniform(_SHORTEST, 1.6 * _SHORTEST), _LONGEST + 8.0 * (wanted - len(met))
        heading, bend = rng.uniform(0.0, 2.0 * np.pi), 0.0
        lean = rng.choice([-1.0, 1.0])
        nodes = rng.uniform(-18.0, 18.0, size=(1, 2))
        grown = [(len(nodes), len(met), heading, bend, 0.0)]
        tries, vain, tail = 0, 0, rng.uniform(4.0, 25.0)
        # the last crossing is no nearer to the end than others may be
        while len(nodes) * _STEP < max(least, grown[-1][4] + tail) or len(met) < wanted:
            tries, vain = tries + 1, vain + 1
            if tries > 400:
                return None
            if (vain > 10 or len(nodes) * _STEP > most) and len(grown) > 1:
                # stuck, or too long without a crossing: go some pieces back
                vain = 0
                grown = grown[: -int(rng.integers(1, min(len(grown), 6)))]
                count, found_before, heading, bend, _ = grown[-1]
                nodes, met = nodes[:count], met[:found_before]
            lean = lean if rng.random() < 0.85 else -lean
            count = int(rng.uniform(8.0, 30.0) / _STEP)
            aim = lean * rng.uniform(0.0, 0.26)
            bends = np.interp(np.arange(count) * _STEP, [0.0, 4.0], [bend, aim])
            headings = heading + np.cumsum(bends) * _STEP
            steps = _STEP * np.stack([np.cos(headings), np.sin(headings)], axis=1)
            piece = nodes[-1] + np.cumsum(steps, axis=0)
            found = _meeting(np.vstack([done, nodes]), len(done), piece)
            if found is None or len(met) + len(found) > wanted:
                continue
            nodes, heading, bend = np.vstack([nodes, piece]), float(headings[-1]), float(bends[-1])
            met = met + found
            crossed = len(nodes) * _STEP if found else grown[-1][4]
            grown.append((len(nodes), len(met), heading, bend, crossed))
            vain = 0
        plans.append(nodes)
        done = np.vstack([done, nodes])
    return plans, met


def _meeting(before: Array, first: int, piece: Array) -> list[tuple[int, int, float]] | None:
    """Pairs of nodes at which a new piece meets what is there, with the sine of the angle; None if at odds.

    `before` holds all nodes so far, its own curve's from number `first` on, whose last the piece goes on
    from.
    """
    count = len(before)
    last = max(count - int(_OWN / _STEP), first)
    old = before[:last] if last - first > 1 or first else before[:0]
    if len(old) < 2:
        return []
    path = np.vstack([before[-1:], piece])
    offset = path[:, None] - old[None]
    near = (offset**2).sum(axis=2) < _APART**2
    if not near.any():
        return []
    if near[-1].any():
        return None
    i, j = np.nonzero(near[:-1, :-1])
    real = j + 1 != first
    i, j = i[real], j[real]
    step, other = path[i + 1] - path[i], old[j + 1] - old[j]

    def cross(a: Array, b: Array) -> Array:
        return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])

    size = cross(step, other)
    with np.errstate(divide="ignore", invalid="ignore"):
        t, u = cross(old[j] - path[i], other) / size, cross(old[j] - path[i], step) / size
    meet = (t >= 0) & (t < 1) & (u >= 0) & (u < 1)
    # strands are near each other only where they cross, and not at a flat angle
    sine = np.abs(size[meet]) / _STEP**2
    if (sine < math.sin(math.radians(_SHALLOWEST))).any():
        return None
    pairs = list(zip(i[meet].tolist(), j[meet].tolist(), strict=True))
    for (a, b), flat in zip(pairs, sine.tolist(), strict=True):
        reach = int((_APART + 1.0) / flat / _STEP) + 1
        near[max(a - reach, 0) : a + reach + 1, max(b - reach, 0) : b + reach + 1] = False
    if near.any():
        return None
    return [(count - 1 + a, b, flat) for (a, b), flat in zip(pairs, sine.tolist(), strict=True)]


def _laid(
    plans: list[Array], met: list[tuple[int, int, float]], rng: np.random.Generator
) -> list[Array] | None:
    """Lift strands over each other; None if they are too near or too sharply bent then."""
    flat = np.concatenate(plans)
    number = np.repeat(np.arange(len(plans)), [len(plan) for plan in plans])
    at = np.concatenate([_STEP * np.arange(len(plan)) for plan in plans])
    top = [(i, j, sine) if rng.random() < 0.5 else (j, i, sine) for i, j, sine in met]
    z = np.ones(len(flat))
    for _ in range(8):
        bumps = np.zeros(len(flat))
        for over, under, sine in top:
            t = np.where(number == number[over], (at - at[over]) / (_RAMP + _SLOW / sine), 2.0)
            rise = z[under] + _RISE - 1.0
            # a smooth maximum of the bumps
            bumps += (rise * np.clip(1.0 - t**2, 0.0, None) ** 3) ** 4
        z = 1.0 + bumps**0.25
        if z.max() > 9.0:
            return None
    solid = np.column_stack([flat, z])
    near = ((solid[:, None] - solid[None]) ** 2).sum(axis=2) < _CLEAR**2
    apart = (np.abs(at[:, None] - at[None]) > _OWN) | (number[:, None] != number[None])
    if (near & apart).any():
        return None
    chains = [solid[number == k] for k in range(len(plans))]
    for chain in chains:
        steps = np.diff(chain, axis=0)
        lengths = np.linalg.norm(steps, axis=1)
        cosine = (steps[1:] * steps[:-1]).sum(axis=1) / (lengths[1:] * lengths[:-1])
        if (np.arccos(np.clip(cosine, -1.0, 1.0)) * _BEND > 0.5 * (lengths[1:] + lengths[:-1])).any():
            return None
    return chains
