"""Tables of tracks, sources of frames, and masks for a tracker; the pages and recordings that show tracks."""

from __future__ import annotations

import base64
import json
import re
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pyarrow.parquet as pq
import pytest

import strand
from strand.figures import write_track_recording, write_track_report
from strand.tracking.events import Event
from strand.tracking.following import follow
from strand.tracking.masking import mask_ropes
from strand.tracking.tables import make_schema, open_table, write_tracks
from strand.tracking.track import Track, TrackedRope

UP = np.array([0.0, 0.0, 1.0])
NODES = 21
LIMIT = 5_000_000  # bytes of a page


def make_rope(number, shift=0.0, label=None):
    """Return a straight rope of 200 mm, half of it predicted."""
    s = np.linspace(0.0, 0.2, NODES)
    predicted = s > 0.1
    return TrackedRope(
        np.stack([s, np.full(NODES, shift), np.full(NODES, 0.004)], axis=1),
        0.004,
        covariance=np.tile(1e-6 * np.diag([1.0, 2.0, 3.0]), (NODES, 1, 1)),
        confidence=0.9 if number else float("nan"),
        label=label,
        number=number,
        s=s,
        velocity=np.tile([0.1, 0.0, 0.0], (NODES, 1)),
        seen=~predicted,
        predicted=predicted,
        age=np.where(predicted, 0.2, 0.0),
        length_sd=0.001,
    )


@pytest.fixture
def tracks():
    """Nothing, one rope, two ropes with events."""
    happened = (
        Event("crossing made", 0.2, 1, 0.05, (0, 0.15), True),
        Event("begun", 0.2, 1),
    )
    return [
        Track((), (), 0.0, (0.0,), 0.0, UP, None),
        Track((make_rope(0),), (Event("begun", 0.1, 0),), 0.1, (0.1,), 0.01, UP, None),
        Track((make_rope(0, 0.01), make_rope(1, 0.02, label=7)), happened, 0.2, (0.2,), 0.02, UP, None),
    ]


def test_a_row_is_a_rope_of_a_frame_with_its_events(tracks, tmp_path):
    path = tmp_path / "tracks.parquet"
    assert write_tracks(iter(tracks), path) == 3
    assert pq.read_schema(path).remove_metadata().equals(make_schema())
    assert pq.ParquetFile(path).metadata.metadata[b"strand.tracks"] == b"1"
    rows = pq.read_table(path).to_pylist()
    assert [(row["frame"], row["rope"]) for row in rows] == [(0, None), (1, 0), (2, 0), (2, 1)]
    assert rows[0]["nodes"] is None
    assert rows[0]["events"] == []
    assert [row["confidence"] for row in rows] == [None, None, None, 0.9]
    assert rows[3]["label"] == 7
    np.testing.assert_array_equal(rows[3]["covariance"][5], (1e-6 * np.diag([1.0, 2.0, 3.0])).ravel())
    assert rows[3]["predicted"] == (np.linspace(0.0, 0.2, NODES) > 0.1).tolist()
    crossing, begun = rows[3]["events"]
    assert crossing == {
        "kind": "crossing made",
        "s": 0.05,
        "under_rope": 0,
        "under_s": 0.15,
        "doubtful": True,
    }
    assert (begun["kind"], begun["s"], begun["under_rope"]) == ("begun", None, None)
    assert rows[2]["events"] == []


def test_many_rows_are_written_in_parts_and_an_error_leaves_the_file(tracks, tmp_path):
    path = tmp_path / "tracks.parquet"
    write_tracks(tracks * 150, path)
    file = pq.ParquetFile(path)
    assert file.metadata.num_rows == 600
    assert file.metadata.num_row_groups > 1
    before = path.read_bytes()

    def stop():
        yield tracks[1]
        raise strand.StrandError("enough")

    with pytest.raises(strand.StrandError, match="enough"):
        write_tracks(stop(), path)
    assert path.read_bytes() == before
    assert [one.name for one in tmp_path.iterdir()] == ["tracks.parquet"]
    with open_table(path) as table:
        table.add_error(3, None, "FileFormatError: damaged")
    (row,) = pq.read_table(path).to_pylist()
    assert (row["frame"], row["time"], row["rope"], row["error"]) == (
        3,
        None,
        None,
        "FileFormatError: damaged",
    )


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
