"""Where another way to explain the images differs from the best one."""

from __future__ import annotations

import numpy as np

from strand.images.doubts import _difference

RADIUS = 0.004


def test_a_rival_is_named_where_it_is_farthest_away_or_joined_otherwise():
    # more nodes than are compared at a time
    nodes = np.arange(1300)[:, None] * [0.5 * RADIUS, 0.0, 0.0]
    assert _difference([nodes], [nodes + 0.1 * RADIUS], RADIUS) is None
    away = nodes.copy()
    away[690:711, 1] = (10.0 - np.abs(np.arange(-10, 11))) * RADIUS
    assert np.array_equal(_difference([nodes], [away], RADIUS), nodes[700])
    # the same places, in another order
    halves = np.vstack([nodes[1000:], nodes[:1000]])
    assert np.array_equal(_difference([nodes], [halves], RADIUS), nodes[999])
    assert np.array_equal(_difference([nodes], [nodes[:600], nodes[600:]], RADIUS), nodes[599])
