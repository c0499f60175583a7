"""`strand report` and `strand view`."""

from __future__ import annotations

import re
import sys

import pytest

import strand
from strand.cli import main, view


def test_report_writes_a_page(scene_npz, tmp_path, capsys):
    out = tmp_path / "report.html"
    assert main(["report", str(scene_npz), "-o", str(out), "--ropes", "1"]) == 0
    assert capsys.readouterr().out == f"{out}\n"
    text = out.read_text("utf-8")
    assert "<h1>arc</h1>" in text
    assert "<td>ropes</td><td>1</td>" in text
    assert "1 chain (" in text


def test_radii_that_differ_are_given_one_by_one(scene_npz, tmp_path, capsys):
    out = tmp_path / "a.html"
    words = ["report", str(scene_npz), "-o", str(out), "--radius", "4.2mm"]
    assert main([*words, "--radius", "2mm"]) == 0
    assert "<td>radius</td><td>4.20 mm, 2.00 mm</td>" in out.read_text("utf-8")
    assert main(words) == 0
    assert "<td>radius</td><td>4.20 mm</td>" in out.read_text("utf-8")


def test_harnesses_are_drawn(tmp_path, capsys):
    made = strand.synthetic.harness("tree", seed=2, views=1)
    path, page, folder = tmp_path / "harness.npz", tmp_path / "h.html", tmp_path / "figures"
    made.save(path)
    assert main(["report", str(path), "--branches", "-o", str(page)]) == 0
    assert capsys.readouterr().out == f"{page}\n"
    text = page.read_text("utf-8")
    edges = re.findall(r"<td>([EJ]\d) to ([EJ]\d)</td>", text)
    assert len(edges) == len(made.edges)
    drawn = text.count('class="junction"')
    assert drawn == len({name for pair in edges for name in pair if name[0] == "J"}) == 2
    stages = re.findall(r"<tr><td>([a-z ]+)</td><td>[\d,]*</td><td>[\d,]*</td><td>", text)
    assert {"extract", "filter", "register", "map", "places", "fit", "total"} <= set(stages)
    graph, again = tmp_path / "h.graphml", tmp_path / "again.html"
    words = ["reconstruct", str(path), "--figures", str(folder), "-o", str(graph), "--report", str(again)]
    assert main(words) == 2
    assert main([*words, "--branches"]) == 0
    assert capsys.readouterr().out.splitlines()[-10:-8] == [str(graph), str(again)]
    assert graph.read_text().count("<edge ") == len(edges)
    assert again.read_text("utf-8").count('class="junction"') == drawn
    names = [name.split("-")[1] for name in sorted(file.stem for file in folder.iterdir())]
    assert names == ["raw", "filtered", "registered", "arcs", "ropes", "residuals", "uncertainty", "cameras"]


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["report", "arc.npz", "-o", "arc.npz"], 2, "--out: expected another file than the inputs"),
        (["report", "arc.npz", "-o", "no/a.html"], 3, "no/a.html: No such file or directory"),
        (["report", "no.npz", "-o", "a.html"], 3, "no.npz: No such file or directory"),
        (["report", "arc.npz", "-o", "a.html", "--radius", "0"], 2, "radius: "),
        (["view", "arc.npz", "--save", "arc.npz"], 2, "--save: expected another file than the inputs"),
        (["view", "arc.npz", "--save", "no/a.rrd"], 3, "no/a.rrd: No such file or directory"),
    ],
)
def test_report_and_view_refuse_wrong_files(words, code, message, scene_npz, monkeypatch, capsys):
    monkeypatch.chdir(scene_npz.parent)
    monkeypatch.setitem(sys.modules, "rerun", sys)  # any module will do
    before = scene_npz.read_bytes()
    assert main(words) == code
    assert message in capsys.readouterr().err
    assert scene_npz.read_bytes() == before
    assert [path.name for path in scene_npz.parent.iterdir()] == ["arc.npz"]


@pytest.mark.parametrize(
    ("words", "package"), [(["report", "-o", "a.html"], "plotly"), (["view", "--save", "a.rrd"], "rerun")]
)
def test_missing_packages_are_named_before_the_work(words, package, monkeypatch, capsys):
    for name in [name for name in sys.modules if name.split(".")[0] == package]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    assert main([words[0], "no.npz", *words[1:]]) == 3
    assert "is needed here: pip install" in capsys.readouterr().err


def test_view_saves_a_recording(scene_npz, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rerun", sys)
    monkeypatch.setattr(
        view.rerun_view,
        "write_recording",
        lambda model, views, path, truth: path.write_text(f"{len(views)}"),
    )
    assert main(["view", str(scene_npz), "--save", str(tmp_path / "a.rrd")]) == 0
    assert (tmp_path / "a.rrd").read_text() == "3"
    assert capsys.readouterr().out == f"{tmp_path / 'a.rrd'}\n"
