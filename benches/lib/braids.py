"""Chains that hold known knots of up to seven crossings: closed braids, cut open and distorted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# by name: the braid whose closure is the right-handed knot (KnotInfo), and whether its mirror image differs
BRAIDS: dict[str, tuple[tuple[int, ...], bool]] = {
    "0_1": ((1, -2), False),
    "3_1": ((1, 1, 1), True),
    "4_1": ((1, -2, 1, -2), False),
    "5_1": ((1, 1, 1, 1, 1), True),
    "5_2": ((1, 1, 1, 2, -1, 2), True),
    "6_1": ((1, 1, 2, -1, -3, 2, -3), True),
    "6_2": ((1, 1, 1, -2, 1, -2), True),
    "6_3": ((1, 1, -2, 1, -2, -2), False),
    "7_1": ((1, 1, 1, 1, 1, 1, 1), True),
    "7_2": ((1, 1, 1, 2, -1, 2, 3, -2, 3), True),
    "7_3": ((1, 1, 1, 1, 1, 2, -1, 2), True),
    "7_4": ((1, 1, 2, -1, 2, 2, 3, -2, 3), True),
    "7_5": ((1, 1, 1, 1, 2, -1, 2, 2), True),
    "7_6": ((1, 1, -2, 1, 3, -2, 3), True),
    "7_7": ((1, -2, 1, -2, 3, -2, 3), True),
    # composite knots
    "granny": ((1, 1, 1, 2, 2, 2), True),
    "square": ((1, 1, 1, -2, -2, -2), False),
    "3_1#4_1": ((1, 1, 1, 2, -3, 2, -3), True),
}
COMPOSITE = {"granny": "3_1#3_1", "square": "3_1#3_1"}


def make_closed_braid(word: tuple[int, ...], steps: int = 24) -> Array:
    """Return (N, 3) nodes of a braid closed about the z axis. Strands are a unit apart."""
    strands = max(abs(letter) for letter in word) + 1
    turn = (1 - np.cos(np.pi * np.arange(steps) / steps)) / 2
    bump = np.sin(np.pi * np.arange(steps) / steps) ** 2
    position, nodes = 0, []
    for _ in range(strands):
        for k, letter in enumerate(word):
            low = abs(letter) - 1
            rise, height = np.zeros(steps), np.zeros(steps)
            if position == low:
                rise, height, after = turn, np.sign(letter) * bump / 2, low + 1
            elif position == low + 1:
                rise, height, after = -turn, -np.sign(letter) * bump / 2, low
            else:
                after = position
            angle = 2 * np.pi * (k + np.arange(steps) / steps) / len(word)
            radius = 2.0 + position + rise
            nodes.append(np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1))
            position = after
    return np.concatenate(nodes)


def resampled(nodes: Array, count: int) -> Array:
    """Return (count, 3) nodes evenly spaced along a polyline, from end to end."""
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(nodes, axis=0), axis=1))])
    at = np.linspace(0.0, arc[-1], count)
    return np.stack([np.interp(at, arc, nodes[:, k]) for k in range(3)], axis=1)


def make_smooth_noise(count: int, rng: np.random.Generator) -> Array:
    """Return (count, 3) a smooth random displacement with standard deviation 1."""
    phase = np.linspace(0.0, 2 * np.pi, count)
    waves = np.arange(1, 25)
    angles = waves[:, None] * phase[:, None, None] + rng.uniform(0, 2 * np.pi, (len(waves), 3))[None]
    return np.asarray(np.sin(angles).sum(axis=1) / np.sqrt(len(waves) / 2))


def make_knotted_chain(name: str, mirror: bool, nodes: int, rng: np.random.Generator) -> Array:
    """Return (nodes, 3) an open chain that holds a knot of `BRAIDS`, about a metre large."""
    ring = make_closed_braid(BRAIDS[name][0])
    ring[:, 2] *= -2.0 if mirror else 2.0
    ring = np.roll(ring, rng.integers(len(ring)), axis=0)
    gap = rng.uniform(0.003, 0.01)
    chain = resampled(ring[: int((1 - gap) * len(ring))], nodes)
    chain += rng.uniform(0.02, 0.08) * make_smooth_noise(nodes, rng)
    stretch = np.exp(rng.uniform(-0.4, 0.4, 3))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    chain = chain * stretch @ turn.T / 8.0
    if rng.random() < 0.5:
        chain = chain[::-1]
    return np.ascontiguousarray(chain)


def make_knots(count: int, nodes: int, seed: int) -> list[tuple[str, str | None, Array]]:
    """Return names, chiralities and chains: the knots of `BRAIDS` by turns, mirrored by chance."""
    found = []
    for k in range(count):
        rng = np.random.default_rng((seed, k))
        name = list(BRAIDS)[k % len(BRAIDS)]
        mirror = bool(rng.random() < 0.5)
        hand = ("left" if mirror else "right") if BRAIDS[name][1] else None
        found.append((COMPOSITE.get(name, name), hand, make_knotted_chain(name, mirror, nodes, rng)))
    return found
