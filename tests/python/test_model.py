"""Chains, models and their files."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import strand
from strand import Chain, Model


def circle(radius: float, nodes: int, closed: bool) -> Chain:
    angle = np.linspace(0, 2 * np.pi, nodes, endpoint=not closed)
    if not closed:
        angle *= 0.75
    return Chain(
        np.stack([radius * np.cos(angle), radius * np.sin(angle), 0.1 * angle * 0], axis=1), 0.004, closed
    )


@pytest.mark.parametrize("closed", [False, True])
def test_length_tangents_and_curvature_of_a_circle(closed):
    chain = circle(0.05, 400, closed)
    around = 2 * np.pi * 0.05 * (1 if closed else 0.75)
    assert chain.length == pytest.approx(around, rel=1e-4)
    assert chain.arc_length[0] == 0
    assert len(chain.arc_length) == len(chain.tangents) == len(chain.curvature) == 400
    np.testing.assert_allclose(chain.curvature, 20.0, rtol=1e-3)
    outwards = chain.points / np.linalg.norm(chain.points, axis=1, keepdims=True)
    tangents = np.cross([0, 0, 1], outwards)
    inner = slice(None) if closed else slice(1, -1)
    np.testing.assert_allclose(chain.tangents[inner], tangents[inner], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(chain.tangents, axis=1), 1.0, atol=1e-12)


def test_at_and_nearest_go_together():
    chain = circle(0.05, 300, False)
    rng = np.random.default_rng(0)
    for s in rng.uniform(0, chain.length, 20):
        found, distance = chain.nearest(chain.at(s))
        assert found == pytest.approx(s, abs=1e-9)
        assert distance == pytest.approx(0, abs=1e-9)
    for p in rng.uniform(-0.1, 0.1, (20, 3)):
        s, distance = chain.nearest(p)
        assert np.linalg.norm(chain.at(s) - p) == pytest.approx(distance, abs=1e-12)
        dense = chain.at(np.linspace(0, chain.length, 5000))
        assert distance <= np.linalg.norm(dense - p, axis=1).min() + 1e-12
    np.testing.assert_array_equal(chain.at(chain.arc_length), chain.points)


def test_a_closed_chain_goes_round_and_an_open_one_is_held_at_its_ends():
    ring, arc = circle(0.05, 100, True), circle(0.05, 100, False)
    np.testing.assert_allclose(ring.at(ring.length + 0.01), ring.at(0.01), atol=1e-12)
    np.testing.assert_allclose(ring.at(ring.length), ring.points[0], atol=1e-12)
    np.testing.assert_array_equal(arc.at(arc.length + 1.0), arc.points[-1])
    np.testing.assert_array_equal(arc.at(-1.0), arc.points[0])
    middle_of_last_piece = (ring.points[-1] + ring.points[0]) / 2
    assert ring.nearest(middle_of_last_piece)[1] == pytest.approx(0, abs=1e-12)


@given(
    st.lists(
        st.tuples(*[st.floats(-10, 10, allow_subnormal=False)] * 3), min_size=2, max_size=20, unique=True
    ),
    st.booleans(),
)
def test_any_chain_survives_its_file_bit_for_bit(tmp_path_factory, nodes, closed):
    points = np.array(nodes)
    # nodes that only rounding tells apart count as equal along a chain
    assume((np.linalg.norm(np.diff(np.vstack([points, points[:1]]), axis=0), axis=1) >= 1e-12).all())
    path = tmp_path_factory.mktemp("model") / "model.json"
    model = Model((Chain(points, 0.0042, closed),), np.eye(4)[None], {"trace": 0.25}, ("a warning",))
    model.save(path)
    loaded = strand.load(path)
    np.testing.assert_array_equal(loaded.chains[0].points, points)
    assert loaded.chains[0].radius == 0.0042
    assert loaded.chains[0].closed is closed
    np.testing.assert_array_equal(loaded.poses, model.poses)
    assert loaded.timings == model.timings
    assert loaded.warnings == model.warnings


def test_a_file_that_cannot_be_written_leaves_the_old_one(tmp_path):
    path = tmp_path / "model.json"
    model = Model((circle(0.05, 10, True),), np.eye(4)[None])
    model.save(path)
    before = path.read_bytes()
    with pytest.raises(ValueError, match="JSON"):
        Model(model.chains, np.full((1, 4, 4), np.nan)).save(path)
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["model.json"]


@pytest.mark.parametrize(
    "content",
    [
        "",
        "{",
        "[]",
        '{"format": "other"}',
        '{"format": "strand model", "version": 2}',
        '{"format": "strand model", "version": 1, "chains": [{}], "poses": [], "timings": {}, '
        '"warnings": []}',
    ],
)
def test_a_file_that_is_no_model_is_refused_by_name(tmp_path, content):
    path = tmp_path / "broken.json"
    path.write_text(content)
    with pytest.raises(strand.FileFormatError, match=r"broken\.json"):
        strand.load(path)


def test_a_truncated_model_is_refused(tmp_path):
    path = tmp_path / "model.json"
    Model((circle(0.05, 50, True),), np.eye(4)[None]).save(path)
    text = path.read_text()
    json.loads(text)
    path.write_text(text[: len(text) // 2])
    with pytest.raises(strand.FileFormatError, match=r"model\.json"):
        strand.load(path)
    with pytest.raises(FileNotFoundError):
        strand.load(tmp_path / "missing.json")


@pytest.mark.parametrize(
    ("points", "radius", "message"),
    [
        (np.zeros((1, 3)), 0.01, "at least two nodes"),
        (np.zeros((2, 3)), 0.01, "no two equal nodes"),
        (np.array([[0.0, 0, 0], [np.nan, 0, 0]]), 0.01, "points: expected finite"),
        (np.array([[0.0, 0, 0], [1.0, 0, 0]]), 0.0, "radius"),
        (np.array([[0.0, 0, 0], [1.0, 0, 0]]), np.nan, "radius"),
    ],
)
def test_a_chain_that_makes_no_sense_is_refused(points, radius, message):
    with pytest.raises(ValueError, match=message):
        Chain(points, radius)


def test_two_nodes_make_a_straight_chain():
    chain = Chain(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]]), 0.01)
    np.testing.assert_array_equal(chain.tangents, [[0, 0, 1], [0, 0, 1]])
    np.testing.assert_array_equal(chain.curvature, [0, 0])
    assert chain.nearest([1.0, 0.0, 0.5]) == (0.5, 1.0)
