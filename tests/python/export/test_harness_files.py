"""Files of harnesses: rustworkx reads the GraphML, MuJoCo loads the trees and steps them."""

from __future__ import annotations

import csv
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
import rustworkx as rx

import strand
from shared.harnesses import draw_harness, make_harness
from strand.ropes.harness import Harness, HarnessEdge, HarnessNode

PAIRS = {
    "tree": [(0, 1), (1, 2), (1, 3), (3, 4), (3, 5)],
    "cycle": [(0, 1), (1, 2), (1, 2), (2, 3)],
    "parts": [(0, 1), (1, 2), (1, 3), (4, 5)],
    "loop": [(0, 1), (1, 1), (1, 2)],
}


@pytest.mark.parametrize("seed", range(5))
def test_rustworkx_reads_the_graph(tmp_path, seed):
    harness = draw_harness(np.random.default_rng(seed))
    path = tmp_path / "harness.graphml"
    harness.save(path)
    (graph,) = rx.read_graphml(str(path))
    assert graph.num_nodes() == len(harness.nodes)
    assert graph.num_edges() == len(harness.edges)
    for node, read in zip(harness.nodes, graph.nodes(), strict=True):
        assert [read["x"], read["y"], read["z"]] == node.position.tolist()
        assert read["kind"] == node.kind
    for edge, (start, stop, read) in zip(harness.edges, graph.weighted_edge_list(), strict=True):
        assert (start, stop) == (edge.start, edge.stop)
        assert (read["length"], read["radius"]) == (edge.length, edge.radius)


def test_a_table_has_a_row_for_each_edge(tmp_path):
    harness = make_harness(PAIRS["tree"])
    harness.save(tmp_path / "edges.csv")
    with (tmp_path / "edges.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(int(row["start"]), int(row["stop"])) for row in rows] == PAIRS["tree"]
    assert [float(row["length"]) for row in rows] == [edge.length for edge in harness.edges]
    assert {row["wires"] for row in rows} == {""}
    with pytest.raises(ValueError, match="path"):
        harness.save(tmp_path / "edges.dot")


def load(path):
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


@pytest.mark.parametrize("pairs", PAIRS.values(), ids=PAIRS)
def test_mujoco_places_the_tree_of_a_urdf_where_the_harness_is(tmp_path, pairs):
    harness = make_harness(pairs, seed=3)
    harness.save_urdf(tmp_path / "harness.urdf", 1e-3)
    model, data = load(tmp_path / "harness.urdf")
    assert model.nv == 0
    places = np.concatenate([edge.chain.points for edge in harness.edges])
    balls = data.geom_xpos[model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE]
    assert max(np.linalg.norm(balls - place, axis=1).min() for place in places) < 1e-9
    links = [link.get("name") for link in ElementTree.parse(tmp_path / "harness.urdf").getroot().iter("link")]
    assert sorted(links) == sorted(
        [
            "world",
            *(f"node_{node.id}" for node in harness.nodes),
            *(f"edge_{edge.id}" for edge in harness.edges),
        ]
    )


def find_ends(model, data, harness):
    """Return the places where each edge's first capsule starts and its last one ends."""
    ends = []
    for edge in harness.edges:
        names = [f"edge_{edge.id}_{i}" for i in range(model.nbody)]
        bodies = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) for name in names]
        bodies = [body for body in bodies if body >= 0]
        last = bodies[-1]
        # a capsule starts at its body's origin
        along = data.xmat[last].reshape(3, 3) @ (2.0 * model.geom_pos[model.body_geomadr[last]])
        ends.append([data.xpos[bodies[0]], data.xpos[last] + along])
    return np.array(ends)


