"""Each kernel with its array arguments by name, and how to call it with them."""

from __future__ import annotations

import numpy as np

import strand
from strand import centerline, count_neighbors, estimate_normals, icp, radius_outlier_mask, trace_chains


def make_lattice(count=120, seed=0):
    """Return points that half precision holds exactly, some duplicated or equally far apart."""
    return np.random.default_rng(seed).integers(-64, 64, (count, 3)) / 64.0


def make_axis_normals(count=120, seed=1):
    rng = np.random.default_rng(seed)
    return np.eye(3)[rng.integers(0, 3, count)] * rng.choice([-1.0, 1.0], (count, 1))


POSE = np.array([[0.0, -1, 0, 0.25], [1, 0, 0, -0.5], [0, 0, 1, 0.125], [0, 0, 0, 1]])


def list_arrays(result):
    """Return all numbers of a kernel's answer as a list of arrays."""
    if isinstance(result, strand.IcpResult):
        return [result.transformation, np.array([result.fitness, result.inlier_rmse, result.iterations])]
    return [result] if isinstance(result, np.ndarray) else list(result)


def assert_same(result, expected):
    result, expected = list_arrays(result), list_arrays(expected)
    assert len(result) == len(expected)
    for got, want in zip(result, expected, strict=True):
        assert got.dtype == want.dtype
        np.testing.assert_array_equal(got, want)


# Each kernel with its array arguments by name, and how to call it with them.
ARRAYS = {
    "radius_outlier_mask": {"points": make_lattice()},
    "count_neighbors": {"points": make_lattice()},
    "estimate_normals k": {"points": make_lattice(), "viewpoint": np.array([0.5, 2.0, 8.0])},
    "estimate_normals radius": {"points": make_lattice(), "viewpoint": make_lattice(seed=2) + 4.0},
    "icp points": {"source": make_lattice(), "target": make_lattice(150, seed=3), "start": POSE},
    "icp planes": {
        "source": make_lattice(),
        "target": make_lattice(150, seed=3),
        "start": POSE,
        "target_normals": make_axis_normals(150),
    },
    "centerline": {"points": make_lattice(), "normals": make_axis_normals()},
    "trace_chains": {"points": make_lattice()},
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


def call_kernel(kernel, **changes):
    options = {name: changes.pop(name) for name in list(changes) if name not in ARRAYS[kernel]}
    return CALLS[kernel](**{**ARRAYS[kernel], **changes}, **options)
