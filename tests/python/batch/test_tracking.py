"""Batches that track ropes: rows, workers, interrupted runs, errors and arguments."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

import strand
from lib.bag_files import START, Messages, write_bag
from shared.batch_recordings import Deadly, read_table
from shared.sequence_files import record, save_images, save_scenes, stamp_of
from shared.tracks import check_rows
from strand.batch import (
    Counts,
    Settings,
    find_units,
    load_models,
    load_table,
    local_engine,
    make_rows,
    make_schema,
    run,
    write_summary,
)
from strand.batch.engines import MAX_ATTEMPTS
from strand.batch.shards import list_shards, prepare_folder
from strand.batch.work import Work
from strand.tracking.track import TrackedRope

COUNT = 6  # frames of a folder
FILM = 22  # frames of the longest recording, so that another reconstruction enters
K = np.array([[600.0, 0.0, 319.5], [0.0, 600.0, 239.5], [0.0, 0.0, 1.0]])  # pixels
SETTINGS = Settings(radius=0.004, ropes=1, intrinsics=K, depth_scale=1e-4, track=True)
ROWS = FILM + COUNT // 2 + 2 * COUNT  # of the table
BAD = 3  # frame of the folder of images that cannot be read
OTHER = 4  # frame of that folder with an image of another size


@pytest.fixture(scope="module")
def film():
    return list(strand.synthetic.sequence("carry", seed=1, frames=FILM))


@pytest.fixture(scope="module")
def frames(film):
    return film[:COUNT]


@pytest.fixture(scope="module")
def recordings(film, frames, tmp_path_factory):
    """Two recordings, a folder of depth images with bad ones, and a folder of scenes."""
    folder, films = tmp_path_factory.mktemp("in"), tmp_path_factory.mktemp("films")
    record(films / "a", film).rename(folder / "a.mcap")
    record(films / "b", frames[::2]).rename(folder / "b.mcap")
    save_images(folder / "images", frames)
    shutil.rmtree(folder / "images" / "masks")
    (folder / "images" / f"{BAD:03}.png").write_bytes(b"no image")
    Image.fromarray(frames[0].depth[0][:240]).save(folder / "images" / f"{OTHER:03}.png")
    save_scenes(folder / "scenes", frames, 0.004)
    return folder


@pytest.fixture(scope="module")
def out(recordings, tmp_path_factory):
    """The table of an undisturbed run with one worker."""
    out = tmp_path_factory.mktemp("out")
    assert run(recordings, out, SETTINGS, root=recordings, workers=1) == Counts(4, 0, ROWS, 2)
    return out


def follow(shown):
    """Return a tracker's answers to views and times, made by hand."""
    tracker = strand.Tracker(0.004, 1)
    return [tracker.update(views, times) for views, times in shown]


def select(table, name):
    return [row for row in table.to_pylist() if row["recording"] == name]


def test_rows_are_the_answers_of_a_tracker(recordings, frames, out):
    table = load_table(out)
    assert table.schema == make_schema()
    for name in ("a.mcap", "b.mcap"):
        with strand.Recording(recordings / name) as recording:
            check_rows(select(table, name), follow((frame.views, frame.times) for frame in recording))
    check_rows(select(table, "scenes"), follow(([frame.view()], frame.number / 30) for frame in frames))
    read = [k for k in range(COUNT) if k not in (BAD, OTHER)]
    views = [strand.View.from_depth(frame.depth[0], K, depth_scale=1e-4) for frame in frames]
    rows = select(table, "images")
    check_rows([rows[k] for k in read], follow(([views[k]], k / 30) for k in read), read)
    assert [row["frame"] for row in rows] == list(range(COUNT))
    assert rows[BAD]["error"].startswith("FileFormatError: ")
    assert rows[OTHER]["error"].startswith("ValueError: views[0]: expected an image of (480, 640) pixels")
    assert rows[OTHER]["time"] == OTHER / 30
    assert {rows[k][name] for k in (BAD, OTHER) for name in ("rope", "state", "events")} == {None}


def test_two_workers_make_the_same_rows(recordings, out, tmp_path):
    assert run(recordings, tmp_path, SETTINGS, root=recordings, workers=2).made == 4
    assert read_table(tmp_path).equals(read_table(out))


