"""Scenes through imitated cameras: masks, walls, bars, distances."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from strand import load_scene
from strand.synthetic import CAMERAS, Camera, Layout, Noise, Segmentation, render_depth, scene
from strand.synthetic.fields import dilate
from strand.synthetic.shapes import shape

RADIUS = 0.0042


def exact(made, i, ropes=True):
    height, width = made.depth.shape[1:]
    chains = made.truth if ropes else []
    return render_depth(chains, made.radius, made.intrinsics, made.poses_true[i], (width, height), 3.0)


def test_a_camera_sees_ropes_and_table_and_gives_a_mask():
    made = scene("loop", camera=Camera("d435"), views=2, seed=2)
    assert made.mask.shape == made.depth.shape
    assert made.mask.dtype == bool
    errors = []
    for i in range(2):
        depth, table = exact(made, i), exact(made, i, ropes=False)
        assert np.array_equal(made.mask[i], depth < table)
        error = made.depth[i] * made.depth_scale - depth
        seen = made.depth[i] > 0
        errors.append(error[made.mask[i] & seen])
        assert seen.mean() > 0.95
        # the table has the same noise
        assert 0.1 * RADIUS < np.std(error[~made.mask[i] & seen]) < RADIUS
    assert made.noise == pytest.approx(1.4826 * np.median(np.abs(np.concatenate(errors))), rel=1e-6)
    assert 0.15 * RADIUS < made.noise < RADIUS
    low, high = made.bounds  # holds the table
    assert low == pytest.approx(made.truth[0].min(axis=0) - 6 * RADIUS)
    assert high == pytest.approx(made.truth[0].max(axis=0) + 6 * RADIUS)
    for view, mask, image in zip(made.views, made.mask, made.depth, strict=True):
        assert len(view.points) == np.count_nonzero(mask & (image > 0))


@pytest.mark.parametrize("name", CAMERAS)
def test_noise_is_the_given_one_or_the_devices(name):
    # except for the rounding, which is coarse in small images
    smooth = dataclasses.replace(CAMERAS[name], amplitude=0.0, step=0.0)
    quiet, loud = (
        scene("s", camera=Camera(smooth, size=(160, 120)), views=1, noise=Noise(depth=part * RADIUS))
        for part in (0.2, 0.8)
    )
    for made, part in ((quiet, 0.2), (loud, 0.8)):
        depth, distance = exact(made, 0), np.linalg.norm(made.poses_true[0, :3, 3])
        table = ~dilate(made.mask[0], 12) & (made.depth[0] > 0) & (np.abs(depth / distance - 1.0) < 0.15)
        error = (made.depth[0] * made.depth_scale - depth)[table]
        assert 0.65 * part < 1.4826 * np.median(np.abs(error)) / RADIUS < 1.35 * part
    own, given = (
        scene("s", camera=Camera(camera, size=(160, 120)), views=1) for camera in (name, CAMERAS[name])
    )
    assert np.array_equal(own.depth, given.depth)
    assert np.array_equal(own.mask, given.mask)
    # the noise changes neither the rope nor the mask
    assert np.array_equal(quiet.truth[0], loud.truth[0])
    assert np.array_equal(quiet.mask, loud.mask)


def test_plain_noise_with_a_mask():
    plain, masked = scene("s", views=2), scene("s", views=2, mask=Segmentation(grow=1))
    assert plain.mask is None
    assert np.array_equal(plain.depth, masked.depth)
    assert masked.noise == plain.noise
    exactly = scene("s", views=2, mask=Segmentation())
    assert (exactly.mask & ~masked.mask).sum() == 0
    assert masked.mask.sum() > 1.2 * exactly.mask.sum()


def test_masks_are_saved(tmp_path):
    made = scene("arc", camera=Camera("tof", size=(160, 120)), views=3)
    made.save(tmp_path / "arc.npz")
    read = load_scene(tmp_path / "arc.npz")
    for view, mask, own in zip(read.views, made.mask, made.views, strict=True):
        assert np.array_equal(view.mask, mask)
        assert np.array_equal(view.points, own.points)
        assert len(view.points) > 100


def test_distance_and_elevation():
    near, far = (
        scene("s", views=1),
        scene("s", views=1, layout=Layout(distance=0.9, elevation=math.radians(70))),
    )
    where = far.poses_true[0, :3, 3]
    assert np.linalg.norm(where) == pytest.approx(0.9)
    assert math.degrees(math.asin(where[2] / 0.9)) == pytest.approx(70)
    # the camera is never so near that it cuts the rope off
    closest = scene("s", views=1, layout=Layout(distance=1e-3))
    assert np.linalg.norm(closest.poses_true[0, :3, 3]) < np.linalg.norm(near.poses_true[0, :3, 3])
    seen = (closest.truth[0] - closest.poses_true[0, :3, 3]) @ closest.poses_true[0, :3, :3]
    pixel = (seen @ closest.intrinsics.T)[:, :2] / seen[:, 2:]
    assert (pixel > 0).all()
    assert (pixel < (319, 239)).all()


def test_a_rope_before_a_wall():
    hung = np.roll(shape("arc"), 1, axis=1)  # upright: x is away from the wall
    made = scene(chains=[hung], camera=Camera("d435"), views=3, layout=Layout(wall=0.6))
    distance = np.linalg.norm(made.poses_true[1, :3, 3])
    azimuths = np.degrees(np.arctan2(made.poses_true[:, 1, 3], made.poses_true[:, 0, 3]))
    assert azimuths == pytest.approx([-40, 0, 40])
    assert made.poses_true[:, 2, 3] == pytest.approx(0.0, abs=1e-12)
    middle = made.depth[1] * made.depth_scale
    assert np.median(middle[~made.mask[1]]) == pytest.approx(distance + 0.6, rel=0.02)
    assert np.median(middle[made.mask[1]]) == pytest.approx(distance - RADIUS, abs=2.5 * RADIUS)
    # the mask holds the pixels of the rope's nodes
    seen = (hung - made.poses_true[0, :3, 3]) @ made.poses_true[0, :3, :3]
    column, row = np.rint((seen @ made.intrinsics.T)[:, :2] / seen[:, 2:]).astype(int).T
    assert made.mask[0][row, column].mean() > 0.99
    assert made.bounds[0] == pytest.approx(hung.min(axis=0) - 6 * RADIUS)


def test_a_bar_hides_the_rope_and_is_not_in_the_mask():
    rope = shape("straight", length=0.2)
    across = (
        np.array([0.0, 1.0, 0.0]) if np.ptp(rope[:, 0]) > np.ptp(rope[:, 1]) else np.array([1.0, 0.0, 0.0])
    )
    bar = np.array([[0.0, 0.0, 0.05]]) + np.array([[-0.05], [0.05]]) * across
    free, hidden = (
        scene(
            chains=[rope], camera=Camera("zed"), views=1, layout=Layout(elevation=math.radians(80), bars=bars)
        )
        for bars in ((), ((bar, 0.012),))
    )
    lost = free.mask[0] & ~hidden.mask[0]
    assert not (hidden.mask & ~free.mask).any()
    assert 0.05 * free.mask.sum() < lost.sum() < 0.3 * free.mask.sum()
    before = hidden.depth[0][lost] * hidden.depth_scale
    assert np.median(before) < np.median(free.depth[0][lost] * free.depth_scale) - 0.03


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (
            lambda: Camera("kinect"),
            ValueError,
            "device: expected one of d435, d405, zed, sgbm, tof, got 'kinect'",
        ),
        (lambda: Camera(3), TypeError, "device: expected a name or a DepthCamera, got int"),
        (
            lambda: scene("arc", camera=Camera("zed"), noise=Noise(flying=0.1)),
            ValueError,
            "noise: expected no `flying` with a device",
        ),
        (lambda: scene("arc", camera="zed"), TypeError, "camera: expected a Camera, got str"),
        (lambda: scene("arc", noise=0.001), TypeError, "noise: expected a Noise, got float"),
        (lambda: scene("arc", mask=True), TypeError, "mask: expected a Segmentation, got bool"),
        (lambda: scene("arc", layout=0.5), TypeError, "layout: expected a Layout, got float"),
        (lambda: Layout(distance=0.0), ValueError, "distance: expected a positive"),
        (lambda: Layout(elevation=math.inf), ValueError, "elevation: expected a finite"),
        (lambda: Layout(elevation="high"), TypeError, "elevation: expected a number"),
        (lambda: Layout(wall=-1.0), ValueError, "wall: expected a positive"),
        (
            lambda: Layout(bars=[(np.zeros((1, 3)), 0.01)]),
            ValueError,
            r"bars\[0\]: expected at least two nodes",
        ),
        (lambda: Layout(bars=[(np.eye(3)[:2], 0.0)]), ValueError, r"bars\[0\]: expected a positive"),
        (lambda: Layout(bars=[np.eye(3)]), ValueError, r"bars\[0\]: expected a pair of nodes and a radius"),
    ],
)
def test_wrong_input(make, error, message):
    with pytest.raises(error, match=message):
        make()
