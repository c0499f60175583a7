"""Sources of frames, and masks for a tracker; the pages and recordings that show tracks."""

from __future__ import annotations

import base64
import json
import re
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

import strand
from shared.tracks import NODES, make_tracks
from strand.figures import write_track_recording, write_track_report
from strand.tracking.following import follow
from strand.tracking.masking import mask_ropes

LIMIT = 5_000_000  # bytes of a page


@pytest.fixture
def tracks():
    return make_tracks()


class Counter:
    """Stands for a tracker: its answer is its arguments."""

    def update(self, views, time):
        return views, time


def test_frames_come_from_a_list_or_a_callable():
    shown = [(["a"], 0.0), (["b"], (0.1, 0.2))]
    assert list(follow(Counter(), shown)) == shown
    left = [None, *shown[::-1]]
    assert list(follow(Counter(), left.pop)) == shown
    assert left == []


@pytest.fixture(scope="module")
def scene():
    return strand.synthetic.frame_scene("usual", 0)


def test_ropes_are_found_where_there_is_no_mask(scene):
    camera = (scene.intrinsics, scene.poses[0])
    view = strand.View.from_depth(scene.depth[0], *camera, depth_scale=scene.depth_scale)
    (found,) = mask_ropes([view], scene.radius)
    truth = scene.mask[0] > 0
    assert (found.mask & truth).sum() > 0.6 * (found.mask | truth).sum()
    rows, columns = np.nonzero(found.mask)
    points = found.image.lift(rows, columns, found.image.depth[rows, columns])
    least = float(np.median(points[:, 0])) - 0.02
    low, high = np.array([least, -10.0, -10.0]), np.array([10.0, 10.0, 10.0])
    (part,) = mask_ropes([view], scene.radius, (low, high))
    inside = np.zeros_like(truth)
    inside[rows, columns] = points[:, 0] >= least
    assert part.mask.sum() > 0.3 * found.mask.sum()
    assert not (part.mask & found.mask & ~inside).any()
    (kept,) = mask_ropes([found], scene.radius, (low, high))
    np.testing.assert_array_equal(kept.mask, inside & (found.image.depth > 0))
    (own,) = mask_ropes([found], scene.radius)
    assert own is found


def test_a_table_without_ropes_has_an_empty_mask(scene):
    view = strand.View.from_depth(np.ones((120, 160)), np.array([[150.0, 0, 80], [0, 150, 60], [0, 0, 1]]))
    (found,) = mask_ropes([view], 0.004)
    assert not found.mask.any()
    with pytest.raises(ValueError, match=r"views\[1\]: expected a view of a depth image"):
        mask_ropes([view, strand.View(np.ones((5, 3)))])


def read_page(path, name):
    text = path.read_text("utf-8")
    return json.loads(
        re.search(rf'<script type="application/json" id="{name}">(.*?)</script>', text).group(1)
    )


def test_a_page_holds_nodes_events_and_states(tracks, tmp_path):
    path = tmp_path / "a.html"
    write_track_report(tracks, path, title="<b>", numbers=[4, 6, 8])
    said = path.read_text("utf-8")
    assert "rope 0: 200 mm, tracking at the end, confidence not known; " in said
    assert "rope 1: 200 mm, tracking at the end, confidence 0.90: act on it where it is seen." in said
    film = read_page(path, "film")
    assert film["frames"] == [4, 6, 8]
    assert film["times"] == pytest.approx([0.0, 0.1, 0.2])
    assert film["events"] == [1, 2, 2]
    assert [rope["name"] for rope in film["ropes"]] == ["rope 0", "rope 1"]
    assert [film["states"][k] if k >= 0 else None for k in film["ropes"][1]["states"]] == [
        None,
        None,
        "tracking",
    ]
    nodes = np.frombuffer(base64.b64decode(film["ropes"][1]["nodes"]), "<f4").reshape(3, film["nodes"], 3)
    assert np.isnan(nodes[:2]).all()
    np.testing.assert_allclose(nodes[2, [0, -1], 0], [0.0, 200.0], atol=1e-3)
    np.testing.assert_allclose(nodes[2, :, 1], 20.0, atol=1e-3)
    hidden = np.frombuffer(base64.b64decode(film["ropes"][1]["hidden"]), "u1").reshape(3, film["nodes"])
    assert hidden[2].mean() == pytest.approx(0.5, abs=0.05)
    text = path.read_text("utf-8")
    assert "<h1>&lt;b&gt;</h1>" in text
    assert "rope 1 at 50 mm: crossing made, over rope 0 at 150 mm, doubtful" in text
    with pytest.raises(ValueError, match="numbers: expected one for each of 3 tracks, got 1"):
        write_track_report(tracks, path, numbers=[1])


def test_a_page_is_small_for_any_number_of_frames(tracks, tmp_path):
    write_track_report(tracks * 2000, tmp_path / "a.html")
    assert (tmp_path / "a.html").stat().st_size < LIMIT
    text = (tmp_path / "a.html").read_text("utf-8")
    assert "6000 frames" in text
    assert "of them are shown" in text
    assert "more</p>" in text
    write_track_report([], tmp_path / "b.html")
    assert read_page(tmp_path / "b.html", "film")["times"] == []


class Recording:
    def __init__(self, name):
        self.told, self.now = [], {}
        Recording.last = self

    def set_time(self, name, **when):
        self.now[name] = when

    def log(self, name, what):
        self.told.append((self.now["frame"]["sequence"], name, what))

    def memory_recording(self):
        return SimpleNamespace(drain_as_bytes=lambda: b"RRF")


def test_rerun_gets_a_timeline(tracks, tmp_path, monkeypatch):
    stand_in = ModuleType("rerun")
    for kind in ("Points3D", "LineStrips3D", "TextLog", "Clear"):
        setattr(stand_in, kind, lambda *values, kind=kind, **named: (kind, values, named))
    stand_in.RecordingStream = Recording
    stand_in.Radius = SimpleNamespace(ui_points=lambda size: -size)
    monkeypatch.setitem(sys.modules, "rerun", stand_in)
    clouds = [np.zeros((k, 3)) for k in range(4)]
    write_track_recording([*tracks, tracks[1]], tmp_path / "a.rrd", clouds=clouds)
    assert (tmp_path / "a.rrd").read_bytes() == b"RRF"
    told = Recording.last.told
    assert {frame for frame, name, _ in told if name == "points"} == {0, 1, 2, 3}
    ((_, (seen,), _), (_, (predicted,), _)) = (
        next(what for frame, name, what in told if frame == 2 and name == f"ropes/1/{part}")
        for part in ("line", "predicted")
    )
    assert len(seen[0]) + len(predicted[0]) == NODES + 1
    assert [what[0] for frame, name, what in told if name == "ropes/1"] == ["Clear"]
    assert [frame for frame, name, _ in told if name == "events"] == [1, 2, 2, 3]
    with pytest.raises(ValueError, match="clouds: expected one for each of 3 tracks, got 4"):
        write_track_recording(tracks, tmp_path / "a.rrd", clouds=clouds)
