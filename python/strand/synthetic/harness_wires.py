"""Bundles as they look: wires side by side on a table, and ties around them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from strand.support.checks import Array
from strand.synthetic.harness_plans import STEP, Piece, find_heading

Tube = tuple[Array, float]
"""Nodes (M, 3) and a radius, metres."""

_SIDE = 2.02  # radii between the axes of wires side by side
_SMOOTH = 4.0  # radii: deviation of the Gaussian that smooths a wire where its bundle parts
_AROUND = 8.0  # radii around a junction in which it does; at twice as many it has no effect
_TIE = 1.2  # radii of a tie, in those of a wire
_BETWEEN_TIES = (0.025, 0.045)  # metres: range of the distance of ties
_LOOP = (0.08, 0.12)  # metres: range of a loop's length
_TAIL = (0.1, 0.16)  # metres: range of a tail's length


def lay_wires(rng: np.random.Generator, pieces: Sequence[Piece], radius: float) -> list[Tube]:
    """Return the wires of a tree side by side on the table, each whole, and the ties."""
    after: dict[int, list[Piece]] = {}
    for piece in pieces:
        after.setdefault(piece.start, []).append(piece)
    into = {piece.stop: piece for piece in pieces}

    def list_ends(piece: Piece) -> list[tuple[int, int]]:
        """Return each wire of an edge as its end and its number there, from the left to the right."""
        followers = after.get(piece.stop, [])
        if not followers:
            return [(piece.stop, number) for number in range(piece.wires or 1)]
        heading = find_heading(piece.line)
        leftmost = sorted(followers, key=lambda one: -_turn(find_start(one.line) - heading))
        return [wire for one in leftmost for wire in list_ends(one)]

    slots = {piece.stop: list_ends(piece) for piece in pieces}
    junctions = np.array([piece.line[-1, :2] for piece in pieces if piece.stop in after]).reshape(-1, 2)
    tubes: list[Tube] = []
    for wire in slots[pieces[0].stop]:
        parts, node = [], wire[0]
        while node in into:
            piece, row = into[node], slots[node]
            aside = (0.5 * (len(row) - 1) - row.index(wire)) * _SIDE * radius
            parts.append(piece.line[:, :2] + aside * _find_left(piece.line))
            node = piece.start
        tubes.append((_smooth(np.concatenate(parts[::-1]), radius, junctions), radius))
    for piece in pieces:
        s, at = rng.uniform(*_BETWEEN_TIES), piece.at
        while piece.wires != 1 and s < at[-1] - 0.5 * _BETWEEN_TIES[0]:
            tubes.append(_make_tie(piece.line, int(np.searchsorted(at, s)), piece.wires or 1, radius))
            s += rng.uniform(*_BETWEEN_TIES)
        if piece.stop in after:
            tubes.append(_make_tie(piece.line, len(piece.line) - 2, piece.wires or 1, radius))
    return tubes


def tie_loop(rng: np.random.Generator, radius: float) -> tuple[list[Piece], list[Tube]]:
    """Return a wire that one tie holds to itself: its graph, and the wire with the tie."""
    t = np.linspace(0.0, 2.0 * np.pi, 200)
    length, width = rng.uniform(*_LOOP), rng.uniform(0.6, 0.9)
    loop = np.stack([0.5 * (1.0 - np.cos(t)), 0.5 * width * np.sin(t) * (1.0 - np.cos(t))], axis=1) * length
    beside = 0.5 * _SIDE * radius
    loop[:, 1] += beside * np.cos(0.5 * t)
    tails = []
    for side in (1.0, -1.0):
        s = np.linspace(0.0, rng.uniform(*_TAIL), 60)
        tails.append(np.stack([-s, side * (beside + rng.uniform(2.0, 5.0) * s * s)], axis=1))
    turn = rng.uniform(-math.pi, math.pi)
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    lines = [line @ rotation.T for line in (tails[0][::-1], loop, tails[1])]
    wire = np.concatenate([lines[0][:-1], lines[1], lines[2][1:]])
    tubes = [(_smooth(wire, radius, np.empty((0, 2))), radius)]
    tie = np.array([[-STEP, 0.0], [0.0, 0.0], [STEP, 0.0]]) @ rotation.T
    tubes.append(_make_tie(tie, 1, 2, radius))
    # the graph's edges share the middle of the tie
    for line, ends in zip(lines, ((False, True), (True, True), (True, False)), strict=True):
        s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
        for away, is_end in ((s, ends[0]), (s[-1] - s, ends[1])):
            if is_end:
                line -= np.outer(np.clip(1.0 - away / (6.0 * radius), 0.0, None), line[np.argmin(away)])
    pieces = [
        Piece(a, b, line, radius, 1) for (a, b), line in zip(((0, 1), (1, 1), (1, 2)), lines, strict=True)
    ]
    return pieces, tubes


def find_start(line: Array) -> float:
    """Return the heading at the start of a line, radians."""
    return math.atan2(*(line[1] - line[0])[[1, 0]])


def _turn(angle: float) -> float:
    """Return an angle between -pi and pi."""
    return math.remainder(angle, 2.0 * math.pi)


def _find_left(line: Array) -> Array:
    """Return the (M, 2) unit vectors to the left of a line."""
    along = np.gradient(line[:, :2], axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return np.stack([-along[:, 1], along[:, 0]], axis=1)


def _smooth(line: Array, radius: float, junctions: Array) -> Array:
    """Return a wire on the table along a line, evenly spaced, and smoothed near (J, 2) junctions."""
    s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    spacing = 0.5 * STEP
    even = np.arange(0.0, s[-1], spacing)
    wide = int(4.0 * _SMOOTH * radius / spacing)
    kernel = np.exp(-0.5 * (np.arange(-wide, wide + 1) * spacing / (_SMOOTH * radius)) ** 2)
    smooth = np.full((len(even), 3), radius)
    for k in range(2):
        values = np.interp(even, s, line[:, k])
        # mirrored through the ends, which stay where they are
        padded = np.concatenate(
            [2 * values[0] - values[wide:0:-1], values, 2 * values[-1] - values[-2 : -wide - 2 : -1]]
        )
        smooth[:, k] = np.convolve(padded, kernel / kernel.sum(), "valid")
    exact = np.stack([np.interp(even, s, line[:, k]) for k in range(2)], axis=1)
    away = np.linalg.norm(exact[:, None] - junctions, axis=2).min(axis=1, initial=np.inf)
    share = np.clip(2.0 - away / (_AROUND * radius), 0.0, 1.0)[:, None]
    smooth[:, :2] = share * smooth[:, :2] + (1.0 - share) * exact
    return smooth


def _make_tie(line: Array, node: int, wires: int, radius: float) -> Tube:
    """Return a tie across a bundle: a bar that is a little thicker than a wire."""
    half = (0.5 * (wires - 1) * _SIDE + 1.0) * radius
    across = np.outer(np.linspace(-half, half, 5), _find_left(line)[node])
    return np.column_stack([line[node, :2] + across, np.full(5, _TIE * radius)]), _TIE * radius
