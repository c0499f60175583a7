"""`strand track`."""

from __future__ import annotations

import sys
from types import ModuleType

import numpy as np
import pyarrow.parquet as pq
import pytest

import strand
from lib.bag_files import START, Messages, write_bag
from shared.scene_files import make_ply, write_scene
from shared.sequence_files import K_WORDS, record, save_images, save_scenes, stamp_of
from shared.tracks import check_rows
from strand.cli import main

COUNT = 4
SIZE = (480, 640)


@pytest.fixture(scope="module")
def made():
    return strand.synthetic.sequence("still", seed=1, frames=COUNT, views=2)


@pytest.fixture(scope="module")
def frames(made):
    return list(made)


def follow(made, shown):
    """Return the answers of a tracker for views and times."""
    tracker = strand.Tracker(made.radius, 1)
    return [tracker.update(views, times) for views, times in shown]


def test_a_recording_of_two_cameras_becomes_a_table(made, frames, tmp_path, capsys):
    path, out = record(tmp_path / "bag", frames), tmp_path / "tracks.parquet"
    radius = ["--radius", f"{made.radius}", "--ropes", "1"]
    words = [str(path), *radius, "-o", str(out), "--topic", "/camera_*/depth", "--world", "world"]
    assert main(["track", *words]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert printed[0] == f"frame 0 at {START / 1e9 + 0.002:.3f} s: rope 0: begun"
    assert printed[-1] == str(out)
    assert f"{COUNT} frames, " in "\n".join(printed)
    shown = []
    for frame in frames:
        depths = (frame.depth * frame.depth_scale).astype(np.float32)
        views = [
            strand.View.from_depth(depth, frame.intrinsics, pose)
            for depth, pose in zip(depths, frame.poses, strict=True)
        ]
        times = [stamp_of(frame, k) / 10**9 for k in range(2)]
        shown.append((views, times))
    rows = pq.read_table(out).to_pylist()
    assert [row["frame"] for row in rows] == list(range(COUNT))
    for row, track in zip(rows, follow(made, shown), strict=True):
        # poses come from quaternions, and pixels at the edge of what stands out come and go
        np.testing.assert_allclose(row["nodes"], track.ropes[0].points, rtol=0, atol=1e-3)
        assert row["image_times"] == list(track.image_times)
    truth = frames[-1].nodes[0]
    gaps = np.linalg.norm(truth[:, None] - np.array(rows[-1]["nodes"]), axis=2).min(axis=1)
    assert gaps.mean() < 0.5 * made.radius


def test_a_folder_of_scenes_has_masks_and_a_radius(made, frames, tmp_path, capsys):
    folder = save_scenes(tmp_path / "scenes", frames, made.radius)
    out = tmp_path / "tracks.parquet"
    assert main(["track", str(folder), "--ropes", "1", "--rate", "20", "-o", str(out)]) == 0
    capsys.readouterr()
    shown = [([frame.view(0), frame.view(1)], frame.number / 20) for frame in frames]
    check_rows(pq.read_table(out).to_pylist(), follow(made, shown))


def test_a_folder_of_images_takes_masks_beside_them(made, frames, tmp_path, capsys):
    folder = save_images(tmp_path / "depth", frames)
    out = tmp_path / "tracks.parquet"
    known = [*K_WORDS, "--radius", f"{made.radius}", "--ropes", "1", "--mask", str(folder / "masks")]
    words = ["track", str(folder), *known, "--frame", "1", "--every", "2", "-o", str(out)]
    assert main(words) == 0
    numbers = range(1, COUNT, 2)
    shown = []
    for k in numbers:  # without poses, the camera's frame is the world's
        depth = frames[k].depth[0]
        view = strand.View.from_depth(depth, made.intrinsics, depth_scale=1e-4, mask=frames[k].mask[0])
        shown.append(([view], k / 30))
    check_rows(pq.read_table(out).to_pylist(), follow(made, shown), numbers)
    (folder / "masks" / "003.png").unlink()
    capsys.readouterr()
    assert main(words) == 2
    assert "--mask: expected an image for each depth image" in capsys.readouterr().err


def test_damaged_frames_and_frames_out_of_order_are_rows_with_an_error(made, frames, tmp_path, capsys):
    folder = save_images(tmp_path / "depth", frames)
    (folder / "002.png").write_bytes(b"no image")
    out = tmp_path / "tracks.parquet"
    known = [*K_WORDS, "--radius", f"{made.radius}", "--ropes", "1"]
    assert main(["track", str(folder), *known, "-o", str(out)]) == 0
    said = capsys.readouterr()
    assert "strand: warning: frame 2: " in said.err
    assert f"{COUNT - 1} frames, " in said.out
    assert ", 1 with an error" in said.out
    rows = pq.read_table(out).to_pylist()
    assert [row["frame"] for row in rows if row["error"]] == [2]
    assert rows[2]["error"].startswith("FileFormatError: ")
    assert rows[2]["rope"] is None
    assert rows[3]["rope"] == 0

    made_messages = Messages()
    late = frames[1]
    again = made_messages.image((late.depth[0] * 1e-4).astype(np.float32), stamp_of(late), "camera_0")
    path = record(tmp_path / "bag", frames[:3], [("/camera_0/depth", stamp_of(frames[2]) + 1, again)])
    words = ["--topic", "/camera_0/depth", "--radius", f"{made.radius}", "-o", str(out)]
    assert main(["track", str(path), *words]) == 0
    late = f"time: expected a time after {stamp_of(frames[2]) / 1e9:.15g} s, that of the last frame"
    assert f"strand: warning: frame 3: {late}" in capsys.readouterr().err
    assert late in pq.read_table(out).to_pylist()[-1]["error"]


def test_frames_without_ropes_leave_no_file(tmp_path, capsys):
    made = Messages()
    empty = made.image(np.zeros(SIZE, np.uint16), START)
    info = made.info(np.diag([600.0, 600.0, 1.0]), SIZE, START)
    path = write_bag(tmp_path / "bag", "mcap", [("/camera_info", START, info), ("/depth", START, empty)])
    out = tmp_path / "tracks.parquet"
    out.write_text("before")
    assert main(["track", str(path), "-o", str(out), "--report", str(tmp_path / "a.html")]) == 1
    assert "none of 1 frames supports an answer" in capsys.readouterr().err
    assert out.read_text() == "before"
    assert sorted(one.name for one in tmp_path.iterdir()) == ["bag", "tracks.parquet"]


@pytest.fixture(scope="module")
def folder(frames, tmp_path_factory):
    """A folder with one frame as images, as a bag, as points, and with no frame at all."""
    folder = tmp_path_factory.mktemp("recordings")
    save_images(folder / "depth", frames[:1])
    record(folder / "bag", frames[:1])
    (folder / "empty").mkdir()
    (folder / "points").mkdir()
    np.savetxt(folder / "points" / "0.xyz", np.random.default_rng(0).normal(3.0, 0.1, (50, 3)))
    strand.synthetic.scene("arc", views=1).save(folder / "depth" / "masks" / "a.npz")
    return folder


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["no.bag", "-o", "a.parquet"], 3, "no.bag: No such file or directory"),
        (["empty", "-o", "a.parquet"], 2, "recordings: "),
        (["points", "-o", "a.parquet"], 2, "recordings: "),
        (["depth"], 2, "expected at least one of --out, --report, --rerun, --mcap and --lerobot, got none"),
        (["depth", "--mcap", "a.bag"], 2, "a.bag: expected a name that ends with .mcap"),
        (["depth", "-o", "a.csv"], 2, "a.csv: expected a name that ends with .parquet"),
        (["depth", "-o", "no/a.parquet"], 3, "no/a.parquet: No such file or directory"),
        (["depth", "-o", "a.parquet", "--report", "a.parquet"], 2, "expected different files"),
        (["depth", "-o", "a.parquet"], 2, "intrinsics: "),
        (["depth", "-o", "a.parquet", *K_WORDS, "--rate", "0"], 2, "rate: expected a positive number"),
        (["depth", "-o", "a.parquet", *K_WORDS, "--frame", "-1"], 2, "--frame: expected at least 0"),
        (["depth", "-o", "a.parquet", *K_WORDS, "--every", "0"], 2, "every: expected at least 1"),
        (
            ["depth", "-o", "a.parquet", *K_WORDS, "--frame", "1"],
            2,
            "--frame 1: the folder has 1 frame, 0",
        ),
        (["depth", "-o", "a.parquet", *K_WORDS, "--radius", "0"], 2, "radius: "),
        (
            ["depth", "--report", "depth/000.png", *K_WORDS],
            2,
            "--report: expected another file than the inputs",
        ),
        (["bag", "-o", "a.parquet", "--rate", "5"], 2, "--rate: for folders only"),
        (["bag", "-o", "a.parquet", "--mask", "depth"], 2, "--mask: for folders of depth images only"),
        (["bag", "-o", "a.parquet"], 2, "topics: "),
        ([".", "-o", "a.parquet"], 2, "RECORDING: expected one, got "),
    ],
)
def test_errors_are_one_line(words, code, said, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    before = sorted(folder.rglob("*"))
    assert main(["track", *words]) == code
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("strand: error: ")
    assert said in line
    assert sorted(folder.rglob("*")) == before


def test_a_recording_of_points_is_refused(tmp_path, capsys):
    (tmp_path / "a.ply").write_bytes(make_ply())
    write_scene(tmp_path, "a.ply", head="")
    words = ["track", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "a.parquet")]
    assert main(words) == 1
    assert "expected depth images, which a tracker needs, got points" in capsys.readouterr().err
    assert sorted(one.name for one in tmp_path.iterdir()) == ["a.ply", "scene.toml"]


