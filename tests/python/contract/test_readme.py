"""The README's commands, length, picture and numbers; `test_code_blocks.py` runs its examples."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import strand
from shared.pictures import MAX_DIFFERENCE, compare_pictures
from strand.cli import main

ROOT = Path(__file__).resolve().parents[3]
README = (ROOT / "README.md").read_text()
SHELL = "\n".join(re.findall(r"```sh\n(.*?)```", README, re.DOTALL))
PICTURES = ROOT / "docs" / "images" / "demo"
# cells of tables that today's code must give again, whatever the machine
KEPT = ("scene", "topology", "chains", "Fréchet / r", "RMS mm", "length %", "crossings", "confidence")


def test_the_commands_exist():
    assert re.findall(r"^\./run (\w+)", SHELL, re.MULTILINE) == ["demo", "test"]
    done = subprocess.run([ROOT / "run"], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "./run demo" in done.stderr
    scripts = re.findall(r"`python (benches/\w+\.py)", README)
    assert len(scripts) > 4
    assert [script for script in scripts if not (ROOT / script).is_file()] == []


def test_it_is_short():
    assert len(README.splitlines()) <= 90
    assert len(re.findall(r"(?<!!)\[[^]]+\]\((?!https?:)", README)) == 6
    assert len(re.findall(r"!\[", README)) == 1
    assert len(re.search(r"```python\n(.*?)```", README, re.DOTALL).group(1).splitlines()) <= 12


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """What `./run demo` writes."""
    folder = tmp_path_factory.mktemp("demo")
    assert main(["demo", "--out", str(folder)]) == 0
    return folder


@pytest.mark.parametrize("path", sorted(PICTURES.rglob("*.png")), ids=lambda path: path.name)
def test_pictures_are_those_of_the_demo(path, drawn):
    made = drawn / path.relative_to(PICTURES)
    assert compare_pictures(path, made) < MAX_DIFFERENCE, f"copy strand-demo/{path.name} to {path}"


def test_pictures_of_another_rope_differ(drawn, tmp_path):
    scene = strand.synthetic.scene("paper", seed=1)
    model = strand.reconstruct(scene.views, scene.radius, scene.bounds, ropes=1, keep_stages=True)
    strand.figures.draw_ropes(model, scene.truth).savefig(tmp_path / "5-ropes.png", bbox_inches="tight")
    assert compare_pictures(drawn / "5-ropes.png", tmp_path / "5-ropes.png") > 3.0 * MAX_DIFFERENCE


# Numbers.


def read_tables(text: str) -> list[dict[str, str]]:
    """Return the rows of Markdown tables by the names of their columns."""
    rows, head = [], []
    for line in [*text.splitlines(), ""]:
        cells = [cell.strip() for cell in line.strip("|").split("|")] if line.startswith("|") else []
        if not cells:
            head = []
        elif not head:
            head = cells
        elif not set(line) <= set("|-: "):
            rows.append(dict(zip(head, cells, strict=True)))
    return rows


def read_results(command: str) -> list[dict[str, str]]:
    """Return the rows that a bench printed, as `benches/results/` keeps them."""
    page = (ROOT / "benches" / "results" / f"{Path(command.split()[0]).stem}.md").read_text("utf-8")
    after = page.split(f"## `python benches/{command}`\n", 1)[1]
    return read_tables(after.split("\n## ", 1)[0])


def find_measured(text: str) -> list[str]:
    """Return the numbers of a row of the README: strand's, then those of the others."""
    (row,) = (row for row in read_tables(README) if text in row["what"])
    return re.findall(r"(?<![\w.])\d+(?:\.\d+)?", f"{row['strand']} {row['compared with']}")


@pytest.mark.parametrize("options", ["", " --published"])
def test_right_scenes_are_those_of_the_table(options):
    rows = [row for row in read_results(f"scenes.py{options}") if "topology" in row]
    right = sum(row["topology"] == "right" for row in rows)
    assert f"{len(rows)} simulated scenes" in README
    assert find_measured("simulated scenes")[bool(options)] == f"{right}"


def test_errors_are_those_of_the_table():
    rows = [row for row in read_results("limits.py") if row["scene"].startswith("median")]
    assert find_measured("RMS error") == [
        *(row["RMS mm"] for row in rows),
        *(row["bound mm"] for row in rows),
    ]


def test_random_scenes_are_those_of_the_table():
    (row,) = (
        row
        for row in read_results("fresh.py --noise small --scenes 500 --out target/fresh")
        if row.get("scenes") == "500"
    )
    assert find_measured("random scenes") == [row["right %"]]


def test_wrong_answers_are_those_of_the_page_on_confidence():
    page = (ROOT / "docs" / "confidence.md").read_text("utf-8")
    share, scenes = re.search(r"([\d.]+) % of ([\d,]+) answers\s+are sure", page).groups()
    assert f"{scenes} scenes" in README
    bins = [row for row in read_tables(page) if "answers" in row and "right" in row]
    counts = [int(row["answers"]) for row in bins]
    assert sum(counts) == int(scenes.replace(",", ""))
    wrong = sum(n * (100.0 - float(row["right"].split()[0])) for n, row in zip(counts, bins, strict=True))
    assert find_measured("confidence ≥ 0.9") == [share, f"{wrong / sum(counts):.0f}"]


def test_times_are_those_of_the_tables():
    cases = {row["case"]: row for row in read_results("cases.py --turns 3 --against PATH") if "case" in row}
    wanted = [
        f"{float(cases[case][column]):.0f}"
        for case in ("paper", "published")
        for column in ("processor, ms", "two threads, ms")
    ]
    assert find_measured("depth images to the model") == wanted
    rows = [
        row
        for row in read_results("compare.py --slow --points 12000 100000")
        if (row.get("points"), row.get("order")) == ("100000", "random")
        and row["stage"] == "normals, 16 nearest"
    ]
    wanted = [rows[0]["strand ms"], *(row["peer ms"] for row in rows)]
    assert find_measured("normals of 100,000 points") == [f"{float(ms):.0f}" for ms in wanted]


@pytest.mark.parametrize("options", [(), ("--published",)])
def test_todays_code_makes_the_rows_of_the_tables(options):
    done = subprocess.run(
        [sys.executable, ROOT / "benches" / "scenes.py", "--only", "_mid", "--runs", "1", *options],
        capture_output=True,
        text=True,
        check=True,
    )
    stored = {row.get("scene"): row for row in read_results(" ".join(["scenes.py", *options]))}
    made = [row for row in read_tables(done.stdout) if "scene" in row]
    assert len(made) > 2
    for row in made:
        assert [row[name] for name in KEPT] == [stored[row["scene"]][name] for name in KEPT]
