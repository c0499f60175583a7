"""Tests of recordings for Rerun, with a stand-in for its large package."""

from __future__ import annotations

import sys
from dataclasses import replace
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

import strand
from strand.figures import show, write_recording


class Recording:
    def __init__(self, name):
        self.told, self.spawned, self.flushed, self.time = {}, False, False, None
        Recording.last = self

    def log(self, name, what, *, static):
        assert static == (self.time is None)
        assert " " not in name
        self.told.setdefault(name, []).append(what)

    def set_time(self, name, *, timestamp):
        assert name == "time"
        self.time = timestamp

    def memory_recording(self):
        return SimpleNamespace(drain_as_bytes=lambda: b"RRF" + str(len(self.told)).encode())

    def spawn(self):
        self.spawned = True

    def flush(self):
        self.flushed = True


@pytest.fixture
def rerun(monkeypatch):
    stand_in = ModuleType("rerun")

    def kept(kind):
        return lambda *values, **named: SimpleNamespace(kind=kind, values=values, **named)

    for kind in ("Points3D", "LineStrips3D", "Pinhole", "Transform3D", "DepthImage"):
        setattr(stand_in, kind, kept(kind))
    stand_in.RecordingStream = Recording
    stand_in.ViewCoordinates = SimpleNamespace(RDF="RDF")
    stand_in.Radius = SimpleNamespace(ui_points=lambda size: -size)
    monkeypatch.setitem(sys.modules, "rerun", stand_in)


@pytest.mark.usefixtures("rerun")
def test_everything_is_logged_and_the_file_is_complete(paper, paper_model, tmp_path):
    write_recording(paper_model, paper.views, tmp_path / "a.rrd", truth=paper.truth)
    told = Recording.last.told
    assert (tmp_path / "a.rrd").read_bytes() == b"RRF" + str(len(told)).encode()
    assert not Recording.last.spawned
    np.testing.assert_array_equal(told["chains/0"][0].values[0][0], paper_model.chains[0].points)
    np.testing.assert_array_equal(told["points/2"][0].values[0], paper_model.stages["registered"][2])
    transform, pinhole = told["cameras/1"]
    np.testing.assert_array_equal(transform.translation, paper_model.poses[1, :3, 3])
    assert pinhole.resolution == [320, 240]
    np.testing.assert_allclose(told["cameras/1/depth"][0].values[0], paper.views[1].image.depth, rtol=1e-6)
    assert len(told["truth/0"][0].values[0][0]) == len(paper.truth[0])
    assert {"ends/0", "crossings", "next_view"} <= set(told)


@pytest.mark.usefixtures("rerun")
def test_a_model_with_a_stamp_is_on_a_timeline(paper, paper_model, tmp_path):
    for stamp in (None, 1_700_000_000.5):
        write_recording(replace(paper_model, stamp=stamp), paper.views, tmp_path / "a.rrd")
        assert Recording.last.time == stamp
        assert "chains/0" in Recording.last.told


@pytest.mark.usefixtures("rerun")
def test_a_window_is_opened_only_on_request(paper, paper_model):
    show(paper_model, paper.views)
    assert Recording.last.spawned
    assert Recording.last.flushed


@pytest.mark.usefixtures("rerun")
def test_a_viewer_that_does_not_start_raises_strand_error(paper, paper_model, monkeypatch):
    def spawn(_):
        raise RuntimeError("no display\nsee the manual")

    monkeypatch.setattr(Recording, "spawn", spawn)
    with pytest.raises(strand.StrandError, match=r"cannot be started \(no display\); write_recording"):
        show(paper_model, paper.views)


@pytest.mark.usefixtures("rerun")
def test_models_without_chains_and_views_without_points(tmp_path):
    model = strand.Model((), np.eye(4)[None])
    write_recording(model, [strand.View(np.empty((0, 3)))], tmp_path / "a.rrd")
    assert set(Recording.last.told) == {"points/0"}
    with pytest.raises(ValueError, match="views: expected the 1"):
        write_recording(model, [strand.View(np.ones((1, 3)))] * 2, tmp_path / "b.rrd")
    assert not (tmp_path / "b.rrd").exists()


def test_names_the_missing_package(paper, paper_model, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(ImportError, match=r'rerun-sdk is needed here: pip install "[\w.-]+\[rerun\]"'):
        write_recording(paper_model, paper.views, tmp_path / "a.rrd")
