"""The poses of the next view."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

import strand
from shared.ropes import R
from strand import synthetic
from strand.ropes.doubt import Doubt, Join

LINE = np.stack([np.linspace(-0.08, 0.08, 161), np.zeros(161), np.full(161, R)], axis=1)
SCENE = synthetic.scene(chains=[LINE], views=3, camera=synthetic.Camera(size=(160, 120)), seed=5)
CHAIN = strand.Chain(LINE, R)
OVER = strand.Chain(LINE + np.array([0.0, 0.0, 8.0 * R]), R)
ABOVE = synthetic.camera_pose(0.0, 0.4, np.radians(90.0))
ASLANT = synthetic.camera_pose(0.3, 0.4, np.radians(50.0))
MOTION = np.eye(4)
MOTION[:3, :3] = strand.rotation_xyz(0.4, -0.9, 2.0)
MOTION[:3, 3] = 0.3, -0.2, 0.7
TILTED = np.eye(4)
TILTED[:3, :3] = strand.rotation_xyz(0.2, 0.3, 0.8)


def doubt_at(place, kind="join", amount=1.0):
    return Doubt(kind, amount, "whether", "because", place)


def hide_under_another():
    """Return a model of a rope right under another one, seen from above, with a doubt about the lower one."""
    return strand.Model((CHAIN, OVER), [ABOVE], doubts=(doubt_at(LINE[80]), doubt_at(None, "noise", 0.1)))


def sees(model, camera, place, radius=R):
    """Return whether the first tube on the way from a camera to a place is the one around the place."""
    way = place - camera
    return model.ray_hits(camera[None], way[None]).distance[0] > np.linalg.norm(way) - 2.0 * radius


def move(model):
    """Return a model with everything in another frame."""
    turn, shift = MOTION[:3, :3], MOTION[:3, 3]
    return replace(
        model,
        chains=tuple(strand.Chain(chain.points @ turn.T + shift, chain.radius) for chain in model.chains),
        poses=MOTION @ model.poses,
        up=turn @ model.up,
        doubts=tuple(
            replace(doubt, place=None if doubt.place is None else turn @ doubt.place + shift)
            for doubt in model.doubts
        ),
    )


def test_a_view_looks_at_the_ropes_from_an_upright_camera():
    model = strand.Model((CHAIN,), [ASLANT], doubts=(doubt_at(LINE[40]),))
    views = model.next_view()
    assert len(views) == 3
    for view in views:
        np.testing.assert_allclose(view.pose[:3, :3] @ view.pose[:3, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(view.pose) == pytest.approx(1.0)
        ahead = view.look_at - view.position
        np.testing.assert_allclose(view.pose[:3, 2], ahead / np.linalg.norm(ahead), atol=1e-12)
        assert view.up[2] > 0.0
        assert view.pose[2, 0] == pytest.approx(0.0, abs=1e-12)
        assert not view.pose.flags.writeable
    np.testing.assert_allclose(views[0].look_at, LINE.mean(axis=0), atol=1e-6)
    assert "settles 1 doubt" in str(views[0])
    assert repr(views[0]) == f"NextView({views[0]})"


def test_the_best_view_comes_first_and_others_look_from_elsewhere():
    views = hide_under_another().next_view(count=5)
    gains = [view.gain for view in views]
    assert gains == sorted(gains, reverse=True)
    assert 0.0 < gains[-1] <= gains[0] <= 1.0
    away = np.array([(view.position - view.look_at) for view in views])
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    apart = np.degrees(np.arccos(np.clip(away @ away.T, -1.0, 1.0)))
    assert (apart[~np.eye(len(views), dtype=bool)] > 24.9).all()
    assert hide_under_another().next_view(count=1)[0].gain == gains[0]


def test_the_next_view_sees_a_place_that_another_rope_hid():
    model = hide_under_another()
    place = LINE[80]
    assert not sees(model, ABOVE[:3, 3], place)
    views = model.next_view()
    assert model.doubts[0] in views[0].settles
    for view in views:
        assert (model.doubts[0] in view.settles) <= sees(model, view.position, place)
    turn = (views[0].position - place) @ [0.0, 0.0, 1.0] / np.linalg.norm(views[0].position - place)
    assert np.degrees(np.arccos(turn)) > 20.0


def test_the_next_view_sees_under_a_roof():
    roof = [strand.Chain(LINE[50:111] + np.array([0.0, 1.9 * R * k, 8.0 * R]), R) for k in range(-5, 6)]
    model = strand.Model((CHAIN, *roof), [ABOVE], doubts=(doubt_at(LINE[80]),))
    for view in model.next_view():
        assert view.settles == model.doubts
        assert sees(model, view.position, LINE[80])
        assert view.position[2] < 0.75 * np.linalg.norm(view.position)


def test_the_next_view_goes_along_the_rope_past_a_bar():
    ends = [LINE[:75], LINE[86:]]
    chains = tuple(strand.Chain(end, R) for end in ends)
    doubts = tuple(doubt_at(place, "hidden end", 1.4) for place in (ends[0][-1], ends[1][0]))
    best = strand.Model(chains, [ABOVE], doubts=doubts).next_view(count=1)[0]
    away = best.position - best.look_at
    assert abs(away[0]) / np.linalg.norm(away) > 0.45


def test_the_next_view_shows_a_rope_from_its_side():
    model = strand.Model((CHAIN,), [ABOVE], doubts=(doubt_at(None, "noise"),))
    along, across = (
        model.next_view(lambda places, k=k: np.abs(places[:, k]) > 5.0 * np.abs(places[:, 1 - k]), count=1)[0]
        for k in (0, 1)
    )
    assert across.gain > along.gain + 0.1
    assert model.next_view(count=1)[0].gain >= across.gain


def test_the_next_view_is_not_from_an_old_side():
    best = strand.Model((CHAIN,), [ASLANT], doubts=(doubt_at(None, "noise"),)).next_view(count=1)[0]
    old, new = ASLANT[:3, 3], best.position
    turn = old @ new / np.linalg.norm(old) / np.linalg.norm(new)
    assert np.degrees(np.arccos(turn)) > 30.0


@pytest.mark.parametrize(
    "workspace",
    [
        strand.Box([0.1, -0.3, 0.1], [0.3, -0.1, 0.5]),
        strand.Box([-0.1, -0.1, 0.2], [0.1, 0.1, 0.4], TILTED),
        strand.Box([-np.inf, -np.inf, 0.25], [-0.05, np.inf, np.inf]),
    ],
    ids=["along the axes", "turned", "open"],
)
def test_the_camera_stays_in_a_box(workspace):
    views = hide_under_another().next_view(workspace)
    assert views
    assert all(workspace.holds(view.position, 1e-12) for view in views)
    found = hide_under_another().next_view(lambda places: workspace.holds(places))
    assert all(workspace.holds(view.position) for view in found)


def test_a_function_may_say_where_the_camera_stays():
    asked = []

    def allow(places):
        asked.append(places.shape)
        return places[:, 1] > 0.15

    views = hide_under_another().next_view(allow)
    assert views
    assert all(view.position[1] > 0.15 for view in views)
    assert len(asked) == 1
    assert asked[0][1] == 3


def test_no_view_is_proposed_where_the_camera_may_not_be():
    model = hide_under_another()
    assert model.next_view(lambda places: np.zeros(len(places), dtype=bool)) == ()
    assert model.next_view(strand.Box([-1.0, -1.0, -0.5], [1.0, 1.0, -0.1])) == (), "under the table"
    near = strand.Box([-0.1, -0.1, 0.0], [0.1, 0.1, 0.3])
    assert model.next_view(near)
    assert model.next_view(near, min_distance=0.5) == ()


@pytest.mark.parametrize("least", [0.1, 0.39, 1.0, 50.0])
def test_the_camera_keeps_its_distance(least):
    model = hide_under_another()
    views = model.next_view(min_distance=least)
    assert len(views) == 3
    distances = model.signed_distance(np.array([view.position for view in views]))
    assert (distances >= least).all()
    assert distances.max() < 1.1 * max(least, 0.4)


def test_a_camera_too_far_away_settles_nothing():
    model = hide_under_another()
    near, far = model.next_view()[0], model.next_view(min_distance=50.0)[0]
    assert near.gain > 0.5
    assert near.settles
    assert far.gain < 0.02
    assert far.settles == ()
    beside = strand.Box([5.0, 5.0, 5.0], [6.0, 6.0, 6.0])
    assert all(view.gain < 0.1 and not view.settles for view in model.next_view(beside))


def test_the_ropes_fit_in_the_image_as_before():
    """A rope seen nearly end on from the side would be cut off from above at the same distance."""
    low = synthetic.camera_pose(0.0, 0.25, np.radians(20.0))
    model = strand.Model((CHAIN,), [low])

    def measure(position):
        ahead = LINE.mean(axis=0) - position
        ahead /= np.linalg.norm(ahead)
        depth = (LINE - position) @ ahead
        return (np.linalg.norm(LINE - position - depth[:, None] * ahead, axis=1) / depth).max()

    assert all(measure(view.position) <= 1.001 * measure(low[:3, 3]) for view in model.next_view())


def test_the_next_view_moves_with_the_scene():
    model = hide_under_another()
    for workspace in (None, strand.Box([-0.3, -0.3, 0.1], [0.3, 0.3, 0.3])):
        moved = None if workspace is None else replace(workspace, pose=MOTION)
        for here, there in zip(model.next_view(workspace), move(model).next_view(moved), strict=True):
            np.testing.assert_allclose(there.pose, MOTION @ here.pose, atol=1e-9)
            assert there.gain == pytest.approx(here.gain, abs=1e-9)
            assert [doubt.kind for doubt in there.settles] == [doubt.kind for doubt in here.settles]


def test_threads_do_not_change_the_next_view(paper_model):
    poses = []
    before = strand.num_threads()
    try:
        for threads in (1, 2, 5):
            strand.set_num_threads(threads)
            poses.append([view.pose.tobytes() for view in replace(paper_model).next_view()])
    finally:
        strand.set_num_threads(before)
    assert poses[0] == poses[1] == poses[2]


def test_the_next_view_leaves_out_a_camera_in_a_rope():
    place = LINE[80]
    poses = SCENE.poses.copy()
    poses[0, :3, 3] = place
    model = strand.Model((CHAIN,), poses, joins=(Join(place, (0,), 1.0),))
    assert np.isfinite(model.next_view()[0].pose).all()
    with pytest.raises(strand.NotEnoughDataError, match="poses"):
        replace(model, poses=poses[:1]).next_view()
    with pytest.raises(strand.NotEnoughDataError, match="poses"):
        replace(model, poses=poses[:0]).next_view()
    with pytest.raises(strand.NotEnoughDataError, match="chains"):
        replace(model, chains=()).next_view()


def test_joins_count_where_no_doubt_has_a_place():
    model = strand.Model((CHAIN, OVER), [ABOVE], joins=(Join(LINE[80], (0,), 1.0),))
    assert sees(model, model.next_view(count=1)[0].position, LINE[80])


def test_input_errors_are_not_settled_by_another_view():
    model = strand.Model((CHAIN,), [ASLANT], doubts=(doubt_at(None, "intrinsics"), doubt_at(None, "noise")))
    assert [doubt.kind for doubt in model.next_view()[0].settles] == ["noise"]


@pytest.mark.parametrize(
    ("wrong", "error", "name"),
    [
        ({"workspace": ([0, 0, 0], [1, 1, 1])}, TypeError, "workspace"),
        ({"workspace": lambda places: places}, ValueError, "workspace"),
        ({"workspace": lambda places: [1] * len(places)}, ValueError, "workspace"),
        ({"workspace": lambda places: True}, ValueError, "workspace"),
        ({"min_distance": -0.1}, ValueError, "min_distance"),
        ({"min_distance": float("nan")}, ValueError, "min_distance"),
        ({"min_distance": "0.2 m"}, TypeError, "min_distance"),
        ({"count": 0}, ValueError, "count"),
        ({"count": 1.5}, TypeError, "count"),
    ],
)
def test_wrong_arguments_are_named(wrong, error, name):
    with pytest.raises(error, match=name):
        hide_under_another().next_view(**wrong)


def test_a_call_takes_a_fraction_of_a_reconstruction(paper_model):
    times = []
    for _ in range(5):
        fresh = replace(paper_model)
        begun = time.process_time()
        fresh.next_view()
        times.append(time.process_time() - begun)
    assert min(times) < 0.1


def test_the_next_view_is_never_from_under_the_table(collected):
    for name in ("arc_0.3mm", "arc_0.7mm"):
        scene = collected(name)
        model = strand.reconstruct(scene.views, scene.radius, scene.bounds)
        assert all(view.position[2] > 0.0 for view in model.next_view())
