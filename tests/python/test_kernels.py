"""The NumPy boundary of the compiled kernels: layouts, dtypes, wrong input, threads, processes."""

import inspect
import multiprocessing
import pickle
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import strand
from strand import (
    NotEnoughDataError,
    StrandError,
    centerline,
    count_neighbors,
    estimate_normals,
    icp,
    radius_outlier_mask,
    trace_chains,
)


def lattice(count=120, seed=0):
    """Points that half precision holds exactly, with duplicates and equal distances among them."""
    return np.random.default_rng(seed).integers(-64, 64, (count, 3)) / 64.0


def axis_normals(count=120, seed=1):
    rng = np.random.default_rng(seed)
    return np.eye(3)[rng.integers(0, 3, count)] * rng.choice([-1.0, 1.0], (count, 1))


POSE = np.array([[0.0, -1, 0, 0.25], [1, 0, 0, -0.5], [0, 0, 1, 0.125], [0, 0, 0, 1]])


def numbers(result):
    """All numbers of a kernel's answer in one list of arrays."""
    if isinstance(result, strand.IcpResult):
        return [result.transformation, np.array([result.fitness, result.inlier_rmse, result.iterations])]
    return [result] if isinstance(result, np.ndarray) else list(result)


def assert_same(result, expected):
    result, expected = numbers(result), numbers(expected)
    assert len(result) == len(expected)
    for got, want in zip(result, expected, strict=True):
        assert got.dtype == want.dtype
        np.testing.assert_array_equal(got, want)


# Each kernel with its array arguments by name, and how to call it with them.
ARRAYS = {
    "radius_outlier_mask": {"points": lattice()},
    "count_neighbors": {"points": lattice()},
    "estimate_normals k": {"points": lattice(), "viewpoint": np.array([0.5, 2.0, 8.0])},
    "estimate_normals radius": {"points": lattice(), "viewpoint": lattice(seed=2) + 4.0},
    "icp points": {"source": lattice(), "target": lattice(150, seed=3), "start": POSE},
    "icp planes": {
        "source": lattice(),
        "target": lattice(150, seed=3),
        "start": POSE,
        "target_normals": axis_normals(150),
    },
    "centerline": {"points": lattice(), "normals": axis_normals()},
    "trace_chains": {"points": lattice()},
}
CALLS = {
    "radius_outlier_mask": lambda points, **o: radius_outlier_mask(points, 0.5, 5, **o),
    "count_neighbors": lambda points, **o: count_neighbors(points, 0.5, **o),
    "estimate_normals k": lambda points, viewpoint, **o: estimate_normals(
        points, k=8, viewpoint=viewpoint, variation=True, **o
    ),
    "estimate_normals radius": lambda points, viewpoint, **o: estimate_normals(
        points, radius=0.5, viewpoint=viewpoint, variation=True, **o
    ),
    "icp points": lambda source, target, start, **o: icp(
        source, target, 0.5, start=start, max_iterations=3, **o
    ),
    "icp planes": lambda source, target, start, target_normals, **o: icp(
        source, target, 0.5, start=start, target_normals=target_normals, max_iterations=3, **o
    ),
    "centerline": lambda points, normals, **o: centerline(points, normals, 0.25, 3, **o),
    "trace_chains": lambda points, **o: trace_chains(points, 0.25, 0.5, **o),
}
ARGUMENTS = [(kernel, name) for kernel, arrays in ARRAYS.items() for name in arrays]
CLOUDS = [(kernel, name) for kernel, name in ARGUMENTS if np.shape(ARRAYS[kernel][name])[1:] == (3,)]


def call(kernel, **changes):
    options = {name: changes.pop(name) for name in list(changes) if name not in ARRAYS[kernel]}
    return CALLS[kernel](**{**ARRAYS[kernel], **changes}, **options)


def misaligned(array):
    raw = np.zeros(array.nbytes + 1, np.uint8)
    copy = np.frombuffer(raw.data, np.float64, array.size, offset=1).reshape(array.shape)
    copy[...] = array
    return copy


def read_only(array):
    copy = array.copy()
    copy.flags.writeable = False
    return copy


def every_second(array):
    wide = np.full((*array.shape[:-1], 2 * array.shape[-1]), np.nan)
    wide[..., ::2] = array
    return wide[..., ::2]


