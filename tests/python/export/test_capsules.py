"""Capsules and spheres: within the given error of the tubes, by points on both surfaces."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

import strand
from shared.ropes import R, draw_circle, make_smooth_chain, measure_path_distance
from strand import Chain, Model

CHAINS = {
    "paper": Chain(strand.synthetic.shape("paper"), R),
    "smooth": make_smooth_chain(),
    "ring": draw_circle(0.05, 60, True),
    "right angles": Chain(np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 1.0]]) * 0.05, R),
    "two nodes": Chain(np.array([[0, 0, 0], [0, 0, 0.1]]), R),
}
ERRORS = [1e-4, 5e-4, 2e-3]


def make_model(*chains):
    return Model(chains, np.eye(4)[None])


def sample_axis(chain):
    """Return segments that follow a centreline far more closely than any tested error."""
    if chain.closed:
        path = np.vstack([chain.points, chain.points[:1]])
    else:
        path = chain.points if chain.curve is None else chain.at(np.linspace(0, chain.length, 1000))
    return path[:-1], path[1:]


def sample_surface(start, stop, radius, count=2000):
    """Return points on the surface of capsules, evenly along and around, without those inside other ones."""
    rng = np.random.default_rng(0)
    lengths = np.linalg.norm(stop - start, axis=1)
    which = rng.choice(len(start), size=count, p=lengths / lengths.sum())
    line = stop[which] - start[which]
    along = line / np.linalg.norm(line, axis=1, keepdims=True)
    outward = rng.normal(size=(count, 3))
    ball = rng.random(count) < 0.25  # on a round end
    outward[~ball] -= ((outward * along).sum(axis=1, keepdims=True) * along)[~ball]
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    share = np.where(ball, rng.integers(0, 2, count), rng.random(count))
    points = start[which] + share[:, None] * line + radius * outward
    return points[measure_path_distance(points, start, stop) > radius - 1e-9]


@pytest.mark.parametrize("error", ERRORS)
@pytest.mark.parametrize("name", CHAINS)
def test_capsules_are_within_the_error_of_the_tube_and_the_tube_of_them(name, error):
    chain = CHAINS[name]
    capsules = make_model(chain).capsules(error)
    axis = sample_axis(chain)
    from_capsules = sample_surface(capsules.start, capsules.stop, chain.radius)
    from_tube = sample_surface(*axis, chain.radius)
    assert min(len(from_capsules), len(from_tube)) > 500
    beyond = np.abs(measure_path_distance(from_capsules, *axis) - chain.radius)
    missed = np.abs(measure_path_distance(from_tube, capsules.start, capsules.stop) - chain.radius)
    assert max(beyond.max(), missed.max()) <= error
    if name in ("paper", "smooth"):
        # no more capsules than the error asks for
        assert missed.max() > 0.4 * error
        assert len(capsules) < 0.3 * len(axis[0])


@pytest.mark.parametrize("error", [*ERRORS, R])
@pytest.mark.parametrize("name", CHAINS)
def test_spheres_are_within_the_error_of_the_tube(name, error):
    chain = CHAINS[name]
    spheres = make_model(chain).spheres(error)
    axis = sample_axis(chain)
    rng = np.random.default_rng(0)
    outward = rng.normal(size=(3000, 3))
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    points = rng.choice(spheres.center, 3000) + chain.radius * outward
    points = points[measure_path_distance(points, spheres.center, spheres.center) > chain.radius - 1e-9]
    assert measure_path_distance(points, *axis).max() <= chain.radius + error
    assert measure_path_distance(points, *axis).min() >= chain.radius - error
    # and so the other way round: points of the tube are no farther from a sphere, or in one
    missed = (
        measure_path_distance(sample_surface(*axis, chain.radius), spheres.center, spheres.center)
        - chain.radius
    )
    assert missed.max() <= error
    if error < R:
        assert missed.max() > 0.4 * error


@pytest.mark.parametrize("name", CHAINS)
def test_capsules_run_along_the_rope_from_end_to_end(name):
    chain = CHAINS[name]
    capsules = make_model(chain).capsules(1e-3)
    np.testing.assert_allclose(chain.at(capsules.s[:, 0]), capsules.start, atol=1e-9)
    np.testing.assert_allclose(chain.at(capsules.s[:, 1]), capsules.stop, atol=1e-9)
    np.testing.assert_array_equal(capsules.start[1:], capsules.stop[:-1])
    np.testing.assert_allclose([capsules.s[0, 0], capsules.s[-1, 1]], [0.0, chain.length], atol=1e-12)
    assert (np.diff(capsules.s, axis=1) > 0).all()


def test_frames_place_a_capsule_as_trimesh_makes_it():
    """The capsule runs along z, with its middle in the origin."""
    chain = CHAINS["paper"]
    capsules = make_model(chain).capsules(5e-4)
    np.testing.assert_allclose(np.linalg.det(capsules.poses[:, :3, :3]), 1.0)
    for k in range(0, len(capsules), 7):
        mesh = trimesh.creation.capsule(height=capsules.lengths[k], radius=capsules.radius[k])
        mesh.apply_transform(capsules.poses[k])
        off = measure_path_distance(mesh.vertices, capsules.start[[k]], capsules.stop[[k]])
        np.testing.assert_allclose(off, R, rtol=1e-6)


def test_several_ropes_keep_their_numbers_and_radii():
    thick = Chain(CHAINS["two nodes"].points, 0.01)
    model = make_model(CHAINS["paper"], thick, CHAINS["ring"])
    for parts in (model.capsules(1e-3), model.spheres(1e-3)):
        assert set(parts.chain.tolist()) == {0, 1, 2}
        assert (np.diff(parts.chain) >= 0).all()
        np.testing.assert_array_equal(parts.radius, np.array([R, 0.01, model.chains[2].radius])[parts.chain])
        with pytest.raises(ValueError, match="read-only"):
            parts.radius[0] = 1.0
    assert repr(model.capsules(1e-3)).startswith("Capsules(")
    assert repr(model.spheres(1e-3)).endswith("of 3 ropes)")


def test_a_model_without_ropes_has_none():
    capsules, spheres = make_model().capsules(1e-3), make_model().spheres(1e-3)
    assert len(capsules) == len(spheres) == 0
    assert capsules.poses.shape == (0, 4, 4)


def test_any_error_that_is_large_leaves_a_capsule_of_some_length():
    for name, chain in CHAINS.items():
        capsules = make_model(chain).capsules(10.0)
        assert 1 <= len(capsules) <= 2, name
        assert (capsules.lengths > 0).all()


@pytest.mark.parametrize("ask", [Model.capsules, Model.spheres])
def test_wrong_errors_are_refused(ask):
    model = make_model(CHAINS["paper"])
    for wrong in (0.0, -1e-3, float("nan"), float("inf")):
        with pytest.raises(ValueError, match="error: expected a positive number"):
            ask(model, wrong)
    with pytest.raises(ValueError, match=r"error: expected at least .*radi"):
        ask(model, 1e-9)
    with pytest.raises(TypeError, match="error: expected a number, got str"):
        ask(model, "1 mm")
