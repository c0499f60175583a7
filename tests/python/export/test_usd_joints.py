"""Harnesses in USD: curves share their nodes, by attachments that OpenUSD loads."""

from __future__ import annotations

import numpy as np
import pytest
import rustworkx as rx
from pxr import Sdf, Usd

import strand
from shared.harnesses import make_harness
from shared.ropes import draw_circle
from strand.ropes.harness import Harness, HarnessEdge, HarnessNode

PAIRS = {
    "tree": [(0, 1), (1, 2), (1, 3), (3, 4), (3, 5)],
    "four": [(0, 1), (1, 2), (1, 3), (1, 4)],
    "cycle": [(0, 1), (1, 2), (1, 2), (2, 3)],
    "parts": [(0, 1), (1, 2), (1, 3), (4, 5)],
    "loop": [(1, 1), (0, 1)],
    "eight": [(0, 0), (0, 0)],
    "alone": [(0, 0)],
    "rope": [(0, 1)],
}


def load(folder, harness, **more):
    chains = tuple(edge.chain for edge in harness.edges)
    model = strand.Model(chains, np.empty((0, 4, 4)), harness=harness)
    model.save_usd(folder / "harness.usda", **more)
    # anonymous, as USD keeps layers by their paths
    return Usd.Stage.Open(Sdf.Layer.OpenAsAnonymous(str(folder / "harness.usda")))


def read(prim, name):
    return prim.GetAttribute(f"physics:{name}").Get()


def list_kind(stage, kind):
    return [prim for prim in stage.Traverse() if prim.GetTypeName() == kind]


def read_points(stage, path):
    return np.array(stage.GetPrimAtPath(path).GetAttribute("points").Get(), dtype=float)


def read_sources(prim):
    names = [prim.GetRelationship(f"physics:src{side}").GetTargets() for side in (0, 1)]
    assert [len(one) for one in names] == [1, 1]
    return [one[0] for one in names]


@pytest.mark.parametrize("pairs", PAIRS.values(), ids=PAIRS)
def test_attachments_join_what_the_graph_joins(tmp_path, pairs):
    harness = make_harness(pairs, seed=3)
    stage = load(tmp_path, harness)
    sites = []
    for number, edge in enumerate(harness.edges):
        points = read_points(stage, f"/ropes/rope_{number}/curve")
        assert len(points) >= 3
        for vertex, node in ((0, edge.start), (len(points) - 1, edge.stop)):
            away = np.linalg.norm(points[vertex] - harness.nodes[node].position)
            assert away < 1e-4
            sites.append((f"/ropes/rope_{number}/curve", vertex, node))
    graph = rx.PyGraph()
    graph.add_nodes_from(sites)
    number_of = {site[:2]: k for k, site in enumerate(sites)}
    for joint in list_kind(stage, "PhysicsAttachment"):
        assert (read(joint, "type0"), read(joint, "type1")) == ("point", "point")
        (one,), (other,) = read(joint, "indices0"), read(joint, "indices1")
        first, second = read_sources(joint)
        # Newton takes joints between two curves only; a loop alone has no other
        assert first != second or pairs == PAIRS["alone"]
        graph.add_edge(number_of[str(first), one], number_of[str(second), other], None)
    joined = sorted(sorted(part) for part in rx.connected_components(graph))
    wanted = {}
    for k, (_, _, node) in enumerate(sites):
        wanted.setdefault(node, []).append(k)
    assert joined == sorted(wanted.values())
    assert graph.num_edges() == len(sites) - len(wanted)


def test_segments_near_a_junction_do_not_collide(tmp_path):
    harness = make_harness(PAIRS["tree"], seed=3)
    stage = load(tmp_path, harness)
    filters = list_kind(stage, "PhysicsElementCollisionFilter")
    assert len(filters) == 6
    for one in filters:
        near = []
        for side, source in enumerate(read_sources(one)):
            points = read_points(stage, source)
            listed = np.array(read(one, f"groupElemIndices{side}"), dtype=int)
            assert list(read(one, f"groupElemCounts{side}")) == [len(listed)]
            assert (listed >= 0).all()
            assert (listed < len(points) - 1).all()
            near.append(np.vstack([points[listed], points[listed + 1]]))
        # both groups reach the node, and end a few diameters behind it
        gaps = np.linalg.norm(near[0][:, None] - near[1][None], axis=2)
        (place, _) = np.unravel_index(gaps.argmin(), gaps.shape)
        assert gaps.min() < 1e-6
        for places in near:
            away = np.linalg.norm(places - near[0][place], axis=1)
            assert away.min() < 1e-6
            assert 0.02 < away.max() < 0.05


def test_a_ring_has_no_joint_and_one_on_a_ring_has_one(tmp_path):
    ring = strand.Chain(draw_circle(0.1, 60, True).points, 0.004, True)
    alone = Harness([HarnessNode(0, ring.points[0], None, 2)], [HarnessEdge(0, 0, 0, ring)])
    assert not list_kind(load(tmp_path, alone), "PhysicsAttachment")
    out = ring.points[0] + np.linspace(0.0, 1.0, 20)[:, None] * [0.0, 0.0, 0.1]
    nodes = [HarnessNode(0, ring.points[0], None, 3), HarnessNode(1, out[-1], None, 1)]
    handle = HarnessEdge(1, 0, 1, strand.Chain(out, 0.004))
    stage = load(tmp_path, Harness(nodes, [HarnessEdge(0, 0, 0, ring), handle]))
    (joint,) = list_kind(stage, "PhysicsAttachment")
    assert (list(read(joint, "indices0")), list(read(joint, "indices1"))) == ([0], [0])


def test_ends_that_miss_their_node_are_moved_to_it(tmp_path):
    harness = make_harness(PAIRS["four"], seed=1)
    moved = []
    for edge in harness.edges:
        points = edge.chain.points.copy()
        points[0] += [0.002, 0.0, 0.0]
        moved.append(HarnessEdge(edge.id, edge.start, edge.stop, strand.Chain(points, edge.radius)))
    stage = load(tmp_path, Harness(harness.nodes, moved))
    for number, edge in enumerate(harness.edges):
        first = read_points(stage, f"/ropes/rope_{number}/curve")[0]
        np.testing.assert_allclose(first, harness.nodes[edge.start].position, atol=1e-6)


def test_ropes_without_a_graph_have_no_joints(tmp_path):
    harness = make_harness(PAIRS["tree"])
    model = strand.Model(tuple(edge.chain for edge in harness.edges), np.empty((0, 4, 4)))
    model.save_usd(tmp_path / "ropes.usda")
    text = (tmp_path / "ropes.usda").read_text()
    assert "PhysicsAttachment" not in text
    assert "Filter" not in text
