"""Views without masks whose depths scatter widely."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import strand
from strand.reconstruction.images.noisy_depth import _measure_overlap
from strand.synthetic import Camera, Noise, scene
from strand.views.rope_images import make_rope_images

RADIUS = 0.004


def noisy(name, relative, **options):
    return scene(name, radius=RADIUS, noise=Noise(depth=relative * RADIUS), **options)


@pytest.mark.parametrize(
    ("name", "relative", "views", "seed"),
    [
        ("loop", 0.8, 1, 1),
        ("figure8", 0.7, 3, 2),
        ("overhand", 0.6, 3, 3),
        ("straight", 0.9, 2, 4),
        ("coil", 0.7, 3, 5),
    ],
)
def test_ropes_are_right_in_wide_noise(name, relative, views, seed, measure):
    made = noisy(name, relative, views=views, seed=seed)
    model = strand.reconstruct(made.views, made.radius, made.bounds)
    assert measure(model, made.truth, made.radius).right


@pytest.mark.parametrize(("past", "views", "seed"), [(1.0, 1, 0), (1.0, 2, 0), (2.0, 2, 1)])
def test_an_end_on_another_strand_is_found_in_wide_noise(past, views, seed, measure):
    """It neither rises where nothing carries it nor stops at the strand."""
    s, t = np.linspace(-25.0, past, 200), np.linspace(-25.0, 25.0, 200)
    upper = np.stack([0.0 * s, s, 1.0 + 2.15 * np.exp(-((s / 3.0) ** 2))], axis=1)
    lower = np.stack([t, 2.0 * np.sin(t / 12.0), np.ones_like(t)], axis=1)
    chains = [RADIUS * upper, RADIUS * lower]
    made = scene(chains=chains, radius=RADIUS, noise=Noise(depth=0.75 * RADIUS), views=views, seed=seed)
    model = strand.reconstruct(made.views, made.radius, made.bounds)
    assert measure(model, made.truth, made.radius).right


def test_a_range_above_the_table_does_not_crash():
    made = noisy("arc", 0.8, views=2, seed=8)
    low, high = made.bounds
    above = np.array([*low[:2], low[2] + 6.0 * RADIUS]), np.array([*high[:2], high[2] + 20.0 * RADIUS])
    try:
        model = strand.reconstruct(made.views, made.radius, above)
    except strand.NotEnoughDataError:
        return
    assert model.confidence < 0.5


def test_the_answer_is_the_same_for_any_number_of_threads():
    made = noisy("loop", 0.7, views=2, seed=7)
    found = []
    for threads in (1, 3):
        strand.set_num_threads(threads)
        found.append(strand.reconstruct(made.views, made.radius, made.bounds))
    strand.set_num_threads(0)
    assert found[0].confidence == found[1].confidence
    for some, other in zip(found[0].chains, found[1].chains, strict=True):
        assert np.array_equal(some.points, other.points)


def test_scattered_depths_without_a_table_are_refused():
    made = noisy("arc", 0.8, views=1, seed=8)
    bare = dataclasses.replace(made, depth=np.where(made.depth > 0, 0, made.depth).astype(np.uint16))
    with pytest.raises(strand.NotEnoughDataError):
        strand.reconstruct(bare.views, made.radius, made.bounds)


@pytest.mark.parametrize("seed", [1, 4])
def test_a_bare_table_in_wide_noise_shows_no_rope(seed):
    made = noisy("straight", 1.2, views=1 + seed % 2, seed=seed)
    rng = np.random.default_rng(seed)
    views = []
    for view in made.views:
        (fx, fy), (cx, cy) = view.image.camera
        v, u = np.mgrid[: view.image.depth.shape[0], : view.image.depth.shape[1]]
        down = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones(u.shape)], axis=-1) @ view.pose[2, :3]
        depth = np.maximum(-view.pose[2, 3] / down, 0.0)
        depth += np.where(depth > 0.0, made.noise * rng.standard_normal(depth.shape), 0.0)
        views.append(strand.View.from_depth(depth, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], view.pose))
    try:
        model = strand.reconstruct(views, made.radius, made.bounds)
    except strand.NotEnoughDataError:
        return
    assert model.confidence < 0.05


def test_a_radius_in_millimetres_is_refused_at_once():
    made = noisy("arc", 0.8, views=1, seed=8, camera=Camera(size=(160, 120)))
    with pytest.raises(strand.NotEnoughDataError, match="the radius in metres"):
        strand.reconstruct(made.views, 1000.0 * made.radius, made.bounds)


@pytest.mark.filterwarnings("error")
def test_infinite_depths_do_not_count_as_scatter():
    made = noisy("arc", 0.8, views=1, seed=8)
    (view,) = made.views
    (fx, fy), (cx, cy) = view.image.camera
    depth = view.image.depth.copy()
    depth[:40] = np.inf
    endless = strand.View.from_depth(depth, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], view.pose)
    model = strand.reconstruct([endless], made.radius, made.bounds)
    assert model.sensor.sd > 0.3 * RADIUS


def test_overlap_is_the_length_of_rope_within_other_strands():
    x = 0.5 * RADIUS * np.arange(3000.0)
    rope = np.column_stack([x, 0.0 * x, 0.0 * x])
    assert _measure_overlap([rope], RADIUS) == 0.0
    # its first half again, a radius beside it
    beside = rope[:1500] + np.array([0.0, RADIUS, 0.0])
    found = _measure_overlap([rope, beside], RADIUS)
    assert found == pytest.approx(0.5 * 2 * 1500, abs=2.0)


def test_a_rope_on_rough_ground_is_not_mistaken_for_a_noisy_one(measure):
    made = scene("figure8", radius=RADIUS, noise=Noise(depth=0.05 * RADIUS), views=1, seed=9)
    (true,) = make_rope_images(
        [view.crop(made.bounds) for view in made.views], made.views, strand.Box(*made.bounds)
    )
    ground = np.random.default_rng(9).normal(0.0, 0.006 / made.depth_scale, true.mask.shape)
    depth = np.where(true.mask, made.depth[0], made.depth[0] + np.abs(ground))
    rough = dataclasses.replace(made, depth=depth[None].astype(np.uint16))
    model = strand.reconstruct(rough.views, made.radius, made.bounds)
    assert measure(model, made.truth, made.radius).right
    assert model.confidence > 0.8


def test_the_sensor_is_that_of_single_pixels():
    made = noisy("arc", 0.8, views=1, seed=10, camera=Camera(size=(640, 480)))
    model = strand.reconstruct(made.views, made.radius, made.bounds)
    assert model.sensor.sd == pytest.approx(made.noise, rel=0.1)
    assert model.sensor.correlation == 0.0
