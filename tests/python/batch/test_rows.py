"""The rows of a unit: schema, contents, errors."""

from __future__ import annotations

import multiprocessing
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
from PIL import Image

import strand
from lib.bag_files import START, Messages, record_film, write_bag
from shared import occluded
from shared.batch_recordings import SETTINGS, save_scenes
from shared.occluded import GRIPPER, make_view
from shared.ropes import make_zigzags
from strand.batch import Settings, find_units, load_models, load_table, make_rows, make_schema, write_summary
from strand.batch.rows import make_model_rows
from strand.batch.table import VARYING_COLUMN, make_record_batch
from strand.batch.work import ShardCounts, Work
from strand.ropes.crossings import list_crossings

SCENE = strand.synthetic.scene("arc", seed=0, views=3)
COLUMNS = (
    *("recording", "frame", "time", "rope", "nodes", "arc_length", "covariance", "radius", "closed"),
    *("confidence", "label", "color", "hidden_ends", "model_confidence", "up", "table", "warnings"),
    *("crossings", "graph", "state", "generation", "length_sd", "velocity", "seen", "predicted", "age"),
    *("image_times", "unexplained", "events", "version", "configuration", "seconds", "error"),
)


def only(path, settings=SETTINGS):
    (unit,) = find_units([path], settings, path.parent)
    return unit


@pytest.fixture(scope="module")
def knot(tmp_path_factory):
    """A scene with a rope that crosses itself, and another rope."""
    path = tmp_path_factory.mktemp("knot") / "knot.npz"
    chains = strand.synthetic.random_ropes(2, 3, seed=0)
    strand.synthetic.scene(chains=chains, seed=0, views=4).save(path)
    return path


def test_the_columns_are_these():
    assert tuple(make_schema().names) == COLUMNS
    assert make_schema().field("nodes").type == pa.list_(pa.list_(pa.float64()))
    assert VARYING_COLUMN == "seconds"


def test_rows_hold_the_model_bit_for_bit(knot):
    settings = Settings()
    batch = make_rows(only(knot, settings), settings)
    assert batch.schema == make_schema()
    scene = strand.load_scene(knot)
    model = strand.reconstruct(scene.views, scene.radius, scene.bounds)
    crossings = list_crossings(model.chains, model.up, model.doubts, model.confidence)
    assert len(batch) == len(model.chains) > 1
    assert len(crossings) > 0
    written = []
    for k, (row, chain) in enumerate(zip(batch.to_pylist(), model.chains, strict=True)):
        assert (row["recording"], row["frame"], row["time"], row["rope"]) == ("knot.npz", 0, None, k)
        np.testing.assert_array_equal(row["nodes"], chain.points)
        np.testing.assert_array_equal(row["arc_length"], chain.arc_length)
        np.testing.assert_array_equal(np.reshape(row["covariance"], (-1, 3, 3)), chain.covariance)
        assert (row["radius"], row["closed"], row["confidence"]) == (
            chain.radius,
            chain.closed,
            chain.confidence,
        )
        assert (row["label"], row["color"], row["hidden_ends"]) == (None, None, [False, False])
        assert row["model_confidence"] == model.confidence
        assert row["up"] == model.up.tolist()
        assert row["table"] == [*model.table.normal, model.table.offset]
        about = [w for w in model.warnings if not w.chains or k in w.chains]
        assert row["warnings"] == [f"{one.kind}: {one.message}" for one in about]
        assert (row["version"], row["configuration"]) == (strand.__version__, settings.digest)
        assert row["seconds"] > 0
        assert row["error"] is None
        assert {row[name] for name in ("state", "velocity", "age", "image_times", "events")} == {None}
        assert {one["over_rope"] for one in row["crossings"]} <= {k}
        written += [(one["over_at"], one["under_rope"], one["probability"]) for one in row["crossings"]]
    assert sorted(written) == sorted((one.over[1], one.under[0], one.probability) for one in crossings)


def test_rows_hold_labels_colours_and_hidden_ends(tmp_path):
    image = make_view(GRIPPER, masked=True, colored=True).image
    arrays = {
        "depth": np.rint(1e4 * image.depth)[None].astype(np.uint16),
        "mask": 7 * image.mask[None].astype(np.uint8),
        "color": image.colors[None],
        "occluders": image.occluders[None],
    }
    known = {"depth_scale": 1e-4, "K": occluded.K, "poses": image.pose[None], "radius": occluded.R}
    np.savez(tmp_path / "held.npz", **arrays, **known)
    (row,) = make_rows(only(tmp_path / "held.npz", Settings()), Settings()).to_pylist()
    assert (row["label"], row["hidden_ends"]) == (7, [False, True])
    np.testing.assert_allclose(np.multiply(255.0, row["color"]), (200.0, 40.0, 40.0), atol=6.0)


def test_crossings_that_are_too_many_to_list_are_null():
    for nodes, listed in ((20, True), (200, False)):
        rows = list(make_model_rows("a", 0, None, make_zigzags(nodes), 0.1))
        batch = make_record_batch(rows, strand.__version__, "")
        assert [row["crossings"] is not None for row in batch.to_pylist()] == [listed, listed]


def test_frames_of_a_recording_have_numbers_and_times(tmp_path):
    empty = Messages().image(np.zeros(SCENE.depth.shape[1:], np.uint16), START + 1)
    entries = sorted([*record_film(SCENE, 3), ("/depth", START + 1, empty)], key=lambda entry: entry[1])
    path = write_bag(tmp_path / "rope", "mcap", entries)
    rows = make_rows(only(path), Settings(radius=0.0042, bounds=SCENE.bounds, world="world")).to_pylist()
    assert [row["frame"] for row in rows] == [0, 1, 2, 3]
    assert [row["error"] is None for row in rows] == [True, False, True, True]
    assert rows[1]["error"].startswith("NotEnoughDataError: views")
    assert (rows[1]["rope"], rows[1]["nodes"], rows[1]["warnings"]) == (None, None, [])
    assert rows[0]["time"] == START / 1e9


