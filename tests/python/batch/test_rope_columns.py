"""Ropes as columns of a LeRobot data set: read back by pandas and by strand; the data set stays as it was."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

import strand
from lib.lerobot_files import COLOR, DATA, DEPTH, EPISODES, change_info, make_ramp, write_data_set
from shared.tracks import make_rope
from strand.batch import write_lerobot
from strand.ropes.chain import Chain
from strand.ropes.model import Model

LENGTHS = (3, 5)
NODES = 40


def make_chain(k, shift=0.0, **more):
    """Return an arc whose end depends on the frame."""
    angle = np.linspace(0.0, 1.0 + 0.1 * k, NODES)
    points = np.stack([0.1 * np.cos(angle), 0.1 * np.sin(angle), np.full(NODES, 0.5 + shift)], axis=1)
    return Chain(points, 0.004, confidence=0.5 + 0.05 * k, **more)


def make_model(*chains):
    return Model(tuple(chains), np.empty((0, 4, 4)))


def digest(folder):
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.fixture(params=["video", "tiff"])
def data_set(request, tmp_path):
    return write_data_set(tmp_path / "set", make_ramp(8), LENGTHS, request.param)


def read_rows(folder):
    return pd.read_parquet(folder / DATA)


def test_pandas_reads_the_points_of_each_frame(data_set, tmp_path):
    before, out = digest(data_set), tmp_path / "new"
    models = {k: make_model(make_chain(k)) for k in (0, 2, 3, 7)}
    write_lerobot(models.items(), data_set, out, points=16)
    assert digest(data_set) == before
    rows, old = read_rows(out), read_rows(data_set)
    pd.testing.assert_frame_equal(rows[old.columns], old)
    assert rows["observation.rope.valid"].tolist() == [k in models for k in range(8)]
    for k in range(8):
        points = np.stack(rows["observation.rope"][k])
        assert (points.shape, points.dtype) == ((16, 3), np.float32)
        if k not in models:
            assert not points.any()
            assert rows["observation.rope.confidence"][k] == 0.0
            continue
        (chain,) = models[k].chains
        np.testing.assert_allclose(points, chain.resample(16).points, atol=1e-7)
        assert rows["observation.rope.confidence"][k] == np.float32(chain.confidence)
    assert not any(rows[name].isna().any() for name in rows)


def test_videos_and_other_files_are_copied_as_they_are(data_set, tmp_path):
    (data_set / "README.md").write_text("my ropes", encoding="utf-8")
    (data_set / ".cache").mkdir()
    (data_set / ".cache" / "lock").touch()
    write_lerobot([(0, make_model(make_chain(0)))], data_set, tmp_path / "new")
    old, new = digest(data_set), digest(tmp_path / "new")
    changed = {"meta/info.json", "meta/stats.json", DATA, EPISODES}
    assert set(new) == set(old) - {".cache/lock"}
    assert {name for name in new if new[name] != old[name]} == changed
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


def test_info_and_statistics_are_those_of_the_columns(data_set, tmp_path):
    out = tmp_path / "new"
    write_lerobot([(k, make_model(make_chain(k))) for k in range(8)], data_set, out, points=16)
    features = json.loads((out / "meta/info.json").read_text(encoding="utf-8"))["features"]
    assert features["observation.rope"] == {"dtype": "float32", "shape": [16, 3], "names": ["point", "xyz"]}
    assert features["observation.rope.valid"] == {"dtype": "bool", "shape": [1], "names": None}
    assert features["observation.rope.confidence"] == {"dtype": "float32", "shape": [1], "names": None}
    rows = read_rows(out)
    points = np.array([np.stack(one) for one in rows["observation.rope"]])
    stats = json.loads((out / "meta/stats.json").read_text(encoding="utf-8"))
    assert stats["timestamp"] == {"min": [0.0]}
    check_stats(stats["observation.rope"], points)
    check_stats(stats["observation.rope.confidence"], rows["observation.rope.confidence"].to_numpy()[:, None])
    episodes = pq.read_table(out / EPISODES).to_pylist()
    assert [row["episode_index"] for row in episodes] == [0, 1]
    for row, start, stop in zip(episodes, (0, 3), (3, 8), strict=True):
        names = ("min", "max", "mean", "std", "count", "q01", "q10", "q50", "q90", "q99")
        check_stats({name: row[f"stats/observation.rope/{name}"] for name in names}, points[start:stop])
        assert row["stats/timestamp/min"] == [0.0]


def check_stats(stats, values):
    flat = values.reshape(-1, values.shape[-1]).astype(np.float64)
    assert stats["count"] == [len(values)]
    for name in ("min", "max", "mean", "std"):
        np.testing.assert_allclose(stats[name], getattr(np, name)(flat, axis=0))
    for name in ("q01", "q10", "q50", "q90", "q99"):
        np.testing.assert_allclose(stats[name], np.quantile(flat, float(name[1:]) / 100, axis=0))


def test_the_result_is_a_recording_of_the_same_frames(data_set, tmp_path):
    write_lerobot([], data_set, tmp_path / "new")
    given = {"intrinsics": np.array([[60.0, 0, 31.5], [0, 60.0, 23.5], [0, 0, 1.0]])}
    with strand.Recording(data_set, **given) as old, strand.Recording(tmp_path / "new", **given) as new:
        assert new.episodes == old.episodes
        for a, b in zip(old, new, strict=True):
            np.testing.assert_array_equal(a.views[0].image.depth, b.views[0].image.depth)


def test_tracked_ropes_keep_a_column_each_and_tell_what_is_seen(data_set, tmp_path):
    first, second = make_rope(0), make_rope(5, 0.02)
    models = [(0, make_model(second)), (1, make_model(first, second)), (4, make_model(first))]
    write_lerobot(models, data_set, tmp_path / "new", points=21)
    rows = read_rows(tmp_path / "new")
    assert rows["observation.rope0.valid"].tolist() == [k in (1, 4) for k in range(8)]
    assert rows["observation.rope1.valid"].tolist() == [k in (0, 1) for k in range(8)]
    np.testing.assert_array_equal(rows["observation.rope1.seen"][0], second.seen)
    np.testing.assert_allclose(np.stack(rows["observation.rope1"][0]), second.points, atol=1e-7)
    assert rows["observation.rope0.confidence"][1] == 0.0  # not known
    write_lerobot(models, data_set, tmp_path / "one", points=21, ropes=1, feature="observation.cable")
    rows = read_rows(tmp_path / "one")
    # the rope of most frames, of the two in as many the first
    np.testing.assert_allclose(np.stack(rows["observation.cable"][0]), second.points, atol=1e-7)
    assert rows["observation.cable.valid"].tolist() == [k in (0, 1, 4) for k in range(8)]


def test_what_is_seen_comes_from_the_points_of_untracked_ropes(data_set, tmp_path):
    counts = np.where(np.arange(NODES) < NODES // 2, 9, 0)
    chain = replace(make_chain(0), points_seen=counts, views_seen=np.minimum(counts, 1))
    write_lerobot([(0, make_model(chain))], data_set, tmp_path / "new", points=NODES)
    seen = read_rows(tmp_path / "new")["observation.rope.seen"]
    np.testing.assert_array_equal(seen[0], counts > 0)
    assert not any(np.any(one) for one in seen[1:])


def test_closed_ropes_have_as_many_points(data_set, tmp_path):
    angle = np.linspace(0.0, 2 * np.pi, 30, endpoint=False)
    ring = Chain(0.1 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1), 0.004, True)
    write_lerobot([(0, make_model(ring))], data_set, tmp_path / "new", points=12)
    points = np.stack(read_rows(tmp_path / "new")["observation.rope"][0])
    np.testing.assert_allclose(points, ring.resample(12).points, atol=1e-7)


@pytest.mark.parametrize(
    ("models", "more", "message"),
    [
        ([(8, 0)], {}, r"frame 8: the data set has 8 frames, 0 to 7"),
        ([(1, 0), (1, 0)], {}, r"frame 1 comes twice"),
        ([], {"points": 1}, r"points"),
        ([], {"feature": "a/b"}, r"feature: expected a name without /"),
        ([], {"feature": "timestamp"}, r"feature: the data set has timestamp already"),
    ],
)
def test_wrong_arguments_are_named_and_leave_nothing(data_set, tmp_path, models, more, message):
    given = [(number, make_model(make_chain(0))) for number, _ in models]
    with pytest.raises(ValueError, match=message):
        write_lerobot(given, data_set, tmp_path / "new", **more)
    assert [path.name for path in tmp_path.iterdir()] == ["set"]


def test_nothing_is_overwritten_or_written_inside(data_set, tmp_path):
    (tmp_path / "there").mkdir()
    for out, error in (
        (tmp_path / "there", FileExistsError),
        (data_set, FileExistsError),
        (data_set / "new", ValueError),
        (tmp_path / "none" / "new", FileNotFoundError),
    ):
        with pytest.raises(error, match="expected"):
            write_lerobot([], data_set, out)
    assert list((tmp_path / "there").iterdir()) == []


def test_a_damaged_table_leaves_no_new_data_set(data_set, tmp_path):
    path = data_set / DATA
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(strand.FileFormatError, match=r"file-000\.parquet"):
        write_lerobot([], data_set, tmp_path / "new")
    assert [path.name for path in tmp_path.iterdir()] == ["set"]


def test_a_table_with_a_column_that_info_leaves_out_is_refused(data_set, tmp_path):
    write_lerobot([], data_set, tmp_path / "new")

    def drop(content):
        for name in [name for name in content["features"] if "rope" in name]:
            del content["features"][name]

    change_info(tmp_path / "new", drop)
    with pytest.raises(strand.FileFormatError, match=r"info\.json does not name"):
        write_lerobot([], tmp_path / "new", tmp_path / "newer")
    assert {DEPTH, COLOR} <= set(json.loads((data_set / "meta/info.json").read_text())["features"])
