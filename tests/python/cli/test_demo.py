"""`strand demo`: what it prints and writes."""

from __future__ import annotations

import contextlib
import io
import re
import shutil
import subprocess
import sys
from itertools import pairwise

import pytest

import strand
from strand.cli import demo as demo_command
from strand.cli import main

STAGES = ["extract", "filter", "register", "arcs", "link", "fit", "ends"]
PUBLISHED_STAGES = ["extract", "filter", "normals", "register", "centerline", "trace", "split", "reconnect"]


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo") / "out"
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(["demo", "--out", str(folder), "--seed", "1"])
    return code, out.getvalue(), err.getvalue(), folder


def test_demo_shows_both_methods_the_default_one_first(demo):
    code, out, err, _ = demo
    assert code == 0
    default, published = out.split("The published method\n")
    assert default.startswith("The default method\n")
    for said, names in ((default, STAGES), (published, PUBLISHED_STAGES)):
        rows = re.findall(r"^(\w+) +(\d+)? +(\d+)? +\d+\.\d$", said, re.MULTILINE)
        assert [name for name, *_ in rows if name != "total"] == names
        points = [(int(before), int(after)) for _, before, after in rows if before]
        assert points[0][0] > points[0][1] > 1000
        assert len(points) > 4
        assert all(before[1] == after[0] for before, after in pairwise(points))
        assert re.search(
            r"^rope 0: length \d+\.\d mm, truth 400\.\d mm \([+-]\d+\.\d+%\), RMS", said, re.MULTILINE
        )
        assert "rope 1" not in said
    assert re.search(r"^whole ropes +1$", default, re.MULTILINE)
    counts = re.findall(r"^([a-z ]+?) +(\d+) +(\d+)$", published, re.MULTILINE)
    assert [(name, paper) for name, _, paper in counts] == [
        ("chains traced", "3"),
        ("segments after the split", "7"),
        ("whole strings", "1"),
    ]
    assert [here for _, here, _ in counts[1:]] == ["7", "1"]
    assert [line for line in err.splitlines() if "warning" not in line] == [
        f"strand: {name}" for name in (*STAGES, *PUBLISHED_STAGES)
    ]


def test_demo_writes_models_and_figures_of_both_methods(demo):
    _, out, _, folder = demo
    written = sorted(str(path) for path in folder.rglob("*") if path.is_file())
    assert sorted(line for line in out.splitlines() if line.startswith(str(folder))) == written
    for place, method, figures in ((folder, "default", 8), (folder / "published", "published", 10)):
        assert len(list(place.glob("*.png"))) == figures
        model = strand.load_model(place / "model.json")
        assert (model.method, len(model.chains)) == (method, 1)
    assert len(written) == 8 + 10 + 2


def test_demo_leaves_other_files_alone(demo, tmp_path, monkeypatch, capsys):
    _, _, _, folder = demo
    shutil.copytree(folder, tmp_path / "out")
    (tmp_path / "out" / "notes.txt").write_text("mine")
    monkeypatch.setattr(demo_command.figures, "write_figures", lambda *_: [])
    assert main(["demo", "--out", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out" / "notes.txt").read_text() == "mine"
    assert "model.json" in capsys.readouterr().out


@pytest.mark.parametrize("screen", [True, False])
def test_demo_lays_the_rope_on_a_table_in_mujoco(tmp_path, monkeypatch, capsys, screen):
    shown = []

    def run(command, **_):
        shown.append(command)
        return subprocess.CompletedProcess(command, 0 if screen else 1)

    monkeypatch.setattr(demo_command.figures, "write_figures", lambda *_: [])
    monkeypatch.setattr(demo_command.subprocess, "run", run)
    assert main(["demo", "--out", str(tmp_path), "--simulate"]) == 0
    out, err = capsys.readouterr()
    moved = re.fullmatch(
        r"MuJoCo [\d.]+: in 1 s on a table the rope moves by ([\d.]+) mm", out.splitlines()[-1]
    )
    assert 0.0 < float(moved[1]) < 5.0
    scene = tmp_path / "simulation.xml"
    assert str(scene) in out.splitlines()
    assert shown == [[sys.executable, "-m", "mujoco.viewer", f"--mjcf={scene}"]]
    assert ("the viewer did not open, which needs a screen" in err) is not screen


def test_demo_without_matplotlib_writes_the_rest(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert main(["demo", "--out", str(tmp_path)]) == 0
    out, err = capsys.readouterr()
    assert re.search(r"warning: no figures: matplotlib is needed here: pip install", err)
    assert err.index("no figures") < err.index("extract")
    assert "RMS distance from truth" in out
    assert sorted(path.name for path in tmp_path.rglob("*.*")) == ["model.json", "model.json"]


def test_demo_records_a_carried_rope_that_the_commands_read(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(demo_command, "_FRAMES", 5)
    assert main(["demo", "--recording", "rope.bag"]) == 2
    assert main(["demo", "--recording", "rope.mcap"]) == 0
    commands = [line.split() for line in capsys.readouterr().out.splitlines() if line.startswith("strand ")]
    assert [words[1] for words in commands] == ["info", "reconstruct", "track"]
    for words in commands:
        assert main(words[1:]) == 0
    assert "rope 0: " in capsys.readouterr().out
    assert {path.name for path in tmp_path.iterdir()} == {"rope.mcap", "tracks.parquet", "tracks.html"}


def test_demo_says_how_to_install_mujoco(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    assert main(["demo", "--out", str(tmp_path / "out"), "--simulate"]) == 3
    assert re.search(
        r'mujoco is needed here: pip install ".*\[simulate\]" installs it', capsys.readouterr().err
    )
    assert not (tmp_path / "out").exists()
