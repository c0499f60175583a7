"""What several files share: the data folder, the scenes, the real frames, the measure of a reconstruction."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benches"))

import collection
import frames
from measure import Measure, measured

import strand
from strand.synthetic import SyntheticScene


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of stored data."""
    return collection.DATA


@pytest.fixture(scope="session")
def collected() -> Callable[[str], SyntheticScene]:
    """A scene of the collection by its name."""
    return cache(collection.scene)


@pytest.fixture(scope="session")
def frame() -> Callable[[str], strand.View]:
    """A real depth frame by its number, in the camera frame: x right, y down, z forward."""
    return lambda name: strand.View.from_depth(frames.depth(name), frames.intrinsics())


@pytest.fixture(scope="session")
def measure() -> Callable[[strand.Model, Sequence[np.ndarray], float], Measure]:
    """How well a model matches true centrelines."""
    return lambda model, truth, radius: measured([chain.points for chain in model.chains], truth, radius)
