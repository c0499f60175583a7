"""Every code block of the documentation runs: Python and commands. TOML and JSON are read.

Blocks of text are output of programs. `shared/code_blocks.py` has the data and files that blocks need.
`test_recipes.py` runs the recipes for cameras' libraries.
"""

from __future__ import annotations

import json
import os
import re
import sys
from itertools import pairwise

import numpy as np
import pytest
from first_grasp import draw
from PIL import Image

import strand
from shared import code_blocks
from shared.code_blocks import PAGES, ROOT, find_blocks, find_commands, run_python, run_strand
from shared.pictures import MAX_DIFFERENCE, compare_pictures
from shared.scene_files import make_ply
from strand.report import rerun_view
from strand.support.files import read_toml

# headings of blocks that need a camera's library: test_recipes.py runs them with stand-ins
WITH_LIBRARIES = {"docs/recordings.md": frozenset({"RealSense", "Orbbec", "ZED"})}
RUN = (ROOT / "run").read_text(encoding="utf-8")
PROJECT = read_toml(ROOT / "pyproject.toml")["project"]
CARGO = read_toml(ROOT / "Cargo.toml")
BENCHES = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "benches").glob("*.py"))

# pages with commands of strand
COMMANDS = [page for page in PAGES if any(words[0] == "strand" for words in find_commands(page))]


def find_pages(language):
    return [page for page in PAGES if any(block.language == language for block in find_blocks(page))]


def test_every_block_is_of_a_language_that_is_tested():
    languages = {block.language for page in PAGES for block in find_blocks(page)}
    assert {"python", "sh", "toml"} <= languages <= {"python", "sh", "toml", "json", "text"}
    fences = sum(len(re.findall("^ *```", (ROOT / p).read_text("utf-8"), re.MULTILINE)) for p in PAGES)
    assert fences == 2 * sum(len(find_blocks(page)) for page in PAGES)


def test_blocks_that_run_elsewhere_are_there():
    for page, headings in WITH_LIBRARIES.items():
        assert headings <= {block.heading for block in find_blocks(page) if block.language == "python"}


def check_readme(names, out, folder):
    assert re.match(r"\d+ nodes, (39\d|40\d) mm, middle at \[.*\]\n", out)
    assert len(strand.load_model(folder / "rope.json").chains) == 1
    assert names["result"].fitness > 0.5
    assert len(names["axis_points"]) > 100
    assert max(len(chain) for chain in names["chains"]) > 10
    assert max(len(nodes) for nodes, _ in names["arcs"]) > 10


def check_batch(names, out, folder):
    assert (names["counts"].made, names["counts"].errors) == (4, 1)
    assert names["table"].num_rows == 4
    # the first frame has no rope
    first = strand.batch.load_table(folder / "table", ["nodes", "error"])[:1].to_pylist()
    assert first == [{"nodes": None, "error": None}]
    assert [row[0] for row in names["lengths"]] == [
        f"recordings/monday/{name}.npz" for name in ("loop", "arc")
    ]
    assert names["failed"] == [("FileFormatError", 1)]
    assert names["nodes"].shape[1] == 3
    assert len(names["found"]) == 3
    assert (folder / "summary.html").exists()


def check_configuration(names, out, folder):
    (block,) = [block for block in find_blocks("docs/configuration.md") if block.language == "toml"]
    (folder / "numbers.toml").write_text(block.text)
    assert names["config"] == strand.config.load(folder / "numbers.toml") != strand.Config()


def check_export(names, out, folder):
    assert names["simulated"].nbody > 10
    assert json.dumps(names["world"])
    assert {path.name for path in folder.iterdir()} >= {"tube.ply", "rope.urdf", "rope.xml", "rope.usda"}


def check_pictures(names, out, folder):
    assert (folder / "report.html").stat().st_size > 100_000
    assert len(list((folder / "figures").glob("*.png"))) == 8


def check_recordings(names, out, folder):
    assert out.startswith("2 ('/depth',) [17")
    assert out.count("Model(chains: 1") == 2
    assert len(names["path"]["poses"]) == len(names["model"].chains[0].points)
    np.testing.assert_array_equal(names["view"].pose, names["pose"])


