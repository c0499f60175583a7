"""Joints of harnesses in USD text: where curves share a node, they are attached and do not collide."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import NamedTuple

from strand.geometry.line import Line
from strand.support.checks import Array

_REACH = 4.0  # sums of two radii along both ropes, within which segments near their node do not collide


class Site(NamedTuple):
    """The place where a curve meets others: its number, the vertex, and whether the curve starts there."""

    rope: int
    vertex: int
    starts: bool


def move_ends(places: Array, closed: bool, start: Array, stop: Array) -> Array:
    """Return the vertices of a curve whose ends are exactly at its nodes."""
    moved = places.copy()
    moved[0] = start
    if not closed:
        moved[-1] = stop
    return moved


def list_sites(
    chains: Sequence[Line], ends: Sequence[tuple[int, int]], counts: Sequence[int]
) -> dict[int, list[Site]]:
    """Return the sites at each node; `counts` are the numbers of vertices. A ring has one."""
    sites: dict[int, list[Site]] = {}
    for rope, (start, stop) in enumerate(ends):
        sites.setdefault(start, []).append(Site(rope, 0, True))
        if not chains[rope].closed:
            sites.setdefault(stop, []).append(Site(rope, counts[rope] - 1, False))
    return sites


def describe_joints(chains: Sequence[Line], counts: Sequence[int], node: int, sites: list[Site]) -> list[str]:
    """Return the lines of the attachments at a node, and of filters of collisions near it."""
    lines: list[str] = []
    for number, (one, other) in enumerate(_pair(sites)):
        lines += [
            f'    def PhysicsAttachment "joint_{node}_{number}"',
            "    {",
            *_describe_sources(one, other),
            '        uniform token physics:type0 = "point"',
            '        uniform token physics:type1 = "point"',
            f"        int[] physics:indices0 = [{one.vertex}]",
            f"        int[] physics:indices1 = [{other.vertex}]",
            "    }",
        ]
    for number, (one, other) in enumerate(combinations(sites, 2)):
        reach = _REACH * (chains[one.rope].radius + chains[other.rope].radius)
        lines += [
            f'    def PhysicsElementCollisionFilter "filter_{node}_{number}"',
            "    {",
            *_describe_sources(one, other),
        ]
        for side, site in enumerate((one, other)):
            near = _list_segments(chains[site.rope], counts[site.rope], site, reach)
            lines += [
                f"        uint[] physics:groupElemCounts{side} = [{len(near)}]",
                f"        uint[] physics:groupElemIndices{side} = [{', '.join(map(str, near))}]",
            ]
        lines.append("    }")
    return lines


def _pair(sites: list[Site]) -> Iterator[tuple[Site, Site]]:
    """Yield pairs of sites that join all, of two curves if there are two: few readers join one to itself."""
    first = sites[0]
    for site in sites[1:]:
        others = (other for other in sites if other.rope != site.rope)
        yield (first if first.rope != site.rope else next(others, first)), site


def _describe_sources(one: Site, other: Site) -> Iterator[str]:
    for side, site in enumerate((one, other)):
        yield f"        rel physics:src{side} = </ropes/rope_{site.rope}/curve>"


def _list_segments(chain: Line, count: int, site: Site, reach: float) -> list[int]:
    """Return the numbers of a curve's segments that begin within a reach of a site, in order."""
    segments = count if chain.closed else count - 1
    near = min(max(math.ceil(reach / chain.length * segments), 1), segments)
    if chain.closed:
        return sorted({*range(near), *range(segments - near, segments)})
    return list(range(near) if site.starts else range(segments - near, segments))
