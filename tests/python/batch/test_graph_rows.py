"""Rows of ropes that branch: the graph in the table, in models and on the page."""

from __future__ import annotations

import dataclasses
import json
import re

import numpy as np
import pytest

import strand
from lib.bag_files import record_film, write_bag
from shared.harnesses import make_harness
from strand.batch import Settings, load_models, load_table, run, write_summary
from strand.batch.reading import _make_model
from strand.batch.rows import make_model_rows
from strand.batch.table import make_record_batch
from strand.batch.writing import write_rows
from strand.cli import main
from strand.io.models import load_frames
from strand.support.files import JSON_BYTES, FileFormatError
from strand.synthetic import Camera, Noise, harness

NET = strand.Netlist([("plug", "split", 0.3), ("split", "lamp", 0.1), ("split", "motor", 0.2)])


@pytest.fixture(scope="module")
def made():
    return harness("tree", seed=0, views=3, camera=Camera(size=(480, 360)), noise=Noise(depth=0.0003))


@pytest.fixture(scope="module")
def batch(made, tmp_path_factory):
    """A harness and a rope, and the settings with which they were read."""
    folder, out = tmp_path_factory.mktemp("in"), tmp_path_factory.mktemp("out")
    made.save(folder / "harness.npz")
    harness("rope", seed=1, views=3, camera=Camera(size=(480, 360))).save(folder / "rope.npz")
    settings = Settings(branches=True, wire=min(made.radii))
    run(folder, out, settings, root=folder, workers=1)
    return folder, out, settings


def check_same(found, want):
    assert len(found.nodes) == len(want.nodes)
    for node, other in zip(found.nodes, want.nodes, strict=True):
        np.testing.assert_array_equal(node.position, other.position)
        if other.covariance is None:
            assert node.covariance is None
        else:
            np.testing.assert_array_equal(node.covariance, other.covariance)
        np.testing.assert_equal((node.degree, node.confidence), (other.degree, other.confidence))
    for edge, other in zip(found.edges, want.edges, strict=True):
        assert (edge.start, edge.stop, edge.wires) == (other.start, other.stop, other.wires)
        assert (edge.radius, edge.radius_sd) == (other.radius, other.radius_sd)
        np.testing.assert_array_equal(edge.chain.points, other.chain.points)


def test_rows_hold_the_graph_of_reconstruct(batch):
    folder, out, settings = batch
    scene = strand.load_scene(folder / "harness.npz")
    want = strand.reconstruct(scene.views, scene.radius, scene.bounds, branches=True, wire=settings.wire)
    found = {name: model for name, _, model in load_models(out)}
    assert len(want.harness.edges) > 2
    check_same(found["harness.npz"].harness, want.harness)
    # two ropes that cross stay two
    assert [node.kind for node in found["rope.npz"].harness.nodes] == ["end"] * 4
    rows = [row for row in load_table(out).to_pylist() if row["recording"] == "harness.npz"]
    graph = json.loads(rows[0]["graph"])
    assert [row["graph"] for row in rows[1:]] == [None] * (len(rows) - 1)
    for edge, listed in zip(want.harness.edges, graph["edges"], strict=True):
        assert {name: getattr(edge, name) for name in listed} == listed
        assert {"length", "radius", "radius_sd", "wires", "start", "stop"} < set(listed)
    assert [node["kind"] for node in graph["nodes"]] == [node.kind for node in want.harness.nodes]


