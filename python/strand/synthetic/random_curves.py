"""Random ropes: smooth curves on a table that cross over and under one another."""

from __future__ import annotations

import math

import numpy as np

from strand.support.checks import Array, check_integer, check_positive
from strand.synthetic.shapes import compute_arc_lengths

_MIN_LENGTH = 45.0  # radii: length of a rope
_MAX_LENGTH = 110.0  # radii: length of a rope without crossings
_LENGTH_PER_CROSSING = 8.0  # radii that each crossing adds to the greatest length
_STEP = 0.5  # radii between the nodes of a plan
_RISE = 2.15  # radii between the axes of two strands at a crossing
_RAMP = 2.5  # radii: half the width of the bump at a crossing
_RAMP_PER_SINE = 3.5  # radii that a flat angle adds to the ramp, over the sine of the angle
_MIN_DISTANCE = 2.0  # radii between the axes of two strands in space
_MIN_PLAN_DISTANCE = 2.2  # radii between two strands in the plan, except at crossings
_MIN_BEND = 2.5  # radii: radius of the sharpest bend
_MAX_HEIGHT = 9.0  # radii: height of an axis above the table
_SAME_STRAND = 4.5  # radii of arc length: nodes of one rope this near to each other are one strand
_MIN_SINE = math.sin(math.radians(35.0))  # sine of the angle of the flattest crossing
_MAX_PLANS = 40  # plans drawn
_MAX_LAYINGS = 12  # random orders of the crossings tried for each plan
_MAX_TRIES = 400  # pieces tried for a rope
_MAX_FAILURES = 10  # pieces that fail in a row before the rope is cut back
_MAX_CUT = 6  # pieces cut back at once, exclusive
_MAX_CROSSINGS = 20  # crossings that a caller may ask for
_MAX_ROPES = 8  # ropes that a caller may ask for
_MAX_RADIUS = 1.0  # metres


def random_ropes(
    crossings: int = 3, ropes: int = 1, radius: float = 0.0042, seed: int = 0
) -> tuple[Array, ...]:
    """Draw random ropes on the table z = 0 that cross a given number of times.

    Seen from above, the ropes are random bends. The function draws them again until they have the given
    number of crossings; a rope may cross itself or another one. The upper strand of each crossing is random
    too, so that knots occur. Strands touch at some crossings, but never cut through each other: their axes
    are at least 2 radii apart. No bend is tighter than 2.5 radii.

    Parameters
    ----------
    crossings : int
        Number of crossings, seen from above; at most 20.
    ropes : int
        Number of ropes; at most 8.
    radius : float
        The ropes' radius, metres; at most 1.
    seed : int
        Seed of the random numbers, not negative.

    Returns
    -------
    tuple of (M, 3) ndarray
        Nodes in the world frame, metres, from end to end, 1 mm or a quarter of the radius apart.

    Raises
    ------
    TypeError
        If `radius` is not a number, or another argument is not an integer.
    ValueError
        If an argument is out of range, or no draw has the given number of crossings.

    Examples
    --------
    >>> import strand
    >>> one, two = strand.synthetic.random_ropes(crossings=1, ropes=2, seed=0)
    >>> len(strand.Chain(one, radius=0.0042).points) == len(one)
    True
    """
    radius = check_positive("radius", radius, _MAX_RADIUS)
    crossings, ropes = (
        check_integer("crossings", crossings, 0, _MAX_CROSSINGS),
        check_integer("ropes", ropes, 1, _MAX_ROPES),
    )
    rng = np.random.default_rng(check_integer("seed", seed))
    chains: list[Array] | None = None
    for _ in range(_MAX_PLANS):
        drawn = _draw_plans(ropes, crossings, rng)
        if drawn is None:
            continue
        for _ in range(_MAX_LAYINGS):
            chains = _lay_plans(*drawn, rng)
            if chains is not None:
                break
        if chains is not None:
            break
    else:
        raise ValueError(
            f"crossings: no {ropes} ropes that cross {crossings} times were found; try another seed"
        )
    spacing = min(1e-3, 0.25 * radius)
    resampled = []
    for chain in chains:
        at = compute_arc_lengths(chain) * radius
        s = np.linspace(0.0, at[-1], math.ceil(at[-1] / spacing) + 1)
        resampled.append(np.stack([np.interp(s, at, chain[:, k] * radius) for k in range(3)], axis=1))
    all_nodes = np.concatenate(resampled)[:, :2]
    middle = 0.5 * (all_nodes.min(axis=0) + all_nodes.max(axis=0))
    for nodes in resampled:
        nodes[:, :2] -= middle
    return tuple(resampled)


