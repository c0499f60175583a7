"""What several files share: stored data, scenes, models, real frames, the measure of a reconstruction."""

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
    """Listen to interrupts, which tests raise: what a shell starts in the background may ignore them."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_unconfigure() -> None:
    """Forget interrupts that tests raised in blocks of code, by running one that ends well.

    Python remembers how the last compiled string ended, and makes a KeyboardInterrupt its own exit code, 130.
    """
    exec("pass")


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of stored data."""
    return collection.DATA


@pytest.fixture(scope="session")
def collected() -> Callable[[str], SyntheticScene]:
    """A scene of the collection by its name."""
    return cache(collection.make_scene)


@pytest.fixture(scope="session")
def paper() -> SyntheticScene:
    """The published experiment, simulated."""
    return strand.synthetic.scene("paper", seed=3)


@pytest.fixture(scope="session")
def paper_model(paper: SyntheticScene) -> strand.Model:
    """What the default method makes of it, with the stages."""
    return strand.reconstruct(paper.views, paper.radius, paper.bounds, keep_stages=True)


@pytest.fixture(scope="session")
def tucked_under() -> SyntheticScene:
    """A rope whose end lies under another one, one radius beyond its axis, seen from one place."""
    over = [
        np.linspace(-0.1, 0.1, 201),
        np.zeros(201),
        R + 2.2 * R * np.exp(-((np.arange(-100, 101) / 20) ** 2)),
    ]
    under = [np.zeros(111), np.linspace(-0.11 + R, R, 111), np.full(111, R)]
    return strand.synthetic.scene(chains=[np.stack(over, axis=1), np.stack(under, axis=1)], views=1, seed=5)


@pytest.fixture(scope="session")
def frame() -> Callable[[str], strand.View]:
    """A real depth frame by its number, in the camera frame: x right, y down, z forward."""
    return lambda name: strand.View.from_depth(frames.load_depth(name), frames.load_intrinsics())


@pytest.fixture(scope="session")
def measure() -> Callable[[strand.Model, Sequence[np.ndarray], float], Measure]:
    """How well a model matches true centrelines."""
    return lambda model, truth, radius: measure_chains(
        [chain.points for chain in model.chains], truth, radius
    )


@pytest.fixture
def threads() -> Iterator[Callable[[int], None]]:
    """Sets the number of threads; afterwards it is as it was."""
    yield strand.set_num_threads
    strand.set_num_threads(0)


def pytest_sessionfinish(session: pytest.Session) -> None:
    """A skipped test fails the run: it would hide what is missing."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if reporter is not None and reporter.stats.get("skipped") and session.exitstatus == 0:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
