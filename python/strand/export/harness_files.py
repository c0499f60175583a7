"""Harnesses as graphs and trees: GraphML, a table of edges, URDF and MuJoCo models."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from strand.export.capsules import make_capsules
from strand.export.segments import MIN_SPACING, cut_segments
from strand.export.urdf import make_shapes
from strand.export.xml import format_document, format_numbers
from strand.geometry.line import Line
from strand.support.checks import Array, check_positive

EDGE_COLUMNS = ("edge", "start", "stop", "length", "radius", "radius_sd", "wires")

_DAMPING = 0.01  # seconds, times the stiffness of a joint
_ARMATURE = 1.0 / 3.0  # of a segment's mass and squared length: inertia of joints, without which twist jumps
# welds hold to a few millimetres when a harness falls on a table; the usual ones give way by centimetres
_WELD = {"solref": "0.004 1", "solimp": "0.99 0.999 0.001"}
_MAX_DEPTH = 400  # bodies in each other: MuJoCo and XML readers nest calls


class Branch(NamedTuple):
    """An edge of a tree: its number, the nodes where it starts and stops, and its line from start to stop."""

    number: int
    start: int
    stop: int
    line: Line


def format_graphml(nodes: Sequence[dict[str, Any]], edges: Sequence[dict[str, Any]]) -> bytes:
    """Return a GraphML file of nodes, which have an `id`, and edges with `id`, `start` and `stop`.

    Other values become attributes; None is left out.
    """
    root = ElementTree.Element("graphml", xmlns="http://graphml.graphdrawing.org/xmlns")
    kinds = {int: "long", float: "double", str: "string"}
    keys: dict[tuple[str, str], str] = {}
    for place, rows in (("node", nodes), ("edge", edges)):
        for row in rows:
            for name, value in row.items():
                if name in ("id", "start", "stop") or value is None or (place, name) in keys:
                    continue
                keys[place, name] = f"{place}_{name}"
                key = {"id": f"{place}_{name}", "for": place, "attr.name": name}
                ElementTree.SubElement(root, "key", key | {"attr.type": kinds[type(value)]})
    graph = ElementTree.SubElement(root, "graph", id="harness", edgedefault="undirected")
    for place, rows in (("node", nodes), ("edge", edges)):
        for row in rows:
            ends = {"source": f"n{row['start']}", "target": f"n{row['stop']}"} if place == "edge" else {}
            part = ElementTree.SubElement(graph, place, {"id": f"{place[0]}{row['id']}", **ends})
            for name, value in row.items():
                if (place, name) in keys and value is not None:
                    data = ElementTree.SubElement(part, "data", key=keys[place, name])
                    data.text = value if isinstance(value, str) else repr(value)
    return format_document(root)


def format_edges(rows: Sequence[Sequence[Any]]) -> bytes:
    """Return a table with a row for each edge, in `EDGE_COLUMNS`; unknown values are empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(EDGE_COLUMNS)
    writer.writerows(rows)
    return text.getvalue().encode()


def make_harness_urdf(places: Array, trees: Sequence[tuple[int, Sequence[Branch]]], error: float) -> bytes:
    """Return a URDF with a link for each node and edge, see `strand.ropes.harness.Harness.save_urdf`.

    `trees` has the root of each part and all its edges, each after one that leads to its start.
    """
    robot = ElementTree.Element("robot", name="harness")
    ElementTree.SubElement(robot, "link", name="world")

    def add(name: str, parent: str, offset: Array) -> ElementTree.Element:
        link = ElementTree.SubElement(robot, "link", name=name)
        joint = ElementTree.SubElement(robot, "joint", name=f"{name}_joint", type="fixed")
        ElementTree.SubElement(joint, "parent", link=parent)
        ElementTree.SubElement(joint, "child", link=name)
        ElementTree.SubElement(joint, "origin", xyz=format_numbers(offset), rpy="0 0 0")
        return link

    for root, branches in trees:
        add(f"node_{root}", "world", places[root])
        reached = {root}
        for branch in branches:
            name = f"edge_{branch.number}"
            link = add(name, f"node_{branch.start}", np.zeros(3))
            moved = replace(
                branch.line, points=branch.line.points - places[branch.start], curve=None, covariance=None
            )
            for kind in ("visual", "collision"):
                for i, (origin, shape) in enumerate(make_shapes(make_capsules([moved], error), 0)):
                    part = ElementTree.SubElement(link, kind, name=f"{name}_{kind}_{i}")
                    ElementTree.SubElement(part, "origin", origin)
                    ElementTree.SubElement(ElementTree.SubElement(part, "geometry"), *shape)
            if branch.stop not in reached:
                reached.add(branch.stop)
                add(f"node_{branch.stop}", name, places[branch.stop] - places[branch.start])
    return format_document(robot)