def test_a_stretch_beyond_the_last_frame_has_no_rows(tmp_path):
    path = write_bag(tmp_path / "rope", "mcap", record_film(SCENE, 3))
    settings = Settings(radius=0.0042, bounds=SCENE.bounds, world="world", stretch=5)
    beyond = replace(only(path, settings), start=5)
    written = Work(settings, str(tmp_path / "out"))
    (tmp_path / "out").mkdir()
    assert written(beyond) == ShardCounts(0, 0)
    assert load_table(tmp_path / "out").schema == make_schema()
    assert len(load_table(tmp_path / "out")) == 0


def broken(path):
    path.write_bytes(b"nonsense")


def cut(path):
    strand.synthetic.scene("arc", views=1, camera=strand.synthetic.Camera(size=(160, 120))).save(path)
    path.write_bytes(path.read_bytes()[:2000])


@pytest.mark.parametrize(
    ("name", "spoil", "said"),
    [
        ("a.npz", broken, "FileFormatError: "),
        ("a.npz", cut, "FileFormatError: "),
        ("a.mcap", broken, "FileFormatError: "),
        ("a.npz", lambda path: None, "FileNotFoundError: "),
        ("a.png", broken, "FileFormatError: "),
    ],
)
def test_a_broken_recording_is_a_row_with_its_error(tmp_path, name, spoil, said):
    path = tmp_path / name
    path.touch()
    unit = only(path)
    path.unlink()
    spoil(path)
    (row,) = make_rows(unit, SETTINGS).to_pylist()
    assert row["error"].startswith(said)
    assert (row["recording"], row["frame"], row["rope"]) == (name, None, None)


# opening a recording decodes its first message
@pytest.mark.parametrize("spoilt", [1, 2])
def test_a_damaged_message_affects_only_its_frame(spoilt, tmp_path):
    settings = Settings(radius=0.0042, bounds=SCENE.bounds, world="world")
    entries = list(record_film(SCENE, 3))
    images = [k for k, (topic, _, _) in enumerate(entries) if topic == "/depth"]
    entries[images[spoilt]][2].encoding = "rgb8"
    rows = make_rows(only(write_bag(tmp_path / "rope", "mcap", entries)), settings).to_pylist()
    assert [row["frame"] for row in rows] == [0, 1, 2]
    assert [row["error"] is None for row in rows] == [k != spoilt for k in range(3)]
    assert rows[spoilt]["error"].startswith("FileFormatError: ")


def test_a_damaged_image_affects_only_its_frame(tmp_path):
    folder = tmp_path / "caf\udce9"
    folder.mkdir()
    settings = Settings(
        radius=0.0042, intrinsics=SCENE.intrinsics, depth_scale=SCENE.depth_scale, stretch=3, every=2
    )
    for k in range(5):
        Image.fromarray(SCENE.depth[0]).save(folder / f"{k}.png")
    (folder / "2.png").write_bytes(b"nonsense")
    (unit,) = find_units([folder], replace(settings, stretch=None), tmp_path)
    rows = make_rows(unit, settings).to_pylist()
    assert [row["frame"] for row in rows] == [0, 2, 4]
    assert [row["error"] is None for row in rows] == [True, False, True]
    # a message may hold a path of any bytes, and a table holds UTF-8
    assert "caf\\udce9" in rows[1]["error"]


def test_a_frame_without_ropes_is_an_answer(tmp_path):
    settings = Settings(intrinsics=SCENE.intrinsics, depth_scale=SCENE.depth_scale)
    # a table and nothing else
    depth = np.random.default_rng(0).normal(6000.0, 3.0, SCENE.depth[0].shape).astype(np.uint16)
    Image.fromarray(depth).save(tmp_path / "0.png")
    (unit,) = find_units([tmp_path], settings, tmp_path.parent)
    (row,) = make_rows(unit, settings).to_pylist()
    assert (row["frame"], row["rope"], row["error"]) == (0, None, None)
    assert row["warnings"][0].startswith("no rope: views: ")
    (tmp_path / "out").mkdir()
    assert Work(settings, str(tmp_path / "out"))(unit) == ShardCounts(1, 0)
    ((_, frame, model),) = load_models(tmp_path / "out")
    assert (frame, model.chains, [one.kind for one in model.warnings]) == (0, (), ["no rope"])
    write_summary(tmp_path / "out", tmp_path / "summary.html")


def test_a_missing_package_is_raised(tmp_path, monkeypatch):
    path = tmp_path / "a.npz"
    path.touch()

    def without(*_, **__):
        raise ImportError('lz4 is needed here: pip install ".[recordings]" installs it')

    monkeypatch.setattr("strand.batch.frames.load_scene", without)
    with pytest.raises(ImportError, match="lz4"):
        make_rows(only(path), SETTINGS)


@pytest.mark.parametrize("start", ["fork", "forkserver", "spawn"])
def test_rows_are_the_same_however_processes_start(tmp_path, start):
    units = list(find_units([save_scenes(tmp_path, 2)], SETTINGS, tmp_path))
    here = [make_rows(unit, SETTINGS).drop_columns([VARYING_COLUMN]) for unit in units]
    with multiprocessing.get_context(start).Pool(1) as pool:
        there = pool.starmap(make_rows, [(unit, SETTINGS) for unit in units])
    assert [one.drop_columns([VARYING_COLUMN]) for one in there] == here