def check_first_grasp(names, out, folder):
    """Check the page's figures, and that a gripper would hold the rope."""
    assert [chain.length for chain in names["first"].chains] == pytest.approx([0.373, 0.240], abs=1e-3)
    assert names["first"].confidence == pytest.approx(0.32, abs=0.01)
    assert [chain.length for chain in names["model"].chains] == pytest.approx([0.729], abs=1e-3)
    assert names["model"].confidence == pytest.approx(0.99, abs=0.01)
    (truth,) = names["scene"].truth
    pose, (normal, _) = names["best"].pose, names["found"].tables[0]
    place, (x, y, z) = pose[:3, 3], pose[:3, :3].T
    distances = np.linalg.norm(truth - place, axis=1)
    node = distances.argmin()
    assert distances[node] < 0.003
    along = truth[node + 3] - truth[node - 3]
    assert abs(x @ along) / np.linalg.norm(along) > 0.99
    np.testing.assert_allclose(np.cross(x, y), z, atol=1e-12)
    # the fingers come down from above and close on one stretch of rope
    assert z @ normal < -0.9
    along, across, _ = np.abs((truth - place) @ pose[:3, :3]).T
    between = np.flatnonzero((along < 0.008) & (across < names["best"].width / 2))
    assert node in between
    assert (np.diff(between) == 1).all()
    assert (folder / "grasp.html").exists()
    pictures = ROOT / "docs" / "images" / "first_grasp"
    draw(names, folder / "drawn")
    drawn = {path.name: path for path in (folder / "drawn").iterdir()}
    assert set(drawn) == {path.name for path in pictures.iterdir()}
    for name, path in drawn.items():
        assert compare_pictures(pictures / name, path) < MAX_DIFFERENCE, name


def check_recipes(names, out, folder):
    assert names["near"].distance[0] < 1e-6
    np.testing.assert_allclose(names["same_place"], names["middle"][:3, 3], atol=1e-4)
    assert len(names["every_20_mm"]) == 21
    assert len(names["poses"]) == 7
    assert len(names["model"].chains) == 1


def check_masks(names, out, folder):
    assert "no rope" not in out
    assert "2 colours of rope" in out
    assert len(names["model"].chains) == len(names["scene"].scene.truth) == 2
    made = names["scene"].scene
    for truth in made.truth:
        seen = (truth - made.poses[0][:3, 3]) @ made.poses[0][:3, :3]
        assert names["model"].nearest(seen).distance.max() < 3.0 * made.radius


def check_tracking(names, out, folder):
    assert "rope 0: begun" in out
    assert len(names["track"].ropes) == len(names["answer"].ropes) == 1


CHECKS = {
    "README.md": check_readme,
    "docs/batch.md": check_batch,
    "docs/configuration.md": check_configuration,
    "docs/export.md": check_export,
    "docs/first_grasp.md": check_first_grasp,
    "docs/masks.md": check_masks,
    "docs/pictures.md": check_pictures,
    "docs/recipes.md": check_recipes,
    "docs/recordings.md": check_recordings,
    "docs/tracking.md": check_tracking,
}


@pytest.mark.parametrize("page", find_pages("python"))
def test_python(page, tmp_path, capsys):
    threads = strand.num_threads()
    names = run_python(page, tmp_path, WITH_LIBRARIES.get(page, frozenset()))
    assert strand.num_threads() == threads
    CHECKS.get(page, lambda *_: None)(names, capsys.readouterr().out, tmp_path)


def test_known_lengths_give_the_number_of_ropes(monkeypatch):
    block = next(block for block in find_blocks("README.md") if "length=" in block.text)
    models, reconstruct = [], strand.reconstruct
    monkeypatch.setattr(strand, "reconstruct", lambda *a, **known: models.append(reconstruct(*a, **known)))
    exec(block.text, code_blocks.give_image() | {"strand": strand})
    assert [len(model.chains) for model in models] == [1, 2]


