"""Views of (H, W, 3) clouds."""

import numpy as np
import pytest

import strand


def test_an_organised_cloud_is_the_list_of_its_points():
    cloud = np.random.default_rng(0).uniform(0.1, 1.0, (4, 5, 3))
    colors = np.random.default_rng(1).uniform(size=(4, 5, 3))
    cloud[1, 2] = np.nan
    cloud[2, 3, 0] = np.inf
    cloud[0, 0] = 0.0
    view = strand.View(cloud, colors=colors)
    kept = np.isfinite(cloud).all(axis=2) & (cloud != 0).any(axis=2)
    np.testing.assert_array_equal(view.points, cloud[kept])
    np.testing.assert_array_equal(view.colors, colors[kept])
    assert view.dropped == 2
    with pytest.raises(ValueError, match=r"points: expected shape"):
        strand.View(np.zeros((4, 5, 2)))
    with pytest.raises(ValueError, match=r"colors: expected the shape"):
        strand.View(cloud, colors=colors[:3])
    with pytest.raises(TypeError, match="points"):
        strand.View(np.zeros((4, 5, 3), dtype=int))
