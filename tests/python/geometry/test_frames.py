"""Frames, bends and even nodes along chains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import strand
from shared.ropes import draw_circle
from strand import Chain
from strand.geometry.curve import Curve

T = np.linspace(0.0, 4 * np.pi, 400)


def make_helix(radius=0.05, climb=0.01, hand=1.0):
    return Chain(np.stack([radius * np.cos(T), hand * radius * np.sin(T), climb * T], axis=1), 0.002)


def make_smooth(seed=0):
    """Return a chain with a curve through its nodes."""
    control = np.cumsum(
        np.random.default_rng(seed).normal(size=(12, 3)) * [0.02, 0.02, 0.005] + [0.02, 0, 0], axis=0
    )
    curve = Curve.whole(control)
    return Chain(curve.at(curve.spaced(0.004))[0], 0.004, curve=curve)


@pytest.mark.parametrize(
    "chain", [make_helix(), make_smooth(), draw_circle(0.05, 100, True), draw_circle(0.05, 100, False)]
)
def test_frames_are_rotations_along_the_chain_without_twist(chain):
    s = np.linspace(0.0, chain.length * (1 - 1e-9), 20_001)
    places, frames = chain.frames_at(s)
    np.testing.assert_array_equal(places, chain.at(s))
    np.testing.assert_allclose(frames[..., 0], chain.tangent_at(s), atol=1e-12)
    np.testing.assert_allclose(
        np.swapaxes(frames, 1, 2) @ frames, np.tile(np.eye(3), (20_001, 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(frames), 1.0)
    # y changes towards x only, not towards z
    twist = (np.diff(frames[..., 1], axis=0) * frames[:-1, :, 2]).sum(axis=1)
    assert np.abs(twist).sum() < 0.03
    assert frames[0, 2, 2] == pytest.approx(np.sqrt(1 - frames[0, 2, 0] ** 2))


def test_frames_at_single_places_and_outside_of_the_chain():
    chain = make_helix()
    place, frame = chain.frames_at(0.1)
    assert (place.shape, frame.shape) == ((3,), (3, 3))
    np.testing.assert_array_equal(chain.frames_at([[0.1, 99.0]])[1][0, 0], frame)
    np.testing.assert_array_equal(chain.frames_at(99.0)[1], chain.frames_at(chain.length)[1])
    ring = draw_circle(0.05, 100, True)
    np.testing.assert_allclose(ring.frames_at(ring.length + 0.01)[1], ring.frames_at(0.01)[1], atol=1e-9)
    upright = Chain([[0.0, 0, 0], [0.0, 0, 1.0]], 0.01)
    np.testing.assert_allclose(upright.frames_at(0.5)[1][:, 2], [1, 0, 0])
    for call in (chain.frames_at, chain.curvature_vector_at, chain.torsion_at, chain.tangent_at):
        with pytest.raises(ValueError, match="s: expected finite"):
            call([0.1, np.nan])
        with pytest.raises(TypeError, match="s: expected numbers"):
            call("here")


def test_a_strand_that_turns_back_on_itself_has_frames_too():
    chain = Chain([[0.0, 0, 0], [1.0, 0, 0], [0.5, 0, 0]], 0.01)
    frames = chain.frames_at(np.linspace(0, 1.5, 7))[1]
    np.testing.assert_allclose(np.linalg.det(frames), 1.0)


@pytest.mark.parametrize("hand", [1.0, -1.0])
def test_bends_of_a_helix(hand):
    chain, a, b = make_helix(hand=hand), 0.05, 0.01
    s = np.linspace(0.1, 0.5, 9)
    np.testing.assert_allclose(chain.torsion_at(s), hand * b / (a * a + b * b), rtol=1e-3)
    bend = chain.curvature_vector_at(s)
    np.testing.assert_allclose(np.linalg.norm(bend, axis=1), a / (a * a + b * b), rtol=1e-3)
    outwards = chain.at(s) * [1, 1, 0]
    assert ((bend * outwards).sum(axis=1) < 0).all()
    radius, at = chain.min_bend_radius()
    assert radius == pytest.approx((a * a + b * b) / a, rel=1e-3)
    assert 0 <= at <= chain.length


def test_bends_of_a_curve_are_those_of_its_derivatives():
    chain = make_smooth()
    s = np.linspace(0.1, 0.9, 7) * chain.length
    step = 1e-5
    t = [chain.tangent_at(s + k * step) for k in (-1, 1)]
    np.testing.assert_allclose(chain.curvature_vector_at(s), (t[1] - t[0]) / (2 * step), rtol=2e-2, atol=0.2)
    # dB/ds = -torsion N
    binormal = []
    for k in (-1, 1):
        normal = np.cross(chain.tangent_at(s + k * step), chain.curvature_vector_at(s + k * step))
        binormal.append(normal / np.linalg.norm(normal, axis=1, keepdims=True))
    bend = chain.curvature_vector_at(s)
    bend /= np.linalg.norm(bend, axis=1, keepdims=True)
    torsion = -((binormal[1] - binormal[0]) / (2 * step) * bend).sum(axis=1)
    np.testing.assert_allclose(chain.torsion_at(s), torsion, rtol=2e-2, atol=0.2)
    radius, at = chain.min_bend_radius()
    dense = np.linalg.norm(chain.curvature_vector_at(np.linspace(0, chain.length, 20_001)), axis=1)
    assert radius == pytest.approx(1 / dense.max(), rel=1e-4)
    assert 1 / np.linalg.norm(chain.curvature_vector_at(at)) == pytest.approx(radius)


def add_covariance(chain):
    """Return the chain with covariances, as if reconstructed."""
    return replace(chain, covariance=np.tile(1e-8 * np.eye(3), (len(chain.points), 1, 1)))


@pytest.mark.parametrize("hand", [1.0, -1.0])
def test_bends_over_a_window_are_those_of_a_helix_up_to_its_ends(hand):
    chain, a, b = add_covariance(replace(make_helix(hand=hand), radius=0.004)), 0.05, 0.01
    s = np.linspace(0, chain.length, 50)
    np.testing.assert_allclose(chain.torsion_at(s), hand * b / (a * a + b * b), rtol=2e-2)
    np.testing.assert_allclose(
        np.linalg.norm(chain.curvature_vector_at(s), axis=1), chain.curvature[0], rtol=3e-3
    )
    np.testing.assert_allclose(chain.curvature, a / (a * a + b * b), rtol=3e-3)
    assert chain.min_bend_radius()[0] == pytest.approx((a * a + b * b) / a, rel=3e-3)
    assert chain.torsion_at(0.1).shape == ()
    assert chain.torsion_at([[0.1, 99.0]]).shape == (1, 2)
    ring = add_covariance(draw_circle(0.05, 400, True))
    np.testing.assert_allclose(ring.curvature, 20.0, rtol=1e-3)
    np.testing.assert_allclose(
        ring.curvature_vector_at(0.0), ring.curvature_vector_at(ring.length), atol=1e-6
    )


@pytest.mark.parametrize("size", [0.06, 0.1])
def test_a_reconstructed_ring_bends_at_its_seam_as_elsewhere(size):
    turn = np.linspace(0, 2 * np.pi, 301)
    nodes = np.stack([size * np.cos(turn), 0.9 * size * np.sin(turn), 0.0042 + 0 * turn], axis=1)
    scene = strand.synthetic.scene(chains=[nodes], seed=0)
    (ring,) = strand.reconstruct(scene.views, scene.radius, scene.bounds).chains
    assert ring.closed
    # the closest bend of an ellipse
    assert ring.min_bend_radius()[0] == pytest.approx(0.81 * size, rel=0.2)
    assert ring.curvature[[0, 1, 2, -1, -2, -3]].max() < 1.25 / (0.81 * size)


@pytest.mark.parametrize(("name", "least", "most"), [("straight", 0.2, np.inf), ("arc", 0.085, 0.13)])
def test_ends_of_a_reconstructed_rope_are_no_bends(name, least, most):
    scene = strand.synthetic.scene(name, seed=0)
    (chain,) = strand.reconstruct(scene.views, scene.radius, scene.bounds).chains
    assert least < chain.min_bend_radius()[0] < most


def test_a_straight_rope_bends_nowhere():
    for chain in (
        add_covariance(Chain(np.linspace([0.0, 0, 0], [1.0, 2, 0.3], 9), 0.01)),
        add_covariance(Chain([[0.0, 0, 0], [0.001, 0.002, 0]], 0.01)),
        Chain([[0.0, 0, 0], [1.0, 2, 0]], 0.01),
        Chain(np.linspace([0.0, 0, 0], [1.0, 0, 0], 9), 0.01),
    ):
        assert chain.min_bend_radius() == (np.inf, 0.0)
        np.testing.assert_array_equal(chain.torsion_at([0.0, 0.5]), [0, 0])
        np.testing.assert_allclose(chain.curvature_vector_at(0.5), [0, 0, 0], atol=1e-9)


def test_even_nodes_along_the_same_rope(paper_model):
    chain = paper_model.chains[0]
    again = chain.resample(50)
    assert len(again.points) == len(again.covariance) == len(again.points_seen) == 50
    assert again.length == chain.length
    np.testing.assert_allclose(again.points, chain.at(again.arc_length), atol=1e-12)
    np.testing.assert_allclose(again.covariance[[0, -1]], chain.covariance[[0, -1]])
    whole = chain.resample(len(chain.points))
    np.testing.assert_allclose(whole.points, chain.points, atol=1e-12)
    np.testing.assert_array_equal(whole.points_seen, chain.points_seen)
    for closed, least in ((False, 2), (True, 3)):
        line = draw_circle(0.05, 100, closed)
        assert line.resample(1000).length == pytest.approx(line.length, rel=1e-3)
        assert len(line.resample(least).points) == least
        steps = np.linalg.norm(np.diff(line.resample(40).points, axis=0), axis=1)
        np.testing.assert_allclose(steps, steps.mean(), rtol=0.01)
        with pytest.raises(ValueError, match=f"n: expected at least {least}"):
            line.resample(least - 1)
    with pytest.raises(TypeError, match="n: expected an integer"):
        chain.resample(7.5)


def test_values_between_nodes():
    ring = draw_circle(0.05, 100, True)
    values = np.arange(100.0)
    middle = 0.5 * (ring.arc_length[3] + ring.arc_length[4])
    assert ring.interpolated(values, middle) == pytest.approx(3.5)
    seam = 0.5 * (ring.arc_length[99] + ring.length)
    assert ring.interpolated(values, seam) == pytest.approx(49.5)
    np.testing.assert_allclose(ring.interpolated(ring.points, [0.1, 0.2]), ring.at([0.1, 0.2]))
    with pytest.raises(ValueError, match="values: expected one for each of 100 nodes"):
        ring.interpolated(values[:50], 0.1)
