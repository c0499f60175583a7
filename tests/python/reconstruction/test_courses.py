"""Courses of chains."""

from __future__ import annotations

from shared.ropes import R, draw_line
from strand.reconstruction.courses import have_same_courses


def test_courses_are_the_same_whatever_the_direction_of_chains():
    chains = [(draw_line([0, 0, 0], [0.1, 0, 0]), False), (draw_line([0, 0.05, 0], [0.1, 0.05, 0]), False)]
    flipped = [(chains[1][0][::-1], False), chains[0]]
    assert have_same_courses(chains, flipped, R)
    assert not have_same_courses(chains, chains[:1], R)
    other = [chains[0], (draw_line([0, 0.05, 0], [0.1, 0.09, 0]), False)]
    assert not have_same_courses(chains, other, R)
