"""A rope on a table under a gripper or a hand, whose pixels are known."""

from __future__ import annotations

import numpy as np

import strand
from strand.synthetic.objects import Box, add_objects

K = np.array([[400.0, 0.0, 239.5], [0.0, 400.0, 179.5], [0.0, 0.0, 1.0]])
SIZE = (480, 360)
R = 0.004
X = np.linspace(-0.2, 0.2, 400)
ROPE = np.column_stack([X, 0.03 * np.sin(12.0 * X), np.full(400, R)])
# over the last end of the rope, and over its middle
GRIPPER = [Box((ROPE[-1, 0] - 0.02, ROPE[-1, 1], 0.035), (0.1, 0.08, 0.05), 0.0)]
HAND = [Box((0.0, 0.0, 0.05), (0.05, 0.3, 0.03), 0.0)]


def make_view(objects, azimuth=0.3, *, known=True, masked=False, colored=False, noise=0.0005):
    """A view of the rope and of objects, `known` as occluders or not."""
    pose = strand.synthetic.camera_pose(azimuth, 0.5, 1.1)
    bare = strand.synthetic.render_depth([ROPE], R, K, pose, SIZE)
    alone = strand.synthetic.render_depth([ROPE], R, K, pose, SIZE, table=False)
    exact = add_objects(bare.copy(), objects, K, pose)
    hidden, rope = exact != bare, (alone > 0) & np.isfinite(alone)
    rng = np.random.default_rng(0)
    depth = np.where(exact > 0, exact + rng.normal(0.0, noise, exact.shape), 0.0)
    given = {"mask": rope & ~hidden} if masked else {}
    if known:
        given["occluders"] = hidden
    if colored:
        colors = np.full((*exact.shape, 3), 120.0)
        colors[rope], colors[hidden] = (200.0, 40.0, 40.0), (50.0, 50.0, 55.0)
        colors += rng.normal(0.0, 4.0, colors.shape)
        given["colors"] = np.clip(colors, 0.0, 255.0).astype(np.uint8)
    return strand.View.from_depth(depth, K, pose, **given)
