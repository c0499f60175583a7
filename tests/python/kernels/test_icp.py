"""What ICP returns."""

from __future__ import annotations

import inspect
import pickle

import numpy as np
import pytest

import strand
from shared.kernel_calls import assert_same, make_lattice
from strand import icp


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


def test_defaults_are_what_signatures_say():
    """Arguments that are left out and the numbers of the signature give one answer."""
    source, target = make_lattice(), make_lattice(150, seed=3)
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
