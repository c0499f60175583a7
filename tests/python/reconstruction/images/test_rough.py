"""Ropes whose masks have gaps, miss pixels of the rope or hold pixels of the table."""

from __future__ import annotations

import pytest

import strand
from strand.synthetic import rough_scene


@pytest.mark.parametrize(
    ("kind", "seed", "known"), [("bar", 0, True), ("bar", 8, True), ("bar", 9, False), ("ragged", 6, True)]
)
def test_a_rope_behind_a_bar_and_one_in_a_ragged_mask_are_right(kind, seed, known, measure):
    made = rough_scene(kind, seed)
    ropes = len(made.truth) if known else None
    model = strand.reconstruct(made.views, made.radius, made.bounds, ropes=ropes)
    assert measure(model, made.truth, made.radius).right