def field_of_records(array):
    records = np.zeros(len(array), [("flag", "u1"), ("value", "f8", array.shape[1:])])
    records["value"] = array
    return records["value"]


LAYOUTS = {
    "fortran": np.asfortranarray,
    "transposed": lambda a: np.ascontiguousarray(a.T).T,
    "every second column": every_second,
    "every second row": lambda a: np.repeat(a, 2, axis=0)[::2],
    "reversed": lambda a: np.ascontiguousarray(a[::-1])[::-1],
    "reversed columns": lambda a: np.ascontiguousarray(a[..., ::-1])[..., ::-1],
    "read only": read_only,
    "misaligned": misaligned,
    "field of records": field_of_records,
    "float32": lambda a: a.astype(np.float32),
    "float16": lambda a: a.astype(np.float16),
    "long double": lambda a: a.astype(np.longdouble),
    "big-endian": lambda a: a.astype(">f8"),
    "big-endian float32": lambda a: a.astype(">f4"),
    "lists": lambda a: a.tolist(),
    "subclass": lambda a: a.view(np.recarray),
}


# arrays of every kind


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("kernel", CALLS)
def test_every_layout_gives_the_same_answer(kernel, layout):
    arrays = {name: LAYOUTS[layout](array) for name, array in ARRAYS[kernel].items()}
    assert_same(call(kernel, **arrays), call(kernel))


@pytest.mark.parametrize("kernel", CALLS)
def test_arguments_are_left_alone_and_results_are_the_callers_own(kernel):
    before = {name: array.copy() for name, array in ARRAYS[kernel].items()}
    for result in numbers(call(kernel)):
        assert result.flags.c_contiguous
        assert result.flags.writeable
        assert not any(np.shares_memory(result, array) for array in ARRAYS[kernel].values())
    assert all(np.array_equal(before[name], array) for name, array in ARRAYS[kernel].items())


def test_shapes_and_dtypes_of_the_answers():
    points, normals = lattice(), axis_normals()
    mask = radius_outlier_mask(points, 0.5, 5)
    counts = count_neighbors(points, 0.5)
    assert (mask.shape, mask.dtype) == ((120,), np.bool_)
    assert (counts.shape, counts.dtype) == ((120,), np.int64)
    np.testing.assert_array_equal(mask, counts >= 5)
    only = estimate_normals(points, 8)
    both = estimate_normals(points, 8, variation=True)
    assert (only.shape, only.dtype) == ((120, 3), np.float64)
    assert (both[1].shape, both[1].dtype) == ((120,), np.float64)
    np.testing.assert_array_equal(only, both[0])
    axis, indices = centerline(points, normals, 0.25, 3)
    assert axis.shape == (len(indices), 3)
    assert indices.dtype == np.int64
    assert all(chain.dtype == np.int64 and chain.ndim == 1 for chain in trace_chains(points, 0.25, 0.5))


@pytest.mark.parametrize(
    "wrong",
    [
        lambda a: np.ones(a.shape, bool),
        lambda a: a.astype(complex),
        lambda a: a.astype(object),
        lambda a: a.astype(str),
        lambda a: np.zeros(a.shape, "m8[s]"),
        lambda a: "points",
        lambda a: object(),
        lambda a: {},
    ],
)
@pytest.mark.parametrize(("kernel", "name"), ARGUMENTS)
def test_other_elements_than_numbers_are_a_type_error(kernel, name, wrong):
    with pytest.raises(TypeError, match=rf"^{name}: expected (floating point )?numbers, got dtype"):
        call(kernel, **{name: wrong(ARRAYS[kernel][name])})


@pytest.mark.parametrize(
    "wrong",
    [
        lambda a: np.ones(a.shape, int),
        lambda a: np.ones(a.shape, np.uint16),
        lambda a: np.ones(a.shape, int).tolist(),
    ],
)
@pytest.mark.parametrize(("kernel", "name"), CLOUDS)
def test_clouds_of_whole_numbers_are_refused_with_the_reason(kernel, name, wrong):
    with pytest.raises(TypeError, match=rf"^{name}: .*whole numbers have no unit, convert them to metres"):
        call(kernel, **{name: wrong(ARRAYS[kernel][name])})


