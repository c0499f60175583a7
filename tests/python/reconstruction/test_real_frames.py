"""Real depth frames of a rope between two grippers."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import strand
from strand.views.view import masked

PUBLISHED = strand.Config.published()
# where the two grippers hold the rope, and the crossing, in the camera frame; read off the colour images
FRAMES = {
    "0500": ([-0.060, -0.111], [0.070, -0.103], [0.000, -0.065]),
    "0590": ([-0.095, -0.097], [0.072, -0.112], [-0.023, -0.044]),
}


@pytest.mark.parametrize("name", FRAMES)
@pytest.mark.parametrize("config", [strand.Config(), PUBLISHED], ids=["tubes", "published"])
def test_a_real_rope_goes_from_gripper_to_gripper_straight_through_its_crossing(frame, name, config):
    view = frame(name)
    model = strand.reconstruct([view], radius=0.006, ropes=1, config=config)
    (chain,) = model.chains
    left, right, crossing = FRAMES[name]
    ends = sorted([chain.points[0, :2].tolist(), chain.points[-1, :2].tolist()])
    np.testing.assert_allclose(ends, [left, right], atol=0.012)
    # the loop: the chain passes the crossing twice, and goes on straight each time
    off = np.linalg.norm(chain.points[:, :2] - crossing, axis=1)
    near = off < 0.015
    passes = np.flatnonzero(np.diff(np.concatenate([[False], near]).astype(int)) == 1)
    assert len(passes) == 2
    for start in passes:
        inside = start + np.argmin(np.append(near[start:], False))
        entering, leaving = chain.tangents[max(start - 1, 0)], chain.tangents[min(inside, len(near) - 1)]
        assert entering @ leaving > 0.8
    # every point of the rope is on the tube
    inner = view.points[::10]
    distance = chain.nearest(inner).distance
    assert np.median(np.abs(distance - 0.006)) < 0.0015


def test_a_rope_behind_a_bar_is_followed_from_gripper_to_gripper(frame):
    lengths = []
    for name in ("0091", "0156", "0190", "0285", "0500", "0590"):
        view = frame(name)
        (chain,) = strand.reconstruct([view], radius=0.0038, ropes=1).chains
        # in all frames the grippers hold the leftmost and the rightmost of the rope
        for side in (view.points[:, 0].argmin(), view.points[:, 0].argmax()):
            gripper = view.points[side]
            assert min(np.linalg.norm(chain.points[[0, -1]] - gripper, axis=1)) < 0.012
        # gaps are marked, and nothing else
        apart = np.array([np.linalg.norm(view.points - node, axis=1).min() for node in chain.points])
        assert (apart[chain.bridged] > 0.5 * chain.radius).all()
        assert np.mean(apart[~chain.bridged] < 2.0 * chain.radius) > 0.97
        lengths.append(chain.length)
    # it is the same rope
    assert np.ptp(lengths) < 0.035 * np.mean(lengths)


def test_a_mask_of_a_rope_behind_a_bar_leaves_it_as_long_as_it_is(frame):
    lengths = []
    for name in ("0091", "0156", "0190", "0285", "0500", "0590"):
        view = frame(name)
        seen = masked(view, dataclasses.replace(view.image, labels=view.image.depth > 0))
        (chain,) = strand.reconstruct([seen], radius=0.0038, ropes=1).chains
        for side in (view.points[:, 0].argmin(), view.points[:, 0].argmax()):
            gripper = view.points[side, :2]
            assert min(np.linalg.norm(chain.points[[0, -1], :2] - gripper, axis=1)) < 0.012
        lengths.append(chain.length)
    # nor does it double back where the mask is too wide, or leave the rest where nothing shows it
    assert np.ptp(lengths) < 0.035 * np.mean(lengths)
    assert abs(np.mean(lengths) - 0.514) < 0.012
