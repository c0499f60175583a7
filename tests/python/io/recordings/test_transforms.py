"""Tests of trees of static and moving transforms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from lib.bag_files import Messages
from strand.io.recordings.transforms import Transforms
from strand.views.pose import pose_from_angles

MADE = Messages()
A = pose_from_angles(0.3, -0.2, 1.1, [0.1, 0.2, 0.3])
B = pose_from_angles(-1.0, 0.4, 0.2, [-0.4, 0.0, 0.9])
C = pose_from_angles(2.0, 0.1, -0.7, [0.0, 0.5, 0.0])


def make_tree(*messages, beyond=0, static=True, max_bytes=1 << 20):
    made = Transforms(beyond, max_bytes)
    for message in messages:
        made.add(message, static)
    return made


def test_frames_are_followed_up_and_down():
    found = make_tree(MADE.tf([("map", "base", A), ("base", "arm", B), ("base", "/camera", C)], 0))
    for world, frame, want in (
        ("map", "camera", A @ C),
        ("camera", "map", np.linalg.inv(A @ C)),
        ("arm", "camera", np.linalg.inv(B) @ C),
        ("base", "arm", B),
        ("/arm", "arm", np.eye(4)),
    ):
        np.testing.assert_allclose(found.find_pose(world, frame, 5), want, rtol=0, atol=1e-12)
    assert found.frames == ["arm", "base", "camera", "map"]


@given(part=st.floats(0, 1), turns=st.lists(st.floats(-3, 3), min_size=6, max_size=6))
def test_interpolation_is_linear_in_place_and_angle(part, turns):
    one, other = (pose_from_angles(*turns[i : i + 3], [i, 2.0 - i, 0.5]) for i in (0, 3))
    assume(
        np.linalg.norm(one[:3, :3] - other[:3, :3]) < 2.8
    )  # after half a turn, both directions are equally short
    span = 10**9
    found = make_tree(
        MADE.tf([("w", "c", one)], 10 * span), MADE.tf([("w", "c", other)], 11 * span), static=False
    ).find_pose("w", "c", 10 * span + round(part * span))
    np.testing.assert_allclose(found[:3, 3], (1 - part) * one[:3, 3] + part * other[:3, 3], atol=1e-8)
    between = Slerp([0, 1], Rotation.from_matrix(np.stack([one[:3, :3], other[:3, :3]])))
    np.testing.assert_allclose(found[:3, :3], between(part).as_matrix(), atol=1e-6)


@pytest.mark.parametrize(("shift", "turn"), [(0.05, 0.0), (0.0, 0.02), (0.0, 0.0)])
def test_a_gap_in_which_a_frame_moved_has_no_pose(shift, turn):
    step = 33_000_000  # nanoseconds
    found, filled = Transforms(step, 1 << 20), Transforms(step, 1 << 20, fill_gaps=True)
    for k in [*range(10), *range(30, 40), 44]:
        moved = pose_from_angles(turn * (k >= 30), 0.0, 0.0, [shift * (k >= 30), 0.0, 0.0])
        for tree in (found, filled):
            tree.add(MADE.tf([("w", "c", moved)], k * step), False)
            tree.add(MADE.tf([("c", "lens", A)], 0), True)
    known = [k for k in range(45) if found.find_pose("w", "lens", k * step) is not None]
    lost = range(11, 29) if shift or turn else ()  # a transform holds for a step beyond its time
    assert known == [k for k in range(45) if k not in lost]
    assert known == [k for k in range(45) if found.has_pose("w", "lens", k * step)]
    assert all(filled.has_pose("w", "lens", k * step) for k in range(45))


def test_moving_transforms_are_known_at_their_times_only():
    at = [MADE.tf([("w", "c", pose)], time) for pose, time in ((A, 3000), (B, 1000), (C, 2000))]
    found = make_tree(*at, static=False, beyond=100)
    for time, want in ((1000, B), (2000, C), (3000, A), (901, B), (3099, A)):
        np.testing.assert_allclose(found.find_pose("w", "c", time), want, rtol=0, atol=1e-12)
    assert found.find_pose("w", "c", 899) is None
    assert found.find_pose("w", "c", 3101) is None
    assert found.find_pose("c", "w", 0) is None


@pytest.mark.parametrize("count", [1, 2, 5, 8])
def test_chains_of_moving_and_static_frames_are_composed(count):
    made, times = Transforms(0, 1 << 20), (1000, 4000, 2000)
    rng = np.random.default_rng(count)
    frames = ["root", *(f"{side}{i}" for side in "ab" for i in range(count))]
    links = [("root" if i == 0 else f"{side}{i - 1}", f"{side}{i}") for side in "ab" for i in range(count)]
    for k, link in enumerate(links):
        for time in times:
            pose = pose_from_angles(*rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 3))
            made.add(MADE.tf([(*link, pose)], time), static=k % 3 == 1)
    for time in (1000, 1300, 2000, 3999, 4000):
        found = {"root": np.eye(4)}
        for parent, child in links:
            found[child] = found[parent] @ made.find_pose(parent, child, time)
        for world in frames:
            for frame in frames:
                want = np.linalg.inv(found[world]) @ found[frame]
                np.testing.assert_allclose(made.find_pose(world, frame, time), want, rtol=0, atol=1e-12)
    assert made.has_pose("root", "a0", 1000)
    assert not made.has_pose("root", "a0", 999)


def test_transforms_may_be_added_after_a_search():
    found = make_tree(MADE.tf([("w", "c", A)], 0))
    assert found.find_pose("w", "c", 0) is not None
    found.add(MADE.tf([("w", "c", B)], 1), static=True)
    np.testing.assert_allclose(found.find_pose("w", "c", 0), B, rtol=0, atol=1e-12)


def test_the_last_static_transform_holds():
    found = make_tree(MADE.tf([("w", "c", A)], 0), MADE.tf([("w", "c", B)], 1))
    np.testing.assert_allclose(found.find_pose("w", "c", 0), B, rtol=0, atol=1e-12)


def test_unknown_frames_are_named():
    found = make_tree(MADE.tf([("map", "base", A), ("sky", "moon", B)], 0))
    with pytest.raises(ValueError, match="no frame 'camera' in TF; there are base, map, moon, sky"):
        found.find_pose("map", "camera", 0)
    with pytest.raises(ValueError, match="TF does not connect 'moon' and 'map'"):
        found.find_pose("map", "moon", 0)
    with pytest.raises(ValueError, match="no frame 'map' in TF; there are none"):
        make_tree().find_pose("map", "camera", 0)
    with pytest.raises(ValueError, match=r"c019, \.\.\.$"):
        make_tree(make_many(500)).find_pose("w", "x", 0)


def make_many(count):
    return MADE.tf([("w", f"c{i:03}", A) for i in range(count)], 0)


def test_circles_and_second_parents_are_refused():
    found = make_tree(MADE.tf([("a", "b", A), ("b", "c", B), ("c", "a", C)], 0))
    with pytest.raises(ValueError, match="TF has a circle through 'a'"):
        found.find_pose("a", "c", 0)
    with pytest.raises(ValueError, match="frame 'b': expected one parent, got 'a' and 'c'"):
        make_tree(MADE.tf([("a", "b", A), ("c", "b", B)], 0))


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e300])
def test_invalid_motions_are_refused(bad):
    for field, axes in (("translation", "xyz"), ("rotation", "xyzw")):
        for axis in axes:
            message = MADE.tf([("a", "b", A)], 0)
            setattr(getattr(message.transforms[0].transform, field), axis, bad)
            with pytest.raises(ValueError, match="frame 'b': expected a translation in metres and a unit q"):
                make_tree(message)


def test_long_chains_are_refused():
    links = [(str(i), str(i + 1), np.eye(4)) for i in range(65)]
    make_tree(MADE.tf(links[:64], 0)).find_pose("0", "64", 0)
    with pytest.raises(ValueError, match="TF has more than 64 frames from '65' to the root"):
        make_tree(MADE.tf(links, 0)).find_pose("0", "65", 0)


def test_memory_is_limited():
    with pytest.raises(ValueError, match="the transforms take more than max_bytes"):
        make_tree(make_many(90), max_bytes=100_000)
    assert make_tree(make_many(80), max_bytes=100_000).size < 100_000