@pytest.mark.parametrize("dtype", [np.int64, np.uint8, list])
def test_vectors_and_poses_may_be_whole_numbers(dtype):
    def whole(array):
        return array.astype(int).tolist() if dtype is list else array.astype(dtype)

    viewpoint, start = np.array([0.0, 2.0, 8.0]), np.eye(4)
    for kernel, changes in [
        ("estimate_normals k", {"viewpoint": viewpoint}),
        ("icp points", {"start": start}),
    ]:
        assert_same(call(kernel, **{name: whole(a) for name, a in changes.items()}), call(kernel, **changes))
    points = lattice()
    arcs = strand.trace_tubes(points, whole(viewpoint), 1)
    assert_same(
        [a for arc in arcs for a in arc],
        [a for arc in strand.trace_tubes(points, viewpoint, 1.0) for a in arc],
    )


@pytest.mark.parametrize(("kernel", "name"), ARGUMENTS)
def test_wrong_shapes_are_a_value_error(kernel, name):
    array = ARRAYS[kernel][name]
    for wrong in (array[..., :2], array[..., None], array[None], array.ravel(), np.float64(1.0), np.zeros(0)):
        if np.shape(wrong) != (3,):  # one viewpoint for all, which the raveled array is too
            with pytest.raises(ValueError, match=f"^{name}: expected "):
                call(kernel, **{name: wrong})
    with pytest.raises(ValueError, match=f"^{name}: "):
        call(kernel, **{name: [[1.0, 2.0, 3.0], [1.0]]})


@pytest.mark.parametrize(
    ("kernel", "name"),
    [("estimate_normals radius", "viewpoint"), ("icp planes", "target_normals"), ("centerline", "normals")],
)
@pytest.mark.parametrize("rows", [0, 1, 119, 151])
def test_arrays_that_belong_together_are_of_one_length(kernel, name, rows):
    for nonfinite in ("raise", "drop"):
        with pytest.raises(
            ValueError, match=rf"^{name}: expected one row for each of the 1[25]0 points, got {rows}"
        ):
            call(kernel, **{name: np.zeros((rows, 3))}, nonfinite=nonfinite)


# NaN and infinity


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e100, -1e300])
@pytest.mark.parametrize(("kernel", "name"), CLOUDS)
def test_coordinates_that_are_not_finite_are_refused_by_name_and_row(kernel, name, bad):
    array = ARRAYS[kernel][name].copy()
    array[17, 1] = array[30, 0] = bad
    with pytest.raises(
        ValueError, match=rf"^{name}: expected finite coordinates below 1e100, but row 17 is "
    ):
        call(kernel, **{name: array})


def test_a_viewpoint_or_a_start_that_is_not_finite_is_refused():
    with pytest.raises(ValueError, match=r"^viewpoint: expected finite"):
        estimate_normals(lattice(), 8, viewpoint=[0.0, np.nan, 0.0])
    with pytest.raises(ValueError, match=r"^start: expected a rigid motion, but it holds NaN"):
        icp(lattice(), lattice(), 1.0, start=np.where(np.eye(4), 1.0, np.nan))


@pytest.mark.parametrize("kernel", CALLS)
def test_dropping_equals_calling_with_the_finite_rows(kernel):
    rng = np.random.default_rng(5)
    spoilt, finite, kept = {}, {}, {}
    for name, array in ARRAYS[kernel].items():
        spoilt[name] = array.copy()
        if array.shape[1:] == (3,):
            rows = rng.choice(len(array), 10, replace=False)
            spoilt[name][rows, rng.integers(0, 3, 10)] = rng.choice([np.nan, np.inf, -np.inf], 10)
            group = "target" if name.startswith("target") else "source"
            kept[group] = kept.get(group, True) & np.isfinite(spoilt[name]).all(axis=1)
    for name, array in spoilt.items():
        group = "target" if name.startswith("target") else "source"
        finite[name] = array[kept[group]] if array.shape[1:] == (3,) else array
    result, expected = call(kernel, **spoilt, nonfinite="drop"), call(kernel, **finite)
    rows = np.flatnonzero(kept["source"])
    assert len(rows) < 120
    if kernel in ("radius_outlier_mask", "count_neighbors", "estimate_normals k", "estimate_normals radius"):
        for got, want in zip(numbers(result), numbers(expected), strict=True):
            scattered = np.zeros((120, *want.shape[1:]), want.dtype)
            scattered[rows] = want
            np.testing.assert_array_equal(got, scattered)
    elif kernel == "centerline":
        assert_same(result, (expected[0], rows[expected[1]]))
    elif kernel == "trace_chains":
        assert_same(result, [rows[chain] for chain in expected])
    else:
        assert_same(result, expected)
    assert_same(call(kernel, nonfinite="drop"), call(kernel))


