"""Numbers at the boundary of the kernels, too little data, and clouds without a shape."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import strand
from shared.kernel_calls import assert_same, list_arrays, make_axis_normals, make_lattice
from strand import (
    NotEnoughDataError,
    StrandError,
    _core,
    centerline,
    count_neighbors,
    estimate_normals,
    icp,
    radius_outlier_mask,
    trace_chains,
)


@pytest.mark.parametrize("bad", [0.0, -0.5, np.nan, np.inf, -np.inf, 1e100])
def test_lengths_are_positive(bad):
    points, normals = make_lattice(), make_axis_normals()
    expected = "expected a positive number below 1e100, got "
    for function in (
        lambda: radius_outlier_mask(points, bad, 3),
        lambda: count_neighbors(points, bad),
        lambda: estimate_normals(points, radius=bad),
        lambda: centerline(points, normals, bad, 3),
    ):
        with pytest.raises(ValueError, match=f"^radius: {expected}"):
            function()
    with pytest.raises(ValueError, match=f"^max_correspondence_distance: {expected}"):
        icp(points, points, bad)
    with pytest.raises(ValueError, match=f"^near: {expected}"):
        trace_chains(points, bad, 0.5)
    with pytest.raises(ValueError, match=f"^far: {expected}"):
        trace_chains(points, 0.25, bad)


@pytest.mark.parametrize("bad", ["0.5", None, [0.5], 1j, object(), True, np.complex128(1), np.ones(1)])
def test_lengths_are_numbers(bad):
    points, normals = make_lattice(), make_axis_normals()
    for name, function in [
        ("radius", lambda: radius_outlier_mask(points, bad, 3)),
        ("radius", lambda: count_neighbors(points, bad)),
        ("radius", lambda: estimate_normals(points, radius=bad) if bad else count_neighbors(points, bad)),
        ("radius", lambda: centerline(points, normals, bad, 3)),
        ("max_correspondence_distance", lambda: icp(points, points, bad)),
        ("tolerance", lambda: icp(points, points, 1.0, tolerance=bad or "none")),
        ("near", lambda: trace_chains(points, bad, 0.5)),
        ("far", lambda: trace_chains(points, 0.25, bad)),
    ]:
        with pytest.raises(TypeError, match=f"^{name}: expected a number, got "):
            function()


COUNTS = [
    ("min_neighbors", lambda n: radius_outlier_mask(make_lattice(), 0.5, n)),
    ("min_neighbors", lambda n: centerline(make_lattice(), make_axis_normals(), 0.25, n)),
    ("k", lambda n: estimate_normals(make_lattice(), n)),
    ("max_iterations", lambda n: icp(make_lattice(), make_lattice(), 0.5, max_iterations=n)),
    ("start", lambda n: trace_chains(make_lattice(), 0.25, 0.5, start=n)),
    ("threads", lambda n: strand.set_num_threads(n)),
]


@pytest.mark.parametrize(("name", "function"), COUNTS)
def test_counts_are_whole_numbers_and_not_negative(name, function):
    for bad in (3.0, 2.5, np.float64(3), "3", [3], True, np.True_, np.array([3])):
        with pytest.raises(TypeError, match=f"^{name}: expected a whole number, got "):
            function(bad)
    for bad in (-1, np.int64(-7)):
        with pytest.raises(ValueError, match=f"^{name}: expected a number >= 0, got {bad}"):
            function(bad)
    for bad in (2**63, 10**30, -(10**30), np.uint64(2**64 - 1)):
        with pytest.raises(ValueError, match=f"^{name}: expected a number >= 0 and below 2.63"):
            function(bad)


def test_numpy_scalars_are_numbers_too():
    points = make_lattice()
    assert_same(
        radius_outlier_mask(points, np.float32(0.5), np.uint8(5)), radius_outlier_mask(points, 0.5, 5)
    )
    assert_same(radius_outlier_mask(points, np.array(0.5), np.array(5)), radius_outlier_mask(points, 0.5, 5))
    assert_same(
        trace_chains(points, np.float16(0.25), 1, start=np.int64(3)), trace_chains(points, 0.25, 1.0, start=3)
    )


def test_neighbours_of_normals_are_given_one_way():
    for arguments in ({}, {"k": 5, "radius": 0.5}):
        with pytest.raises(TypeError, match=r"^expected exactly one of k and radius"):
            estimate_normals(make_lattice(), **arguments)
    for k in (0, 1, 2):
        with pytest.raises(ValueError, match=f"^k: expected at least 3 neighbours, got {k}"):
            estimate_normals(make_lattice(), k)


def test_ranges_of_tracing_and_registration():
    points = make_lattice()
    for near, far in ((0.5, 0.5), (0.5, 0.25)):
        with pytest.raises(ValueError, match=r"^far: expected more than near = 0.5, got 0"):
            trace_chains(points, near, far)
    with pytest.raises(ValueError, match=r"^start: expected an index below 120, got 120"):
        trace_chains(points, 0.25, 0.5, start=120)
    for tolerance in (-1e-9, np.nan):
        with pytest.raises(ValueError, match=r"^tolerance: expected a number >= 0"):
            icp(points, points, 1.0, tolerance=tolerance)


@pytest.mark.parametrize(
    "start",
    [
        np.diag([1.0, 1.0, -1.0, 1.0]),
        np.diag([1.1, 1.1, 1.1, 1.0]),
        np.diag([1.0, 1.0, 1.0, 2.0]),
        np.eye(4) + np.eye(4, k=1) * 0.1,
        np.zeros((4, 4)),
    ],
)
def test_a_start_that_is_no_rigid_motion_is_refused(start):
    with pytest.raises(ValueError, match=r"^start: expected a rigid motion, but its "):
        icp(make_lattice(), make_lattice(), 1.0, start=start)


def test_errors_have_a_common_base():
    assert issubclass(NotEnoughDataError, StrandError)
    assert issubclass(StrandError, Exception)
    assert not issubclass(StrandError, ValueError)


def test_empty_clouds():
    none = np.zeros((0, 3))
    assert radius_outlier_mask(none, 1.0, 3).shape == (0,)
    assert count_neighbors(none, 1.0).shape == (0,)
    for neighbors in ({"k": 5}, {"radius": 1.0}):
        normals, variation = estimate_normals(none, **neighbors, viewpoint=none, variation=True)
        assert (normals.shape, variation.shape) == ((0, 3), (0,))
    axis, indices = centerline(none, none, 1.0, 3)
    assert (axis.shape, indices.shape) == ((0, 3), (0,))
    assert trace_chains(none, 1.0, 2.0) == []
    with pytest.raises(ValueError, match=r"^start: "):
        trace_chains(none, 1.0, 2.0, start=0)
    for source, target, name in ((none, make_lattice(), "source"), (make_lattice(), none, "target")):
        with pytest.raises(NotEnoughDataError, match=f"^{name}: expected at least one point"):
            icp(source, target, 1.0)


def test_a_cloud_that_dropping_empties():
    nothing = np.full((5, 3), np.nan)
    assert not radius_outlier_mask(nothing, 1.0, 0, nonfinite="drop").any()
    np.testing.assert_array_equal(estimate_normals(nothing, 3, nonfinite="drop"), np.zeros((5, 3)))
    assert len(centerline(nothing, nothing, 1.0, 0, nonfinite="drop")[0]) == 0
    assert trace_chains(nothing, 1.0, 2.0, nonfinite="drop") == []
    with pytest.raises(NotEnoughDataError, match=r"^source: "):
        icp(nothing, make_lattice(), 1.0, nonfinite="drop")


def test_fewer_points_than_neighbours_asked_for():
    with pytest.raises(
        NotEnoughDataError, match=r"^points: 4 points, fewer than the k = 5 neighbours asked for"
    ):
        estimate_normals(make_lattice(4), 5)
    # finite ones count
    points = make_lattice(6)
    points[:2] = np.nan
    with pytest.raises(NotEnoughDataError, match=r"^points: 4 points"):
        estimate_normals(points, 5, nonfinite="drop")
    assert estimate_normals(make_lattice(5), 5).shape == (5, 3)


def test_all_points_equal():
    points, normals = np.full((500, 3), 0.3), np.tile([0.0, 0.0, 1.0], (500, 1))
    assert radius_outlier_mask(points, 1e-6, 499).all()
    assert not radius_outlier_mask(points, 1e-6, 500).any()
    for neighbors in ({"k": 10}, {"radius": 0.1}):
        found, variation = estimate_normals(points, **neighbors, variation=True)
        assert not found.any()
        assert not variation.any()
    result = icp(points, points, 1.0)
    assert (result.stop, result.iterations, result.fitness) == ("degenerate", 0, 1.0)
    axis, indices = centerline(points, normals, 0.1, 500)
    np.testing.assert_allclose(axis, points - [0.0, 0.0, 0.1], atol=1e-14)
    np.testing.assert_array_equal(indices, np.arange(500))
    assert [chain.tolist() for chain in trace_chains(points, 0.1, 0.2, start=7)] == [[7]]


def test_all_points_on_a_line():
    points = np.linspace(-1.0, 1.0, 101)[:, None] * [0.2, -0.3, 0.6]
    for neighbors in ({"k": 10}, {"radius": 0.1}):
        found, variation = estimate_normals(points, **neighbors, variation=True)
        assert not found.any()
        assert not variation.any()
    result = icp(points + 0.001, points, 1.0, target_normals=np.tile([0.0, 0.0, 1.0], (101, 1)))
    assert result.stop == "degenerate"
    result = icp(points + 0.001, points, 1.0)
    assert (result.stop, result.converged) == ("degenerate", False)
    np.testing.assert_array_equal(result.transformation, np.eye(4))
    (chain,) = trace_chains(points, 0.03, 0.06, start=50)
    assert abs(chain[-1] - chain[0]) >= 95
    assert len(set(np.sign(np.diff(chain)))) == 1


HUGE = st.sampled_from(
    [0.0, 5e-324, 1e-310, 1e-300, 1e-160, 1e-8, 0.25, 1.0, 1e5, 1e30, 1e77, 1e99, 1e100, 1e308]
)
COORDINATE = st.one_of(
    st.sampled_from([0.0, 0.25, 1.0]),
    st.tuples(HUGE, st.sampled_from([-1.0, 1.0])).map(lambda pair: pair[0] * pair[1]),
    st.floats(),
)


def finite_or_refused(function):
    """Whether a call gives finite numbers, or an error that names an argument; a panic is neither."""
    try:
        return all(np.isfinite(array).all() for array in list_arrays(function()))
    except (ValueError, NotEnoughDataError) as error:
        return re.match(
            r"(points|radius|near|far|source|target|viewpoint|max_correspondence_distance): ", str(error)
        )


@settings(max_examples=300, deadline=None, derandomize=True, database=None)
@given(
    st.lists(st.tuples(COORDINATE, COORDINATE, COORDINATE), max_size=25),
    st.sampled_from([1e-308, 1e-300, 1e-100, 1e-3, 0.3, 1e5, 1e99, 1e200]),
    st.sampled_from(["raise", "drop"]),
)
def test_any_numbers_get_a_finite_answer_or_a_reason(rows, radius, nonfinite):
    points = np.array(rows, dtype=np.float64).reshape(-1, 3)
    normals = make_axis_normals(len(points))
    for function in (
        lambda: count_neighbors(points, radius, nonfinite=nonfinite),
        lambda: estimate_normals(points, 3, viewpoint=points, variation=True, nonfinite=nonfinite),
        lambda: estimate_normals(points, radius=radius, variation=True, nonfinite=nonfinite),
        lambda: icp(points, points[::-1], radius, nonfinite=nonfinite),
        lambda: icp(points, points[::-1], radius, target_normals=normals, nonfinite=nonfinite),
        lambda: centerline(points, normals, radius, 1, nonfinite=nonfinite),
        lambda: trace_chains(points, radius, 2.0 * radius, nonfinite=nonfinite),
    ):
        assert finite_or_refused(function)
    if (np.abs(points) < 1e100).all() and radius < 1e100:
        assert len(radius_outlier_mask(points, radius, 2, nonfinite=nonfinite)) == len(points)
    elif nonfinite == "raise":
        with pytest.raises(ValueError, match=r"^(points|radius): expected"):
            radius_outlier_mask(points, radius, 2)


def test_what_only_the_package_calls_refuses_mad_numbers_too():
    nodes = make_lattice(40)
    for arguments, name in (((0.1, -3.0), "span"), ((np.nan, 1.0), "radius"), ((0.1, np.inf), "span")):
        with pytest.raises(ValueError, match=f"^{name}: "):
            _core.straighten(nodes, *arguments)
    with pytest.raises(ValueError, match=r"^nodes: "):
        _core.straighten(nodes * np.nan, 0.1, 1.0)
    with pytest.raises(ValueError, match=r"^steps: expected at most "):
        _core.find_short_outlines(np.zeros((4, 4), np.float32), [0.5], 10**12)


def test_small_answers_have_their_numbers_in_order():
    # small arrays are copied into memory of NumPy's, large ones keep Rust's
    for count in (3, 5000):
        nodes = np.random.default_rng(0).normal(size=(count, 3)) + 10.0 * np.arange(count)[:, None]
        # nodes so far apart have no neighbours, and stay
        kept = _core.straighten(nodes, 1e-6, 1.0)
        assert kept.flags.c_contiguous
        np.testing.assert_array_equal(kept, nodes)


@pytest.mark.parametrize("reach", [0.0, 1.0, 2.5, 7.0, 30.4])
def test_pairs_of_a_discs_pixels_are_those_of_its_spectrum(reach):
    whole = int(reach)
    size = 4 * whole + 1
    y, x = np.ogrid[-whole : whole + 1, -whole : whole + 1]
    disc = np.hypot(x, y) <= reach
    pairs = np.rint(np.fft.irfft2(np.abs(np.fft.rfft2(disc, (size, size))) ** 2, (size, size)))
    assert np.array_equal(_core.count_disc_pairs(reach), pairs)
    with pytest.raises(ValueError, match="reach: expected 0 to"):
        _core.count_disc_pairs(-1.0)
