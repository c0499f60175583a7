"""Ropes as models of MuJoCo: cables up to version 3, flexible rods from version 4 on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from xml.etree import ElementTree

import numpy as np

from strand.export.segments import cut_segments
from strand.export.xml import document, numbers
from strand.geometry.line import Line
from strand.support.checks import Array, check_integer, check_positive

# radii: segments two apart touch below two, and chords of bends are shorter than their arcs
_LEAST_SPACING = 2.5
# seconds of damping in proportion to stiffness; below the time step cables of version 3 are unstable
_DAMPING = 0.01
_CABLE = "mujoco.elasticity.cable"


def make_mjcf(
    chains: Sequence[Line], version: int, spacing: float | None, density: float, young: float
) -> bytes:
    """Return a model of MuJoCo, see `strand.Model.save_mjcf`."""
    version = check_integer("version", version, 3, 4)
    density, young = check_positive("density", density), check_positive("young", young)
    model = ElementTree.Element("mujoco", model="strand")
    # version 4 bends rods by this integrator; in version 3 it damps joints implicitly
    integrator = "implicitfast" if version == 3 else "discrete"
    ElementTree.SubElement(model, "option", integrator=integrator)
    if version == 3:
        extension = ElementTree.SubElement(model, "extension")
        ElementTree.SubElement(extension, "plugin", plugin=_CABLE)
    world = ElementTree.SubElement(model, "worldbody")
    for number, chain in enumerate(chains):
        # MuJoCo makes no cable of two bodies
        places = cut_segments(chain, spacing, _LEAST_SPACING, fewest=3 if version == 3 else 2)
        mass = density * math.pi * chain.radius**2 * chain.length
        name = f"rope_{number}"
        if version == 3:
            _add_cable(model, world, name, chain, places, mass, young)
        else:
            _add_rod(world, name, chain, places, mass, young)
    return document(model)


def _add_rod(
    world: ElementTree.Element, name: str, chain: Line, places: Array, mass: float, young: float
) -> None:
    """Add a flex of one dimension, whose edges keep their lengths."""
    here = np.arange(len(places))
    pairs = np.stack([here, np.roll(here, -1)], axis=1)[: None if chain.closed else -1]
    rod = ElementTree.SubElement(
        world,
        "flexcomp",
        name=name,
        type="direct",
        dim="1",
        radius=numbers(chain.radius),
        mass=numbers(mass),
        point=numbers(places),
        element=" ".join(map(str, pairs.ravel().tolist())),
    )
    ElementTree.SubElement(rod, "edge", equality="true")
    ElementTree.SubElement(
        rod, "elasticity", young=numbers(young), shear=numbers(young / 3.0), damping=numbers(_DAMPING)
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
    """Add a composite of capsules with ball joints; a ring's ends are held together."""
    path = np.vstack([places, places[:1]]) if chain.closed else places
    count = len(path) - 1
    cable = ElementTree.SubElement(
        world, "composite", type="cable", prefix=f"{name}_", initial="free", vertex=numbers(path)
    )
    plugin = ElementTree.SubElement(cable, "plugin", plugin=_CABLE)
    ElementTree.SubElement(plugin, "config", key="twist", value=numbers(young / 3.0))
    ElementTree.SubElement(plugin, "config", key="bend", value=numbers(young))
    stiffness = young * math.pi / 4.0 * chain.radius**4 * count / chain.length
    ElementTree.SubElement(cable, "joint", kind="main", damping=numbers(_DAMPING * stiffness))
    # the mass is the rope's: by a density the round ends of all capsules would count too
    ElementTree.SubElement(
        cable, "geom", type="capsule", size=numbers(chain.radius), mass=numbers(mass / count)
    )
    bodies = [f"{name}_B_{i}" for i in range(count)]
    bodies[0], bodies[-1] = f"{name}_B_first", f"{name}_B_last"
    # MuJoCo leaves out neighbours; their neighbours touch where the rope bends closely
    apart = {(i, i + 2) for i in range(count - 2)}
    if chain.closed:
        apart |= {(0, count - 1), (0, count - 2), (1, count - 1)}
        equality = ElementTree.SubElement(model, "equality")
        ElementTree.SubElement(equality, "connect", body1=bodies[0], body2=bodies[-1], anchor="0 0 0")
    contact = ElementTree.SubElement(model, "contact")
    for i, k in sorted(pair for pair in apart if pair[1] - pair[0] > 1):
        ElementTree.SubElement(contact, "exclude", body1=bodies[i], body2=bodies[k])
