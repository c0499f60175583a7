"""Radii of bundles, chosen together."""

from __future__ import annotations

import numpy as np
import pytest

from strand.reconstruction.harness.wires import choose_radii, list_bundles

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
