"""Radii of bundles, chosen together."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from strand.reconstruction.harness.wires import choose_radii, list_bundles
from strand.synthetic import Camera, Segmentation, harness

PAIRS = [(0, 1), (1, 2), (1, 3), (3, 4), (3, 5)]
COUNTS = [4, 1, 3, 2, 1]
WIRE = 0.002


@pytest.mark.parametrize("shared", [0.92, 1.0, 1.08])
def test_wires_add_up_in_spite_of_noise(shared):
    rng = np.random.default_rng(0)
    right = 0
    for _ in range(50):
        radii = WIRE * np.sqrt(COUNTS) * shared * (1.0 + 0.05 * rng.normal(size=len(COUNTS)))
        right += choose_radii(radii, PAIRS, list_bundles(WIRE)).counts == COUNTS
    assert right >= 40


def test_exact_radii_need_no_junctions():
    choice = choose_radii(WIRE * np.sqrt([1.0, 5.0, 2.0]), [(0, 1), (2, 3), (4, 5)], list_bundles(WIRE))
    assert choice.counts == [1, 5, 2]
    assert choice.unequal == []


def test_equal_radii_refuse_that_wires_add_up():
    choice = choose_radii(np.full(5, WIRE), PAIRS, list_bundles(WIRE))
    assert choice.counts == [1] * 5
    assert choice.unequal == [1, 3]


def test_strands_thinner_than_a_wire_have_no_counts():
    assert choose_radii(np.full(5, 0.4 * WIRE), PAIRS, list_bundles(WIRE)).counts == [None] * 5


def test_a_wire_of_another_radius_strains_the_choice():
    radii = WIRE * np.sqrt(COUNTS)
    assert not choose_radii(1.02 * radii, PAIRS, list_bundles(WIRE), 0.02).strained
    assert choose_radii(radii, PAIRS, list_bundles(0.8 * WIRE), 0.02).strained
    assert choose_radii(radii, PAIRS, list_bundles(1.2 * WIRE), 0.02).strained


def test_other_counts_that_fit_nearly_as_well_are_named():
    radii, pairs = WIRE * np.sqrt([4.0, 2.0, 2.0]), [(0, 1), (1, 2), (1, 3)]
    choice = choose_radii(0.85 * radii, pairs, list_bundles(WIRE), 0.08)
    assert choice.counts == [4, 2, 2]
    assert choice.rival.tolist() == [1, 0, 0]
    assert 0.0 < choice.margin < 1.0
    assert choose_radii(radii, pairs, list_bundles(WIRE), 0.02).margin == np.inf


@pytest.mark.parametrize("views", [1, 3])
def test_heights_tell_radii_where_masks_are_too_wide(views):
    camera = Camera("sgbm", size=(1280, 720))
    made = harness("tree", seed=3, views=views, camera=camera, mask=Segmentation(grow=1, ragged=0.5))
    unknown = strand.reconstruct(made.views, None, made.bounds, branches=True).harness
    edges = sorted(unknown.edges, key=lambda edge: edge.radius)
    radii, deviations = np.array([(edge.radius, edge.radius_sd) for edge in edges]).T
    off = np.abs(radii / np.sort(made.radii) - 1.0)
    assert off.max() < 0.12
    assert (off < 3.0 * deviations / radii).all()


@pytest.mark.parametrize("wire", [1e-6, 3e-4, 0.2])
def test_a_wire_of_another_size_is_doubted_and_leaves_the_graph_right(wire):
    made = harness("tree", seed=2, views=3)
    model = strand.reconstruct(made.views, None, made.bounds, branches=True, wire=wire)
    assert [edge.wires for edge in model.harness.edges] == [None] * len(made.edges)
    radii = sorted(edge.radius for edge in model.harness.edges)
    assert radii == pytest.approx(sorted(made.radii), rel=0.05)
    (doubt,) = (doubt for doubt in model.doubts if doubt.kind == "wires")
    assert f"no bundles of wires of {1e3 * wire:.3g} mm" in doubt.reason