def _draw_plans(
    ropes: int, crossings: int, rng: np.random.Generator
) -> tuple[list[Array], list[tuple[int, int, float]]] | None:
    """Return plane curves with a number of crossings, grown piece by piece; None if one cannot grow further.

    The result holds the (N, 2) nodes of each curve, in radii, and its crossings. A crossing is a pair of
    indices into all nodes, and the sine of the angle.
    """
    done = np.zeros((0, 2))
    met: list[tuple[int, int, float]] = []
    plans = []
    for rope in range(ropes):
        wanted = crossings if rope + 1 == ropes else int(rng.integers(0, crossings - len(met) + 1)) + len(met)
        least = rng.uniform(_MIN_LENGTH, 1.6 * _MIN_LENGTH)
        most = _MAX_LENGTH + _LENGTH_PER_CROSSING * (wanted - len(met))
        heading, bend = rng.uniform(0.0, 2.0 * np.pi), 0.0
        lean = rng.choice([-1.0, 1.0])
        nodes = rng.uniform(-18.0, 18.0, size=(1, 2))
        grown = [(len(nodes), len(met), heading, bend, 0.0)]
        tries, failures, tail = 0, 0, rng.uniform(4.0, 25.0)
        # `tail` keeps the last crossing away from the end
        while len(nodes) * _STEP < max(least, grown[-1][4] + tail) or len(met) < wanted:
            tries, failures = tries + 1, failures + 1
            if tries > _MAX_TRIES:
                return None
            if (failures > _MAX_FAILURES or len(nodes) * _STEP > most) and len(grown) > 1:
                # cut some pieces back
                failures = 0
                grown = grown[: -int(rng.integers(1, min(len(grown), _MAX_CUT)))]
                count, found_before, heading, bend, _ = grown[-1]
                nodes, met = nodes[:count], met[:found_before]
            lean = lean if rng.random() < 0.85 else -lean
            count = int(rng.uniform(8.0, 30.0) / _STEP)
            aim = lean * rng.uniform(0.0, 0.26)
            bends = np.interp(np.arange(count) * _STEP, [0.0, 4.0], [bend, aim])
            headings = heading + np.cumsum(bends) * _STEP
            steps = _STEP * np.stack([np.cos(headings), np.sin(headings)], axis=1)
            piece = nodes[-1] + np.cumsum(steps, axis=0)
            found = _find_crossings(np.vstack([done, nodes]), len(done), piece)
            if found is None or len(met) + len(found) > wanted:
                continue
            nodes, heading, bend = np.vstack([nodes, piece]), float(headings[-1]), float(bends[-1])
            met = met + found
            crossed = len(nodes) * _STEP if found else grown[-1][4]
            grown.append((len(nodes), len(met), heading, bend, crossed))
            failures = 0
        plans.append(nodes)
        done = np.vstack([done, nodes])
    return plans, met


def _find_crossings(before: Array, first: int, piece: Array) -> list[tuple[int, int, float]] | None:
    """Return the crossings of a new piece with earlier nodes; None if it comes too near to them elsewhere.

    `before` holds all earlier nodes. The nodes from index `first` on are those of the piece's own curve.
    """
    count = len(before)
    last = max(count - int(_SAME_STRAND / _STEP), first)
    old = before[:last] if last - first > 1 or first else before[:0]
    if len(old) < 2:
        return []
    path = np.vstack([before[-1:], piece])
    offset = path[:, None] - old[None]
    near = (offset**2).sum(axis=2) < _MIN_PLAN_DISTANCE**2
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
    # strands may be near each other only where they cross at a steep angle
    sine = np.abs(size[meet]) / _STEP**2
    if (sine < _MIN_SINE).any():
        return None
    pairs = list(zip(i[meet].tolist(), j[meet].tolist(), strict=True))
    for (a, b), flat in zip(pairs, sine.tolist(), strict=True):
        reach = int((_MIN_PLAN_DISTANCE + 1.0) / flat / _STEP) + 1
        near[max(a - reach, 0) : a + reach + 1, max(b - reach, 0) : b + reach + 1] = False
    if near.any():
        return None
    return [(count - 1 + a, b, flat) for (a, b), flat in zip(pairs, sine.tolist(), strict=True)]


def _lay_plans(
    plans: list[Array], met: list[tuple[int, int, float]], rng: np.random.Generator
) -> list[Array] | None:
    """Return ropes with strands lifted over each other; None if strands come too near or bend too sharply."""
    flat = np.concatenate(plans)
    number = np.repeat(np.arange(len(plans)), [len(plan) for plan in plans])
    at = np.concatenate([_STEP * np.arange(len(plan)) for plan in plans])
    top = [(i, j, sine) if rng.random() < 0.5 else (j, i, sine) for i, j, sine in met]
    z = np.ones(len(flat))
    for _ in range(8):
        bumps = np.zeros(len(flat))
        for over, under, sine in top:
            t = np.where(number == number[over], (at - at[over]) / (_RAMP + _RAMP_PER_SINE / sine), 2.0)
            rise = z[under] + _RISE - 1.0
            # the sum of fourth powers is a smooth maximum of the bumps
            bumps += (rise * np.clip(1.0 - t**2, 0.0, None) ** 3) ** 4
        z = 1.0 + bumps**0.25
        if z.max() > _MAX_HEIGHT:
            return None
    solid = np.column_stack([flat, z])
    near = ((solid[:, None] - solid[None]) ** 2).sum(axis=2) < _MIN_DISTANCE**2
    separate = (np.abs(at[:, None] - at[None]) > _SAME_STRAND) | (number[:, None] != number[None])
    if (near & separate).any():
        return None
    chains = [solid[number == k] for k in range(len(plans))]
    for chain in chains:
        steps = np.diff(chain, axis=0)
        lengths = np.linalg.norm(steps, axis=1)
        cosine = (steps[1:] * steps[:-1]).sum(axis=1) / (lengths[1:] * lengths[:-1])
        if (np.arccos(np.clip(cosine, -1.0, 1.0)) * _MIN_BEND > 0.5 * (lengths[1:] + lengths[:-1])).any():
            return None
    return chains
