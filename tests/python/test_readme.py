"""The README's commands and examples."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np

import strand

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text()
PYTHON = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
SHELL = "\n".join(re.findall(r"```sh\n(.*?)```", README, re.DOTALL))


def test_the_example_runs_as_it_stands(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", PYTHON[0]], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(r"\d+ nodes, (39\d|40\d) mm, middle at \[.*\]\n", done.stdout)
    assert len(strand.load(tmp_path / "rope.json").chains) == 1
    assert len(PYTHON[0].strip().splitlines()) <= 12


def test_the_kernels_run_as_they_stand():
    scene = strand.synthetic.scene("arc", seed=0)
    source, target = (view.crop(scene.bounds).world_points for view in scene.views[2:4])
    names = {
        "strand": strand,
        "points": target,
        "camera_centre": scene.views[3].viewpoint,
        "source": source,
        "target": target,
    }
    exec(PYTHON[1], names)
    assert names["mask"].mean() > 0.5
    assert names["result"].fitness > 0.5
    assert len(names["axis_points"]) > 100
    assert max(len(chain) for chain in names["chains"]) > 10


def test_what_is_known_beforehand_is_told_as_it_stands(monkeypatch):
    (block,) = [code for code in PYTHON if "length=" in code]
    scene = strand.synthetic.scene(chains=strand.synthetic.random_ropes(1, 2, seed=0), views=3)
    depth = scene.depth[0] * scene.depth_scale
    image = np.zeros((*depth.shape, 3), dtype=np.uint8)
    views = [view.crop(scene.bounds) for view in scene.views]
    names = {"views": views, "depth": depth, "K": scene.intrinsics, "pose": scene.poses[0], "image": image}
    names["mask"] = depth > 0
    models = []
    reconstruct = strand.reconstruct
    monkeypatch.setattr(strand, "reconstruct", lambda *a, **known: models.append(reconstruct(*a, **known)))
    exec(block, names | {"strand": strand})
    assert [len(model.chains) for model in models] == [1, 2]


def test_the_commands_exist():
    assert re.findall(r"^\./run (\w+)", SHELL, re.MULTILINE) == ["demo", "test"]
    done = subprocess.run([ROOT / "run"], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "./run demo" in done.stderr
    scripts = re.findall(r"`python (benches/\w+\.py)", README)
    assert len(scripts) > 4
    assert [script for script in scripts if not (ROOT / script).is_file()] == []


def test_it_is_short():
    assert len(README.splitlines()) <= 120
    assert len(re.findall(r"!\[", README)) == 1


def test_the_command_line_reconstructs_a_recorded_scene(tmp_path):
    command = re.search(r"^strand (reconstruct SCENE .*)$", SHELL, re.MULTILINE).group(1)
    strand.synthetic.scene("arc", seed=1).save(tmp_path / "SCENE.npz")
    words = command.replace("SCENE", "SCENE.npz").split()
    done = subprocess.run(
        [sys.executable, "-m", "strand", *words], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    (chain,) = strand.load(tmp_path / "model.json").chains
    assert np.isclose(chain.length, 0.4, rtol=0.02)
    assert len(list((tmp_path / "figures").glob("*.png"))) == 8