@pytest.fixture
def rerun(monkeypatch):
    """Replace Rerun, whose package is too large for the tests."""
    monkeypatch.setitem(sys.modules, "rerun", sys)
    monkeypatch.setattr(rerun_view, "show", lambda *_, **__: None)
    monkeypatch.setattr(rerun_view, "write_recording", lambda model, views, path, **_: path.touch())


@pytest.mark.usefixtures("rerun")
@pytest.mark.parametrize("page", COMMANDS)
def test_commands_of_strand(page, tmp_path):
    done = run_strand(page, tmp_path)
    assert [words for words, code in done if code] == []
    for words, _ in done:
        written = [after for word, after in pairwise(words) if word in ("-o", "--tube")]
        assert [name for name in written if not (tmp_path / name).stat().st_size] == []
    if page == "README.md":
        (chain,) = strand.load_model(tmp_path / "model.json").chains
        assert np.isclose(chain.length, 0.4, rtol=0.02)
        assert len(list((tmp_path / "figures").glob("*.png"))) == 8
    if page == "docs/recordings.md":
        frames = list(strand.io.models.load_frames(tmp_path / "models.jsonl"))
        assert [number for number, _, model in frames if model is not None] == [30, 40]


OTHERS = sorted({words for page in PAGES for words in find_commands(page) if words[0] != "strand"})


@pytest.mark.parametrize("command", OTHERS, ids=" ".join)
def test_other_commands_have_their_targets(command):
    program, *words = command
    options = [word for word in words if word.startswith("--")]
    if program == "./run":
        assert re.search(rf"^{words[0]}\)$", RUN, re.MULTILINE)
    elif program == "python":
        assert (ROOT / words[0]).is_file()
        assert [option for option in options if f'"{option}"' not in BENCHES] == []
    elif program == "pytest":
        assert (ROOT / words[0]).is_file()
    elif program == "pip":
        extras = re.findall(r"\.\[(\w+)\]", words[1])
        assert set(extras) <= set(PROJECT["optional-dependencies"])
        # peers of benches, and what builds wheels
        assert extras or set(words[1:]) <= {"maturin", "trimesh", "rtree", "coal"}
    elif program == "maturin":
        assert words[words.index("--extras") + 1] in PROJECT["optional-dependencies"]
    elif program == "cargo":
        assert words[0] in ("bench", "test")
        assert "--bench" not in words or words[2] in [bench["name"] for bench in CARGO["bench"]]
    elif "/" in program:
        assert os.access(ROOT / program, os.X_OK)
    else:
        assert " ".join(command) in ("python3 -m venv .venv", ". .venv/bin/activate")


@pytest.mark.parametrize("page", sorted({*find_pages("toml"), *find_pages("json")}))
def test_data(page, tmp_path):
    for block in find_blocks(page):
        if block.language == "toml":
            (tmp_path / "block.toml").write_text(block.text)
            assert read_toml(tmp_path / "block.toml")
        if block.language == "json":
            assert json.loads(block.text)


def test_the_scene_of_the_page_on_files_is_read(tmp_path):
    """Read the page's scene.toml beside files with its names."""
    (block,) = [block for block in find_blocks("docs/files.md") if block.language == "toml"]
    (tmp_path / "scene.toml").write_text(block.text)
    scene = code_blocks.make_arc()
    Image.fromarray(scene.depth[0]).save(tmp_path / "view0.png")
    Image.fromarray((255 * (scene.depth[0] > 0)).astype(np.uint8)).save(tmp_path / "view0_mask.png")
    Image.fromarray(np.zeros((240, 320, 3), np.uint8)).save(tmp_path / "view0_color.png")
    Image.fromarray(np.zeros((240, 320), np.uint8)).save(tmp_path / "view0_robot.png")
    (tmp_path / "view1.ply").write_bytes(make_ply())
    np.save(tmp_path / "view2.npy", scene.depth[2] * scene.depth_scale)
    read = strand.load_scene(tmp_path)
    assert (read.name, read.radius, len(read.views)) == ("knot", 0.0042, 3)
    assert [view.mask is not None for view in read.views] == [True, False, False]
