"""A harness is the same graph in a turned world, in a mirror, larger, and with views in another order."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

import strand
from strand.synthetic import Noise, harness

SCALE = 2.5
TURN = np.array([[0.6, -0.8, 0.0, 0.3], [0.8, 0.6, 0.0, -0.2], [0.0, 0.0, 1.0, 0.7], [0.0, 0.0, 0.0, 1.0]])
MIRROR = np.diag([-1.0, 1.0, 1.0, 1.0])


def collect(made):
    """Return the arguments of a call: images, intrinsics, poses, radii, bounds."""
    low, high = np.asarray(made.bounds, dtype=float)
    depth = [image.astype(np.float32) * np.float32(made.depth_scale) for image in made.depth]
    return depth, made.intrinsics, list(made.poses), sorted(set(made.radii)), (low, high)


def turn(depth, camera, poses, radii, bounds):
    return depth, camera, [TURN @ pose for pose in poses], radii, strand.Box(*bounds, TURN)


def enlarge(depth, camera, poses, radii, bounds):
    poses = [np.block([[pose[:3, :3], SCALE * pose[:3, 3:]], [0.0, 0.0, 0.0, 1.0]]) for pose in poses]
    larger = [image * np.float32(SCALE) for image in depth]
    return (
        larger,
        camera,
        poses,
        [SCALE * radius for radius in radii],
        strand.Box(*(SCALE * np.array(bounds))),
    )


def mirror(depth, camera, poses, radii, bounds):
    flipped = [np.ascontiguousarray(image[:, ::-1]) for image in depth]
    camera = np.array(camera)
    camera[0, 2] = depth[0].shape[1] - 1 - camera[0, 2]
    (low, high) = (np.array(corner) for corner in bounds)
    low[0], high[0] = -high[0], -low[0]
    return flipped, camera, [MIRROR @ pose @ MIRROR for pose in poses], radii, strand.Box(low, high)


def reverse(depth, camera, poses, radii, bounds):
    return depth[::-1], camera, poses[::-1], radii, strand.Box(*bounds)


def solve(depth, camera, poses, radii, bounds):
    views = [strand.View.from_depth(image, camera, pose) for image, pose in zip(depth, poses, strict=True)]
    return strand.reconstruct(views, radii, bounds, branches=True)


@pytest.mark.parametrize(("change", "scale"), [(turn, 1.0), (mirror, 1.0), (enlarge, SCALE), (reverse, 1.0)])
@pytest.mark.parametrize(("kind", "seed"), [("tree", 5), ("tied", 3), ("cross", 2)])
def test_a_harness_is_the_same_graph(kind, seed, change, scale):
    made = harness(kind, seed=seed, views=3, noise=Noise(depth=0.0003))
    given = collect(made)
    some = solve(*given[:4], strand.Box(*given[4])).harness
    other = solve(*change(*given)).harness
    degrees = [Counter(node.degree for node in graph.nodes) for graph in (some, other)]
    assert degrees[0] == degrees[1] == Counter(Counter(np.ravel(made.edges).tolist()).values())
    lengths = [np.sort([edge.length for edge in graph.edges]) for graph in (some, other)]
    # places of slow partings move along the trunk
    np.testing.assert_allclose(lengths[1], scale * lengths[0], atol=2.0 * scale * made.radii[0])
    assert lengths[1].sum() == pytest.approx(scale * lengths[0].sum(), rel=0.02)
