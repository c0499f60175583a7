"""Named rope shapes: centrelines of ropes that lie on a table and cross themselves.

A list of bends draws a shape in the plane. The shape lies on the table z = 0, and a smooth bump lifts it
where it passes over itself, so that the rope does not cut through itself.
"""

from __future__ import annotations

import math

import numpy as np

from strand.support.checks import Array, check_positive

# a loose overhand knot with its two ends: (length, turn in degrees) of each piece
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
_MIRRORED_OVERHAND = tuple((length, -turn) for length, turn in _OVERHAND)

# Plans of the shapes: (length, turn in degrees) of the pieces in order; left turns are positive. Only the
# ratios of lengths count. For shapes with crossings, the numbers are radii of a rope of 95 radii, as in the
# published experiment.
_PLANS: dict[str, tuple[tuple[float, float], ...]] = {
    "straight": ((1.0, 0.0),),
    "arc": ((1.0, 200.0),),
    "s": ((1.0, 170.0), (1.0, -170.0)),
    "loop": ((30.0, -20.0), (32.0, 275.0), (30.0, -20.0)),
    "figure8": ((29.2, -12.0), (21.2, 284.0), (3.2, 0.0), (26.8, -196.0), (12.6, -12.0)),
    "overhand": ((8.5, 8.0), *_OVERHAND, (8.5, 8.0)),
    "paper": (
        (7.4, 6.0),
        (7.0, -40.0),  # the bight will cross this piece twice
        (5.8, 0.0),
        (15.7, 272.0),  # the bight
        (4.8, 0.0),
        (10.8, -152.0),  # under the rope, around it and over it
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
    "square": ((8.5, 8.0), *_OVERHAND, (8.5, 0.0), *_MIRRORED_OVERHAND, (8.5, -8.0)),
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
"""The names of shapes."""

_DEFAULT_LENGTH = 0.4  # metres, at a radius of 4.2 mm
_TWO_KNOT_LENGTH = 0.72  # metres, at a radius of 4.2 mm: default of shapes with two knots

LONGEST = 1e3
"""Largest length of a rope, metres; its nodes are 1 mm apart."""

# radii: shortest lengths at which strands do not touch and no bend is tighter than 2.5 radii
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

_STEPS = 4000  # steps along a plan
_ROUNDING = 0.02  # fraction of the length: a bend begins and ends gradually over twice this
_LIFT = 2.1  # radii: distance between the axes at a crossing; at 2 the strands would touch
_RAMP = 7.0  # radii: half the width of the bump over a strand
_SPIRAL_START = 4.0  # radii: inner radius of the coil
_SPIRAL_PITCH = 2.6  # radii: distance between the coil's turns, which leaves a gap of 0.6


def shape(name: str, radius: float = 0.0042, length: float | None = None) -> Array:
    """Return the centreline of a rope in a named shape, lying on the table z = 0.

    - `straight`: a straight line.
    - `arc`: a bend of 200 degrees.
    - `s`: a bend to the left and one to the right.
    - `coil`: a flat spiral with gaps of 0.6 radii between its turns.
    - `loop`: a circle that closes over itself; 1 crossing.
    - `figure8`: two loops, one to the left and one to the right, the end over the start; 2 crossings.
    - `overhand`: a loose trefoil knot; 3 crossings.
    - `paper`: a bight around the rope, a straight part, and a circle that closes over itself; 3 crossings.
    - `figure8_knot`: a loose figure-eight knot; 4 crossings.
    - `granny`, `square`: two overhand knots in a row, equal (granny) or mirrored (square); 6 crossings.

    A longer rope has a larger plan; a longer coil has more turns. Heights, ramps and the gaps of a coil
    depend on `radius` only.

    Along the rope, crossings alternate between under and over. The axis of the lower strand is at z = radius,
    that of the upper one 2.1 radii higher. Places more than pi * radius apart along the rope are at least
    2 * radius apart in space. No bend of the axis has a radius below 2.5 * radius.

    `paper` imitates the string of the published experiment, at the default radius and length. A true knot
    and a circle would take four crossings, and the string has three. Its knotted part is therefore a bight,
    which comes apart when pulled. `overhand` is a true knot.

    Parameters
    ----------
    name : str
        One of `SHAPES`.
    radius : float
        The rope's radius, metres.
    length : float, optional
        Arc length of the axis from end to end, metres; 0.4 by default, 0.72 for `granny` and `square`.

    Returns
    -------
    (M, 3) ndarray
        Nodes in the world frame, metres, from end to end. Their spacing is even: 1 mm, or a quarter of the
        radius if that is smaller. The middle of their extent in x and y is the origin.

    Raises
    ------
    TypeError
        If `radius` or `length` is not a number.
    ValueError
        If there is no such shape, `radius` or `length` is not positive, or `length` is too short for
        the shape at that radius.

    Examples
    --------
    >>> import strand
    >>> nodes = strand.synthetic.shape("overhand")
    >>> strand.knot(nodes).name
    '3_1'
    """
    return lay_shape(name, radius, default_length(name) if length is None else length, np.eye(2))


def default_length(name: str) -> float:
    """Return the default length of a shape at a radius of 4.2 mm, metres."""
    return _TWO_KNOT_LENGTH if name in ("granny", "square") else _DEFAULT_LENGTH


def lay_shape(name: str, radius: float, length: float, plane: Array) -> Array:
    """Return the nodes of `shape`, with a (2, 2) linear map of its plan in the table plane.

    The length is that of the mapped rope. The clearances and bends of `shape` hold for rotations, reflections
    and stretches of up to 3 percent.
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
        flat = _draw_spiral(radius, 1.1 * length) @ plane.T
        curve = np.column_stack([flat, np.full(len(flat), radius)])
    else:
        curve = _lift_crossings(_draw_plan(_PLANS[name]) @ plane.T, radius, length)
    along = compute_arc_lengths(curve)
    count = math.ceil(length / min(1e-3, 0.25 * radius)) + 1
    at = np.linspace(0.0, length, count)
    nodes = np.stack([np.interp(at, along, curve[:, k]) for k in range(3)], axis=1)
    nodes[:, :2] -= 0.5 * (nodes[:, :2].min(axis=0) + nodes[:, :2].max(axis=0))
    return nodes


def compute_arc_lengths(points: Array) -> Array:
    """Return the (N,) arc lengths from the first of (N, 2) or (N, 3) points, along straight segments."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def _draw_plan(pieces: tuple[tuple[float, float], ...]) -> Array:
    """Return an (N, 2) curve of length 1 with these pieces and gradual changes of curvature."""
    lengths, turns = np.asarray(pieces).T
    ends = np.concatenate([[0.0], np.cumsum(lengths)]) / lengths.sum()
    headings = np.radians(np.concatenate([[0.0], np.cumsum(turns)]))
    # a running mean of the heading, twice: the curvature has no jumps, and the total turn stays
    box = np.full(round(_ROUNDING * _STEPS), 1.0 / round(_ROUNDING * _STEPS))
    kernel = np.convolve(box, box)
    margin = len(kernel) // 2
    middles = (np.arange(-margin, _STEPS + margin) + 0.5) / _STEPS
    heading = np.convolve(np.interp(middles, ends, headings), kernel, mode="valid")
    steps = np.stack([np.cos(heading), np.sin(heading)], axis=1) / _STEPS
    return np.vstack([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def _draw_spiral(radius: float, length: float) -> Array:
    """Return an (N, 2) Archimedean spiral from the inside outwards, of about the given length."""
    start, growth = _SPIRAL_START * radius, _SPIRAL_PITCH * radius / (2.0 * np.pi)
    last = (math.sqrt(start**2 + 2.0 * growth * length) - start) / growth
    angle = np.linspace(0.0, last, max(_STEPS, math.ceil(20.0 * length / radius)))
    reach = start + growth * angle
    return np.stack([reach * np.cos(angle), reach * np.sin(angle)], axis=1)


def _lift_crossings(flat: Array, radius: float, length: float) -> Array:
    """Return (N, 3) points: a plan of any size laid on the table and over itself, with the given length."""
    at = compute_arc_lengths(flat)
    flat, at = flat / at[-1], at / at[-1]
    over = np.sort(_find_self_crossings(flat, at))[1::2]
    size = length
    # the bumps add a length that hardly depends on the plan's size
    for _ in range(8):
        t = (at[:, None] - over) * (size / (_RAMP * radius))
        bumps = np.clip(1.0 - t**2, 0.0, None) ** 3
        curve = np.column_stack([flat * size, radius * (1.0 + _LIFT * bumps.sum(axis=1))])
        size += length - compute_arc_lengths(curve)[-1]
    return curve


def _find_self_crossings(flat: Array, at: Array) -> Array:
    """Return the arc lengths at which a plane curve crosses itself, two per crossing."""
    thin = slice(None, None, 8)
    points, at = flat[thin], at[thin]
    start, step = points[:-1], np.diff(points, axis=0)

    def cross(a: Array, b: Array) -> Array:
        return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])

    # segments i and j meet at start_i + t step_i = start_j + u step_j
    i, j = np.triu_indices(len(step), k=2)
    offset, size = start[j] - start[i], cross(step[i], step[j])
    with np.errstate(divide="ignore", invalid="ignore"):
        t, u = cross(offset, step[j]) / size, cross(offset, step[i]) / size
    # for parallel segments, as in a straight part, t and u are noise
    meet = (t >= 0) & (t < 1) & (u >= 0) & (u < 1) & (np.abs(size) > 1e-6 * at[1] ** 2)
    i, j, t, u = i[meet], j[meet], t[meet], u[meet]
    return np.concatenate([at[i] + t * (at[i + 1] - at[i]), at[j] + u * (at[j + 1] - at[j])])