def test_a_start_among_the_dropped_points_is_refused():
    points = lattice()
    points[7, 2] = np.nan
    with pytest.raises(ValueError, match=r"^start: expected the index of a finite point, got 7"):
        trace_chains(points, 0.25, 0.5, start=7, nonfinite="drop")
    assert 8 in trace_chains(points, 0.25, 0.5, start=8, nonfinite="drop")[0]


@pytest.mark.parametrize("kernel", CALLS)
def test_nothing_but_raise_and_drop_is_accepted(kernel):
    with pytest.raises(ValueError, match=r'^nonfinite: expected "raise" or "drop", got "ignore"'):
        call(kernel, nonfinite="ignore")


# numbers


@pytest.mark.parametrize("bad", [0.0, -0.5, np.nan, np.inf, -np.inf, 1e100])
def test_lengths_are_positive(bad):
    points, normals = lattice(), axis_normals()
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


@pytest.mark.parametrize("bad", ["0.5", None, [0.5], 1j, object()])
def test_lengths_are_numbers(bad):
    points, normals = lattice(), axis_normals()
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
    ("min_neighbors", lambda n: radius_outlier_mask(lattice(), 0.5, n)),
    ("min_neighbors", lambda n: centerline(lattice(), axis_normals(), 0.25, n)),
    ("k", lambda n: estimate_normals(lattice(), n)),
    ("max_iterations", lambda n: icp(lattice(), lattice(), 0.5, max_iterations=n)),
    ("start", lambda n: trace_chains(lattice(), 0.25, 0.5, start=n)),
    ("threads", lambda n: strand.set_num_threads(n)),
]


@pytest.mark.parametrize(("name", "function"), COUNTS)
def test_counts_are_whole_numbers_and_not_negative(name, function):
    for bad in (3.0, 2.5, np.float64(3), "3", [3]):
        with pytest.raises(TypeError, match=f"^{name}: expected a whole number, got "):
            function(bad)
    for bad in (-1, np.int64(-7)):
        with pytest.raises(ValueError, match=f"^{name}: expected a number >= 0, got {bad}"):
            function(bad)


def test_numpy_scalars_are_numbers_too():
    points = lattice()
    assert_same(
        radius_outlier_mask(points, np.float32(0.5), np.uint8(5)), radius_outlier_mask(points, 0.5, 5)
    )
    assert_same(
        trace_chains(points, np.float16(0.25), 1, start=np.int64(3)), trace_chains(points, 0.25, 1.0, start=3)
    )


def test_neighbours_of_normals_are_given_one_way():
    for arguments in ({}, {"k": 5, "radius": 0.5}):
        with pytest.raises(TypeError, match=r"^expected exactly one of k and radius"):
            estimate_normals(lattice(), **arguments)
    for k in (0, 1, 2):
        with pytest.raises(ValueError, match=f"^k: expected at least 3 neighbours, got {k}"):
            estimate_normals(lattice(), k)


def test_ranges_of_tracing_and_registration():
    points = lattice()
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
        icp(lattice(), lattice(), 1.0, start=start)


# too little data


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
    for source, target, name in ((none, lattice(), "source"), (lattice(), none, "target")):
        with pytest.raises(NotEnoughDataError, match=f"^{name}: expected at least one point"):
            icp(source, target, 1.0)


def test_a_cloud_that_dropping_empties():
    nothing = np.full((5, 3), np.nan)
    assert not radius_outlier_mask(nothing, 1.0, 0, nonfinite="drop").any()
    np.testing.assert_array_equal(estimate_normals(nothing, 3, nonfinite="drop"), np.zeros((5, 3)))
    assert len(centerline(nothing, nothing, 1.0, 0, nonfinite="drop")[0]) == 0
    assert trace_chains(nothing, 1.0, 2.0, nonfinite="drop") == []
    with pytest.raises(NotEnoughDataError, match=r"^source: "):
        icp(nothing, lattice(), 1.0, nonfinite="drop")


