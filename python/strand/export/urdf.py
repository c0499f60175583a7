"""Ropes as rigid obstacles in a URDF."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from xml.etree import ElementTree

import numpy as np

from strand.export.capsules import Capsules, make_capsules
from strand.export.xml import format_document, format_numbers
from strand.geometry.line import Line


def make_urdf(chains: Sequence[Line], error: float) -> bytes:
    """Return a URDF with a link for each rope, see `strand.Model.save_urdf`."""
    capsules = make_capsules(chains, error)
    robot = ElementTree.Element("robot", name="strand")
    ElementTree.SubElement(robot, "link", name="world")
    for number in range(len(chains)):
        name = f"rope_{number}"
        link = ElementTree.SubElement(robot, "link", name=name)
        for kind in ("visual", "collision"):
            for i, (origin, shape) in enumerate(make_shapes(capsules, number)):
                part = ElementTree.SubElement(link, kind, name=f"{name}_{kind}_{i}")
                ElementTree.SubElement(part, "origin", origin)
                ElementTree.SubElement(ElementTree.SubElement(part, "geometry"), *shape)
        joint = ElementTree.SubElement(robot, "joint", name=f"{name}_joint", type="fixed")
        ElementTree.SubElement(joint, "parent", link="world")
        ElementTree.SubElement(joint, "child", link=name)
    return format_document(robot)


def make_shapes(
    capsules: Capsules, number: int
) -> Iterator[tuple[dict[str, str], tuple[str, dict[str, str]]]]:
    """Yield a rope's cylinders, and the spheres at their ends, as many readers know no capsules."""
    lengths = capsules.lengths
    mine = np.flatnonzero(capsules.chain == number)
    for i in mine:
        x, y, z = (capsules.stop[i] - capsules.start[i]).tolist()
        # the pitch turns z, then the yaw
        turn = np.array([0.0, math.atan2(math.hypot(x, y), z), math.atan2(y, x)])
        middle = 0.5 * (capsules.start[i] + capsules.stop[i])
        size = {"radius": format_numbers(capsules.radius[i]), "length": format_numbers(lengths[i])}
        yield {"xyz": format_numbers(middle), "rpy": format_numbers(turn)}, ("cylinder", size)
    for place in np.vstack([capsules.start[mine[:1]], capsules.stop[mine]]):
        yield (
            {"xyz": format_numbers(place), "rpy": "0 0 0"},
            ("sphere", {"radius": format_numbers(capsules.radius[mine[0]])}),
        )
