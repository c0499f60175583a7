"""Triangle meshes of tubes."""

from __future__ import annotations

from collections import Counter

import numpy as np
import open3d as o3d
import pytest
import trimesh

import strand
from shared.ropes import draw_circle
from strand import Chain

RADIUS = 0.004


def draw_helix(count=200, closed=False):
    """Return nodes of a curve with torsion; a closed one runs around a torus."""
    t = np.linspace(0, 2 * np.pi, count, endpoint=not closed)
    if closed:
        wide = 0.06 + 0.015 * np.cos(5 * t)
        return Chain(
            np.stack([wide * np.cos(t), wide * np.sin(t), 0.015 * np.sin(5 * t)], axis=1), RADIUS, True
        )
    return Chain(np.stack([0.03 * np.cos(2 * t), 0.03 * np.sin(2 * t), 0.01 * t], axis=1), RADIUS)


def draw_straight():
    return Chain(np.linspace([0.1, 0.2, 0.3], [0.1, 0.6, 0.0], 30), RADIUS)


CHAINS = {
    "straight": draw_straight(),
    "two nodes": Chain(np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]), RADIUS),
    "helix": draw_helix(),
    "ring": draw_circle(0.05, 60, True),
    "knotted ring": draw_helix(closed=True),
}


def measure_volume(vertices, triangles):
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return float((np.cross(a, b) * c).sum() / 6)


@pytest.mark.parametrize("name", CHAINS)
@pytest.mark.parametrize("sides", [3, 16])
def test_every_edge_is_in_two_triangles_that_go_opposite_ways(name, sides):
    vertices, triangles = CHAINS[name].tube(sides)
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    directed = Counter(map(tuple, edges.tolist()))
    assert set(directed.values()) == {1}
    assert all((b, a) in directed for a, b in directed)
    assert len(np.unique(triangles)) == len(vertices) == triangles.max() + 1


@pytest.mark.parametrize("name", CHAINS)
@pytest.mark.parametrize("sides", [3, 16, 64])
def test_the_volume_is_that_of_the_rope(name, sides):
    """Pappus: the volume is the area of the cross-section times the length of the centreline."""
    chain = CHAINS[name]
    area = sides / 2 * np.sin(2 * np.pi / sides) * RADIUS**2
    exact = name in ("straight", "two nodes")
    assert measure_volume(*chain.tube(sides)) == pytest.approx(
        area * chain.length, rel=1e-9 if exact else 0.01
    )


@pytest.mark.parametrize("name", CHAINS)
def test_vertices_are_a_radius_from_the_centreline_and_hardly_turn(name):
    chain = CHAINS[name]
    vertices, _ = chain.tube(16)
    rings = vertices[: 16 * len(chain.points)].reshape(-1, 16, 3)
    aside = rings - chain.points[:, None]
    np.testing.assert_allclose(np.linalg.norm(aside, axis=2), RADIUS, rtol=1e-9)
    np.testing.assert_allclose(np.einsum("nkd,nd->nk", aside, chain.tangents), 0, atol=1e-12)
    # the same vertex of neighbouring rings: apart by the step and the bend, not by a turn about the tangent
    ahead = np.roll(aside[:, 0], -1, axis=0)
    across = np.cross(chain.tangents, aside[:, 0])
    turned = np.abs(((ahead - aside[:, 0]) * across).sum(axis=1)) / RADIUS**2
    if not chain.closed:  # there the last ring is no neighbour of the first
        turned = turned[:-1]
    assert turned.max() < (0.06 if chain.closed else 0.005)


def test_right_angles():
    nodes = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 1], [0, 1, 1.0]]) * 0.1
    vertices, triangles = Chain(nodes, RADIUS).tube(8)
    assert np.isfinite(vertices).all()
    assert measure_volume(vertices, triangles) > 0


@pytest.mark.parametrize(
    ("sides", "said"),
    [
        (2, "at least 3"),
        (0, "at least 3"),
        (-1, "at least 3"),
        (1001, "at most 1000"),
        (2**63, "at most 1000"),
    ],
)
def test_tubes_have_three_sides_at_least_and_a_thousand_at_most(sides, said):
    with pytest.raises(ValueError, match=f"sides: expected {said}"):
        draw_straight().tube(sides)
    with pytest.raises(TypeError, match="sides"):
        draw_straight().tube(3.5)


def test_a_ring_of_two_nodes_has_no_tube():
    with pytest.raises(ValueError, match="at least three nodes of a closed chain, got 2"):
        Chain(np.array([[0.0, 0, 0], [0.1, 0, 0]]), RADIUS, True).tube()


def test_open3d_reads_what_is_saved(tmp_path):
    model = strand.Model(tuple(CHAINS.values()), np.eye(4)[None])
    model.save_tube(tmp_path / "a.ply", sides=24)
    mesh = o3d.io.read_triangle_mesh(str(tmp_path / "a.ply"))
    assert mesh.is_edge_manifold(allow_boundary_edges=False)
    assert mesh.is_vertex_manifold()
    assert mesh.is_orientable()
    each = [chain.tube(24) for chain in model.chains]
    np.testing.assert_array_equal(np.asarray(mesh.vertices), np.concatenate([one[0] for one in each]))
    assert len(mesh.triangles) == sum(len(one[1]) for one in each)
    strand.Model((CHAINS["helix"],), np.eye(4)[None]).save_tube(tmp_path / "b.ply", sides=24)
    mesh = o3d.io.read_triangle_mesh(str(tmp_path / "b.ply"))
    assert mesh.is_watertight()
    assert mesh.get_volume() == pytest.approx(np.pi * RADIUS**2 * CHAINS["helix"].length, rel=0.02)


@pytest.mark.parametrize("name", CHAINS)
def test_trimesh_calls_what_is_saved_a_volume(tmp_path, name):
    strand.Model((CHAINS[name],), np.eye(4)[None]).save_tube(tmp_path / "a.ply")
    mesh = trimesh.load_mesh(tmp_path / "a.ply")
    assert mesh.is_watertight
    assert mesh.is_volume  # wound outwards, too
    area = 8 * np.sin(np.pi / 8) * RADIUS**2
    assert mesh.volume == pytest.approx(area * CHAINS[name].length, rel=0.01)


def test_a_model_without_ropes_has_an_empty_mesh(tmp_path):
    strand.Model((), np.eye(4)[None]).save_tube(tmp_path / "a.ply")
    assert b"element face 0\n" in (tmp_path / "a.ply").read_bytes()
    with pytest.raises(ValueError, match=r"a\.obj: expected a name that ends with"):
        strand.Model((), np.eye(4)[None]).save_tube(tmp_path / "a.obj")
    with pytest.raises(ValueError, match=r"a\.csv: expected a name that ends with \.ply"):
        strand.Model((), np.eye(4)[None]).save_tube(tmp_path / "a.csv")
    assert [path.name for path in tmp_path.iterdir()] == ["a.ply"]
