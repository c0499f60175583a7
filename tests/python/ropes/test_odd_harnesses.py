"""Odd graphs: queries, crossings, contacts, grasps and files of one edge, rings, short edges and parts."""

from __future__ import annotations

import warnings
from collections import Counter

import mujoco
import numpy as np
import pytest

import strand
from shared.ropes import draw_circle
from strand.ropes.harness import Harness, HarnessEdge, HarnessNode

R = 0.004
GRIPPER = strand.Gripper(opening=0.03, width=0.01, thickness=0.006, depth=0.04)
TABLE = ([0.0, 0.0, 1.0], 0.0)


def draw(start, stop, bow=0.0, nodes=30):
    """Return a straight chain in plan, or one that bows to the side."""
    share = np.linspace(0.0, 1.0, nodes)
    points = np.array(start) + share[:, None] * (np.array(stop) - start)
    points[:, 1] += bow * np.sin(np.pi * share)
    return strand.Chain(points, R)


def join(*items):
    """Return the model of edges: the numbers of two nodes and the chain between them."""
    degrees = Counter(end for start, stop, _ in items for end in (start, stop))
    places = {}
    for start, stop, chain in items:
        places.setdefault(start, chain.points[0])
        places.setdefault(stop, chain.points[0 if chain.closed else -1])
    nodes = tuple(HarnessNode(k, places[k], None, degrees[k]) for k in range(len(places)))
    edges = tuple(HarnessEdge(k, *item) for k, item in enumerate(items))
    return strand.Model([chain for *_, chain in items], np.empty((0, 4, 4)), harness=Harness(nodes, edges))


CIRCLE = draw_circle(0.08, 60, True).points * [1.0, 1.0, 0.0] + [0.0, 0.0, R]
RING = strand.Chain(CIRCLE, R, True)
LOOP = strand.Chain(np.vstack([CIRCLE, CIRCLE[:1]]), R)
AWAY = CIRCLE[0] + [0.15, 0.0, 0.0]
MIDDLE = [0.0, 0.0, R]
EAST = [0.2, 0.0, R]
WEST = [-0.2, 0.0, R]
NORTH = [0.0, 0.2, R]
SOUTH = [0.0, -0.2, R]
ODD = {
    "one edge": join((0, 1, draw(MIDDLE, EAST))),
    "ring": join((0, 0, RING)),
    "loop": join((0, 0, LOOP)),
    "ring with a tail": join((0, 0, RING), (0, 1, draw(CIRCLE[0], AWAY))),
    "loop with a tail": join((0, 0, LOOP), (0, 1, draw(CIRCLE[0], AWAY))),
    "four": join(*((0, k + 1, draw(MIDDLE, end)) for k, end in enumerate((EAST, WEST, NORTH, SOUTH)))),
    "twins": join(
        (0, 1, draw(MIDDLE, EAST, 0.05)), (0, 1, draw(MIDDLE, EAST, -0.05)), (1, 2, draw(EAST, [0.4, 0, R]))
    ),
    "two parts": join((0, 1, draw(MIDDLE, EAST)), (2, 3, draw([0.1, -0.1, 3 * R], [0.1, 0.1, 3 * R]))),
    "short edge": join(
        (0, 1, draw(MIDDLE, EAST)),
        (1, 2, draw(EAST, [0.202, 0, R], nodes=2)),
        (2, 3, draw([0.202, 0, R], [0.3, 0.1, R])),
        (2, 4, draw([0.202, 0, R], [0.3, -0.1, R])),
    ),
    "shortest edge": join((0, 1, draw(MIDDLE, EAST)), (1, 2, draw(EAST, [0.2, 0.0005, R], nodes=2))),
}
odd = pytest.mark.parametrize("model", ODD.values(), ids=ODD)


@pytest.fixture(autouse=True)
def refuse_warnings():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