def test_the_page_counts_graphs(batch, tmp_path):
    _, out, _ = batch
    write_summary(out, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    rows = re.findall(r'<td class="n">(\d+)</td>' * 4 + "<td>(.*?)</td>", page.partition("Graphs")[2])
    nodes = {name: model.harness.nodes for name, _, model in load_models(out)}
    for *numbers, example in rows:
        (name,) = (name for name in nodes if name in example)
        ends = sum(node.kind == "end" for node in nodes[name])
        edges = sum(node.degree for node in nodes[name]) // 2
        assert [*map(int, numbers)] == [len(nodes[name]) - ends, ends, edges, 1]
    assert len(rows) == 2


@pytest.mark.parametrize(
    "pairs", [[(0, 1), (1, 2), (1, 2), (2, 3)], [(0, 1), (1, 1)], [(0, 1), (2, 3)], [(0, 1)]]
)
def test_graphs_with_cycles_loops_and_parts_come_back(pairs, tmp_path):
    graph = make_harness(pairs, seed=2)
    edges = [
        dataclasses.replace(edge, wires=edge.id + 1, chain=dataclasses.replace(edge.chain, radius_sd=1e-4))
        for edge in graph.edges[:-1]
    ]
    graph = dataclasses.replace(graph, edges=(*edges, graph.edges[-1]))
    chains = tuple(edge.chain for edge in graph.edges)
    model = strand.Model(chains, np.empty((0, 4, 4)), harness=graph)
    (tmp_path / "aa").mkdir()
    name = f"{'a' * 16}-{'b' * 16}-0-end.parquet"
    with (tmp_path / "aa" / name).open("w+b") as file:
        write_rows(make_model_rows("a", 0, None, model, 0.0), file, "")
    ((_, _, found),) = load_models(tmp_path)
    check_same(found.harness, graph)


def test_ropes_that_do_not_branch_have_no_graph():
    model = strand.Model((strand.Chain([[0.0, 0, 0], [0.1, 0, 0]], 0.004),), np.empty((0, 4, 4)))
    rows = make_record_batch(list(make_model_rows("a", 0, None, model, 0.0)), "0", "").to_pylist()
    assert [row["graph"] for row in rows] == [None]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('"start": 0', '"start": 99'),
        ('"nodes"', '"places"'),
        ('"wires"', '"threads"'),
        ('"degree": 1', '"degree": 2'),
        ('"radius_sd": ', '"radius_sd": -'),
        ("}", ""),
        ('{"nodes"', '[{"nodes"'),
    ],
)
def test_a_damaged_graph_is_an_error(old, new, tmp_path):
    graph = make_harness([(0, 1), (1, 2), (1, 3)])
    chains = tuple(dataclasses.replace(edge.chain, radius_sd=1e-4) for edge in graph.edges)
    edges = tuple(dataclasses.replace(edge, chain=chains[edge.id]) for edge in graph.edges)
    model = strand.Model(chains, np.empty((0, 4, 4)), harness=dataclasses.replace(graph, edges=edges))
    table = make_record_batch(list(make_model_rows("a", 0, None, model, 0.0)), "0", "")
    rows = table.to_pylist()
    assert old in rows[0]["graph"]
    rows[0]["graph"] = rows[0]["graph"].replace(old, new)
    with pytest.raises(FileFormatError):
        list(_make_model(tmp_path / "a.parquet", rows, JSON_BYTES))
    with pytest.raises(FileFormatError, match=r"graph: text and values may take \d+ bytes"):
        list(_make_model(tmp_path / "a.parquet", table.to_pylist(), 1000))


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"wire": 0.001}, "wire: expected None without branches"),
        ({"branches": True, "ropes": 1}, "branches: expected False with ropes or length"),
        ({"branches": True, "track": True}, "branches: not with track"),
        ({"branches": NET, "track": True}, "branches: not with track"),
        ({"branches": True, "wire": 0.0}, "wire: expected a positive number"),
        ({"branches": True, "config": strand.Config(method="published")}, "with the published method"),
    ],
)
def test_settings_that_contradict_each_other_are_refused(given, said):
    with pytest.raises(ValueError, match=said):
        Settings(**given)
    with pytest.raises(TypeError, match="branches"):
        Settings(branches="yes")


def test_the_netlist_is_part_of_the_digest():
    longer = strand.Netlist([("plug", "split", 0.4), ("split", "lamp", 0.1), ("split", "motor", 0.2)])
    given = [Settings(), *(Settings(branches=one) for one in (True, NET, longer))]
    assert len({settings.digest for settings in given}) == 4
    assert Settings(branches=NET).digest == Settings(branches=strand.Netlist(NET.edges)).digest


def test_a_netlist_reaches_the_reconstruction(made, tmp_path):
    made.save(tmp_path / "harness.npz")
    out = tmp_path / "out"
    run(tmp_path / "harness.npz", out, Settings(branches=NET), root=tmp_path, workers=1)
    ((_, _, found),) = load_models(out)
    scene = strand.load_scene(tmp_path / "harness.npz")
    want = strand.reconstruct(scene.views, scene.radius, scene.bounds, branches=NET)
    assert found.confidence == want.confidence
    plain = strand.reconstruct(scene.views, scene.radius, scene.bounds, branches=True)
    assert want.confidence != plain.confidence


def test_the_command_takes_branches_and_a_wire(batch, tmp_path, monkeypatch, capsys):
    folder, out, settings = batch
    monkeypatch.chdir(folder)
    words = ["--branches", "--wire", f"{settings.wire!r}m", "--root", str(folder)]
    assert main(["batch", str(folder), "-o", str(out), *words]) == 0
    assert "skipped  2 finished units" in capsys.readouterr().out
    assert main(["batch", str(folder), "-o", str(tmp_path / "out"), "--wire", "1mm"]) == 2
    assert "wire: expected None without branches" in capsys.readouterr().err


def test_lines_of_json_have_the_graph(made, tmp_path):
    path = write_bag(tmp_path / "film", "mcap", record_film(made, 1))
    out = tmp_path / "frames.jsonl"
    words = ["--branches", "--every", "1", "--world", "world", "-o", str(out)]
    assert main(["reconstruct", str(path), *words]) == 0
    ((_, _, model),) = load_frames(out)
    assert len(model.harness.edges) == len(model.chains) > 0
