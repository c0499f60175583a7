"""Gaps of TF are found by the rule of recordings, from the transforms that have come."""

from __future__ import annotations

import numpy as np
import pytest

from lib.bag_files import Messages
from strand.io.recordings.transforms import Transforms
from strand.views.pose import pose_from_angles
from strand_ros.tf_gaps import TransformGaps

MADE = Messages()
STEP = 33_000_000  # nanoseconds
LENS = pose_from_angles(0.3, -0.2, 1.1, [0.1, 0.2, 0.3])


def send(gaps, k, pose, parent="w"):
    for transform in MADE.tf([(parent, "c", pose)], k * STEP).transforms:
        gaps.add(transform, static=False)


def make_gaps():
    gaps = TransformGaps()
    for transform in MADE.tf([("c", "/lens", LENS)], 0).transforms:
        gaps.add(transform, static=True)
    return gaps


@pytest.mark.parametrize(("shift", "turn"), [(0.05, 0.0), (0.0, 0.02), (0.0, 0.0)])
@pytest.mark.parametrize("missing", [3, 8, 20])
def test_gaps_are_those_of_recordings(shift, turn, missing):
    gaps, tree = make_gaps(), Transforms(0, 1 << 20)
    tree.add(MADE.tf([("c", "lens", LENS)], 0), True)
    last = 450 + missing
    for k in [*range(450), *range(last, last + 40)]:  # more than are kept
        pose = pose_from_angles(turn * (k >= last), 0.0, 0.0, [shift * (k >= last), 0.0, 0.0])
        send(gaps, k, pose)
        tree.add(MADE.tf([("w", "c", pose)], k * STEP), False)
    for world, frame in (("w", "lens"), ("/lens", "w")):
        lost = [k for k in range(last + 40) if gaps.find(world, frame, k * STEP) is not None]
        assert lost == [k for k in range(last + 40) if not tree.has_pose(world, frame, k * STEP)]
    assert bool(lost) == (missing > 5 and bool(shift or turn))
    if lost:
        name, length = gaps.find("w", "lens", lost[0] * STEP)
        assert (name, round(length, 3)) == ("c", round((missing + 1) * 0.033, 3))
    assert gaps.find("c", "lens", 452 * STEP) is None  # a gap above both counts for neither


def test_late_invalid_and_unknown_transforms_make_no_gap():
    gaps = make_gaps()
    for k in range(10):
        send(gaps, k, np.eye(4))
    send(gaps, 2, LENS)
    (wrong,) = MADE.tf([("w", "c", LENS)], 40 * STEP).transforms
    wrong.transform.rotation.w += 0.5
    gaps.add(wrong, static=False)
    assert gaps.find("w", "lens", 20 * STEP) is None
    assert gaps.find("nowhere", "lens", 20 * STEP) is None
    send(gaps, 30, LENS)
    assert gaps.find("w", "lens", 20 * STEP) is not None
    gaps.clear()
    assert gaps.find("w", "lens", 20 * STEP) is None


def test_a_new_parent_begins_anew_and_circles_end():
    gaps = make_gaps()
    for k in range(10):
        send(gaps, k, np.eye(4))
    send(gaps, 30, LENS, parent="lens")
    assert gaps.find("w", "lens", 20 * STEP) is None