@pytest.mark.parametrize("pairs", PAIRS.values(), ids=PAIRS)
def test_a_tree_of_capsules_falls_bends_and_stays_joined(tmp_path, pairs):
    harness = make_harness(pairs, seed=3)
    harness.save_mjcf(tmp_path / "harness.xml", spacing=0.03, young=1e5)
    model, data = load(tmp_path / "harness.xml")
    ends = find_ends(model, data, harness)
    at = np.array(
        [[harness.nodes[edge.start].position, harness.nodes[edge.stop].position] for edge in harness.edges]
    )
    # edges that are walked backwards have their first capsule at their last node
    off = np.minimum(np.abs(ends - at).max(axis=(1, 2)), np.abs(ends[:, ::-1] - at).max(axis=(1, 2)))
    assert off.max() < 1e-9
    mass = sum(1000.0 * np.pi * edge.radius**2 * edge.length for edge in harness.edges)
    # corners of the chains are cut
    assert 0.9 * mass < model.body_mass.sum() < 1.1 * mass
    for _ in range(300):
        mujoco.mj_step(model, data)
    fallen = find_ends(model, data, harness)
    assert np.isfinite(fallen).all()
    assert data.time > 0.1
    turned = np.abs(ends - at).max(axis=(1, 2)) > 1e-6
    fallen[turned] = fallen[turned][:, ::-1]
    for node in harness.nodes:
        here = [
            fallen[edge.id, side]
            for edge in harness.edges
            for side, end in enumerate((edge.start, edge.stop))
            if end == node.id
        ]
        assert np.ptp(here, axis=0).max() < 0.005
    assert (data.qpos[2] < harness.nodes[0].position[2]).all()


CYCLES = {
    "square": [(0, 1), (1, 2), (2, 3), (3, 0), (2, 4)],
    "eight": [(0, 1), (1, 2), (2, 0), (2, 3), (3, 4), (4, 2)],
    "mesh": [(0, 1), (1, 2), (2, 3), (3, 0), (0, 2)],
    "loop": [(0, 1), (1, 1), (1, 2)],
}


@pytest.mark.parametrize("young", [1e5, 1e7])
@pytest.mark.parametrize("pairs", [PAIRS["tree"], *CYCLES.values()], ids=["tree", *CYCLES])
def test_what_falls_on_a_floor_stays_welded(tmp_path, pairs, young):
    harness = make_harness(pairs, seed=5)
    harness.save_mjcf(tmp_path / "harness.xml", spacing=0.04, young=young)
    tree = ElementTree.parse(tmp_path / "harness.xml")
    low = min(edge.chain.points[:, 2].min() for edge in harness.edges) - 0.05
    floor = {"type": "plane", "size": "3 3 0.1", "pos": f"0 0 {low}", "contype": "0", "conaffinity": "1"}
    ElementTree.SubElement(tree.getroot().find("worldbody"), "geom", floor)
    tree.write(tmp_path / "floor.xml")
    model, data = load(tmp_path / "floor.xml")
    assert model.neq == len(pairs) - len(harness.nodes) + 1
    assert set(model.eq_type.tolist()) <= {int(mujoco.mjtEq.mjEQ_WELD)}
    before = data.xmat.reshape(-1, 3, 3).copy()
    hold = [(model.eq_obj1id[k], model.eq_obj2id[k]) for k in range(model.neq)]
    offsets = [before[b].T @ (data.xpos[a] - data.xpos[b]) for a, b in hold]
    landed = False
    for _ in range(round(1.0 / model.opt.timestep)):
        earlier = data.xpos.copy()
        mujoco.mj_step(model, data)
        landed |= data.ncon > 2
        # it falls some 0.4 m, at 3 m/s in the end, and ends of bends whip
        assert np.linalg.norm(data.xpos - earlier, axis=1).max() / model.opt.timestep < 10.0
    assert landed
    assert not any(warning.number for warning in data.warning)
    turned = data.xmat.reshape(-1, 3, 3)
    for (a, b), offset in zip(hold, offsets, strict=True):
        assert np.linalg.norm(turned[b].T @ (data.xpos[a] - data.xpos[b]) - offset) < 0.002
        angle = np.arccos(np.clip((np.trace(turned[b].T @ turned[a]) - 1.0) / 2.0, -1.0, 1.0))
        assert angle < np.radians(5.0)
    assert data.xpos[1:, 2].min() > low - 0.01


def test_a_ring_and_segments_without_end(tmp_path):
    circle = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    ring = strand.Chain(
        0.1 * np.stack([np.cos(circle), np.sin(circle), 0 * circle], axis=1), 0.004, closed=True
    )
    alone = Harness([HarnessNode(0, ring.points[0], None, 2)], [HarnessEdge(0, 0, 0, ring)])
    alone.save_mjcf(tmp_path / "ring.xml", spacing=0.03)
    model, _ = load(tmp_path / "ring.xml")
    assert model.neq == 1
    long = make_harness([(0, 1)], radius=1e-4)
    with pytest.raises(ValueError, match="spacing: expected at most 400 segments"):
        long.save_mjcf(tmp_path / "long.xml")
