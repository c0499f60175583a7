"""The benches start, and their helpers work: the collection of scenes, the real frames, results."""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import fresh
import strand
from lib import collection, frames, judging, libfuzzer, results

BENCHES = Path(collection.__file__).parents[1]
ROOT = BENCHES.parent
SCRIPTS = [path.name for path in sorted(BENCHES.glob("*.py")) if "def main()" in path.read_text()]


def run_bench(script, *arguments, folder):
    return subprocess.run(
        [sys.executable, BENCHES / script, *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


def test_there_are_benches():
    assert {"compare.py", "demo.py", "fresh.py", "scenes.py", "stages.py"} <= set(SCRIPTS)


ASK_ALL = """
import contextlib, io, json, runpy, sys
answers = {}
for script in sys.argv[1:]:
    sys.argv = [script, "--help"]
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said):
            runpy.run_path(script, run_name="__main__")
    except SystemExit as end:
        answers[script] = end.code, said.getvalue()
print(json.dumps(answers))
"""


@pytest.fixture(scope="module")
def usages():
    """Return each bench's answer to --help. One process asks all, as imports take most of the time."""
    command = [sys.executable, "-c", ASK_ALL, *(str(BENCHES / script) for script in SCRIPTS)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize("script", SCRIPTS)
def test_every_bench_says_how_it_is_used(script, usages):
    code, said = usages[str(BENCHES / script)]
    assert code == 0
    assert f"usage: {script}" in said


PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").glob("*.md")), *sorted(BENCHES.rglob("*.md"))]
COMMANDS = sorted(
    {
        command
        for page in PAGES
        for command in re.findall(r"`(python benches/[^`]+)`", page.read_text(encoding="utf-8"))
    }
)


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_of_pages_are_those_of_the_benches(command, usages):
    _, script, *options = shlex.split(command.split("#")[0])
    _, said = usages[str(ROOT / script)]
    assert [option for option in options if option.startswith("--") and option not in said] == []


def test_there_are_tables_of_most_benches():
    kept = {path.stem for path in (BENCHES / "results").glob("*.md")}
    assert kept < {Path(script).stem for script in SCRIPTS}
    assert len(kept) > 20


def test_output_is_kept_by_its_command(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(results, "RESULTS", tmp_path)
    for name, text in (("one", "| a |"), ("two", "| b |"), ("one", "| c |")):
        monkeypatch.setattr("sys.argv", ["some/bench.py", "--write", "--only", name])
        with pytest.raises(SystemExit, match="0"):
            results.run_bench(lambda text=text: print(text) or 0)
    assert capsys.readouterr().out == "| a |\n| b |\n| c |\n"
    _, *sections = (tmp_path / "bench.md").read_text().split("\n## ")
    assert sections == [
        "`python benches/bench.py --only one`\n\n| c |\n",
        "`python benches/bench.py --only two`\n\n| b |\n",
    ]


def test_the_same_answers_have_the_same_digest(tmp_path):
    digests = []
    for options in ([], ["--views", "0", "3", "6"], []):
        done = run_bench("scenes.py", "--only", "arc_0.3mm", "--runs", "1", *options, folder=tmp_path)
        assert done.returncode == 0, done.stderr
        assert "| arc_0.3mm | right | 1 of 1 |" in done.stdout
        assert "Topology right on 1 of 1 scenes" in done.stdout
        digests += re.findall(r"^SHA-256 of the nodes: ([0-9a-f]{64})$", done.stdout, re.MULTILINE)
    assert len(digests) == 3
    assert digests[0] == digests[2] != digests[1]


def test_a_folder_of_scenes_is_taken_instead_of_the_collection(tmp_path):
    made = strand.synthetic.scene("s", seed=3, views=3)
    made.save(tmp_path / "mine.npz")
    (scene,) = collection.choose_scenes(argparse.Namespace(folder=tmp_path, only=""))
    assert scene.name == "mine"
    np.testing.assert_array_equal(scene.depth, made.depth)
    np.testing.assert_array_equal(scene.poses_true, made.poses_true)
    np.testing.assert_array_equal(scene.bounds, made.bounds)
    assert (scene.radius, scene.noise, scene.depth_scale) == (made.radius, made.noise, made.depth_scale)
    assert scene.mask is None
    masked = dataclasses.replace(made, mask=made.depth % 2 == 0)
    masked.save(tmp_path / "masked.npz")
    np.testing.assert_array_equal(collection.load_stored(tmp_path / "masked.npz").mask, masked.mask)
    with pytest.raises(SystemExit, match="no scene whose name holds 'yours'"):
        list(collection.choose_scenes(argparse.Namespace(folder=tmp_path, only="yours")))
    with np.load(tmp_path / "mine.npz") as arrays:
        np.savez(tmp_path / "less.npz", **{key: arrays[key] for key in arrays if key != "noise"})
    with pytest.raises(ValueError, match=r"less\.npz: missing noise"):
        collection.load_stored(tmp_path / "less.npz")


def test_the_collection_has_stored_and_drawn_scenes(collected):
    names = collection.list_names()
    assert len(names) == len(set(names)) > 40
    assert {path.stem for path in (collection.DATA / "scenes").glob("*.npz")} < set(names)
    for name, ropes in (("two_ropes", 2), ("heap00", 1), ("random_3", 2), ("coil_1.5mm", 1)):
        scene = collected(name)
        assert (scene.name, len(scene.truth), len(scene.views)) == (name, ropes, 7)
        again = collection.make_scene(name)
        assert again is not scene
        np.testing.assert_array_equal(again.depth, scene.depth)
        np.testing.assert_array_equal(again.poses, scene.poses)


def test_a_stored_scene_is_what_the_package_reads():
    path = collection.DATA / "scenes" / "two_ropes.npz"
    ours, theirs = collection.load_stored(path), strand.load_scene(path)
    for view, other in zip(ours.views, theirs.views, strict=True):
        np.testing.assert_array_equal(view.world_points, other.world_points)
    for nodes, others in zip(ours.truth, theirs.truth, strict=True):
        np.testing.assert_array_equal(nodes, others)
    np.testing.assert_array_equal(ours.bounds, theirs.bounds)
    assert ours.radius == theirs.radius


def test_real_frames_are_depths_in_metres():
    names = frames.list_frames()
    assert names == ["0091", "0156", "0190", "0285", "0500", "0590"]
    assert [name for name in names if frames.load_gray(name) is not None] == ["0285", "0500"]
    for name in names:
        depth = frames.load_depth(name)
        assert depth.shape == (720, 1280)
        assert 0.3 < np.median(depth[depth > 0]) < 1.0
        view = frames.load_view(name)
        assert len(view.points) == np.count_nonzero(depth)
        assert view.world_points[:, 2].max() < 0.0


def test_scenes_that_are_not_right_are_counted_and_drawn(tmp_path):
    """One of the folder's two scenes has the truth of another rope."""
    for i, camera in enumerate(("tof", "d435")):
        made = strand.synthetic.scene(
            "arc",
            camera=strand.synthetic.Camera(camera),
            views=1,
            noise=strand.synthetic.Noise(depth=2e-4),
            seed=4,
        )
        truth = made.truth if i == 0 else (made.truth[0] + 0.05,)
        dataclasses.replace(made, truth=truth).save(tmp_path / f"arc_{camera}_1v.npz")
    done = run_bench("sensors.py", tmp_path, "--pictures", tmp_path / "drawn", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = [
        [cell.strip() for cell in line.split("|")[1:-1]] for line in done.stdout.splitlines() if "|" in line
    ]
    scenes = {row[0]: row[1:] for row in rows if len(row) == 8}
    assert scenes["arc_tof_1v"][0] == "right"
    assert scenes["arc_d435_1v"][0] == "wrong"
    summary = {row[0]: row[1:4] for row in rows if len(row) == 11}
    assert summary["tof"] == ["1", "1", "1"]
    assert summary["d435"] == ["1", "0", "0"]
    assert summary["1 of a scene"] == summary["all"] == ["2", "1", "1"]
    assert [path.name for path in (tmp_path / "drawn").iterdir()] == ["arc_d435_1v.png"]


def test_random_scenes_are_not_done_again(tmp_path, monkeypatch, capsys):
    judged = []

    def judge(seed, noise, relative):
        judged.append((seed, noise, *relative))
        drawn = {"kind": "plain", "noise": 1e-3, "relative": 0.2, "correlation": 0.0, "views": 1}
        answer = {"right": True, "confidence": 0.5, "crossings": 1, "ropes": 1}
        return {**drawn, **answer, "seed": seed, "asked": [noise, *relative]}

    monkeypatch.setattr(fresh, "judge_seed", judge)
    monkeypatch.setattr(fresh, "plot_rates", lambda *_: None)
    large = ["--noise", "plain", "--relative", "0.4", "1"]
    for count, options in (
        ("2", ["--noise", "small"]),
        ("3", ["--noise", "small"]),
        ("1", large),
        ("1", large),
    ):
        monkeypatch.setattr("sys.argv", ["fresh.py", "--scenes", count, "--out", str(tmp_path), *options])
        assert fresh.main() == 0
        assert f"| all |  | {count} | 100.0 |" in capsys.readouterr().out
    assert judged == [*((seed, "small", 0.05, 1.0) for seed in range(3)), (0, "plain", 0.4, 1.0)]
    assert len((tmp_path / "fresh.jsonl").read_text().splitlines()) == 4
    assert (tmp_path / "curves.png").stat().st_size > 1000


def test_random_scenes_of_both_kinds():
    drawn = [fresh.draw_scene(seed)[1] for seed in (5, 6, 8, 9)]
    assert {record["kind"] for record in drawn} == {"plain", "correlated"}
    for seed, noise in ((5, "plain"), (5, "correlated")):
        scene, record = fresh.draw_scene(seed, noise, (0.4, 0.5))
        assert record["kind"] == noise
        assert 0.4 <= record["relative"] <= 0.5
        assert record["noise"] == pytest.approx(record["relative"] * scene.radius)
        assert (scene.mask is not None) == (noise == "correlated") == (record["correlation"] > 0)


def test_hanging_ropes_cross_as_seen_across_their_layer():
    lying = strand.synthetic.scene("figure8", views=1)
    hung = [np.roll(nodes, 1, axis=1) for nodes in lying.truth]
    hanging = strand.synthetic.scene(
        chains=hung, views=1, layout=strand.synthetic.Layout(wall=0.5), mask=strand.synthetic.Segmentation()
    )
    for made in (lying, hanging):
        found, chains = judging.judge_scene(made, give_radius=True, give_ropes=True)
        assert chains
        assert found.crossings.true == 2


LOG = """
#2\tINITED cov: 120 ft: 130 corp: 3/60b exec/s: 0 rss: 34Mb
#512\tpulse  cov: 140 ft: 160 corp: 5/90b lim: 8 exec/s: 256 rss: 34Mb
thread '<unnamed>' panicked at rust/src/a.rs:7:9:
not finite
stat::number_of_executed_units: 700
stat::average_exec_per_sec:     350
"""


def test_logs_of_fuzzers_are_read():
    found = libfuzzer.read_output(LOG, 77)
    assert found == libfuzzer.Outcome(700, 2.0, 120, 140, 5, "rust/src/a.rs:7:9:")
    assert libfuzzer.read_output(LOG, 0).crash == ""
    with pytest.raises(RuntimeError, match="no such target"):
        libfuzzer.read_output("no such target", 1)
