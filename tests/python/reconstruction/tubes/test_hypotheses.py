"""Hypotheses."""

from __future__ import annotations

from drawn import R, line

from strand.reconstruction.tubes.hypotheses import alike


def test_assemblies_are_alike_whatever_the_direction_of_their_chains():
    chains = [(line([0, 0, 0], [0.1, 0, 0]), False), (line([0, 0.05, 0], [0.1, 0.05, 0]), False)]
    flipped = [(chains[1][0][::-1], False), chains[0]]
    assert alike(chains, flipped, R)
    assert not alike(chains, chains[:1], R)
    other = [chains[0], (line([0, 0.05, 0], [0.1, 0.09, 0]), False)]
    assert not alike(chains, other, R)