@pytest.mark.parametrize(
    ("option", "module"), [("--out", "pyarrow.parquet"), ("--report", "plotly.offline"), ("--rerun", "rerun")]
)
def test_missing_packages_are_named_before_the_work(option, module, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, module, None)
    assert main(["track", "no.bag", option, "a.parquet"]) == 3
    assert "is needed here: pip install" in capsys.readouterr().err


def test_rerun_shows_a_bounded_number_of_points_near_the_ropes(made, frames, tmp_path, monkeypatch):
    folder, shown = save_images(tmp_path / "depth", frames[:2]), []
    monkeypatch.setitem(sys.modules, "rerun", ModuleType("rerun"))
    monkeypatch.setattr(
        "strand.cli.track.write_track_recording",
        lambda tracks, path, numbers, clouds: shown.extend(zip(tracks, clouds, strict=True)),
    )
    words = [*K_WORDS, "--radius", f"{made.radius}", "--rerun", str(tmp_path / "a.rrd")]
    assert main(["track", str(folder), *words]) == 0
    assert len(shown) == 2
    for track, cloud in shown:
        assert 5_000 < len(cloud) <= 20_000  # of 307,200 pixels
        near = track.model.nearest(cloud.astype(float)).distance < 3.0 * made.radius
        assert near.mean() > 0.3


def test_a_page_is_written_along(made, frames, tmp_path, capsys):
    folder, page = save_images(tmp_path / "depth", frames[:3]), tmp_path / "a.html"
    words, updates = ["track", str(folder), *K_WORDS, "--radius", f"{made.radius}"], tmp_path / "a.mcap"
    assert main([*words, "--report", str(page), "--mcap", str(updates)]) == 0
    assert capsys.readouterr().out.splitlines()[-2:] == [str(page), str(updates)]
    assert updates.read_bytes().count(b'"id": "rope_0"') == 3
    assert b'"frame_id": "world"' in updates.read_bytes()
    bag = str(record(tmp_path / "bag", frames[:3]))
    known = ["--topic", "/camera_0/depth", "--radius", f"{made.radius}", "--mcap", str(updates)]
    for world in ([], ["--world", "camera_1"]):
        assert main(["track", bag, *known, *world]) == 0
        frame_id = world[1] if world else "camera_0"
        assert f'"frame_id": "{frame_id}"'.encode() in updates.read_bytes()
    text = page.read_text("utf-8")
    assert "<h1>depth</h1>" in text
    assert "3 frames in 0.07 s; rope 0: " in text
