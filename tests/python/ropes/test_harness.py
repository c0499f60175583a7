"""Harnesses: what they check, and the ways, branches and trees in them."""

from __future__ import annotations

import dataclasses
import itertools
import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from scipy.sparse.csgraph import dijkstra

import strand
from shared.harnesses import draw_harness, make_harness
from strand.ropes.harness import Harness, HarnessEdge, HarnessNode


def test_a_node_knows_what_it_is():
    node = HarnessNode(3, [0.1, 0.2, 0.3], np.eye(3), 1)
    assert (node.kind, dataclasses.replace(node, degree=2).kind) == ("end", "junction")
    assert not node.position.flags.writeable
    assert not node.covariance.flags.writeable


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda nodes, edges: (nodes[::-1], edges), r"nodes\[0\]: expected the number 0, got 4"),
        (lambda nodes, edges: (nodes, edges[1:]), r"edges\[0\]: expected the number 0, got 1"),
        (
            lambda nodes, edges: (nodes[:-1], edges),
            r"edges\[3\]: expected the number of a node as its stop, got 4",
        ),
        (lambda nodes, edges: (nodes, edges[:-1]), r"nodes\[1\]: expected a degree of 3"),
        (
            lambda nodes, edges: (
                [dataclasses.replace(node, position=node.position + 0.1 * np.eye(3)[2]) for node in nodes],
                edges,
            ),
            r"edges\[0\]: expected a chain whose start is within a radius of node 0, got one 100 mm away",
        ),
    ],
)
def test_a_harness_that_contradicts_itself_is_refused(change, said):
    harness = make_harness([(0, 1), (1, 2), (1, 3), (1, 4)])
    with pytest.raises(ValueError, match=said):
        Harness(*change(list(harness.nodes), list(harness.edges)))


def test_only_a_loop_may_be_closed():
    ring = strand.Chain(0.1 * np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0]]), 0.004, closed=True)
    alone = Harness([HarnessNode(0, ring.points[0], None, 2)], [HarnessEdge(0, 0, 0, ring)])
    assert alone.branches_at(0)[1].chain.closed
    with pytest.raises(ValueError, match="expected an open one between nodes 0 and 1"):
        HarnessEdge(0, 0, 1, ring)


@pytest.mark.parametrize("seed", range(20))
def test_ways_and_trees_are_those_of_scipy(seed):
    """Random graphs with cycles, loops, edges side by side and several parts."""
    harness = draw_harness(np.random.default_rng(seed))
    count = len(harness.nodes)
    steps = np.zeros((count, count))  # 0 where there is no edge
    for edge in harness.edges:
        least = min(edge.length, steps[edge.start, edge.stop] or np.inf)
        steps[edge.start, edge.stop] = steps[edge.stop, edge.start] = least
    lengths = dijkstra(steps)
    for a, b in itertools.product(range(count), repeat=2):
        if np.isinf(lengths[a, b]):
            with pytest.raises(ValueError, match=f"expected a node that edges join to node {a}"):
                harness.path(a, b)
            continue
        assert harness.length(a, b) == pytest.approx(lengths[a, b])
        way = harness.path(a, b)
        stops = [a, *(edge.stop for edge in way)]
        assert [edge.start for edge in way] == stops[:-1]
        assert stops[-1] == b
        for edge in way:
            assert edge.chain.points[0] == pytest.approx(harness.nodes[edge.start].position)
            assert edge.length == pytest.approx(harness.edges[edge.id].length)
    for root in range(count):
        reached = {root: 0.0}
        for edge in harness.tree(root):
            assert edge.stop not in reached
            reached[edge.stop] = reached[edge.start] + edge.length
        whole = {end: length for end, length in enumerate(lengths[root]) if np.isfinite(length)}
        assert reached == pytest.approx(whole)


def test_branches_start_at_their_node_and_a_loop_comes_twice():
    harness = make_harness([(0, 1), (2, 1), (2, 2)])
    assert [(edge.id, edge.stop) for edge in harness.branches_at(1)] == [(0, 0), (1, 2)]
    assert [(edge.id, edge.stop) for edge in harness.branches_at(2)] == [(1, 1), (2, 2), (2, 2)]
    one, other = harness.branches_at(2)[1:]
    np.testing.assert_array_equal(one.chain.points, other.chain.points[::-1])
    with pytest.raises(ValueError, match="node: expected at most 2, got 3"):
        harness.branches_at(3)


def test_a_model_has_the_chains_of_its_harness():
    harness = make_harness([(0, 1), (1, 2), (1, 3)])
    chains = [edge.chain for edge in harness.edges]
    model = strand.Model(chains, np.eye(4)[None], up=[0.0, 0.6, 0.8], harness=harness)
    assert all(edge.chain is chain for edge, chain in zip(model.harness.edges, model.chains, strict=True))
    with pytest.raises(ValueError, match=r"harness: expected an edge for each chain \(2\), got 3"):
        strand.Model(chains[1:], np.eye(4)[None], harness=harness)
    with pytest.raises(ValueError, match=r"harness: expected chains\[0\] as the chain of edge 0"):
        strand.Model(chains[::-1], np.eye(4)[None], harness=harness)


def test_a_harness_survives_its_file_and_keeps_to_the_schema(tmp_path):
    made = draw_harness(np.random.default_rng(3))
    nodes = [
        dataclasses.replace(node, covariance=np.eye(3) * 1e-7 / 3, confidence=1 / (3 + node.id))
        for node in made.nodes
    ]
    edges = [dataclasses.replace(edge, wires=edge.id + 1) for edge in made.edges]
    model = strand.Model([edge.chain for edge in edges], np.eye(4)[None], harness=Harness(nodes, edges))
    path = tmp_path / "model.json"
    model.save(path)
    schema = json.loads((Path(__file__).parents[3] / "docs" / "model.schema.json").read_text())
    content = json.loads(path.read_text())
    jsonschema.Draft202012Validator(schema).validate(content)
    loaded = strand.load_model(path).harness
    for one, other in zip(loaded.nodes, nodes, strict=True):
        np.testing.assert_array_equal(one.position, other.position)
        np.testing.assert_array_equal(one.covariance, other.covariance)
        assert (one.id, one.degree, one.confidence) == (other.id, other.degree, other.confidence)
    for one, other in zip(loaded.edges, edges, strict=True):
        assert (one.id, one.start, one.stop, one.wires) == (other.id, other.start, other.stop, other.wires)
        np.testing.assert_array_equal(one.chain.points, other.chain.points)
    content["harness"]["nodes"][0]["kind"] = "junction" if nodes[0].kind == "end" else "end"
    path.write_text(json.dumps(content))
    with pytest.raises(strand.FileFormatError, match="kind: expected"):
        strand.load_model(path)


def test_a_model_without_a_harness_has_none_in_its_file(tmp_path):
    path = tmp_path / "model.json"
    strand.Model([strand.Chain(np.eye(3), 0.004)], np.eye(4)[None]).save(path)
    assert "harness" not in json.loads(path.read_text())
    assert strand.load_model(path).harness is None
