"""Boxes that are turned, as extraction ranges."""

from __future__ import annotations

import itertools

import numpy as np
import open3d
import pytest

import strand
from strand.views.box import make_box

MOTION = strand.pose_from_angles(0.3, -0.7, 1.1, [0.4, -0.2, 0.9])
LOW, HIGH = np.array([-0.1, -0.3, 0.0]), np.array([0.2, 0.1, 0.25])
TURNED = strand.Box(LOW, HIGH, MOTION)


def test_it_holds_what_open3d_says():
    points = np.random.default_rng(0).uniform(-1.0, 1.5, (20_000, 3))
    centre = MOTION[:3, :3] @ (0.5 * (LOW + HIGH)) + MOTION[:3, 3]
    theirs = open3d.geometry.OrientedBoundingBox(centre, MOTION[:3, :3], HIGH - LOW)
    inside = theirs.get_point_indices_within_bounding_box(open3d.utility.Vector3dVector(points))
    assert len(inside) > 30
    np.testing.assert_array_equal(np.flatnonzero(TURNED.holds(points)), np.sort(inside))
    view = strand.View(points @ MOTION[:3, :3] - MOTION[:3, 3] @ MOTION[:3, :3], MOTION)
    np.testing.assert_allclose(view.crop(TURNED).world_points, points[np.sort(inside)], atol=1e-12)


@pytest.mark.parametrize("box", [strand.Box(LOW, HIGH), TURNED], ids=["straight", "turned"])
def test_places_outside_move_to_its_nearest_place(box):
    points = np.random.default_rng(4).normal(size=(300, 3)) + MOTION[:3, 3]
    moved = box.move_inside(points)
    assert box.holds(moved, 1e-12).all()
    inside = box.holds(points)
    np.testing.assert_allclose(moved[inside], points[inside], atol=1e-12)
    # no other place of the box is nearer
    others = box.move_inside(np.random.default_rng(5).normal(size=(2000, 3)) + MOTION[:3, 3])
    distance = np.linalg.norm(points - moved, axis=1)
    assert (np.linalg.norm(points[:, None] - others, axis=2).min(axis=1) >= distance - 1e-12).all()


def test_its_hull_is_that_of_its_corners():
    corners = np.array(list(itertools.product(*zip(LOW, HIGH, strict=True))))
    world = corners @ MOTION[:3, :3].T + MOTION[:3, 3]
    np.testing.assert_allclose(TURNED.find_hull(), [world.min(axis=0), world.max(axis=0)])
    assert TURNED.grown(0.01).holds(world).all()
    assert not TURNED.grown(-0.01).holds(world).any()
    quarter = strand.Box([0, 0, -np.inf], [1, 2, np.inf], strand.pose_from_angles(0, 0, np.pi / 2, [0, 0, 5]))
    np.testing.assert_allclose(quarter.find_hull(), [[-2, 0, -np.inf], [0, 1, np.inf]], atol=1e-12)


def test_a_moved_scene_in_a_moved_box_gives_the_moved_rope():
    scene = strand.synthetic.scene("paper", seed=1)
    # the table comes close to one face: a range along the axes around the moved one would hold some of it
    plain = strand.reconstruct(scene.views, scene.radius, scene.bounds, ropes=1)
    moved = [view.moved(MOTION) for view in scene.views]
    turned = strand.reconstruct(moved, scene.radius, strand.Box(*scene.bounds, MOTION), ropes=1)
    (rope,), (other,) = plain.chains, turned.chains
    there = rope.points @ MOTION[:3, :3].T + MOTION[:3, 3]
    far = np.linalg.norm(other.points[:, None] - there, axis=2).min(axis=1).max()
    assert far < 0.1 * scene.radius + np.linalg.norm(np.diff(there, axis=0), axis=1).max()
    assert other.length == pytest.approx(rope.length, rel=2e-3)
    assert turned.confidence == pytest.approx(plain.confidence, abs=0.05)


def test_an_end_that_leaves_a_turned_box_is_named():
    scene = strand.synthetic.scene("arc", seed=0)
    low, high = scene.bounds
    middle = 0.5 * (low[0] + high[0])
    moved = [view.moved(MOTION) for view in scene.views]
    half = strand.Box(low, [middle, *high[1:]], MOTION)
    model = strand.reconstruct(moved, scene.radius, half)
    cut = [warning for warning in model.warnings if warning.kind == "cut end"]
    assert cut
    for warning in cut:
        assert half.express(warning.place)[0] == pytest.approx(middle, abs=3.0 * scene.radius)


def test_that_nothing_lies_in_it_says_where_it_is():
    scene = strand.synthetic.scene("arc", seed=0)
    away = strand.Box([0, 0, 0], [1, 1, 1], strand.pose_from_angles(0, 0, 0.5, [30.0, 0, 0]))
    with pytest.raises(strand.NotEnoughDataError, match=r"own frame, whose origin is at \(30, 0, 0\) m"):
        strand.reconstruct(scene.views, scene.radius, away)


def test_a_scene_file_may_turn_it(tmp_path):
    points = np.random.default_rng(1).uniform(-1, 1, (500, 3))
    np.savetxt(tmp_path / "a.xyz", points)
    (tmp_path / "scene.toml").write_text(
        "[extract]\nlow = [-1, -0.5, 0]\nhigh = [1, 0.5, 1]\nangles_deg = [0, 0, 30]\norigin = [0.1, 0, 0]\n"
        '[[view]]\nfile = "a.xyz"\nangles_deg = [0, 0, 0]\norigin = [0, 0, 0]\n'
    )
    bounds = strand.load_scene(tmp_path).bounds
    np.testing.assert_array_equal(
        bounds.pose, strand.pose_from_angles(0, 0, np.radians(30.0), [0.1, 0.0, 0.0])
    )
    assert make_box(bounds) is bounds
    half = (tmp_path / "scene.toml").read_text().replace("origin = [0.1, 0, 0]", "")
    (tmp_path / "scene.toml").write_text(half)
    with pytest.raises(strand.FileFormatError, match=r"extract: expected either pose"):
        strand.load_scene(tmp_path)


@pytest.mark.parametrize(
    ("arguments", "error", "said"),
    [
        (([0, 0, 0], [1, 0, 1]), ValueError, "expected low < high"),
        (([0, 0], [1, 1, 1]), ValueError, "low: expected shape"),
        (([0, 0, 0], [1, 1, np.nan]), ValueError, "expected low < high"),
        ((["a"] * 3, [1, 1, 1]), TypeError, "low: expected"),
        (([0, 0, 0], [1, 1, 1], 2.0 * np.eye(4)), ValueError, "pose: expected"),
    ],
)
def test_what_is_no_box_is_refused(arguments, error, said):
    with pytest.raises(error, match=said):
        strand.Box(*arguments)


def test_it_cannot_be_changed():
    assert not any(array.flags.writeable for array in (TURNED.low, TURNED.high, TURNED.pose))
