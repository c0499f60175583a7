"""Ropes as MuJoCo models: cables for version 3, flexible rods for version 4."""

from __future__ import annotations

import math
from collections.abc import Sequence
from xml.etree import ElementTree

import numpy as np

from strand.export.segments import MIN_SPACING, cut_segments
from strand.export.xml import format_document, format_numbers
from strand.geometry.line import Line
from strand.support.checks import Array, check_integer, check_positive

_DAMPING = 0.01  # seconds, times the stiffness; below the time step cables of version 3 are unstable
_CABLE = "mujoco.elasticity.cable"


def make_mjcf(
    chains: Sequence[Line],
    version: int,
    spacing: float | None,
    density: float,
    young: float,
    gravity: Array | None,
) -> bytes:
    """Return a MuJoCo model, see `strand.Model.save_mjcf`."""
    version = check_integer("version", version, 3, 4)
    density, young = check_positive("density", density), check_positive("young", young)
    model = ElementTree.Element("mujoco", model="strand")
    # rods of version 4 need the discrete one; in version 3 the other damps joints implicitly
    integrator = "implicitfast" if version == 3 else "discrete"
    option = ElementTree.SubElement(model, "option", integrator=integrator)
    if gravity is not None:
        option.set("gravity", format_numbers(gravity))
    if version == 3:
        extension = ElementTree.SubElement(model, "extension")
        ElementTree.SubElement(extension, "plugin", plugin=_CABLE)
    world = ElementTree.SubElement(model, "worldbody")
    for number, chain in enumerate(chains):
        # MuJoCo needs three bodies for a cable
        places = cut_segments(chain, spacing, MIN_SPACING, fewest=3 if version == 3 else 2)
        mass = density * math.pi * chain.radius**2 * chain.length
        name = f"rope_{number}"
        if version == 3:
            _add_cable(model, world, name, chain, places, mass, young)
        else:
            _add_rod(world, name, chain, places, mass, young)
    return format_document(model)


def _add_rod(
    world: ElementTree.Element, name: str, chain: Line, places: Array, mass: float, young: float
) -> None:
    """Add a one-dimensional flex whose edges keep their lengths."""
    here = np.arange(len(places))
    pairs = np.stack([here, np.roll(here, -1)], axis=1)[: None if chain.closed else -1]
    rod = ElementTree.SubElement(
        world,
        "flexcomp",
        name=name,
        type="direct",
        dim="1",
        radius=format_numbers(chain.radius),
        mass=format_numbers(mass),
        point=format_numbers(places),
        element=" ".join(map(str, pairs.ravel().tolist())),
    )
    ElementTree.SubElement(rod, "edge", equality="true")
    ElementTree.SubElement(
        rod,
        "elasticity",
        young=format_numbers(young),
        shear=format_numbers(young / 3.0),
        damping=format_numbers(_DAMPING),
    )


def _add_cable(
    model: ElementTree.Element,
    world: ElementTree.Element,
    name: str,
    chain: Line,
    places: Array,
    mass: float,
    young: float,
) -> None:
    """Add a composite of capsules with ball joints, its ends held together if it is a ring."""
    path = np.vstack([places, places[:1]]) if chain.closed else places
    count = len(path) - 1
    cable = ElementTree.SubElement(
        world, "composite", type="cable", prefix=f"{name}_", initial="free", vertex=format_numbers(path)
    )
    plugin = ElementTree.SubElement(cable, "plugin", plugin=_CABLE)
    ElementTree.SubElement(plugin, "config", key="twist", value=format_numbers(young / 3.0))
    ElementTree.SubElement(plugin, "config", key="bend", value=format_numbers(young))
    stiffness = young * math.pi / 4.0 * chain.radius**4 * count / chain.length
    ElementTree.SubElement(cable, "joint", kind="main", damping=format_numbers(_DAMPING * stiffness))
    # by a density, the round ends of all capsules would count too
    ElementTree.SubElement(
        cable, "geom", type="capsule", size=format_numbers(chain.radius), mass=format_numbers(mass / count)
    )
    bodies = [f"{name}_B_{i}" for i in range(count)]
    bodies[0], bodies[-1] = f"{name}_B_first", f"{name}_B_last"
    # MuJoCo excludes contacts of neighbours; those after next touch in tight bends
    excluded = {(i, i + 2) for i in range(count - 2)}
    if chain.closed:
        excluded |= {(0, count - 1), (0, count - 2), (1, count - 1)}
        equality = ElementTree.SubElement(model, "equality")
        ElementTree.SubElement(equality, "connect", body1=bodies[0], body2=bodies[-1], anchor="0 0 0")
    contact = ElementTree.SubElement(model, "contact")
    for i, k in sorted(pair for pair in excluded if pair[1] - pair[0] > 1):
        ElementTree.SubElement(contact, "exclude", body1=bodies[i], body2=bodies[k])
