"""Arrays at the boundary of the kernels: layouts, kinds, shapes, numbers that are not finite."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from shared.kernel_calls import (
    ARGUMENTS,
    ARRAYS,
    CALLS,
    CLOUDS,
    assert_same,
    call_kernel,
    list_arrays,
    make_axis_normals,
    make_lattice,
)
from strand import centerline, count_neighbors, estimate_normals, icp, radius_outlier_mask, trace_chains
from strand._core import copy_constant


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
    "matrix": lambda a: np.asmatrix(a) if a.ndim == 2 else a,
}


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("kernel", CALLS)
def test_every_layout_gives_the_same_answer(kernel, layout):
    arrays = {name: LAYOUTS[layout](array) for name, array in ARRAYS[kernel].items()}
    assert_same(call_kernel(kernel, **arrays), call_kernel(kernel))


@pytest.mark.parametrize("kernel", CALLS)
def test_arrays_that_nobody_can_write_to_give_the_same_answer(kernel):
    arrays = {
        name: copy_constant(array) if array.shape[1:] == (3,) else array
        for name, array in ARRAYS[kernel].items()
    }
    assert_same(call_kernel(kernel, **arrays), call_kernel(kernel))


# of a constant array; kernels look at its memory, at the right place
PARTS = {
    "all": lambda a: a,
    "a slice": lambda a: a[300:700],
    "a slice of a slice": lambda a: a[100:][200:][:400],
    "every second": lambda a: a[::2],
    "reversed": lambda a: a[::-1],
    "reshaped": lambda a: a.reshape(-1)[1:-2].reshape(-1, 3),
    "other kinds and back": lambda a: a.view(np.uint8)[9:].view(np.float64),
    "a subclass": lambda a: a[5:].view(np.recarray),
    "none": lambda a: a[7:7],
    "another array": lambda a: a + 0.5,
}


@pytest.mark.parametrize("part", PARTS)
def test_parts_of_an_array_that_nobody_can_write_to_are_those_parts(part):
    points = PARTS[part](copy_constant(np.random.default_rng(3).uniform(size=(1000, 3))))
    assert_same([count_neighbors(points, 0.2)], [count_neighbors(np.array(points), 0.2)])


class Endless(np.ndarray):
    """Says that it is a part of itself."""

    @property
    def base(self):
        return self


def test_an_array_may_say_that_it_is_part_of_itself():
    points = np.random.default_rng(3).uniform(size=(300, 3))
    assert_same([count_neighbors(points.view(Endless), 0.2)], [count_neighbors(points, 0.2)])


@pytest.mark.parametrize("count", [1, 1000])
def test_nobody_can_write_to_a_constant_array(count):
    points = np.ones((count, 3))
    constant = copy_constant(points)
    points[:] = 7.0
    assert (constant == 1.0).all()
    for array in (constant, constant[:1], constant.reshape(-1), constant.view(np.int64), constant.T):
        assert not array.flags.writeable
        with pytest.raises(ValueError, match="WRITEABLE"):
            array.setflags(write=True)
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0
    with pytest.raises(TypeError, match="read-only"):
        memoryview(constant)[0, 0] = 0.0
    part, last = constant[-1:], constant[-1].copy()
    del constant
    np.testing.assert_array_equal(part, [last])


@pytest.mark.parametrize("kernel", CALLS)
def test_arguments_are_left_alone_and_results_are_the_callers_own(kernel):
    before = {name: array.copy() for name, array in ARRAYS[kernel].items()}
    results = list_arrays(call_kernel(kernel))
    assert results
    for result in results:
        assert result.flags.c_contiguous
        assert result.flags.writeable
        assert not any(np.shares_memory(result, array) for array in ARRAYS[kernel].values())
    assert all(np.array_equal(before[name], array) for name, array in ARRAYS[kernel].items())


def test_shapes_and_dtypes_of_the_answers():
    points, normals = make_lattice(), make_axis_normals()
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
    chains = trace_chains(points, 0.25, 0.5)
    assert chains
    assert all(chain.dtype == np.int64 and chain.ndim == 1 for chain in chains)


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
        call_kernel(kernel, **{name: wrong(ARRAYS[kernel][name])})


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
        call_kernel(kernel, **{name: wrong(ARRAYS[kernel][name])})


@pytest.mark.parametrize("dtype", [np.int64, np.uint8, list])
def test_vectors_and_poses_may_be_whole_numbers(dtype):
    def whole(array):
        return array.astype(int).tolist() if dtype is list else array.astype(dtype)

    viewpoint, start = np.array([0.0, 2.0, 8.0]), np.eye(4)
    for kernel, changes in [
        ("estimate_normals k", {"viewpoint": viewpoint}),
        ("icp points", {"start": start}),
    ]:
        assert_same(
            call_kernel(kernel, **{name: whole(a) for name, a in changes.items()}),
            call_kernel(kernel, **changes),
        )
    points = make_lattice()
    arcs = strand.trace_tubes(points, whole(viewpoint), 1)
    assert_same(
        [a for arc in arcs for a in arc],
        [a for arc in strand.trace_tubes(points, viewpoint, 1.0) for a in arc],
    )


class Quantity(np.ndarray):
    """Has a unit, which NumPy drops."""

    unit = "mm"


@pytest.mark.parametrize(
    ("wrong", "wanted"),
    [
        (lambda a: np.ma.masked_array(a, mask=a > 0), "an array without a mask; fill or drop masked values"),
        (np.ma.masked_array, "an array without a mask; fill or drop masked values"),
        (lambda a: list(np.ma.masked_array(a, mask=np.ones_like(a))), "an array without a mask"),
        (lambda a: a.view(Quantity), "plain numbers in SI units, got Quantity"),
    ],
)
@pytest.mark.parametrize(("kernel", "name"), ARGUMENTS)
def test_masks_and_units_are_refused(kernel, name, wrong, wanted):
    with pytest.raises(TypeError, match=f"^{name}: expected {wanted}"):
        call_kernel(kernel, **{name: wrong(ARRAYS[kernel][name])})


@pytest.mark.parametrize(("kernel", "name"), ARGUMENTS)
def test_wrong_shapes_are_a_value_error(kernel, name):
    array = ARRAYS[kernel][name]
    for wrong in (array[..., :2], array[..., None], array[None], array.ravel(), np.float64(1.0), np.zeros(0)):
        if np.shape(wrong) != (3,):  # one viewpoint for all, which the raveled array is too
            with pytest.raises(ValueError, match=f"^{name}: expected "):
                call_kernel(kernel, **{name: wrong})
    with pytest.raises(ValueError, match=f"^{name}: "):
        call_kernel(kernel, **{name: [[1.0, 2.0, 3.0], [1.0]]})


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
            call_kernel(kernel, **{name: np.zeros((rows, 3))}, nonfinite=nonfinite)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e100, -1e300])
@pytest.mark.parametrize(("kernel", "name"), CLOUDS)
def test_coordinates_that_are_not_finite_are_refused_by_name_and_row(kernel, name, bad):
    array = ARRAYS[kernel][name].copy()
    array[17, 1] = array[30, 0] = bad
    with pytest.raises(
        ValueError, match=rf"^{name}: expected finite coordinates below 1e100, but row 17 is "
    ):
        call_kernel(kernel, **{name: array})


def test_a_viewpoint_or_a_start_that_is_not_finite_is_refused():
    with pytest.raises(ValueError, match=r"^viewpoint: expected finite"):
        estimate_normals(make_lattice(), 8, viewpoint=[0.0, np.nan, 0.0])
    with pytest.raises(ValueError, match=r"^start: expected a rigid motion, but it holds NaN"):
        icp(make_lattice(), make_lattice(), 1.0, start=np.where(np.eye(4), 1.0, np.nan))


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
    result, expected = call_kernel(kernel, **spoilt, nonfinite="drop"), call_kernel(kernel, **finite)
    rows = np.flatnonzero(kept["source"])
    assert len(rows) < 120
    if kernel in ("radius_outlier_mask", "count_neighbors", "estimate_normals k", "estimate_normals radius"):
        for got, want in zip(list_arrays(result), list_arrays(expected), strict=True):
            scattered = np.zeros((120, *want.shape[1:]), want.dtype)
            scattered[rows] = want
            np.testing.assert_array_equal(got, scattered)
    elif kernel == "centerline":
        assert_same(result, (expected[0], rows[expected[1]]))
    elif kernel == "trace_chains":
        assert_same(result, [rows[chain] for chain in expected])
    else:
        assert_same(result, expected)
    assert_same(call_kernel(kernel, nonfinite="drop"), call_kernel(kernel))


def test_a_start_among_the_dropped_points_is_refused():
    points = make_lattice()
    points[7, 2] = np.nan
    with pytest.raises(ValueError, match=r"^start: expected the index of a finite point, got 7"):
        trace_chains(points, 0.25, 0.5, start=7, nonfinite="drop")
    assert 8 in trace_chains(points, 0.25, 0.5, start=8, nonfinite="drop")[0]


@pytest.mark.parametrize("kernel", CALLS)
def test_nothing_but_raise_and_drop_is_accepted(kernel):
    with pytest.raises(ValueError, match=r'^nonfinite: expected "raise" or "drop", got "ignore"'):
        call_kernel(kernel, nonfinite="ignore")
