"""Wires side by side under ties are wide and low."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from strand.reconstruction.harness.flat_bundles import FlatBundles, lay_strands
from strand.reconstruction.harness.strands import Strand
from strand.reconstruction.harness.surface_map import SurfaceMap
from strand.synthetic import Noise, harness


@pytest.mark.parametrize("seed", [3, 4])
def test_wires_that_lie_side_by_side_are_counted_by_their_width(seed):
    made = harness("tied", seed=seed, views=3, noise=Noise(depth=0.0003))
    wire = made.radii[0] / np.sqrt(made.wires[0])
    model = strand.reconstruct(made.views, sorted(set(made.radii)), made.bounds, branches=True, wire=wire)
    assert sorted(edge.wires for edge in model.harness.edges) == sorted(made.wires)
    assert any("side by side" in doubt.reason for doubt in model.doubts)


def test_round_bundles_raise_no_doubt_of_wires_side_by_side():
    made = harness("tree", seed=0, views=3, noise=Noise(depth=0.0003))
    model = strand.reconstruct(made.views, sorted(set(made.radii)), made.bounds, branches=True)
    assert not any("side by side" in doubt.reason for doubt in model.doubts)


@pytest.mark.parametrize("seed", [3, 9, 14])
def test_the_line_of_wires_side_by_side_runs_in_their_middle(seed):
    made = harness("tied", seed=seed, views=3, noise=Noise(depth=0.0003))
    wire = made.radii[0] / np.sqrt(made.wires[0])
    model = strand.reconstruct(made.views, sorted(set(made.radii)), made.bounds, branches=True)
    nodes = np.concatenate([edge.chain.points for edge in model.harness.edges])
    for truth, wires in zip(made.truth, made.wires, strict=True):
        # wires begin to part near junctions
        inner = truth[len(truth) // 4 : -len(truth) // 4]
        away = np.linalg.norm(inner[:, None] - nodes, axis=2).min(axis=1)
        assert np.median(away) < 0.5 * wire, wires
    degrees = [sum(node in pair for pair in made.edges) for node in range(len(made.nodes))]
    for place, degree in zip(made.nodes, degrees, strict=True):
        same = [node.position for node in model.harness.nodes if node.degree == degree]
        # a tie tells where the wires part
        assert np.linalg.norm(np.array(same) - place, axis=1).min() < 2.0 * wire


def test_wires_side_by_side_are_tubes_whose_mean_is_their_strand():
    control = np.column_stack([np.linspace(0.0, 0.2, 9), np.zeros(9), np.zeros(9)])
    bundles = FlatBundles(np.array([1, 4]), 0.003, np.array([0.0, 0.0, 1.0]), np.full(2, np.inf))
    tubes = bundles.lay([control, control])
    assert [len(tube) for tube in tubes] == [9] * 5
    np.testing.assert_array_equal(tubes[0], control)
    np.testing.assert_allclose(np.mean(tubes[1:], axis=0), control, atol=1e-15)
    aside = sorted(float(tube[0, 1]) for tube in tubes[1:])
    np.testing.assert_allclose(aside, [-0.009, -0.003, 0.003, 0.009], atol=1e-15)
    assert bundles.owners.tolist() == [0, 1, 1, 1, 1]
    # a round bundle of four wires is twice as thick as one
    np.testing.assert_allclose(
        bundles.list_widths(bundles.list_radii(np.array([0.005, 0.006]))), [0.005, 0.006]
    )
    assert bundles.list_radii(np.array([0.005, 0.006])).tolist() == [0.005, 0.003]


def test_radii_of_flat_and_round_strands_need_not_be_given():
    made = harness("tied", seed=0, views=3)
    graph = strand.reconstruct(made.views, None, made.bounds, branches=True).harness
    radii, deviations = np.sort([(edge.radius, edge.radius_sd) for edge in graph.edges], axis=0).T
    np.testing.assert_allclose(radii, np.sort(made.radii), rtol=0.05)
    assert (deviations > 0.01 * radii).all()


def test_a_wire_that_lies_along_the_others_is_missed_with_a_doubt():
    made = harness("tied", seed=1051006, views=3, noise=Noise(depth=0.00037))
    model = strand.reconstruct(made.views, sorted(set(made.radii)), made.bounds, branches=True)
    assert len(model.harness.edges) < len(made.edges)
    assert any("do not add up" in doubt.reason for doubt in model.doubts)
    assert model.confidence < 0.5


@pytest.mark.parametrize("middle", [30.0, 5.0])
def test_a_strand_of_two_widths_or_off_the_mask_has_a_line(middle):
    mask = np.zeros((60, 101), dtype=bool)
    mask[26:35, :50] = True
    mask[20:41, 50:] = True
    ones = np.ones(mask.shape)
    drawn = SurfaceMap(np.eye(3), np.zeros(2), 1.0, mask, ones, ones, mask)
    places = np.column_stack([np.full(98, middle), np.arange(1.0, 99.0)])
    strand = Strand(drawn.lift(places, np.ones(98)), (0, 1), 6.0, False)
    bundles = FlatBundles(np.array([3]), 2.0, np.array([0.0, 0.0, 1.0]), np.array([np.inf]))
    (laid,) = lay_strands([strand], bundles, drawn)
    assert np.isfinite(laid.nodes).all()
    if middle == 30.0:
        np.testing.assert_allclose(laid.nodes[:, 0], strand.nodes[:, 0], atol=1.0)
