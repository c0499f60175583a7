"""Ropes that leave the image: their ends at its border are doubted, and do not turn along it."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from shared.occluded import ROPE, K, R
from strand.synthetic import camera_pose, render_depth

_SIZE = (480, 300)  # pixels: the last end of the rope lies outside
_POSE = camera_pose(0.3, 0.5, 1.1)


def _draw(rope, pose=_POSE, size=_SIZE):
    """Return the depth image of a rope on a table, and its mask."""
    depth = render_depth([rope], R, K, pose, size)
    alone = render_depth([rope], R, K, pose, size, table=False)
    seen = np.isfinite(depth) & (depth > 0)
    depth = np.where(seen, depth + np.random.default_rng(0).normal(0.0, 0.0005, depth.shape), 0.0)
    return depth, (alone > 0) & np.isfinite(alone)


def _make_view(kind, size=_SIZE):
    depth, mask = _draw(ROPE, size=size)
    view = strand.View.from_depth(depth, K, _POSE, mask=mask if kind == "mask" else None)
    return strand.View(view.points, _POSE) if kind == "cloud" else view


@pytest.mark.parametrize("kind", ["mask", "image", "cloud"])
@pytest.mark.parametrize("leaves", [True, False])
def test_an_end_at_the_border_is_doubted_and_named(kind, leaves):
    model = strand.reconstruct([_make_view(kind, _SIZE if leaves else (480, 360))], radius=R)
    (chain,) = model.chains
    cut = [warning for warning in model.warnings if warning.kind == "cut end"]
    doubts = [doubt for doubt in model.doubts if "leaves the image" in doubt.reason]
    if not leaves:
        assert cut == [] == doubts
        return
    (warning,), (doubt,) = cut, doubts
    assert warning.chains == (0,)
    assert np.array_equal(warning.place, doubt.place)
    assert np.linalg.norm(chain.points[[0, -1]] - doubt.place, axis=1).min() == 0.0
    assert doubt in chain.doubts
    assert model.confidence < 0.7


def test_a_second_view_that_shows_the_end_leaves_no_doubt():
    other = camera_pose(0.6, 0.5, 1.1)
    depth, mask = _draw(ROPE, other, (480, 360))
    views = [_make_view("mask"), strand.View.from_depth(depth, K, other, mask=mask)]
    assert [warning.kind for warning in strand.reconstruct(views, radius=R).warnings] == []


@pytest.mark.parametrize("seed", [46, 49, 55])
def test_a_rope_does_not_turn_along_the_border(seed):
    made = strand.synthetic.frame_scene("kinks", seed)
    mask = made.mask[0] > 0
    edge = int(np.percentile(np.nonzero(mask)[0], 75))
    view = strand.View.from_depth(
        made.depth[0][:edge],
        made.intrinsics,
        made.poses[0],
        depth_scale=made.depth_scale,
        mask=mask[:edge],
    )
    chains = strand.reconstruct([view], radius=made.radius).chains
    nodes = np.vstack([chain.points for chain in chains])
    away = np.linalg.norm(nodes[:, None] - made.truth[0], axis=2).min(axis=1)
    assert away.max() < 1.2 * made.radius
