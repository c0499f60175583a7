"""The default direction of a model and its chains, and the default table."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import strand
from shared.ropes import R
from strand import Chain, Model
from strand.geometry.plane import Plane
from strand.ropes.seen_side import find_seen_side

S = np.linspace(-0.1, 0.1, 51)[:, None]
UNDER = Chain(S * [1, 0, 0], R)
OVER = Chain(S * [0, 1, 0] + [0, 0, 2 * R], R)
GRIPPER = strand.Gripper(opening=0.03, width=0.01, thickness=0.006, depth=0.04)
DOWN = (0.0, 0.0, -2.0)


def make_model(**more):
    return Model((UNDER, OVER), np.empty((0, 4, 4)), **more)


def test_the_default_direction_is_up():
    usual, turned = make_model(), make_model(up=DOWN)
    assert usual.crossings()[0].over[0] == 1
    assert turned.crossings()[0].over[0] == 0
    assert turned.crossings((0, 0, 1))[0].over[0] == 1
    np.testing.assert_array_equal(turned.up, [0, 0, -1])
    assert {-grasp.approach[2] > 0 for grasp in turned.grasps(GRIPPER)} == {False}
    assert {-grasp.approach[2] > 0 for grasp in usual.grasps(GRIPPER)} == {True}
    assert {pull.chain for pull in turned.pull_plan().pulls if pull.lift} == {0}
    assert turned.segment_between_crossings(0, 0.02) == usual.segment_between_crossings(0, 0.02)
    oblique = make_model(up=(0.0, 0.6, 0.8))
    assert oblique.crossings()[0].over[1] == oblique.crossings((0.0, 0.6, 0.8))[0].over[1] != 0.1


def test_chains_have_the_direction_of_their_model():
    loop = Chain(strand.synthetic.shape("loop"), R)
    model = Model((loop,), np.empty((0, 4, 4)), up=DOWN)
    (chain,) = model.chains
    assert Model((loop,), np.empty((0, 4, 4))).chains[0] is loop
    (below,), (above,) = chain.crossings(), loop.crossings()
    assert (below.over, below.under) == (pytest.approx(above.under), pytest.approx(above.over))
    assert chain.reversed().up.tolist() == chain.up.tolist() == [0.0, 0.0, -1.0]
    assert chain.diagram().gauss == strand.knot_diagram(loop.points, direction=DOWN).gauss
    assert loop.diagram().gauss == strand.knot_diagram(loop.points).gauss
    covariance = np.tile(1e-8 * np.eye(3), (len(loop.points), 1, 1))
    unsure = replace(loop, covariance=covariance)
    assert unsure.knot().probability == pytest.approx(replace(unsure, up=DOWN).knot().probability)


def test_grasps_keep_clear_of_the_models_table():
    table = ((0.0, 0.0, 2.0), -2 * R)
    model = make_model(table=table)
    assert isinstance(model.table, Plane)
    assert model.table.offset == -R
    given = make_model().grasps(GRIPPER, table)
    assert [grasp.table_clearance for grasp in model.grasps(GRIPPER)] == [
        grasp.table_clearance for grasp in given
    ]
    assert np.isnan([grasp.table_clearance for grasp in model.grasps(GRIPPER, False)]).all()


def test_files_keep_up_and_table_and_older_files_have_z(tmp_path):
    up = np.array([0.1, -0.7, -0.69])
    model = make_model(up=up, table=(up, 0.03))
    path = tmp_path / "model.json"
    model.save(path)
    loaded = strand.load_model(path)
    np.testing.assert_array_equal(loaded.up, model.up)
    np.testing.assert_array_equal(loaded.table.normal, model.table.normal)
    assert loaded.table.offset == model.table.offset
    np.testing.assert_array_equal(loaded.chains[0].up, model.up)
    content = json.loads(path.read_text())
    assert content["crossings"][0]["over"][0] == model.crossings()[0].over[0] == 0
    assert "up" not in content["chains"][0]
    del content["up"], content["table"]
    path.write_text(json.dumps(content))
    old = strand.load_model(path)
    np.testing.assert_array_equal(old.up, [0, 0, 1])
    assert old.table is None
    for key, value in (("up", [0, 0, 0]), ("up", None), ("table", {"normal": [0, 0, 1]}), ("table", [1])):
        path.write_text(json.dumps(content | {key: value}))
        with pytest.raises(strand.FileFormatError, match=key):
            strand.load_model(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"up": (0, 0, 0)}, "up"),
        ({"up": (0, 1)}, "up"),
        ({"table": (0, 0, 1)}, "table: expected a normal and an offset, got 3"),
        ({"table": ((0, 0, 1), np.inf)}, "table"),
    ],
)
def test_wrong_directions_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        make_model(**change)


def test_the_side_of_the_cameras_is_z_where_they_are_all_around():
    points = np.zeros((1, 3))
    assert find_seen_side(points, np.array([[0.0, 3, 0], [0, 0, 5]])) == pytest.approx(
        [0, 0.5**0.5, 0.5**0.5]
    )
    np.testing.assert_array_equal(find_seen_side(points, np.array([[0.0, 3, 0], [0, -1, 0]])), [0, 0, 1])
    np.testing.assert_array_equal(find_seen_side(points, np.empty((0, 3))), [0, 0, 1])


def test_nobody_changes_the_usual_up_of_all_ropes():
    chain = strand.Chain(np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.2, 0.0, 0.0]]), radius=0.004)
    with pytest.raises(ValueError, match="WRITEABLE"):
        chain.up.setflags(write=True)
    assert np.array_equal(chain.up, [0.0, 0.0, 1.0])
