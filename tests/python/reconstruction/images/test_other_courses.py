"""Ropes that run otherwise where one ends on a strand, and bridges over bare table."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from strand.reconstruction.images.image_doubts import doubt_over_table
from strand.reconstruction.images.other_courses import cut_over_table, list_swapped, reach_tip
from strand.synthetic import Camera, Noise, random_ropes, scene
from strand.views.rope_images import make_rope_images

RADIUS = 0.004
SPACING = 0.5 * RADIUS
UP = np.array([0.0, 0.0, 1.0])


def line(start, stop):
    """Nodes on a straight way between two places, radii."""
    start, stop = RADIUS * np.array(start, float), RADIUS * np.array(stop, float)
    count = int(np.linalg.norm(stop - start) / SPACING) + 1
    return start + np.linspace(0.0, 1.0, count)[:, None] * (stop - start)


def image_of(chains, noise=0.0):
    made = scene(
        chains=chains,
        radius=RADIUS,
        views=1,
        noise=Noise(depth=noise),
        camera=Camera(size=(640, 480)),
        seed=3,
    )
    (image,) = make_rope_images(
        [view.crop(made.bounds) for view in made.views], made.views, strand.Box(*made.bounds)
    )
    return image, made.truth


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("towards", [1.0, -1.0])
def test_a_rope_that_ends_on_a_strand_goes_on_along_it(towards, turned):
    strand_there = line((-20, 0, 1), (20, 0, 1))
    rope = line((-12 * towards, -13, 1), (0, -1, 1))
    ((joined, rest),) = list_swapped([rope[::-1] if turned else rope, strand_there], RADIUS)
    assert np.allclose(joined[0], rope[0])
    assert np.allclose(joined[-1], RADIUS * np.array([20 * towards, 0, 1]))
    assert np.allclose(rest[0], RADIUS * np.array([-20 * towards, 0, 1]))
    assert np.linalg.norm(rest[-1] - rope[-1]) < 3.0 * RADIUS


def test_ropes_that_end_beside_no_strand_run_as_they_do():
    ropes = [line((-20, 0, 1), (20, 0, 1)), line((0, -20, 1), (0, -5, 1)), line((5, 3.5, 1), (5, 20, 1))]
    assert not list(list_swapped(ropes, RADIUS))


def test_a_rope_that_ends_on_itself_runs_through_its_loop_the_other_way():
    angle = np.linspace(-0.5 * np.pi, np.pi, 80)
    loop = RADIUS * np.column_stack([8.0 * np.cos(angle), 8.0 + 8.0 * np.sin(angle), np.ones(80)])
    ahead, back = line((-25, 0, 1), (-0.5, 0, 1)), line((-8, 7.5, 1), (-10, 1.5, 1))
    rope = np.vstack([ahead, loop, back])
    ((turned,),) = list_swapped([rope], RADIUS)
    assert np.array_equal(turned[0], rope[0])
    assert np.linalg.norm(turned[-1] - back[-1]) < 4.0 * RADIUS
    # the end is within the rope now
    assert np.linalg.norm(turned - back[0], axis=1).argmin() < len(turned) // 2
    # no way leads through a place that the rope does not
    assert np.linalg.norm(turned[:, None] - rope[None], axis=2).min(axis=1).max() < 1e-9


@pytest.mark.parametrize("noise", [0.0, 0.2])
def test_bridges_over_bare_table_are_cut_and_doubted(noise):
    ropes = [line((-22, 0, 1), (-2, 0, 1)), line((2, 0, 1), (22, 0, 1))]
    image, (left, right) = image_of(ropes, noise * RADIUS)
    way = (left[-1], right[0])
    gap = way[0] + np.linspace(0.0, 1.0, 9)[1:-1, None] * (way[1] - way[0])
    every = round(SPACING / np.linalg.norm(left[1] - left[0]))
    left, right = left[::-every][::-1], right[::every]
    kept, (cut,) = cut_over_table([image], [np.vstack([left, gap, right])], RADIUS)
    assert len(kept) == 2
    assert np.linalg.norm(kept[0][-1] - way[0]) < 1.2 * RADIUS
    assert np.linalg.norm(kept[1][0] - way[1]) < 1.2 * RADIUS
    assert np.linalg.norm(cut.mean(axis=0) - gap.mean(axis=0)) < RADIUS
    (doubt,) = doubt_over_table([image], [np.vstack([left, gap, right])], RADIUS)
    assert doubt.kind == "gap"
    assert doubt.amount > 1.5
    assert not cut_over_table([image], [left, right], RADIUS)[1]


def test_a_rope_is_led_on_to_a_tip_that_the_mask_shows():
    image, (rope, other) = image_of([line((-22, 0, 1), (22, 0, 1)), line((-22, -8, 1), (0, -8, 1))])
    every = round(SPACING / np.linalg.norm(rope[1] - rope[0]))
    short = rope[: -12 * every : every]
    *_, longer = reach_tip(image, [other, short], UP, RADIUS)
    assert np.array_equal(longer[: len(short)], short)
    assert np.linalg.norm(longer[-1] - rope[-1]) < 1.6 * RADIUS
    assert reach_tip(image, [other, rope], UP, RADIUS) is None
    # the tip lies behind the last node
    assert reach_tip(image, [other, short[::-1]], UP, RADIUS) is None


def test_a_tip_is_found_beside_an_unread_rope_that_lies_behind():
    image, (rope, _) = image_of([line((-22, 0, 1), (22, 0, 1)), line((8, -8, 1), (14, -8, 1))])
    every = round(SPACING / np.linalg.norm(rope[1] - rope[0]))
    (longer,) = reach_tip(image, [rope[: -12 * every : every]], UP, RADIUS)
    assert np.linalg.norm(longer[-1] - rope[-1]) < 1.6 * RADIUS


def test_ropes_are_not_joined_over_table_that_noisy_depth_shows(measure):
    """A rope ends beyond a crossing, and another one ends beside it, three radii of table away."""
    seed, radius = 7_310_006, 0.00242220726
    made = scene(
        chains=random_ropes(7, 2, radius, seed),
        radius=radius,
        noise=Noise(depth=0.4215 * radius),
        views=1,
        camera=Camera(size=(640, 480)),
        seed=seed,
    )
    model = strand.reconstruct(made.views, made.radius, made.bounds)
    assert len(model.chains) == 2
    assert measure(model, made.truth, made.radius).right
