"""Simulated scenes with their truth."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from strand import load_scene
from strand.synthetic import Camera, Noise, render_depth, scene, shapes
from strand.synthetic.shapes import SHAPES, compute_arc_lengths, shape

RADIUS = 0.0042
PINHOLE = np.array([[212.0, 0.0, 159.5], [0.0, 212.0, 119.5], [0.0, 0.0, 1.0]])


def test_noise_is_normal_with_the_given_deviation():
    for noise in (0.0003, 0.0007, 0.0015):
        made = scene("s", noise=Noise(depth=noise, flying=0.0), views=2, seed=4)
        exact = np.stack([render_depth(made.truth, RADIUS, PINHOLE, pose) for pose in made.poses_true])
        error = (made.depth * made.depth_scale - exact)[exact > 0]
        assert error.mean() == pytest.approx(0.0, abs=0.02 * noise)
        assert error.std() == pytest.approx(math.hypot(noise, made.depth_scale / math.sqrt(12)), rel=0.02)
        assert (np.abs(error) > 2 * noise).mean() == pytest.approx(0.0455, rel=0.15)
        assert not made.depth[exact == 0].any()


def test_reported_poses_are_wrong_in_the_table_plane_only():
    angles, shifts = [], []
    for seed in range(12):
        made = scene("arc", seed=seed, camera=Camera(size=(32, 24)))
        assert np.array_equal(made.poses[3], made.poses_true[3])
        for i in (0, 1, 2, 4, 5, 6):
            error = made.poses[i] @ np.linalg.inv(made.poses_true[i])
            assert error[2] == pytest.approx([0, 0, 1, 0], abs=1e-12)
            assert error[:3, 2] == pytest.approx([0, 0, 1], abs=1e-12)
            angles.append(math.atan2(error[1, 0], error[0, 0]))
            shifts.extend(error[:2, 3])
    assert np.degrees(np.std(angles)) == pytest.approx(0.5, rel=0.25)
    assert np.std(shifts) == pytest.approx(0.0015, rel=0.25)
    exact = scene("arc", camera=Camera(size=(32, 24)), noise=Noise(turn=0.0, shift=0.0))
    assert exact.poses == pytest.approx(exact.poses_true, abs=1e-15)


def test_cameras_stand_around_the_table():
    made = scene("loop", camera=Camera(size=(32, 24)))
    centres = made.poses_true[:, :3, 3]
    distance = np.linalg.norm(centres, axis=1)
    assert distance == pytest.approx(distance[0])
    assert np.degrees(np.arcsin(centres[:, 2] / distance)) == pytest.approx(50)
    assert np.degrees(np.arctan2(centres[:, 1], centres[:, 0])) == pytest.approx(np.arange(-90, 91, 30))
    assert -made.poses_true[:, :3, 2] * distance[:, None] == pytest.approx(centres)  # look at the origin
    assert scene("loop", views=1, camera=Camera(size=(32, 24))).poses_true[0, 1, 3] == 0.0
    large = scene("loop", camera=Camera(size=(640, 480)), views=1)
    assert large.depth.shape == (1, 480, 640)
    assert large.intrinsics == pytest.approx(np.array([[424, 0, 319.5], [0, 424, 239.5], [0, 0, 1]]))


@pytest.mark.parametrize("name", SHAPES)
def test_every_view_holds_the_rope(name):
    made = scene(name, seed=6, noise=Noise(depth=0.0003))
    nodes = made.truth[0]
    for pose in made.poses_true:
        seen = (nodes - pose[:3, 3]) @ pose[:3, :3]
        pixel = seen @ made.intrinsics.T / seen[:, 2:]
        assert (pixel[:, :2] > 0).all()
        assert (pixel[:, :2] < (319, 239)).all()
    low, high = made.bounds
    assert low == pytest.approx([*(nodes[:, :2].min(0) - 6 * RADIUS), 0.6 * RADIUS])
    assert high == pytest.approx(nodes.max(0) + np.array([6, 6, 3]) * RADIUS)
    points = np.vstack([view.crop(made.bounds).points for view in made.views])
    assert 5500 < len(points) * 0.4 / compute_arc_lengths(nodes)[-1] < 13000
    for view, pose in zip(made.views, made.poses, strict=True):
        assert np.array_equal(view.pose, pose)


def test_same_seed_same_bits():
    first, again, other = scene(seed=5, views=2), scene(seed=5, views=2), scene(seed=6, views=2)
    assert first.name == "paper"
    assert np.array_equal(first.depth, again.depth)
    assert np.array_equal(first.poses, again.poses)
    assert np.array_equal(first.truth[0], again.truth[0])
    assert not np.array_equal(first.truth[0], other.truth[0])
    assert not np.array_equal(first.depth, other.depth)
    # the noise does not change the rope
    assert np.array_equal(first.truth[0], scene(seed=5, views=2, noise=Noise(depth=0.0)).truth[0])


def test_several_ropes_of_ones_own():
    one = shape("arc") - (0.0, 0.03, 0.0)
    two = shape("straight", length=0.1) - (0.03, 0.0, 0.0)
    made = scene(chains=[one, two], seed=1, views=3)
    assert made.name == "chains"
    assert len(made.truth) == 2
    assert np.array_equal(made.truth[0], one)
    assert scene("pair", chains=[one], views=1).name == "pair"


def test_large_and_small_ropes():
    for radius in (0.002, 0.01):
        made = scene(radius=radius, views=3)
        assert shapes.compute_arc_lengths(made.truth[0])[-1] == pytest.approx(0.4 * radius / RADIUS, rel=1e-3)
        assert sum(len(view.crop(made.bounds).points) for view in made.views) > 2500


def test_save_and_load(tmp_path):
    path = tmp_path / "two.npz"
    made = scene("two", chains=[shape("arc"), shape("straight", length=0.1) - (0.03, 0.0, 0.0)], views=3)
    made.save(path)
    assert [file.name for file in tmp_path.iterdir()] == ["two.npz"]

    read = load_scene(path)
    assert read.name == "two"
    assert read.radius == made.radius
    assert np.array_equal(np.stack(read.bounds), np.stack(made.bounds))
    for got, view in zip(read.views, made.views, strict=True):
        assert np.array_equal(got.points, view.points)
        assert np.array_equal(got.pose, view.pose)
    for got, nodes in zip(read.truth, made.truth, strict=True):
        assert got == pytest.approx(nodes, abs=1e-7)


def test_saved_in_the_format_of_the_stored_scenes(data, tmp_path):
    path = tmp_path / "paper.npz"
    made = scene()
    made.save(path)
    with np.load(path) as ours, np.load(data / "scenes" / "paper_mid.npz") as theirs:
        assert set(ours.files) == set(theirs.files)
        for key in theirs.files:
            assert ours[key].dtype.kind == theirs[key].dtype.kind
            assert ours[key].dtype.itemsize == theirs[key].dtype.itemsize or key == "name"
            if key != "truth_0":
                assert ours[key].shape == theirs[key].shape
        # read without the package
        K, low, high = ours["K"], *ours["box"]
        for depth, pose, view in zip(ours["depth"], ours["poses"], made.views, strict=True):
            v, u = np.nonzero(depth)
            z = depth[v, u] * float(ours["depth_scale"])
            world = (
                np.c_[(u - K[0, 2]) / K[0, 0] * z, (v - K[1, 2]) / K[1, 1] * z, z] @ pose[:3, :3].T
                + pose[:3, 3]
            )
            inside = world[((world > low) & (world < high)).all(axis=1)]
            assert inside == pytest.approx(view.crop(made.bounds).world_points, abs=1e-12)


def make(camera=None, noise=None, **arguments):
    camera, noise = Camera(**{"size": (32, 24), **(camera or {})}), Noise(**(noise or {}))
    return scene(**{"views": 1, "camera": camera, "noise": noise, **arguments})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (dict(name="bow"), "name: expected one of straight"),
        (dict(radius=0.0), "radius: expected a positive"),
        (dict(radius=-1.0), "radius: expected a positive"),
        (dict(length=0.3), "length: a rope of radius 0.0042 m needs at least 0.399 m"),
        (dict(noise=dict(depth=-1e-3)), "depth: expected a number >= 0"),
        (dict(noise=dict(depth=math.nan)), "depth: expected a number >= 0"),
        (dict(views=0), "views: expected at least 1, got 0"),
        (dict(seed=-1), "seed: expected at least 0, got -1"),
        (dict(camera=dict(size=(0, 240))), r"size\[0\]: expected at least 1, got 0"),
        (dict(camera=dict(size=320)), "size: expected a pair"),
        (dict(camera=dict(depth_scale=0.0)), "depth_scale: expected a positive"),
        (dict(noise=dict(flying=1.5)), "flying: expected a fraction from 0 to 1"),
        (dict(noise=dict(turn=-0.1)), "turn: expected a number >= 0"),
        (dict(noise=dict(shift=math.inf)), "shift: expected a number >= 0"),
        (dict(chains=[]), "chains: expected at least one rope"),
        (dict(chains=[np.zeros((1, 3))]), r"chains\[0\]: expected at least two nodes"),
        (dict(chains=[np.zeros((2, 3))]), r"chains\[0\]: expected no two equal nodes"),
        (dict(chains=[np.zeros((4, 2))]), r"chains\[0\]: expected shape"),
        (dict(chains=[shape("arc")], length=0.4), "length: expected none"),
    ],
)
def test_wrong_values(arguments, message):
    with pytest.raises(ValueError, match=message):
        make(**arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (dict(views=2.5), "views: expected an integer, got float"),
        (dict(seed="one"), "seed: expected an integer, got str"),
        (dict(noise=dict(depth="low")), "depth: expected a number, got str"),
        (dict(camera=dict(size=(320.0, 240.0))), r"size\[0\]: expected an integer"),
        (dict(chains=[np.zeros((4, 3), dtype=int)]), r"chains\[0\]: expected floating point"),
    ],
)
def test_wrong_types(arguments, message):
    with pytest.raises(TypeError, match=message):
        make(**arguments)


def test_a_scene_keeps_its_masks(tmp_path):
    made = scene("arc", views=2, camera=Camera(size=(64, 48)))
    made.save(tmp_path / "without.npz")
    assert made.mask is None
    with np.load(tmp_path / "without.npz") as arrays:
        assert "mask" not in arrays
    labels = np.random.default_rng(5).integers(0, 3, made.depth.shape).astype(np.uint8)
    masked = dataclasses.replace(made, mask=labels)
    masked.save(tmp_path / "with.npz")
    for views in (masked.views, load_scene(tmp_path / "with.npz").views):
        for view, mask in zip(views, labels, strict=True):
            np.testing.assert_array_equal(view.image.labels, mask)
