"""Recordings for the tests of batches, and their table."""

from __future__ import annotations

import pytest

from shared.batch_recordings import COUNT, SETTINGS, read_table, save_scenes
from strand.batch import Counts, run


@pytest.fixture(scope="session")
def recordings(tmp_path_factory):
    return save_scenes(tmp_path_factory.mktemp("recordings"), COUNT)


@pytest.fixture(scope="session")
def expected(recordings, tmp_path_factory):
    """The table of an undisturbed run with two workers."""
    out = tmp_path_factory.mktemp("expected")
    assert run(recordings, out, SETTINGS, root=recordings, workers=2) == Counts(COUNT, 0, COUNT, 0)
    return read_table(out)
