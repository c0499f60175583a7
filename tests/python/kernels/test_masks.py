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


def test_pixels_that_differ_from_most_neighbours_are_odd(mask):
    padded = np.pad(mask, 2)
    most = ndimage.convolve(padded.astype(int), np.ones((3, 3), int), mode="constant") > 4
    steps = sum(np.count_nonzero(np.diff(padded, axis=axis)) for axis in (0, 1))
    assert _core.count_odd_pixels(mask) == (np.count_nonzero(most != padded), steps)


def test_pixels_beside_a_mask_have_depth_and_keep_their_distance(mask):
    depth = np.random.default_rng(1).uniform(size=mask.shape) - 0.2
    rows, columns, z = _core.select_beside(mask, depth, 200, 2, 1e6)
    corners = np.zeros((5, 5), bool)
    corners[::2, ::2] = True
    near = ndimage.binary_dilation(np.pad(mask, 2, mode="edge"), corners)[2:-2, 2:-2]
    expected = np.nonzero((depth > 0) & ~near)
    np.testing.assert_array_equal((rows, columns), expected)
    np.testing.assert_array_equal(z, depth[expected])


def test_pieces_beside_a_mask_are_those_of_scipy(mask):
    chosen = np.random.default_rng(2).uniform(size=mask.shape) < 0.3
    beyond = chosen & (ndimage.distance_transform_edt(~mask) > 1.5)
    numbers, count = ndimage.label(beyond, np.ones((3, 3)))
    expected = [
        numbers == k + 1 for k in range(count) if 2.0 < np.count_nonzero(numbers == k + 1) / 0.5 < 20.0
    ]
    found = _core.find_pieces_beside(chosen, mask, 1.5, 0.5, (2.0, 20.0), 3)
    whole = []
    for (row, column), piece in found:
        drawn = np.zeros_like(mask)
        drawn[row : row + piece.shape[0], column : column + piece.shape[1]] = piece
        whole.append(drawn)
    assert sorted(map(bytes, whole)) == sorted(map(bytes, expected))


def test_wrong_arguments():
    with pytest.raises(TypeError, match="mask: expected"):
        _core.number_blobs(np.zeros((3, 3)))
    with pytest.raises(ValueError, match="mask: expected"):
        _core.measure_edge_distances(np.zeros(3, bool), 4)
    with pytest.raises(ValueError, match="mask: expected"):
        _core.select_beside(np.zeros((3, 4), bool), np.ones((4, 3)), 2, 1, 10.0)
    with pytest.raises(ValueError, match="chosen: expected"):
        _core.find_pieces_beside(np.zeros((3, 4), bool), np.zeros((4, 3), bool), 1.0, 1.0, (0.0, 9.0), 1)
