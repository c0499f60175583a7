"""Fixtures of several tests: stored data, scenes, models, real frames, the measure of a reconstruction."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import strand
from lib import collection, frames
from lib.measure import Measure, measure_chains
from shared.ropes import R
from strand.synthetic import SyntheticScene


def pytest_configure() -> None:
    """Listen to interrupts, which tests raise: a shell may ignore them for background processes."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_unconfigure() -> None:
    """Forget interrupts that tests raised in blocks of code, by running one that ends well.

    Python remembers how the last compiled string ended, and makes a KeyboardInterrupt its own exit code, 130.
    """
    exec("pass")


@pytest.fixture(scope="session")
def data() -> Path:
    """Return the folder of stored data."""
    return collection.DATA


@pytest.fixture(scope="session")
def collected() -> Callable[[str], SyntheticScene]:
    """Return a function that gives a scene of the collection by its name."""
    return cache(collection.make_scene)


@pytest.fixture(scope="session")
def paper() -> SyntheticScene:
    """Return the published experiment, simulated."""
    return strand.synthetic.scene("paper", seed=3)


@pytest.fixture(scope="session")
def paper_model(paper: SyntheticScene) -> strand.Model:
    """Return its model by the default method, with the stages."""
    return strand.reconstruct(paper.views, paper.radius, paper.bounds, keep_stages=True)


@pytest.fixture(scope="session")
def tucked_under() -> SyntheticScene:
    """Return a rope whose end lies under another rope, a radius beyond its axis, seen by one camera."""
    over = [
        np.linspace(-0.1, 0.1, 201),
        np.zeros(201),
        R + 2.2 * R * np.exp(-((np.arange(-100, 101) / 20) ** 2)),
    ]
    under = [np.zeros(111), np.linspace(-0.11 + R, R, 111), np.full(111, R)]
    return strand.synthetic.scene(chains=[np.stack(over, axis=1), np.stack(under, axis=1)], views=1, seed=5)


@pytest.fixture(scope="session")
def frame() -> Callable[[str], strand.View]:
    """Return a function that gives a real depth frame by its number, in the camera frame."""
    return lambda name: strand.View.from_depth(frames.load_depth(name), frames.load_intrinsics())


@pytest.fixture(scope="session")
def measure() -> Callable[[strand.Model, Sequence[np.ndarray], float], Measure]:
    """Return a function that measures a model by true centrelines."""
    return lambda model, truth, radius: measure_chains(
        [chain.points for chain in model.chains], truth, radius
    )


@pytest.fixture
def threads() -> Iterator[Callable[[int], None]]:
    """Give a function that sets the number of threads, and restore it afterwards."""
    yield strand.set_num_threads
    strand.set_num_threads(0)


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail the run if a test was skipped: that would hide a missing package."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if reporter is not None and reporter.stats.get("skipped") and session.exitstatus == 0:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
