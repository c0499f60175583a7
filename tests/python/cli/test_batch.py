"""`strand batch`: what it prints, its exit codes, and what its options mean."""

from __future__ import annotations

import json
import re
import shutil
import threading
import time

import numpy as np
import pyarrow.parquet as pq
import pytest

from lib.bag_files import START, Messages, write_bag
from shared.batch_recordings import save_scenes
from shared.sequence_files import K_WORDS, save_images
from strand.batch import Counts, EngineError, Settings, load_table, local_engine
from strand.cli import batch, main
from strand.synthetic import color_scene, sequence


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_scenes(tmp_path / "in", 3)
    (tmp_path / "in" / "broken.npz").write_bytes(b"nonsense")
    return tmp_path


def test_recordings_become_a_folder_of_shards_with_a_page(folder, capsys):
    assert main(["batch", "in", "-o", "out", "--ropes", "1", "--summary", "page.html"]) == 0
    out, err = capsys.readouterr()
    assert out.splitlines() == [
        "made     4 units, 4 rows, 1 of them errors",
        "skipped  0 finished units",
        "out",
        "page.html",
    ]
    assert err == ""
    assert [row["recording"] for row in load_table("out", ["recording"]).to_pylist()] == [
        *(f"in/{k}/0{k}.npz" for k in range(3)),
        "in/broken.npz",
    ]
    assert "4 recordings" in (folder / "page.html").read_text()
    again = ["batch", "in", "-o", "out", "--ropes", "1", "--summary", "page.html", "--summary-max-bytes"]
    assert main([*again, "1000"]) == 1
    (need,) = re.findall(r"give (\d+) or more as max_bytes \(--summary-max-bytes\)", capsys.readouterr().err)
    assert main([*again, str(100 * int(need))]) == 0
    assert "made     0 units" in capsys.readouterr().out
    assert main(["batch", "in", "-o", "out", "--ropes", "1"]) == 0
    assert capsys.readouterr().out.startswith(
        "made     0 units, 0 rows, 0 of them errors\nskipped  4 finished units"
    )


