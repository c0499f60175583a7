"""A scene's file, for the tests of commands."""

from __future__ import annotations

import pytest

import strand


@pytest.fixture
def scene_npz(tmp_path):
    path = tmp_path / "arc.npz"
    strand.synthetic.scene("arc", views=3).save(path)
    return path
