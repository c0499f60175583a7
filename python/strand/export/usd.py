"""Ropes as USD text: curves that simulators of the draft "Deformable Body Physics" bend."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from strand.export.segments import MIN_SPACING, cut_segments, find_normals
from strand.export.usd_joints import describe_joints, list_sites, move_ends
from strand.geometry.line import Line
from strand.support.checks import (
    Array,
    check_bool,
    check_integer,
    check_number,
    check_positive,
    check_sequence,
)

_LARGEST = 1e30  # of densities and moduli: the numbers of USD end at 3e38
_FRICTION = 1.0  # MuJoCo's default too; without one USD's ropes slide
_SHEAR = 0.9  # share of a round section that carries shear

_HEAD = """\
#usda 1.0
(
    defaultPrim = "ropes"
    doc = "strand, world frame"
    kilogramsPerUnit = 1
    metersPerUnit = 1
    upAxis = "Z"
)

def Xform "ropes"
{"""
_BODY = """\
    def Xform "rope_{}" (
        prepend apiSchemas = ["PhysicsDeformableBodyAPI"]
    )
    {{"""


def make_usd(
    chains: Sequence[Line],
    spacing: float | None,
    density: float,
    young: float,
    stretch: float,
    pinned: Sequence[tuple[int, float]],
    tube: bool,
    gravity: Array | None,
    nodes: Sequence[Array] = (),
    ends: Sequence[tuple[int, int]] = (),
) -> bytes:
    """Return a USD stage as text, see `strand.Model.save_usd`.

    `nodes` has the places of a harness's nodes, and `ends` the two nodes of each of its chains.
    """
    density = check_positive("density", density, _LARGEST)
    young, stretch = check_positive("young", young, _LARGEST), check_positive("stretch", stretch, _LARGEST)
    pins = _check_pins(pinned, chains)
    tube = check_bool("tube", tube)
    lines = [_HEAD]
    if gravity is not None:
        lines += _describe_scene(gravity)
    counts = []
    for number, chain in enumerate(chains):
        places = cut_segments(chain, spacing, MIN_SPACING)
        if ends:
            start, stop = ends[number]
            places = move_ends(places, chain.closed, nodes[start], nodes[stop])
        counts.append(len(places))
        path = f"/ropes/rope_{number}"
        lines.append(_BODY.format(number))
        lines += _describe_curve(path, chain, places, tube)
        lines += _describe_material(chain.radius, density, young, stretch)
        held = [s for one, s in pins if one == number]
        if held:
            lines += _describe_pins(path, chain, places, held)
        if tube:
            lines += _describe_tube(*chain.tube())
        lines.append("    }")
    for node, sites in list_sites(chains, ends, counts).items():
        lines += describe_joints(chains, counts, node, sites)
    return "\n".join([*lines, "}\n"]).encode()


def _check_pins(pinned: Sequence[tuple[int, float]], chains: Sequence[Line]) -> list[tuple[int, float]]:
    """Return pairs of a chain's number and an arc length on it."""
    content = "pairs of a chain's number and an arc length"
    pins = []
    for pin in check_sequence("pinned", pinned, content):
        pair = check_sequence("pinned", pin, content)
        if len(pair) != 2:
            raise ValueError(f"pinned: expected {content}, got {len(pair)} values")
        if not chains:
            raise ValueError("pinned: expected none, as the model has no chains")
        number = check_integer("pinned", pair[0], 0, len(chains) - 1)
        place, chain = check_number("pinned", pair[1]), chains[number]
        if not -chain.radius <= place <= chain.length + chain.radius:
            most = f"{chain.length:.6g} m"
            raise ValueError(
                f"pinned: expected an arc length of chain {number}, from 0 to {most}, got {place:g}"
            )
        pins.append((number, place))
    return pins


def _describe_scene(gravity: Array) -> Iterator[str]:
    """Yield the lines of a scene with gravity, m/s^2."""
    strength = float(np.linalg.norm(gravity))
    down = gravity / strength if strength > 0.0 else np.array([0.0, 0.0, -1.0])
    yield '    def PhysicsScene "scene"'
    yield "    {"
    yield f"        vector3f physics:gravityDirection = {_format_vectors(down[None])}"
    yield f"        float physics:gravityMagnitude = {strength:.9g}"
    yield "    }"


def _describe_curve(path: str, chain: Line, places: Array, hidden: bool) -> Iterator[str]:
    """Yield the lines of a rope's centreline, which simulators move."""
    _, normals = find_normals(places, chain.closed)
    # a normal belongs to the segment after its place: the end of an open rope has none
    normals = np.concatenate([normals, normals[-1:]])[: len(places)]
    diameter = f"[{2.0 * chain.radius:.9g}]"
    apis = ("PhysicsCurvesDeformableSimAPI", "PhysicsCollisionAPI", "MaterialBindingAPI")
    yield '        def BasisCurves "curve" ('
    yield f"            prepend apiSchemas = [{', '.join(map(_quote, apis))}]"
    yield "        )"
    yield "        {"
    yield '            uniform token type = "linear"'
    yield f'            uniform token wrap = "{"periodic" if chain.closed else "nonperiodic"}"'
    if hidden:
        yield '            uniform token purpose = "guide"'
    yield f"            int[] curveVertexCounts = [{len(places)}]"
    yield f"            float3[] extent = [{_format_vectors(_find_extent(places, chain.radius))}]"
    yield f"            point3f[] points = [{_format_vectors(places)}]"
    yield f"            normal3f[] normals = [{_format_vectors(normals)}] ("
    yield '                interpolation = "vertex"'
    yield "            )"
    yield f"            float[] widths = {diameter} ("
    yield '                interpolation = "constant"'
    yield "            )"
    yield f"            float[] physics:thicknesses = {diameter}"
    yield '            uniform token physics:thicknesses:elementType = "constant"'
    yield f"            rel material:binding:physics = <{path}/material>"
    yield "        }"


def _describe_material(radius: float, density: float, young: float, stretch: float) -> Iterator[str]:
    """Yield the lines of a rope's material: stiffnesses of a solid round rod that keeps its volume."""
    area = math.pi * radius**2
    bend = young * 0.25 * area * radius**2
    values = {
        "density": density,
        "dynamicFriction": _FRICTION,
        "staticFriction": _FRICTION,
        "curvesStretchStiffness": stretch * area,
        "curvesShearStiffness": _SHEAR * stretch / 3.0 * area,
        "curvesBendStiffness": bend,
        "curvesTwistStiffness": 2.0 / 3.0 * bend,
    }
    yield '        def Material "material" ('
    yield '            prepend apiSchemas = ["PhysicsMaterialAPI", "PhysicsCurvesDeformableMaterialAPI"]'
    yield "        )"
    yield "        {"
    yield from (f"            float physics:{name} = {value:.9g}" for name, value in values.items())
    yield "        }"


def _describe_pins(path: str, chain: Line, places: Array, held: list[float]) -> Iterator[str]:
    """Yield the lines of points that stay where they are, as masses of zero are not valid in the draft."""
    at = chain.at(held)
    numbers = sorted({int(np.linalg.norm(places - place, axis=1).argmin()) for place in at})
    yield '        def PhysicsAttachment "pins"'
    yield "        {"
    yield f"            rel physics:src0 = <{path}/curve>"
    yield "            rel physics:src1 = </ropes>"
    yield '            uniform token physics:type0 = "point"'
    yield '            uniform token physics:type1 = "xform"'
    yield f"            int[] physics:indices0 = [{', '.join(map(str, numbers))}]"
    yield f"            vector3f[] physics:coords1 = [{_format_vectors(places[numbers])}]"
    yield "        }"


def _describe_tube(vertices: Array, triangles: NDArray[np.int32]) -> Iterator[str]:
    """Yield the lines of a rope's surface, for pictures."""
    yield '        def Mesh "tube"'
    yield "        {"
    yield '            uniform token subdivisionScheme = "none"'
    yield f"            float3[] extent = [{_format_vectors(_find_extent(vertices, 0.0))}]"
    yield f"            point3f[] points = [{_format_vectors(vertices)}]"
    yield f"            int[] faceVertexCounts = [{', '.join(['3'] * len(triangles))}]"
    yield f"            int[] faceVertexIndices = [{', '.join(map(str, triangles.ravel().tolist()))}]"
    yield "        }"


def _find_extent(places: Array, margin: float) -> Array:
    """Return the lowest and the highest corner of a box around places."""
    return np.stack([places.min(axis=0) - margin, places.max(axis=0) + margin])


def _format_vectors(vectors: Array) -> str:
    """Return vectors (N, 3) to the digits of single precision, which is USD's."""
    return ", ".join(f"({x:.9g}, {y:.9g}, {z:.9g})" for x, y, z in vectors.tolist())


def _quote(text: str) -> str:
    return f'"{text}"'
