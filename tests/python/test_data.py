"""Shared scenes and real frames, from the folder beside the checkout."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import strand

SHARED = Path(__file__).resolve().parents[3] / "shared"
REAL = SHARED / "real" / "mp2cdlo"
PUBLISHED = strand.Config.published()


@pytest.fixture(scope="module")
def measure():
    spec = importlib.util.spec_from_file_location("score", SHARED / "score.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    "name", ["straight_low", "straight_mid", "arc_low", "arc_mid", "s_low", "s_mid", "figure8_low"]
)
def test_the_published_method_holds_on_plain_strings_and_steep_crossings(measure, name):
    scene = strand.load_scene(SHARED / "scenes" / f"{name}.npz")
    model = strand.reconstruct(scene.views, scene.radius, scene.bounds, config=PUBLISHED)
    score = measure.score([chain.points for chain in model.chains], scene.truth, scene.radius)
    assert score["topology_ok"]
    assert score["rms"] < 1e-3
    assert score["length_err"] < 0.01
    found, true, right = score["crossings"]
    assert found == true == right


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_papers_string_is_cut_in_seven_and_made_whole(measure, seed):
    scene = strand.synthetic.scene("paper", seed=seed)
    model = strand.reconstruct(
        scene.views, scene.radius, scene.bounds, ropes=1, config=PUBLISHED, keep_stages=True
    )
    assert len(model.stages["segments"]) == 7
    assert len(model.chains) == 1
    score = measure.score([chain.points for chain in model.chains], scene.truth, scene.radius)
    assert score["topology_ok"]
    assert score["rms"] < 1e-3
    assert score["length_err"] < 0.02
    assert score["crossings"] == (3, 3, 3)


# where the two grippers hold the rope, and the crossing, in the camera frame; read off the colour images
FRAMES = {
    "0500": ([-0.060, -0.111], [0.070, -0.103], [0.000, -0.065]),
    "0590": ([-0.095, -0.097], [0.072, -0.112], [-0.023, -0.044]),
}


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("config", [strand.Config(), PUBLISHED], ids=["tubes", "published"])
def test_a_real_rope_goes_from_gripper_to_gripper_straight_through_its_crossing(frame, config):
    camera = json.loads((REAL / "intrinsics.json").read_text())
    intrinsics = np.array([[camera["fx"], 0, camera["cx"]], [0, camera["fy"], camera["cy"]], [0, 0, 1]])
    depth = np.asarray(Image.open(REAL / f"depth_{frame}.png")) * 1e-3
    view = strand.View.from_depth(depth, intrinsics)
    model = strand.reconstruct([view], radius=0.006, ropes=1, config=config)
    (chain,) = model.chains
    left, right, crossing = FRAMES[frame]
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
    distance = np.array([chain.nearest(p)[1] for p in inner])
    assert np.median(np.abs(distance - 0.006)) < 0.0015


def test_a_rope_behind_a_bar_is_followed_from_gripper_to_gripper():
    camera = json.loads((REAL / "intrinsics.json").read_text())
    intrinsics = np.array([[camera["fx"], 0, camera["cx"]], [0, camera["fy"], camera["cy"]], [0, 0, 1]])
    lengths = []
    for frame in ("0091", "0156", "0190", "0285", "0500", "0590"):
        depth = np.asarray(Image.open(REAL / f"depth_{frame}.png")) * 1e-3
        view = strand.View.from_depth(depth, intrinsics)
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
