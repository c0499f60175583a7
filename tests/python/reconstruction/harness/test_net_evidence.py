"""A netlist decides where heights do not, and never against them."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from strand.synthetic import Noise, harness


def measure_edges(made):
    return [
        (f"n{start}", f"n{stop}", float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()))
        for (start, stop), line in zip(made.edges, made.truth, strict=True)
    ]


@pytest.fixture(scope="module")
def made():
    return harness("tree", seed=2, views=3, noise=Noise(depth=0.0003))


def look(made, branches):
    return strand.reconstruct(made.views, sorted(set(made.radii)), made.bounds, branches=branches)


def list_pairs(model):
    return sorted(tuple(sorted((edge.start, edge.stop))) for edge in model.harness.edges)


def test_a_netlist_that_fits_raises_no_doubt(made):
    edges = measure_edges(made)
    model = look(made, strand.Netlist(edges=edges))
    match = model.harness.match(strand.Netlist(edges=edges))
    assert not match.missing
    assert not match.extra
    assert not any("netlist" in doubt.reason for doubt in model.doubts)
    assert model.confidence > 0.8


@pytest.mark.parametrize("change", ["missing", "extra"])
def test_a_wrong_netlist_changes_no_graph_and_makes_a_doubt(made, change):
    edges = measure_edges(made)
    ends = [name for edge in edges for name in edge[:2]]
    leaf = next(k for k, edge in enumerate(edges) if min(ends.count(name) for name in edge[:2]) == 1)
    wrong = edges[:leaf] + edges[leaf + 1 :] if change == "missing" else [*edges, (edges[0][0], "new", 0.2)]
    plain, model = look(made, True), look(made, strand.Netlist(edges=wrong))
    assert list_pairs(model) == list_pairs(plain)
    (doubt,) = (doubt for doubt in model.doubts if "netlist" in doubt.reason)
    assert ("missing" in doubt.reason) == (change == "extra")
    assert model.confidence < plain.confidence - 0.1


def test_a_netlist_decides_between_graphs_of_like_heights():
    made = harness("near", seed=515017, views=1, noise=Noise(depth=0.0006))
    tree = {name for edge in measure_edges(made)[:-1] for name in edge[:2]}
    edges = [edge for edge in measure_edges(made) if edge[0] in tree and edge[1] in tree]
    counts = [len(look(made, branches).harness.edges) for branches in (True, strand.Netlist(edges=edges))]
    assert counts[1] == len(made.edges)


def test_branches_are_a_bool_or_a_netlist(made):
    with pytest.raises(TypeError, match="branches"):
        look(made, [("a", "b", 0.1)])
