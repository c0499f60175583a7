"""Random ropes."""

from __future__ import annotations

import numpy as np
import pytest

from shared.ropes import R
from strand import synthetic
from strand.synthetic import random_ropes


@pytest.mark.parametrize(("crossings", "ropes", "seed"), [(0, 1, 0), (2, 1, 1), (3, 2, 5), (4, 3, 2)])
def test_random_ropes_have_the_given_crossings_and_never_intersect(crossings, ropes, seed):
    chains = random_ropes(crossings, ropes, R, seed)
    assert len(chains) == ropes
    for again, chain in zip(random_ropes(crossings, ropes, R, seed), chains, strict=True):
        np.testing.assert_array_equal(again, chain)
    steps = [(k, i) for k, chain in enumerate(chains) for i in range(len(chain) - 1)]
    start = np.concatenate([chain[:-1] for chain in chains])
    step = np.concatenate([np.diff(chain, axis=0) for chain in chains])
    count = 0
    for i in range(len(steps)):
        j = np.arange(i + 2, len(steps))
        j = j[(start[j, 0] != start[i, 0]) & (np.abs(start[j, :2] - start[i, :2]).max(axis=1) < 0.004)]
        size = step[i, 0] * step[j, 1] - step[i, 1] * step[j, 0]
        apart = start[j, :2] - start[i, :2]
        with np.errstate(all="ignore"):
            t = (apart[:, 0] * step[j, 1] - apart[:, 1] * step[j, 0]) / size
            u = (apart[:, 0] * step[i, 1] - apart[:, 1] * step[i, 0]) / size
        count += int(((t >= 0) & (t < 1) & (u >= 0) & (u < 1)).sum())
    assert count == crossings
    thin = [chain[::3] for chain in chains]
    nodes, number = np.concatenate(thin), np.repeat(np.arange(ropes), [len(chain) for chain in thin])
    along = np.concatenate([np.arange(len(chain)) * 3e-3 for chain in thin])
    apart = np.linalg.norm(nodes[:, None] - nodes[None], axis=2)
    own = (number[:, None] == number[None]) & (np.abs(along[:, None] - along[None]) < 6.0 * R)
    assert apart[~own].min() > 1.9 * R


def test_impossible_numbers_are_refused():
    with pytest.raises(ValueError, match="crossings"):
        random_ropes(-1)
    with pytest.raises(ValueError, match="ropes"):
        random_ropes(1, 0)
    with pytest.raises(ValueError, match="radius"):
        random_ropes(1, 1, 0.0)


@pytest.mark.parametrize(
    ("argument", "value"),
    [("crossings", 10**9), ("ropes", 10**9), ("radius", 1e9), ("radius", 10**400), ("seed", -1)],
)
def test_absurd_numbers_are_refused_at_once(argument, value):
    with pytest.raises(ValueError, match=argument):
        synthetic.random_ropes(**{argument: value})
