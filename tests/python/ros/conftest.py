"""The frames of a rope that a gripper carries, and the entries of their bag. Frames are drawn once."""

from __future__ import annotations

import pytest

import strand
from lib.ros_bags import record_sequence


@pytest.fixture(scope="session")
def carried():
    return list(strand.synthetic.sequence("carry", seed=1, frames=12))


@pytest.fixture(scope="session")
def radius():
    return float(strand.synthetic.sequence("carry", seed=1, frames=1).radius)


@pytest.fixture(scope="session")
def entries(carried):
    return list(record_sequence(carried))


@pytest.fixture(scope="session")
def colored():
    return list(strand.synthetic.sequence("carry", seed=1, frames=3, color=True))
