"""The commands on LeRobot data sets: whole ones, one episode, frames of it, and ropes written back."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

import strand
from lib.lerobot_files import COLOR, DATA, write_data_set
from strand.cli import main
from strand.synthetic import sequence

K_WORDS = ("--intrinsics", "600,600,319.5,239.5")
LENGTHS = (3, 4)


@pytest.fixture(scope="module")
def frames():
    """Return frames of a rope that lies on a table, and of another one."""
    return [frame for seed, count in zip((1, 2), LENGTHS, strict=True) for frame in _draw(seed, count)]


def _draw(seed, count):
    return list(sequence("still", seed, frames=count))


@pytest.fixture(scope="module")
def folder(frames, tmp_path_factory):
    depth = np.stack([frame.depth[0] * np.float32(frame.depth_scale) for frame in frames])
    return write_data_set(tmp_path_factory.mktemp("lerobot") / "set", depth.astype(np.float32), LENGTHS)


def run(*words):
    return main([str(word) for word in words])


def test_info_names_episodes_codes_and_what_is_missing(folder, capsys):
    assert run("info", folder) == 0
    out = capsys.readouterr().out
    assert "recording, LeRobot data set v3.0" in out
    assert "episodes    2" in out
    assert "depth video (0.01 to 10 m, log, lossless)" in out
    assert "missing     intrinsics, radius, bounds" in out
    assert "--episode N for one of 2 episodes" in out
    assert run("info", "--json", folder) == 0
    assert json.loads(capsys.readouterr().out)["holds"]["episodes"] == 2


def test_reconstruct_takes_an_episode_and_a_frame_of_it(folder, tmp_path, capsys):
    for words, expected in (
        (("--every", "2"), [0, 2, 4, 6]),
        (("--episode", "1", "--every", "2"), [3, 5]),
        (("--episode", "0", "--frame", "1", "--every", "1"), [1, 2]),
    ):
        out = tmp_path / "models.jsonl"
        assert run("reconstruct", folder, *K_WORDS, *words, "-o", out) == 0
        assert [number for number, _, _ in strand.io.models.load_frames(out)] == expected
    assert run("reconstruct", folder, *K_WORDS, "--episode", "1", "--frame", "3", "--json") == 0
    capsys.readouterr()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--episode", "2"), "--episode 2: the data set has 2 episodes, 0 to 1"),
        (("--episode", "-1"), "--episode -1: the data set has 2 episodes, 0 to 1"),
        (("--episode", "0", "--frame", "3"), "--frame 3: the episode has 3 frames, 0 to 2"),
        (("--frame", "7"), "--frame 7: the recording has 7 frames, 0 to 6"),
        (("--world", "table"), "world: a LeRobot data set has no TF"),
        (("--topic", "other"), "topics: no depth feature other"),
        (("--color-topic", "other"), "color_topics"),
    ],
)
def test_wrong_choices_are_named(folder, words, message, capsys):
    assert run("reconstruct", folder, *K_WORDS, *words) == 2
    assert message in capsys.readouterr().err


def test_intrinsics_are_asked_for(folder, capsys):
    assert run("reconstruct", folder) == 1
    assert "LeRobot stores no intrinsics; give intrinsics (--intrinsics)" in capsys.readouterr().err


def test_an_episode_is_for_data_sets_alone(tmp_path, capsys):
    strand.synthetic.scene("arc", views=1).save(tmp_path / "arc.npz")
    assert run("reconstruct", tmp_path / "arc.npz", "--episode", "0") == 2
    assert "--episode: for recordings only" in capsys.readouterr().err


def test_colors_reach_the_ropes(folder, capsys):
    assert run("reconstruct", folder, *K_WORDS, "--color-topic", COLOR, "--json") == 0
    (line,) = capsys.readouterr().out.splitlines()
    assert json.loads(line)["chains"][0]["color"] is not None


def test_a_batch_has_a_unit_for_each_episode(folder, tmp_path):
    assert run("batch", folder, "-o", tmp_path / "out", *K_WORDS, "--every", "2", "--workers", "1") == 0
    table = strand.batch.load_table(tmp_path / "out", ["recording", "frame", "time", "error"]).to_pandas()
    assert table["frame"].tolist() == [0, 2, 3, 5]
    np.testing.assert_allclose(table["time"], table["frame"] / 30, atol=1e-6)
    assert table["error"].isna().all()
    units = list(
        strand.batch.find_units([folder], strand.batch.Settings(intrinsics=np.eye(3)), folder.parent)
    )
    assert [(unit.start, unit.stop) for unit in units] == [(0, 3), (3, 7)]
    split = strand.batch.Settings(intrinsics=np.eye(3), stretch=2)
    units = list(strand.batch.find_units([folder], split, folder.parent))
    assert [(unit.start, unit.stop) for unit in units] == [(0, 2), (2, 3), (3, 5), (5, 7)]


def test_track_follows_each_episode_and_writes_a_new_data_set(folder, frames, tmp_path, capsys):
    table, new = tmp_path / "tracks.parquet", tmp_path / "new"
    words = ("--radius", "4mm", "--lerobot", new, "--points", "32")
    assert run("track", folder, *K_WORDS, *words, "-o", table) == 0
    assert str(new) in capsys.readouterr().out
    rows = pd.read_parquet(table)
    assert rows["frame"].tolist() == list(range(7))
    assert rows["rope"].tolist() == [0] * 7
    kept = pd.read_parquet(new / DATA)
    assert kept["observation.rope.valid"].all()
    for number, points in enumerate(kept["observation.rope"]):
        points = np.stack(points)
        assert points.shape == (32, 3)
        # in the frame of the camera, as the data set has no poses
        pose = frames[number].poses[0]
        truth = (frames[number].nodes[0] - pose[:3, 3]) @ pose[:3, :3]
        gaps = np.linalg.norm(points[:, None] - truth[None], axis=2).min(axis=1)
        assert np.quantile(gaps, 0.9) < 0.006
    assert run("info", new) == 0


def test_track_takes_one_episode(folder, tmp_path):
    assert run("track", folder, *K_WORDS, "--episode", "1", "--frame", "1", "-o", tmp_path / "a.parquet") == 0
    assert pd.read_parquet(tmp_path / "a.parquet")["frame"].tolist() == [4, 5, 6]


def test_track_refuses_what_does_not_fit(folder, tmp_path, capsys):
    (tmp_path / "there").mkdir()
    for words, code, message in (
        (("--mcap", tmp_path / "a.mcap"), 2, "--mcap: shows one episode; --episode N chooses it"),
        (("--lerobot", tmp_path / "there"), 3, "never overwritten"),
        (("--points", "8", "-o", tmp_path / "a.parquet"), 2, "--points: only with --lerobot"),
        (("--episode", "2", "-o", tmp_path / "a.parquet"), 2, "--episode 2: the data set has 2 episodes"),
        (("--rate", "30", "-o", tmp_path / "a.parquet"), 2, "--rate: for folders only"),
    ):
        assert run("track", folder, *K_WORDS, *words) == code
        assert message in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["there"]