def test_every_second_frame_keeps_numbers_and_times(recordings, frames, tmp_path):
    settings = replace(SETTINGS, every=2, rate=15.0)
    run(recordings / "scenes", tmp_path, settings, root=recordings, workers=1)
    shown = (([frame.view()], frame.number / 15) for frame in frames[::2])
    check_rows(load_table(tmp_path).to_pylist(), follow(shown), range(0, COUNT, 2))


DRIVER = """
import os
import signal
import sys
import numpy as np
from strand.batch import Settings, run

if __name__ == "__main__":
    K = np.array([[600.0, 0.0, 319.5], [0.0, 600.0, 239.5], [0.0, 0.0, 1.0]])
    settings = Settings(radius=0.004, ropes=1, intrinsics=K, depth_scale=1e-4, track=True)
    end = lambda _: os.kill(os.getpid(), signal.SIGKILL)
    run(sys.argv[1], sys.argv[2], settings, root=sys.argv[1], workers=1, progress=end)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")
def test_a_run_after_a_killed_driver_makes_the_missing_rows(recordings, out, tmp_path):
    (tmp_path / "driver.py").write_text(DRIVER)
    command = [sys.executable, str(tmp_path / "driver.py"), str(recordings), str(tmp_path / "out")]
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    assert subprocess.run(command, env=paths).returncode == -signal.SIGKILL
    assert len(list_shards(tmp_path / "out")) == 1
    done = run(recordings, tmp_path / "out", SETTINGS, root=recordings, workers=1)
    assert (done.made, done.skipped) == (3, 1)
    assert read_table(tmp_path / "out").equals(read_table(out))
    assert run(recordings, tmp_path / "out", SETTINGS, root=recordings) == Counts(0, 4)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")
def test_a_recording_whose_worker_is_killed_begins_again(recordings, out, tmp_path):
    prepare_folder(tmp_path, SETTINGS, recordings)
    (tmp_path / "notes").mkdir()
    deadly = Deadly(
        Work(SETTINGS, str(tmp_path)), ("a.mcap", "scenes"), MAX_ATTEMPTS - 1, str(tmp_path / "notes")
    )
    done = local_engine.run_units(deadly, find_units([recordings], SETTINGS, recordings), 2, 1)
    assert all(counts is not None for _, counts in done)
    assert read_table(tmp_path).equals(read_table(out))


def test_models_have_tracked_ropes(frames, out):
    found = [(frame, model) for name, frame, model in load_models(out) if name == "scenes"]
    tracks = follow(([frame.view()], frame.number / 30) for frame in frames)
    assert [frame for frame, _ in found] == list(range(COUNT))
    for (_, model), track in zip(found, tracks, strict=True):
        (rope,), (want,) = model.chains, track.ropes
        assert isinstance(rope, TrackedRope)
        for name in ("points", "s", "velocity", "covariance", "seen", "predicted", "age", "hidden_ends"):
            np.testing.assert_array_equal(getattr(rope, name), getattr(want, name))
        for name in ("number", "state", "generation", "length", "length_sd", "radius", "label", "confidence"):
            assert getattr(rope, name) == getattr(want, name)
        np.testing.assert_array_equal(rope.up, track.up)


def test_a_table_is_read_by_pandas_and_summarized(out, tmp_path):
    frame = load_table(out).to_pandas()
    tracked = frame[frame.recording == "scenes"].set_index("frame")
    assert tracked.state.notna().all()
    assert (tracked.rope == 0).all()
    speeds = tracked.velocity.map(lambda rows: np.linalg.norm(np.stack(rows), axis=1).max())
    assert speeds.between(0.0, 2.0).all()
    assert [event["kind"] for event in tracked.events[0]] == ["begun"]
    write_summary(out, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert f"4 recordings, {ROWS} frames, {ROWS - 2} of them answered" in page


def test_frames_out_of_order_and_without_ropes(frames, tmp_path):
    made = Messages()
    late = made.image((frames[1].depth[0] * 1e-4).astype(np.float32), stamp_of(frames[1]), "camera_0")
    empty = made.image(np.zeros((480, 640), np.float32), START, "camera_0")
    path = record(
        tmp_path / "film",
        frames[1:4],
        [("/camera_0/depth", START, empty), ("/camera_0/depth", stamp_of(frames[3]) + 1, late)],
    )
    (unit,) = find_units([path], SETTINGS, tmp_path)
    rows = make_rows(unit, replace(SETTINGS, topics=["/camera_0/depth"])).to_pylist()
    assert [row["rope"] for row in rows] == [None, 0, 0, 0, None]
    why = "views: no view has a point; are all depths 0 or not finite?"
    assert rows[0]["warnings"] == [f"no rope: the tracker has found none so far: {why}"]
    assert (rows[0]["error"], rows[0]["events"]) == (None, [])
    assert f"time: expected a time after {stamp_of(frames[3]) / 1e9:.15g} s" in rows[4]["error"]


def test_scenes_of_a_folder_are_one_recording(recordings, frames, tmp_path):
    shutil.copytree(recordings / "scenes", tmp_path / "x" / "inner")
    shutil.copy(recordings / "scenes" / "000.npz", tmp_path / "x" / "a.npz")
    save_images(tmp_path / "x" / "images", frames[:1])
    shutil.copy(recordings / "scenes" / "000.npz", tmp_path / "x" / "images" / "camera.npz")
    found = list(find_units([tmp_path / "x", tmp_path / "x" / "a.npz"], SETTINGS, tmp_path))
    assert [(unit.recording, unit.kind) for unit in found] == [
        ("x", "scenes"),
        ("x/images", "images"),
        ("x/images/masks", "images"),
        ("x/inner", "scenes"),
    ]
    before = {unit.recording: unit.digest for unit in found}
    os.utime(tmp_path / "x" / "inner" / "002.npz", ns=(1, 1))
    after = {unit.recording: unit.digest for unit in find_units([tmp_path / "x"], SETTINGS, tmp_path)}
    assert [name for name in before if before[name] != after[name]] == ["x/inner"]
    # without track, each scene is a recording
    plain = Settings(intrinsics=K)
    assert sum(unit.kind == "scene" for unit in find_units([tmp_path / "x"], plain, tmp_path)) == COUNT + 2
    # a scene of its own has no frames to track
    (unit,) = find_units([tmp_path / "x" / "a.npz"], SETTINGS, tmp_path)
    (row,) = make_rows(unit, SETTINGS).to_pylist()
    assert row["error"].startswith("ValueError: a scene is one frame; to track ropes, name the folder")


def test_a_broken_recording_is_a_row_with_its_error(tmp_path):
    (tmp_path / "a.mcap").write_bytes(b"nonsense")
    write_bag(tmp_path / "b", "mcap", [("/camera_info", START, Messages().info(K, (480, 640), START))])
    assert run(tmp_path, tmp_path / "out", SETTINGS, root=tmp_path, workers=1) == Counts(2, 0, 2, 2)
    rows = load_table(tmp_path / "out").to_pylist()
    assert [row["frame"] for row in rows] == [None, None]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"stretch": 5}, "stretch: not with track: a tracker goes through whole recordings"),
        ({"deadline": 1.0}, "deadline: not with track: a tracker has none"),
        ({"viewpoint": np.zeros(3)}, "viewpoint: not with track: .* a tracker needs depth images"),
        ({"camera_frame": True}, "camera_frame: not with track: .* a tracker needs depth images"),
        ({"rate": 0}, "rate: expected a positive number, got 0"),
        ({"rate": 5.0, "track": False}, "rate: only with track"),
        ({"ropes": 2, "length": (0.3, 0.4, 0.5)}, "length: "),
        ({"radius": (0.003, 0.004)}, "radius: expected one radius, or at most 1"),
    ],
)
def test_arguments_that_make_no_sense_are_refused_by_name(given, said):
    with pytest.raises(ValueError, match=said):
        replace(SETTINGS, **given)
    with pytest.raises(TypeError, match="track: expected"):
        Settings(track=3)


def test_equal_settings_have_equal_digests():
    assert Settings(track=True).digest == Settings(track=True, rate=30).digest
    assert len({Settings().digest, Settings(track=True).digest, Settings(track=True, rate=5).digest}) == 3