@odd
def test_queries_find_the_nearest_surface(model):
    points = np.random.default_rng(0).uniform(-0.3, 0.3, (200, 3))
    lines = [chain.at(np.linspace(0.0, chain.length, 2000)) for chain in model.chains]
    away = np.array([np.linalg.norm(points[:, None] - line, axis=2).min(axis=1) for line in lines]) - R
    np.testing.assert_allclose(model.signed_distance(points), away.min(axis=0), atol=1e-5)
    nearest = model.nearest(points)
    np.testing.assert_allclose(nearest.distance, away.min(axis=0) + R, atol=1e-5)
    # rays to places on the axes meet the surface before them
    aims = np.array([line[1000] for line in lines])
    above = aims + np.array([0.0, 0.0, 0.5])
    hits = model.ray_hits(above, np.tile([0.0, 0.0, -1.0], (len(aims), 1)))
    assert (hits.distance <= 0.5 - R + 1e-6).all()
    assert (model.swept_spheres(aims, aims, 0.001).clearance < 0.0).all()


@odd
def test_only_parts_that_cross_do(model):
    found = model.crossings()
    assert len(found) == (1 if model is ODD["two parts"] else 0)
    if found:
        np.testing.assert_allclose(found[0].point_over, [0.1, 0.0, 3 * R], atol=1e-4)
        assert found[0].over[0] == 1
    assert model.contacts(0.004) == ()


def test_contacts_beyond_a_short_edge_stay():
    near = join(
        (0, 1, draw(MIDDLE, EAST)),
        (1, 2, draw(EAST, [0.202, 0, R], nodes=2)),
        (2, 3, draw([0.202, 0, R], [0.4, 0, R])),
        # it starts beside the first edge, but far along the graph
        (3, 4, strand.Chain([[0.4, 0, R], [0.4, 0.009, R], [0.0, 0.009, R]], R)),
    )
    pairs = {(one.first[0], one.second[0]) for one in near.contacts(0.004)}
    assert (0, 3) in pairs


@odd
def test_grasps_keep_off_junctions_and_other_strands(model):
    grasps = model.grasps(GRIPPER, TABLE)
    assert len(grasps) > 20
    junctions = [node.position for node in model.harness.nodes if node.degree > 1]
    if model is ODD["ring"]:
        junctions = []  # a ring has a node, but nothing branches there
    for grasp in grasps:
        assert np.isfinite(grasp.pose).all()
        assert 0.0 < grasp.score <= 1.0
        assert model.chains[grasp.chain].length > GRIPPER.width
        for place in junctions:
            assert np.linalg.norm(grasp.pose[:3, 3] - place) > 0.5 * GRIPPER.width + R
    if model is ODD["two parts"]:
        under = [grasp.s for grasp in grasps if grasp.chain == 0]
        assert min(abs(s - 0.1) for s in under) > R + 0.5 * GRIPPER.width


@odd
def test_files_load_and_simulations_stay_whole(model, tmp_path):
    model.save(tmp_path / "model.json")
    found = strand.load_model(tmp_path / "model.json")
    assert [(edge.start, edge.stop) for edge in found.harness.edges] == [
        (edge.start, edge.stop) for edge in model.harness.edges
    ]
    model.save_usd(tmp_path / "harness.usda")
    assert "nan" not in (tmp_path / "harness.usda").read_text()
    model.harness.save_urdf(tmp_path / "harness.urdf", 1e-3)
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "harness.urdf")).nv == 0
    model.harness.save_mjcf(tmp_path / "harness.xml", spacing=0.02)
    simulated = mujoco.MjModel.from_xml_path(str(tmp_path / "harness.xml"))
    data = mujoco.MjData(simulated)
    for _ in range(round(1.0 / simulated.opt.timestep)):
        mujoco.mj_step(simulated, data)
    assert not any(warning.number for warning in data.warning)
    # free fall, without a floor
    np.testing.assert_allclose(data.subtree_com[0, 2] - R, -0.5 * 9.81, rtol=0.01)