def test_rows_of_recordings_that_cannot_be_read_now_are_kept(folder, capsys, monkeypatch):
    assert main(["batch", "in", "-o", "out", "--ropes", "1"]) == 0
    scene = folder / "in" / "0" / "00.npz"
    scene.unlink()
    scene.symlink_to("00.npz")
    capsys.readouterr()
    # the folder of the run does not matter
    monkeypatch.chdir(folder / "in")
    assert main(["batch", ".", "-o", "../out", "--ropes", "1"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "made     0 units, 0 rows, 0 of them errors",
        "skipped  3 finished units",
        "kept     1 recordings that cannot be read now",
        "../out",
    ]


def test_options_are_settings(folder):
    words = "--radius 4.2mm --bounds -1 -1 -1 1 1 1 --every 2 --stretch 7 --depth-scale 0.001 --topic /a /b"
    more = (
        "--intrinsics 100,100,50,50 --world map --tolerance 0.5 --length 40cm --threads 1 --color-topic /c /d"
    )
    assert main(["batch", "in", "-o", "out", *words.split(), *more.split()]) == 0
    settings = Settings(
        radius=0.0042,
        bounds=(-np.ones(3), np.ones(3)),
        every=2,
        stretch=7,
        depth_scale=0.001,
        topics=["/a", "/b"],
        intrinsics=[[100.0, 0, 50], [0, 100.0, 50], [0, 0, 1]],
        world="map",
        tolerance=0.5,
        length=0.4,
        color_topics=["/c", "/d"],
    )
    written = folder / "out" / f"_configuration-{settings.digest}.json"
    assert json.loads(written.read_text())["radius"] == 0.0042
    assert set(load_table("out", ["configuration"]).column(0).to_pylist()) == {settings.digest}


def test_ropes_are_tracked(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    frames = list(sequence("still", seed=1, frames=3))
    save_images(tmp_path / "in" / "film", frames)
    shutil.rmtree(tmp_path / "in" / "film" / "masks")
    words = [*K_WORDS, "--radius", "4mm", "--ropes", "1"]
    assert main(["batch", "in", "-o", "out", "--track", "--rate", "15", *words, "--summary", "a.html"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "made     1 units, 3 rows, 0 of them errors",
        "skipped  0 finished units",
        "out",
        "a.html",
    ]
    rows = load_table("out").drop_columns(["recording", "seconds"])
    assert rows["time"].to_pylist() == [0.0, 1 / 15, 2 / 15]
    assert rows["rope"].to_pylist() == [0, 0, 0]
    # the table of `strand track` has the same rows
    assert main(["track", "in/film", "-o", "a.parquet", "--rate", "15", *words]) == 0
    assert pq.read_table("a.parquet").drop_columns(["recording", "seconds"]).cast(rows.schema).equals(rows)


def test_progress_is_printed_while_no_unit_ends(folder, capsys, monkeypatch):
    def slow(recordings, out, settings, *, progress, **_):
        time.sleep(0.3)
        progress(Counts(2, 5, 3, 1))
        time.sleep(0.3)
        return Counts()

    monkeypatch.setattr(batch, "_PERIOD", 0.02)
    monkeypatch.setattr(batch, "run_batch", slow)
    assert main(["batch", "in", "-o", "out"]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "strand: 0 made, 0 skipped, 0 errors, 0.0 per second"
    assert lines[-1].startswith("strand: 2 made, 5 skipped, 1 errors, ")
    assert not [one for one in threading.enumerate() if "print_lines" in one.name]


def test_output_of_engines_goes_to_stderr(folder, capsys, monkeypatch):
    def talkative(*_, **__):
        print("(raylet) Task _task failed")
        return Counts()

    monkeypatch.setattr(batch, "run_batch", talkative)
    assert main(["batch", "in", "-o", "out"]) == 0
    out, err = capsys.readouterr()
    assert [line.split()[0] for line in out.splitlines()] == ["made", "skipped", "out"]
    assert err == "(raylet) Task _task failed\n"


@pytest.mark.parametrize("out", ["out", "in/../out", "out/table"])
def test_a_page_in_the_place_of_the_table_is_refused_before_the_work(folder, capsys, out):
    assert main(["batch", "in", "-o", out, "--summary", "out"]) == 2
    assert f"--summary: expected a file outside of the folder {out} (-o), got out" in capsys.readouterr().err
    assert not (folder / "out").exists()


def test_an_engine_error_is_one_line_with_an_exit_code(folder, capsys, monkeypatch):
    def other(*_):
        raise EngineError("strand is version 2 here, and 1 where it was asked")

    monkeypatch.setattr(local_engine, "run_units", other)
    assert main(["batch", "in", "-o", "out"]) == 3
    err = capsys.readouterr().err
    assert err == "strand: error: strand is version 2 here, and 1 where it was asked\n"


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["missing", "-o", "out"], 3),
        (["in", "-o", "in/broken.npz"], 3),
        (["in", "-o", "out", "--summary", "nowhere/page.html"], 3),
        (["in", "-o", "out", "--workers", "1000"], 2),
        (["in", "-o", "out", "--threads", "1000"], 2),
        (["in", "-o", "out", "--address", "127.0.0.1:1"], 2),
        (["in", "-o", "out", "--radius", "-4mm"], 2),
        (["in", "-o", "out", "--rate", "5"], 2),
        (["in", "-o", "out", "--track", "--stretch", "5"], 2),
        (["in", "-o", "out", "--track", "--deadline", "5"], 2),
        (["in", "-o", "out", "--track", "--camera-frame"], 2),
    ],
)
def test_refused_batches_have_an_exit_code(folder, capsys, words, code):
    assert main(["batch", *words]) == code
    err = capsys.readouterr().err
    assert err.startswith("strand: error: ")
    if "--track" in words:
        name = words[words.index("--track") + 1].strip("-").replace("-", "_")
        assert f" {name}: not with track: " in err
    assert not (folder / "out").exists()


def test_colours_of_recordings_are_used_unless_they_are_turned_off(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    made, scene = Messages(), color_scene("two ropes", 0)
    depth = np.rint(1e3 * scene.scene.depth_scale * scene.scene.depth[0]).astype(np.uint16)
    entries = [
        ("/cam/depth/camera_info", START, made.info(scene.scene.intrinsics, depth.shape, START)),
        ("/cam/depth/image", START, made.image(depth, START)),
        ("/cam/rgb/image", START, made.color(scene.color[0], START)),
    ]
    write_bag(tmp_path / "bag", "mcap", entries)
    for more, labels in (
        ([], {1, 2}),
        (["--color-topic", "/cam/rgb/image"], {1, 2}),
        (["--no-color"], {None}),
    ):
        assert main(["batch", "bag", "-o", "out", *more]) == 0
        assert set(load_table("out")["label"].to_pylist()) == labels
    assert main(["batch", "bag", "-o", "out", "--no-color", "--color-topic", "/cam/rgb/image"]) == 2
    assert "--no-color: expected either" in capsys.readouterr().err
