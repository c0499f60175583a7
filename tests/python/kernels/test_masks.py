"""Blobs and distances of masks, against SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

import strand._core as _core


@pytest.fixture(params=range(6))
def mask(request):
    rng = np.random.default_rng(request.param)
    smooth = ndimage.gaussian_filter(rng.normal(size=(60, 90)), 0.5 + request.param)
    return smooth > np.quantile(smooth, 0.6)


def test_blobs_are_those_of_scipy(mask):
    found = _core.number_blobs(mask)
    expected, count = ndimage.label(mask, np.ones((3, 3)))
    assert set(np.unique(found)) == set(range(count + 1))
    # numbers may differ, blobs may not
    assert len(set(zip(found.ravel().tolist(), expected.ravel().tolist(), strict=True))) == count + 1
    assert not _core.number_blobs(np.zeros((3, 4), bool)).any()


def test_distances_are_those_of_scipy_up_to_the_greatest(mask):
    exact = ndimage.distance_transform_edt(mask)
    np.testing.assert_allclose(_core.measure_edge_distances(mask, 200), exact, atol=1e-5)
    found = _core.measure_edge_distances(mask, 3)
    near = exact <= 3.0
    np.testing.assert_allclose(found[near], exact[near], atol=1e-5)
    assert (found[~near] > 3.0).all()
    assert (_core.measure_edge_distances(np.ones((4, 5), bool), 7) > 7.0).all()
    for shape in ((0, 5), (4, 0), (0, 0)):
        assert _core.measure_edge_distances(np.ones(shape, bool), 7).shape == shape


def test_wrong_arguments():
    with pytest.raises(TypeError, match="mask: expected"):
        _core.number_blobs(np.zeros((3, 3)))
    with pytest.raises(ValueError, match="mask: expected"):
        _core.measure_edge_distances(np.zeros(3, bool), 4)
