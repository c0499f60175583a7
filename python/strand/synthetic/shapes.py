"""Rope shapes: centrelines of ropes that lie on a table, crossing over and under themselves.

A shape is drawn in the plane by a list of bends, laid on the table z = 0 and lifted by a smooth bump
where it passes over itself, so that no rope cuts through itself.
"""

from __future__ import annotations

import math

import numpy as np

from strand.support.checks import Array, check_positive

# A loose overhand knot and the ways to it and from it; its mirror image.
_OVERHAND = (
    (10.8, 40.0),
    (13.0, -154.0),
    (0.8, 0.0),
    (11.8, -92.0),
    (2.8, 0.0),
    (11.8, -92.0),
    (0.8, 0.0),
    (13.0, -154.0),
    (10.8, 40.0),
)
_MIRRORED = tuple((length, -turn) for length, turn in _OVERHAND)

# Plans of the shapes: pieces of (length, turn in degrees, left is positive), walked one after another.
# Lengths count relative to each other; for shapes that cross they are about radii where the rope is
# 95 radii long, as the published experiment's is.
_PLANS: dict[str, tuple[tuple[float, float], ...]] = {
    "straight": ((1.0, 0.0),),
    "arc": ((1.0, 200.0),),
    "s": ((1.0, 170.0), (1.0, -170.0)),
    "loop": ((30.0, -20.0), (32.0, 275.0), (30.0, -20.0)),
    "figure8": ((29.2, -12.0), (21.2, 284.0), (3.2, 0.0), (26.8, -196.0), (12.6, -12.0)),
    "overhand": ((8.5, 8.0), *_OVERHAND, (8.5, 8.0)),
    "paper": (
        (7.4, 6.0),
        (7.0, -40.0),  # where the bight will be laid round it, twice
        (5.8, 0.0),
        (15.7, 272.0),  # the bight
        (4.8, 0.0),
        (10.8, -152.0),  # under the rope, round it and over it
        (1.5, 0.0),
        (12.5, 35.0),  # the straight part
        (16.2, -281.0),  # the circle
        (10.8, 6.0),  # the end, over the rope
    ),
    "figure8_knot": (
        (4.9, 90.0),
        (15.1, 109.0),
        (4.2, 85.0),
        (12.4, 143.0),
        (20.7, 155.0),
        (12.4, 143.0),
        (4.2, 85.0),
        (15.1, 109.0),
        (4.9, 90.0),
    ),
    "granny": ((8.5, 8.0), *_OVERHAND, (8.5, 16.0), *_OVERHAND, (8.5, 8.0)),
    "square": ((8.5, 8.0), *_OVERHAND, (8.5, 0.0), *_MIRRORED, (8.5, -8.0)),
}

SHAPES = (
    "straight",
    "arc",
    "s",
    "coil",
    "loop",
    "figure8",
    "overhand",
    "paper",
    "figure8_knot",
    "granny",
    "square",
)
"""Names that `shape` knows."""

# lengths where none is given, at a radius of 4.2 mm, metres: of two knots, and of the others
_TWO_KNOTS, _USUAL = 0.72, 0.4

LONGEST = 1e3
"""The longest rope that is made, metres: nodes are 1 mm apart."""

# Shortest lengths, in radii, at which strands keep clear and no bend is sharper than 2.5 radii.
_SHORTEST = {
    "straight": 2.0,
    "arc": 12.0,
    "s": 20.0,
    "coil": 45.0,
    "loop": 50.0,
    "figure8": 70.0,
    "overhand": 70.0,
    "paper": 95.0,
    "figure8_knot": 92.0,
    "granny": 120.0,
    "square": 120.0,
}

_STEPS = 4000  # of a plan's walk
_ROUNDING = 0.02  # of the length: bends begin and end gradually over twice this
_LIFT = 2.1  # radii, between the axes where ropes cross: 2 would touch
_RAMP = 7.0  # radii, half the width of the bump over a rope
_SPIRAL_START = 4.0  # radii, the coil's innermost
_SPIRAL_PITCH = 2.6  # radii, between the coil's turns: a gap of 0.6 between surfaces


