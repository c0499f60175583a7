"""Harnesses in tables, summaries and pictures: edges with their nodes, and junctions that are marked."""

from __future__ import annotations

import dataclasses
import re

import numpy as np

import strand
from shared.harnesses import make_harness
from strand.report.cameras import make_cameras
from strand.report.drawn_chains import find_junctions, find_rope_ends
from strand.report.overlay import draw_overlay
from strand.report.tables import describe_chains
from strand.ropes.harness import Harness
from strand.views.view import View

PAIRS = [(0, 1), (1, 2), (1, 3), (3, 4), (3, 5)]


def make_model(joined):
    made = make_harness(PAIRS, seed=4)
    edges = [dataclasses.replace(edge, wires=1 + edge.id) for edge in made.edges]
    chains = [edge.chain for edge in edges]
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = 2.0
    return strand.Model(chains, pose[None], harness=Harness(made.nodes, edges) if joined else None)


def test_tables_and_summaries_name_nodes_and_wires():
    said, plain = describe_chains(make_model(True)), describe_chains(make_model(False))
    assert [line.split("  ")[-1].strip() for line in said.splitlines()[1:]] == [
        "E0 to J1, 1 wire",
        "J1 to E2, 2 wires",
        "J1 to J3, 3 wires",
        "J3 to E4, 4 wires",
        "J3 to E5, 5 wires",
    ]
    assert plain.count("open") == 5
    assert "Harness(edges: 5, junctions: 2, ends: 4, " in make_model(True).summary()
    assert "Harness" not in make_model(False).summary()


def test_junctions_and_ends_are_those_of_the_graph():
    model = make_model(True)
    np.testing.assert_array_equal(find_junctions(model), [model.harness.nodes[k].position for k in (1, 3)])
    assert len(find_rope_ends(model)) == 4
    assert len(find_junctions(make_model(False))) == 0
    assert len(find_rope_ends(make_model(False))) == 10


def test_an_overlay_marks_each_junction_where_the_camera_sees_it():
    model = make_model(True)
    k = np.array([[200.0, 0, 159.5], [0, 200.0, 119.5], [0, 0, 1]])
    view = View.from_depth(np.full((240, 320), 2.0), k, model.poses[0])
    (camera,) = make_cameras(model, [view])
    svg = draw_overlay(camera, model, 100_000)
    places = re.findall(r'<circle class="junction" cx="([-\d.]+)" cy="([-\d.]+)"', svg)
    np.testing.assert_allclose(np.array(places, float), camera.project(find_junctions(model))[0], atol=0.06)
