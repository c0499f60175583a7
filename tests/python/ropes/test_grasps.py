"""Grasps: poses that touch nothing else, and reasons where there is none."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.spatial import cKDTree

from shared.ropes import R, draw_circle
from strand import Chain, Gripper, Model
from strand.ropes.grasps import REASONS
from strand.synthetic import shape

GRIPPER = Gripper(opening=0.03, width=0.01, thickness=0.005, depth=0.04)
TABLE = ((0, 0, 1), 0.0)
S = np.linspace(-0.1, 0.1, 101)
LINE = Chain(np.stack([S, 0 * S, 0 * S + R], axis=1), R)


def make_model(*chains):
    return Model(chains, np.eye(4)[None])


def fill_boxes(grasp, gripper):
    """Return points on and in both fingers and the palm, world frame."""
    x = np.linspace(-0.5, 0.5, 9) * gripper.width
    z = grasp.tip - np.linspace(0.0, 1.0, 21) * gripper.depth
    y = 0.5 * grasp.width + np.linspace(0.0, 1.0, 5) * gripper.thickness
    fingers = np.stack(np.meshgrid(x, np.concatenate([y, -y]), z), axis=-1).reshape(-1, 3)
    wide = np.linspace(-1.0, 1.0, 15) * (0.5 * gripper.opening + gripper.thickness)
    palm = np.stack(np.meshgrid(x, wide, z - gripper.depth), axis=-1).reshape(-1, 3)
    return [part @ grasp.pose[:3, :3].T + grasp.pose[:3, 3] for part in (fingers, palm)]


@pytest.mark.parametrize("name", ["figure8", "overhand", "paper"])
def test_a_gripper_at_every_grasp_touches_no_strand_and_no_table(name):
    chain = Chain(shape(name), R)
    nodes = cKDTree(chain.at(np.linspace(0, chain.length, 2000)))
    found = make_model(chain).grasps(GRIPPER, TABLE)
    assert len(found) > 20
    assert [grasp.score for grasp in found] == sorted((grasp.score for grasp in found), reverse=True)
    for grasp in found:
        np.testing.assert_allclose(grasp.pose[:3, :3].T @ grasp.pose[:3, :3], np.eye(3), atol=1e-12)
        np.testing.assert_allclose(grasp.pose[:3, 3], chain.at(grasp.s))
        np.testing.assert_allclose(grasp.pose[:3, 0], chain.tangent_at(grasp.s), atol=1e-12)
        assert grasp.approach[2] < -0.6
        assert abs(grasp.jaw_axis @ chain.tangent_at(grasp.s)) < 1e-9
        assert 2 * R < grasp.width <= GRIPPER.opening
        fingers, palm = fill_boxes(grasp, GRIPPER)
        assert fingers[:, 2].min() >= GRIPPER.clearance - 1e-9
        for part in (fingers, palm):
            assert nodes.query(part)[0].min() > R + 0.5 * GRIPPER.clearance


def test_grasps_are_printed_in_a_few_lines():
    model = Model((Chain(shape("overhand"), R),), np.eye(4)[None])
    found = model.grasps(Gripper(0.03, 0.01, 0.005, 0.04), ([0.0, 0.0, 1.0], 0.0))
    assert found
    assert found.refused
    first, *others = str(found).splitlines()
    assert first == f"{len(found)} places to hold, the best: {found[0]}"
    counts = {line.partition(": ")[2]: int(line.split()[0]) for line in others}
    assert counts == {
        REASONS[kind]: sum(one.kind == kind for one in found.refused)
        for kind in {one.kind for one in found.refused}
    }
    assert repr(found) == f"Grasps({len(found)} found, {len(found.refused)} stretches refused)"
    assert str(model.grasps(Gripper(0.001, 0.01, 0.005, 0.04))).startswith("no grasp\n")


def test_the_numbers_of_grasps_are_plain():
    found = make_model(Chain(shape("figure8"), R)).grasps(GRIPPER, TABLE)
    assert "np." not in repr(found)


def test_what_lies_between_the_jaws_is_one_stretch_of_rope():
    chain = Chain(shape("overhand"), R)
    s = np.linspace(0, chain.length, 2000)
    for grasp in make_model(chain).grasps(GRIPPER, TABLE):
        x, y, z = np.abs((chain.at(s) - grasp.pose[:3, 3]) @ grasp.pose[:3, :3]).T
        held = (x < 0.5 * GRIPPER.width) & (y < 0.5 * grasp.width) & (z < R)
        assert np.abs(s[held] - grasp.s).max() < 4 * R


@pytest.mark.parametrize("bend", [3.0, 4.0])
def test_jaws_do_not_close_on_both_legs_of_a_bend(bend):
    leg, turn = np.linspace(0.0, 0.15, 150)[:-1], np.linspace(-0.5 * np.pi, 0.5 * np.pi, 60)
    x = np.concatenate([leg, 0.15 + bend * R * np.cos(turn), leg[::-1]])
    y = bend * R * np.concatenate([0 * leg - 1.0, np.sin(turn), 0 * leg + 1.0])
    chain = Chain(np.stack([x, y, 0 * x + R], axis=1), R)
    gripper = Gripper(opening=0.085, width=0.022, thickness=0.01, depth=0.04)
    found = make_model(chain).grasps(gripper, TABLE)
    assert found.refused
    assert len(found) > 20
    s = np.linspace(0, chain.length, 2000)
    for grasp in found:
        x, y, z = ((chain.at(s) - grasp.pose[:3, 3]) @ grasp.pose[:3, :3]).T
        held = (np.abs(x) < 0.5 * gripper.width) & (np.abs(y) < 0.5 * grasp.width) & (z < grasp.tip + R)
        # it passes the jaws once, and does not turn back between them
        assert np.diff(np.flatnonzero(held)).max() == 1
        assert np.diff(x[held]).min() > -1e-6


def test_a_rope_alone_on_a_table_is_held_from_above_everywhere():
    found = make_model(LINE).grasps(GRIPPER, TABLE)
    assert {refused.kind for refused in found.refused} == {"end"}
    for grasp in found:
        np.testing.assert_allclose(grasp.approach, [0, 0, -1], atol=1e-12)
        assert grasp.clearance == np.inf
        assert grasp.table_clearance == pytest.approx(GRIPPER.clearance)
        assert grasp.on_top
        assert sum(grasp.free) == pytest.approx(LINE.length)
    assert np.isnan(make_model(LINE).grasps(GRIPPER)[0].table_clearance)
    again = make_model(LINE).grasps(GRIPPER, ((0, 0, 2.0), 0.0))
    assert [str(grasp) for grasp in again] == [str(grasp) for grasp in found]


def test_the_upper_strand_is_held_and_the_lower_one_is_not_where_they_cross():
    over = Chain(np.stack([0 * S, S, 0 * S + 3 * R], axis=1), R)
    found = make_model(LINE, over).grasps(GRIPPER, TABLE)
    at = [(refused.chain, refused.stretch, refused.kind) for refused in found.refused]
    assert {chain for chain, (start, stop), kind in at if start < 0.1 < stop and kind == "between"} == {0}
    assert {grasp.on_top for grasp in found if grasp.chain == 0} == {False}
    assert {grasp.on_top for grasp in found if grasp.chain == 1} == {True}
    assert found[0].chain == 1
    low = next(grasp for grasp in found if grasp.chain == 0 and grasp.s < 0.05)
    assert low.free == pytest.approx((low.s, 0.1 - low.s))


def test_without_room_there_is_no_grasp_but_reasons():
    thick = dataclasses.replace(GRIPPER, opening=2 * R)
    aside = np.array([0, 2 * R + 0.0015, 0])
    beside = Chain(LINE.points + aside, R)
    more = Chain(LINE.points - aside, R)
    hidden = Chain(LINE.points, R, points_seen=np.zeros(101, dtype=int))
    unsure = Chain(LINE.points, R, covariance=np.tile(1e-4 * np.eye(3), (101, 1, 1)))
    upright = Chain(LINE.points[:, [2, 1, 0]], R)
    for chains, gripper, kind in (
        ([LINE], thick, "thick"),
        ([LINE, beside, more], GRIPPER, "fingers"),
        ([hidden], GRIPPER, "unseen"),
        ([unsure], GRIPPER, "unsure"),
        ([upright], GRIPPER, "steep"),
    ):
        found = make_model(*chains).grasps(gripper)
        of_first = [refused for refused in found.refused if refused.chain == 0]
        assert not [grasp for grasp in found if grasp.chain == 0]
        assert {refused.kind for refused in of_first} == {kind}
        assert REASONS[kind] in str(of_first[0])
    sunk = make_model(Chain(LINE.points - [0, 0, 0.01], R)).grasps(GRIPPER, TABLE)
    assert (len(sunk), {refused.kind for refused in sunk.refused}) == (0, {"table"})
    assert len(make_model().grasps(GRIPPER)) == 0


@pytest.mark.parametrize("sd", [0.0, 0.002])
@pytest.mark.parametrize("width", [0.006, 0.01, 0.03])
def test_fingers_hold_rope_along_all_of_their_width(width, sd):
    along = np.zeros((101, 3, 3))
    along[[0, -1], 0, 0] = sd**2
    gripper = dataclasses.replace(GRIPPER, width=width)
    found = make_model(Chain(LINE.points, R, covariance=along)).grasps(gripper, TABLE)
    least = 0.5 * width + 2.0 * sd
    nearest = min(min(grasp.s, LINE.length - grasp.s) for grasp in found)
    # places are half a width, or a radius, apart
    assert least <= nearest <= least + max(0.5 * width, R)
    assert [(refused.kind, refused.stretch[0] < least) for refused in found.refused] == [
        ("end", True),
        ("end", False),
    ]
    # a finger as wide as the rope is long finds no place
    none = make_model(LINE).grasps(dataclasses.replace(GRIPPER, width=1.01 * LINE.length), TABLE)
    assert (len(none), [refused.kind for refused in none.refused]) == (0, ["end"])


def test_rings_are_held_over_their_seam():
    found = make_model(draw_circle(0.05, 300, True)).grasps(GRIPPER)
    assert not found.refused
    # the other side of the ring
    assert min(grasp.clearance for grasp in found) > 0.05


def test_the_palm_keeps_off_the_table_too():
    gripper = Gripper(opening=0.03, width=0.01, thickness=0.003, depth=0.04)
    # from the side the palm reaches 18 mm down: at 12 mm it has to come from higher up
    for height, from_above in ((0.012, True), (0.03, False)):
        line = Chain(LINE.points + np.array([0, 0, height - R]), R)
        found = make_model(line).grasps(gripper, TABLE, (0, 1, 0))
        assert len(found) > 10
        for grasp in found:
            lowest = min(part[:, 2].min() for part in fill_boxes(grasp, gripper))
            assert lowest >= gripper.clearance - 1e-9
            assert grasp.table_clearance == pytest.approx(lowest)
            assert (grasp.approach[2] < -0.1) == from_above


@pytest.mark.parametrize("turn", [0.15, 3.0])
def test_where_a_ring_starts_has_no_say_in_the_score(turn):
    angle = np.linspace(0.0, 2.0 * np.pi, 300, endpoint=False) + turn
    ring = Chain(np.stack([0.1 * np.cos(angle), 0.1 * np.sin(angle), 0 * angle + 3 * R], axis=1), R, True)
    found = make_model(ring, Chain([[0.0, 0, R], [0.3, 0, R]], R)).grasps(GRIPPER, TABLE)
    above = [grasp for grasp in found if grasp.chain == 0]
    assert len(above) > 80
    for grasp in above:
        near = min(grasp.free)
        bound = (3.0 + near / (near + GRIPPER.opening)) / 4.0
        assert grasp.score <= bound + 1e-12
    # the ring is the same on both sides of the line that it crosses
    sides = [[grasp.score for grasp in above if side * grasp.pose[1, 3] > 0] for side in (1, -1)]
    assert max(sides[0]) == pytest.approx(max(sides[1]), abs=0.01)


@pytest.mark.parametrize("name", [field.name for field in dataclasses.fields(Gripper)])
def test_grippers_in_millimetres_are_refused(name):
    given = dataclasses.asdict(GRIPPER)
    with pytest.raises(ValueError, match=f"^{name}: expected at most 1 m, got 40; is it in metres"):
        Gripper(**given | {name: 40})
    assert getattr(Gripper(**given | {name: 1.0}), name) == 1.0


def test_grippers_and_tables_that_make_no_sense_are_refused():
    with pytest.raises(ValueError, match="opening: expected"):
        dataclasses.replace(GRIPPER, opening=0.0)
    with pytest.raises(ValueError, match="clearance: expected"):
        dataclasses.replace(GRIPPER, clearance=np.nan)
    with pytest.raises(TypeError, match="gripper: expected a Gripper"):
        make_model(LINE).grasps(0.03)
    for table, message in (
        (((0, 0, 0), 0.0), "not zero"),
        (((0, 0, 1), np.nan), "finite"),
        ((1,), "a normal"),
    ):
        with pytest.raises(ValueError, match=f"table.*{message}"):
            make_model(LINE).grasps(GRIPPER, table)