def shape(name: str, radius: float = 0.0042, length: float | None = None) -> Array:
    """Centreline of a rope in a known shape, resting on the table z = 0.

    The plan of a shape grows with `length`; the height at which the rope passes over itself and the
    way up there grow with `radius`, and so do the distances between a coil's turns, of which a longer
    rope has more. Where two strands cross, seen from above, the axis of the lower one is at
    z = radius and that of the upper one 2.1 radii higher. Along the rope it is under, over, under,
    over and so on. Places farther apart than pi * radius along the rope are never nearer than
    2 * radius to each other, and no bend of the axis has a radius under 2.5 * radius.

    - `straight`: a straight line.
    - `arc`: a bend by 200 degrees.
    - `s`: a bend to the left and one to the right.
    - `coil`: a flat spiral whose turns are 0.6 radii apart.
    - `loop`: a circle between two ends, closed over itself; 1 crossing.
    - `figure8`: two loops, one turning left and one right, the end over the start; 2 crossings.
    - `overhand`: a trefoil knot, lying loosely; 3 crossings.
    - `paper`: a bight laid round the rope, a straight part, a circle that closes over itself with the end
      overlapping; 3 crossings.
    - `figure8_knot`: a figure-eight knot, lying loosely; 4 crossings.
    - `granny`, `square`: two overhand knots one after the other, the second as the first or its mirror
      image, as the two halves of these knots are; 6 crossings.

    `paper` stands for the string of the published experiment, at the default radius and length. Its
    three crossings cannot hold both a true knot and a circle that closes over itself: the simplest
    knot takes three crossings and the circle takes one. So its knotted part is a bight laid round the
    rope, two crossings by turns under and over, which comes apart when pulled; `overhand` holds a
    true knot.

    Parameters
    ----------
    name : str
        One of `SHAPES`.
    radius : float
        The rope's radius, metres.
    length : float, optional
        Arc length of the axis from end to end, metres; 0.4 if not given, 0.72 of `granny` and `square`.

    Returns
    -------
    (M, 3) ndarray
        Nodes in the world frame, metres, end to end and evenly apart: by 1 mm, or by a quarter of the
        radius if that is finer. The middle of their extent in x and y is the origin.

    Raises
    ------
    TypeError
        If `radius` or `length` is not a number.
    ValueError
        If there is no such shape, `radius` or `length` is not positive, or `length` is too short for
        the shape at that radius.
    """
    return lay(name, radius, usual_length(name) if length is None else length, np.eye(2))


def usual_length(name: str) -> float:
    """Return how long a shape is if no length is given, at a radius of 4.2 mm, metres."""
    return _TWO_KNOTS if name in ("granny", "square") else _USUAL


def lay(name: str, radius: float, length: float, plane: Array) -> Array:
    """Return the shape as `shape` does, its plan sent through a linear map of the table plane first.

    Parameters
    ----------
    name, radius, length
        As in `shape`; the length is that of the mapped rope.
    plane : (2, 2) ndarray
        A rotation, a reflection or a stretch. What `shape` says of clearances and bends holds for
        stretches of up to 3 percent.

    Returns
    -------
    (M, 3) ndarray

    Raises
    ------
    TypeError, ValueError
        As `shape`.
    """
    if not isinstance(name, str) or name not in SHAPES:
        raise ValueError(f"name: expected one of {', '.join(SHAPES)}, got {name!r}")
    radius, length = check_positive("radius", radius), check_positive("length", length, LONGEST)
    shortest = _SHORTEST[name] * radius
    if length < shortest * (1.0 - 1e-9):
        raise ValueError(
            f"length: a rope of radius {radius:g} m needs at least {shortest:.4g} m "
            f"({_SHORTEST[name]:g} radii) for the shape {name!r}, got {length:g} m"
        )
    if name == "coil":
        flat = _spiral(radius, 1.1 * length) @ plane.T
        curve = np.column_stack([flat, np.full(len(flat), radius)])
    else:
        curve = _lift(_walk(_PLANS[name]) @ plane.T, radius, length)
    knots = arc_lengths(curve)
    count = math.ceil(length / min(1e-3, 0.25 * radius)) + 1
    at = np.linspace(0.0, length, count)
    nodes = np.stack([np.interp(at, knots, curve[:, k]) for k in range(3)], axis=1)
    nodes[:, :2] -= 0.5 * (nodes[:, :2].min(axis=0) + nodes[:, :2].max(axis=0))
    return nodes