def test_fewer_points_than_neighbours_asked_for():
    with pytest.raises(
        NotEnoughDataError, match=r"^points: 4 points, fewer than the k = 5 neighbours asked for"
    ):
        estimate_normals(lattice(4), 5)
    # finite ones count
    points = lattice(6)
    points[:2] = np.nan
    with pytest.raises(NotEnoughDataError, match=r"^points: 4 points"):
        estimate_normals(points, 5, nonfinite="drop")
    assert estimate_normals(lattice(5), 5).shape == (5, 3)


# defined answers for degenerate clouds


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


@settings(max_examples=300, deadline=None, derandomize=True, database=None)
@given(
    st.lists(st.tuples(COORDINATE, COORDINATE, COORDINATE), max_size=25),
    st.sampled_from([1e-308, 1e-300, 1e-100, 1e-3, 0.3, 1e5, 1e99, 1e200]),
    st.sampled_from(["raise", "drop"]),
)
def test_no_numbers_make_a_kernel_panic(rows, radius, nonfinite):
    # a panic is no Exception; pytest reports it
    points = np.array(rows, dtype=np.float64).reshape(-1, 3)
    normals = axis_normals(len(points))
    for function in (
        lambda: radius_outlier_mask(points, radius, 2, nonfinite=nonfinite),
        lambda: count_neighbors(points, radius, nonfinite=nonfinite),
        lambda: estimate_normals(points, 3, viewpoint=points, variation=True, nonfinite=nonfinite),
        lambda: estimate_normals(points, radius=radius, variation=True, nonfinite=nonfinite),
        lambda: icp(points, points[::-1], radius, nonfinite=nonfinite),
        lambda: icp(points, points[::-1], radius, target_normals=normals, nonfinite=nonfinite),
        lambda: centerline(points, normals, radius, 1, nonfinite=nonfinite),
        lambda: trace_chains(points, radius, 2.0 * radius, nonfinite=nonfinite),
    ):
        try:
            result = function()
        except (ValueError, NotEnoughDataError):
            continue
        assert all(np.isfinite(array).all() for array in numbers(result))


# the outcome of a registration