def make_harness_mjcf(
    places: Array,
    trees: Sequence[tuple[int, Sequence[Branch]]],
    spacing: float | None,
    density: float,
    young: float,
) -> bytes:
    """Return a MuJoCo model of trees of capsules, see `strand.ropes.harness.Harness.save_mjcf`."""
    density, young = check_positive("density", density), check_positive("young", young)
    model = ElementTree.Element("mujoco", model="harness")
    ElementTree.SubElement(model, "option", integrator="implicit")
    world = ElementTree.SubElement(model, "worldbody")
    closing: list[tuple[str, str, str, Array]] = []
    for root, branches in trees:
        body = ElementTree.SubElement(world, "body", name=f"node_{root}", pos=format_numbers(places[root]))
        ElementTree.SubElement(body, "freejoint")
        # a body without mass of its own may not move
        size = format_numbers(min(branch.line.radius for branch in branches))
        ball = {"type": "sphere", "size": size, "density": format_numbers(density)}
        ElementTree.SubElement(body, "geom", ball | {"contype": "1", "conaffinity": "0"})
        held = {root: (body, places[root], 0)}
        for branch in branches:
            body, origin, depth = held[branch.start]
            cut = cut_segments(branch.line, spacing, MIN_SPACING)
            path = np.vstack([cut, cut[:1]]) if branch.line.closed else cut
            if depth + len(path) > _MAX_DEPTH:
                raise ValueError(
                    f"spacing: expected at most {_MAX_DEPTH} segments from the root to an end, "
                    f"got more than {depth + len(path) - 1} along edge {branch.number}"
                )
            path[0] = places[branch.start]
            body = _add_segments(body, origin, branch, path, density, young)
            if branch.stop in held:
                # it would close a cycle: its last body is welded to the node's
                node, origin, _ = held[branch.stop]
                last, other = body.get("name", ""), node.get("name", "")
                closing.append((f"edge_{branch.number}_weld", last, other, places[branch.stop] - origin))
            else:
                held[branch.stop] = body, path[-2], depth + len(path) - 1
    if closing:
        equality = ElementTree.SubElement(model, "equality")
        for name, body_name, node_name, anchor in closing:
            bodies = {"body1": body_name, "body2": node_name, "anchor": format_numbers(anchor)}
            ElementTree.SubElement(equality, "weld", {"name": name} | bodies | _WELD)
    return format_document(model)


def _add_segments(
    parent: ElementTree.Element, origin: Array, branch: Branch, path: Array, density: float, young: float
) -> ElementTree.Element:
    """Add the bodies of an edge, each in the one before, and return the last. The first is welded on."""
    radius = branch.line.radius
    lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
    stiffness = young * math.pi / 4.0 * radius**4 / float(lengths.mean())
    for i, length in enumerate(lengths.tolist()):
        parent = ElementTree.SubElement(
            parent, "body", name=f"edge_{branch.number}_{i}", pos=format_numbers(path[i] - origin)
        )
        origin = path[i]
        if i:
            ElementTree.SubElement(
                parent,
                "joint",
                type="ball",
                stiffness=format_numbers(stiffness),
                damping=format_numbers(_DAMPING * stiffness),
                armature=format_numbers(_ARMATURE * density * math.pi * radius**2 * length**3),
            )
        ElementTree.SubElement(
            parent,
            "geom",
            type="capsule",
            fromto=format_numbers([np.zeros(3), path[i + 1] - path[i]]),
            size=format_numbers(radius),
            # by a density, the round ends of all capsules would count too
            mass=format_numbers(density * math.pi * radius**2 * length),
            contype="1",
            conaffinity="0",
        )
    return parent
