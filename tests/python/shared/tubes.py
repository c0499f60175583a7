"""Random tubes, and their distances by brute force."""

from __future__ import annotations

import numpy as np

import strand
from strand import Chain, Model

SEEDS = range(12)
NO_POSES = np.empty((0, 4, 4))


def draw_random_chain(rng, nodes=None):
    """Return a random walk of any radius, open or closed."""
    count = int(rng.integers(2, 40)) if nodes is None else nodes
    steps = 0.01 * rng.normal(size=3) + 0.006 * rng.normal(size=(count, 3))
    points = 0.03 * rng.normal(size=3) + np.cumsum(steps, axis=0)
    return Chain(points, rng.uniform(0.001, 0.012), count > 2 and bool(rng.integers(2)))


def draw_random_model(seed):
    rng = np.random.default_rng(seed)
    return Model(tuple(draw_random_chain(rng) for _ in range(int(rng.integers(1, 5)))), NO_POSES), rng


def _find_segments(chain):
    path = np.vstack([chain.points, chain.points[:1]]) if chain.closed else chain.points
    return path[:-1], np.diff(path, axis=0)


def measure_by_brute_force(chains, points):
    """Return (C, N) the distance of each point from each chain's surface."""
    answers = []
    for chain in chains:
        start, step = _find_segments(chain)
        share = ((points[:, None] - start) * step).sum(axis=2) / (step * step).sum(axis=1)
        feet = start + np.clip(share, 0.0, 1.0)[..., None] * step
        answers.append(np.linalg.norm(points[:, None] - feet, axis=2).min(axis=1) - chain.radius)
    return np.array(answers)


def place_along(starts, ends, times):
    """Return (T, N, 3) places on the ways from starts to ends."""
    return starts + np.asarray(times)[..., None] * (ends - starts)


def draw_near_nodes(model, rng, count, spread):
    """Return (count, 3) places around nodes of all chains."""
    nodes = np.concatenate([chain.points for chain in model.chains])
    return nodes[rng.integers(0, len(nodes), count)] + spread * rng.normal(size=(count, 3))


def draw_random_motion(rng):
    angle = strand.rotation_xyz(*rng.uniform(-np.pi, np.pi, 3))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = angle, rng.normal(size=3)
    return pose


def draw_rope_along_x(radius=0.005):
    return Model((Chain(np.linspace([-0.1, 0.0, 0.0], [0.1, 0.0, 0.0], 41), radius),), NO_POSES)