def test_the_outcome_of_a_registration_is_a_value():
    rng = np.random.default_rng(8)
    target = rng.random((400, 3))
    angle = 0.02
    truth = np.eye(4)
    truth[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    truth[:3, 3] = 0.01, -0.005, 0.002
    source = (target - truth[:3, 3]) @ truth[:3, :3]
    result = icp(source, target, 0.2)
    np.testing.assert_allclose(result.transformation, truth, atol=1e-9)
    assert (result.fitness, result.converged, result.stop) == (1.0, True, "tolerance")
    assert result.inlier_rmse < 1e-9
    assert 1 < result.iterations < 30
    assert repr(result).startswith("IcpResult(fitness=1.0000, inlier_rmse=")
    assert repr(result).endswith(f', iterations={result.iterations}, converged=True, stop="tolerance")')
    # nobody changes it
    result.transformation[:] = 0.0
    np.testing.assert_allclose(result.transformation, truth, atol=1e-9)
    with pytest.raises(AttributeError):
        result.fitness = 2.0
    with pytest.raises(TypeError, match=r"IcpResult"):
        strand.IcpResult()


@pytest.mark.parametrize(
    ("stop", "arguments"),
    [
        ("tolerance", {"tolerance": 1.0}),
        ("iterations", {"max_iterations": 2, "tolerance": 0.0}),
        ("too few correspondences", {"start": np.eye(4) + np.outer([0, 0, 1, 0], [0, 0, 0, 100.0])}),
        ("degenerate", {"target_normals": np.tile([0.0, 0.0, 1.0], (400, 1))}),
    ],
)
def test_it_says_why_the_iterations_ended(stop, arguments):
    target = np.random.default_rng(9).random((400, 3))
    result = icp(target + 0.01, target, 0.2, **arguments)
    assert result.stop == stop
    assert result.converged == (stop == "tolerance")
    assert f'stop="{stop}"' in repr(result)


# threads and processes


@pytest.fixture
def threads():
    yield strand.set_num_threads
    strand.set_num_threads(0)


def test_the_number_of_threads(threads):
    assert strand.num_threads() >= 1
    threads(3)
    assert strand.num_threads() == 3
    threads(2**40)
    assert strand.num_threads() == 256
    threads(0)
    assert strand.num_threads() >= 1


@pytest.mark.parametrize("kernel", CALLS)
def test_answers_do_not_depend_on_the_number_of_threads(kernel, threads):
    big = {
        name: np.tile(array, (40, 1)) + np.random.default_rng(2).normal(0, 1e-3, (40 * len(array), 3))
        if (kernel, name) in CLOUDS and "normals" not in name
        else np.tile(array, (40, 1))
        if (kernel, name) in CLOUDS
        else array
        for name, array in ARRAYS[kernel].items()
    }
    threads(1)
    expected = call(kernel, **big)
    for count in (2, 3, 7):
        threads(count)
        assert_same(call(kernel, **big), expected)


def test_changing_the_number_of_threads_often_does_not_pile_up_threads(threads):
    def running():
        with open("/proc/self/status") as status:
            return next(int(line.split()[1]) for line in status if line.startswith("Threads:"))

    for count in (1, 2):
        threads(count)
        count_neighbors(lattice(), 0.5)
    before = running()
    for count in (1, 2) * 20:
        threads(count)
        count_neighbors(lattice(), 0.5)
    assert running() <= before


def test_several_python_threads_may_call_at_once():
    expected = {kernel: call(kernel) for kernel in CALLS}
    with ThreadPoolExecutor(8) as executor:
        calls = [(kernel, executor.submit(call, kernel)) for _ in range(25) for kernel in CALLS]
        for kernel, future in calls:
            assert_same(future.result(timeout=60), expected[kernel])


def test_python_goes_on_while_a_kernel_works():
    # one place, so that every point is every other's neighbour: much work for little memory
    points = np.zeros((12_000, 3))
    steps = 0
    done = threading.Event()

    def step():
        nonlocal steps
        while not done.is_set():
            steps += 1
            time.sleep(0.0005)

    stepping = threading.Thread(target=step)
    stepping.start()
    try:
        taken = 0
        # with the interpreter locked for the whole call it could take a step or two in any of them; otherwise
        # other programs may still keep it from more in some
        for _ in range(20):
            before = steps
            count_neighbors(points, 1.0)
            taken = max(taken, steps - before)
    finally:
        done.set()
        stepping.join()
    assert taken >= 5


def forked_answers(queue):
    queue.put([numbers(call(kernel)) for kernel in CALLS])


@pytest.mark.parametrize("busy", [False, True])
def test_a_forked_process_can_call_after_its_parent_did(busy):
    expected = [numbers(call(kernel)) for kernel in CALLS]
    stop = threading.Event()

    def keep_working():
        while not stop.is_set():
            count_neighbors(lattice(2000), 0.5)

    # a kernel at work at the moment of the fork
    working = threading.Thread(target=keep_working)
    if busy:
        working.start()
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    children = [context.Process(target=forked_answers, args=(queue,), daemon=True) for _ in range(4)]
    try:
        for child in children:
            child.start()
        for _ in children:
            for got, want in zip(queue.get(timeout=30), expected, strict=True):
                assert_same(got, want)
        for child in children:
            child.join(timeout=30)
            assert child.exitcode == 0
    finally:
        stop.set()
        if busy:
            working.join()
        for child in children:
            if child.is_alive():
                child.kill()


def test_defaults_are_what_signatures_say():
    """Arguments that are left out and the numbers of the signature give one answer."""
    source, target = lattice(), lattice(150, seed=3)
    defaults = inspect.signature(icp).parameters
    said = {name: defaults[name].default for name in ("max_iterations", "tolerance")}
    assert said == {"max_iterations": 30, "tolerance": 1e-6}
    assert_same(icp(source, target, 0.5, **said), icp(source, target, 0.5))


def test_what_icp_found_can_be_pickled():
    points = np.random.default_rng(0).uniform(size=(100, 3))
    found = strand.icp(points, points + 0.001, 0.05)
    again = pickle.loads(pickle.dumps(found))
    np.testing.assert_array_equal(again.transformation, found.transformation)
    for name in ("fitness", "inlier_rmse", "iterations", "converged", "stop"):
        assert getattr(again, name) == getattr(found, name)
    with pytest.raises(ValueError, match="stop"):
        strand.IcpResult(np.eye(4), 1.0, 0.0, 1, True, "why")
