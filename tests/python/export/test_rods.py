"""Arrays for PyElastica, text for DisMech, a world for cuRobo."""

from __future__ import annotations

import json

import numpy as np
import pytest

import strand
from shared.ropes import R, draw_circle
from strand import Chain, Model

ROPE = Chain(strand.synthetic.shape("paper"), R)
RING = draw_circle(0.05, 60, True)
MODEL = Model((ROPE, RING), np.eye(4)[None])


@pytest.mark.parametrize("chain", [ROPE, RING], ids=["rope", "ring"])
@pytest.mark.parametrize("spacing", [None, 0.005])
def test_directors_are_right_handed_frames_that_hardly_turn(chain, spacing):
    rod = strand.export.elastica(chain, spacing)
    count = rod["n_elements"]
    assert rod["position"].shape == (3, count + (not chain.closed))
    assert rod["directors"].shape == (3, 3, count)
    path = rod["position"].T
    if chain.closed:
        path = np.vstack([path, path[:1]])
    np.testing.assert_allclose(path, chain.at(np.linspace(0, chain.length, count + 1)), atol=1e-12)
    steps = np.diff(path, axis=0)
    tangents = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    frames = rod["directors"].transpose(2, 0, 1)  # rows: normal, binormal, tangent
    np.testing.assert_allclose(frames[:, 2], tangents, atol=1e-12)
    np.testing.assert_allclose(
        frames @ frames.transpose(0, 2, 1), np.tile(np.eye(3), (count, 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(frames), 1.0)
    # twist from element to element, after the shortest turn of the tangent
    turned = np.einsum("nij,nkj->nik", frames[1:], frames[:-1])
    twist = np.arctan2(turned[:, 1, 0] - turned[:, 0, 1], turned[:, 0, 0] + turned[:, 1, 1])
    assert np.abs(twist).max() < 0.06
    assert rod["base_length"] == pytest.approx(np.linalg.norm(steps, axis=1).sum())
    assert rod["base_radius"] == chain.radius
    assert ("ring_center_position" in rod) is chain.closed
    assert ("start" in rod) is not chain.closed


def test_dismech_counts_nodes_from_one_through_all_ropes():
    lines = strand.export.dismech(MODEL.chains, 0.01).splitlines()
    at = lines.index("*Edges")
    assert lines[0] == "*Nodes"
    nodes = np.array([line.split(",") for line in lines[1:at]], dtype=float)
    edges = np.array([line.split(",") for line in lines[at + 1 :]], dtype=int)
    first = int(ROPE.length / 0.01) + 1
    np.testing.assert_allclose(nodes[:first], ROPE.at(np.linspace(0, ROPE.length, first)), atol=1e-11)
    assert edges.min() == 1
    assert edges.max() == len(nodes)
    # a rope has one edge fewer than nodes; a ring as many, and goes on to its first node
    assert edges[: first - 1].tolist() == [[i, i + 1] for i in range(1, first)]
    assert edges[-1].tolist() == [len(nodes), first + 1]
    assert len(edges) == len(nodes) - 1
    assert strand.export.dismech(()) == "*Nodes\n*Edges\n"


def test_a_world_of_curobo_has_the_spheres():
    spheres = MODEL.spheres(1e-3)
    world = strand.export.curobo(spheres)
    assert json.loads(json.dumps(world)) == world
    assert list(world) == ["sphere"]
    rows = world["sphere"]
    assert len(rows) == len(spheres)
    np.testing.assert_array_equal([one["pose"][:3] for one in rows.values()], spheres.center)
    assert {tuple(one["pose"][3:]) for one in rows.values()} == {(1.0, 0.0, 0.0, 0.0)}
    np.testing.assert_array_equal([one["radius"] for one in rows.values()], spheres.radius)
    assert all(name.startswith(f"rope_{k}_") for name, k in zip(rows, spheres.chain, strict=True))


def test_wrong_arguments_are_named():
    with pytest.raises(TypeError, match="chain: expected a Chain or Line, got Model"):
        strand.export.elastica(MODEL)
    with pytest.raises(TypeError, match="spheres: expected Spheres, got Capsules"):
        strand.export.curobo(MODEL.capsules(1e-3))
    with pytest.raises(TypeError, match="chains"):
        strand.export.dismech(ROPE)
    for wrong, said in [(0.0, "positive"), (float("nan"), "positive"), (1e-9, "at most 100000 segments")]:
        with pytest.raises(ValueError, match=f"spacing: expected .*{said}"):
            strand.export.elastica(ROPE, wrong)