def arc_lengths(points: Array) -> Array:
    """(N,) Arc length from the first of (N, 2) or (N, 3) points to each, along straight segments."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def _walk(pieces: tuple[tuple[float, float], ...]) -> Array:
    """(N, 2) Curve of length 1 that bends as the pieces say, with gradual changes of curvature."""
    lengths, turns = np.asarray(pieces).T
    ends = np.concatenate([[0.0], np.cumsum(lengths)]) / lengths.sum()
    headings = np.radians(np.concatenate([[0.0], np.cumsum(turns)]))
    # twice the running mean of the heading: its curvature has no jumps, its total turn stays
    box = np.full(round(_ROUNDING * _STEPS), 1.0 / round(_ROUNDING * _STEPS))
    kernel = np.convolve(box, box)
    margin = len(kernel) // 2
    middles = (np.arange(-margin, _STEPS + margin) + 0.5) / _STEPS
    heading = np.convolve(np.interp(middles, ends, headings), kernel, mode="valid")
    steps = np.stack([np.cos(heading), np.sin(heading)], axis=1) / _STEPS
    return np.vstack([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def _spiral(radius: float, length: float) -> Array:
    """(N, 2) Archimedean spiral from the inside outwards, of about the given length."""
    start, growth = _SPIRAL_START * radius, _SPIRAL_PITCH * radius / (2.0 * np.pi)
    last = (math.sqrt(start**2 + 2.0 * growth * length) - start) / growth
    angle = np.linspace(0.0, last, max(_STEPS, math.ceil(20.0 * length / radius)))
    reach = start + growth * angle
    return np.stack([reach * np.cos(angle), reach * np.sin(angle)], axis=1)


def _lift(flat: Array, radius: float, length: float) -> Array:
    """(N, 3) Lay a plan of any size on the table and over itself, scaled to the given length."""
    at = arc_lengths(flat)
    flat, at = flat / at[-1], at / at[-1]
    over = np.sort(_passes(flat, at))[1::2]
    size = length
    # the way up and down adds to the length by an amount that hardly depends on the plan's size
    for _ in range(8):
        t = (at[:, None] - over) * (size / (_RAMP * radius))
        bumps = np.clip(1.0 - t**2, 0.0, None) ** 3
        curve = np.column_stack([flat * size, radius * (1.0 + _LIFT * bumps.sum(axis=1))])
        size += length - arc_lengths(curve)[-1]
    return curve


def _passes(flat: Array, at: Array) -> Array:
    """Arc lengths at which a plane curve meets itself, two for each crossing."""
    thin = slice(None, None, 8)
    points, at = flat[thin], at[thin]
    start, step = points[:-1], np.diff(points, axis=0)

    def cross(a: Array, b: Array) -> Array:
        return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])

    # segments i and j meet at start_i + t step_i = start_j + u step_j
    i, j = np.triu_indices(len(step), k=2)
    apart, size = start[j] - start[i], cross(step[i], step[j])
    with np.errstate(divide="ignore", invalid="ignore"):
        t, u = cross(apart, step[j]) / size, cross(apart, step[i]) / size
    # between parallel segments, as in a straight part, t and u are noise
    meet = (t >= 0) & (t < 1) & (u >= 0) & (u < 1) & (np.abs(size) > 1e-6 * at[1] ** 2)
    i, j, t, u = i[meet], j[meet], t[meet], u[meet]
    return np.concatenate([at[i] + t * (at[i + 1] - at[i]), at[j] + u * (at[j + 1] - at[j])])
