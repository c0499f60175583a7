"""Named shapes of ropes."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from lib.measure import find_crossings
from strand.synthetic import Camera, scene, shapes
from strand.synthetic.shapes import SHAPES, shape

CROSSINGS = dict(
    straight=0,
    arc=0,
    s=0,
    coil=0,
    loop=1,
    figure8=2,
    overhand=3,
    paper=3,
    figure8_knot=4,
    granny=6,
    square=6,
)
RADIUS = 0.0042
# metres, at this radius
USUAL = {name: 0.72 if name in ("granny", "square") else 0.4 for name in SHAPES}


def finer(nodes, times=3):
    s = shapes.compute_arc_lengths(nodes)
    at = np.linspace(0.0, s[-1], times * (len(nodes) - 1) + 1)
    return np.stack([np.interp(at, s, nodes[:, k]) for k in range(3)], axis=1)


def clearance(nodes, radius):
    """Return the least distance between places more than pi * radius apart along the rope, radii."""
    fine = finer(nodes)
    s = shapes.compute_arc_lengths(fine)
    apart = cdist(fine, fine)[np.abs(s[:, None] - s) > np.pi * radius]
    return apart.min(initial=np.inf) / radius


def bend_radius(nodes):
    steps = np.diff(nodes, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    cosines = np.clip((steps[:-1] * steps[1:]).sum(1) / (lengths[:-1] * lengths[1:]), -1.0, 1.0)
    return (lengths[:-1] / np.maximum(np.arccos(cosines), 1e-12)).min()


def assert_valid(name, nodes, radius):
    assert nodes[:, 2].min() >= radius
    assert clearance(nodes, radius) >= 2.0
    assert bend_radius(nodes) >= 2.5 * radius
    assert len(find_crossings(nodes)) == CROSSINGS[name]


@pytest.mark.parametrize("radius", [0.002, 0.0042, 0.01])
@pytest.mark.parametrize("name", SHAPES)
def test_no_shape_cuts_through_itself(name, radius):
    length = USUAL[name] * radius / RADIUS
    nodes = shape(name, radius, length)
    assert_valid(name, nodes, radius)
    steps = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    assert steps.sum() == pytest.approx(length, rel=1e-3)
    assert steps == pytest.approx(min(1e-3, radius / 4), rel=0.02)
    assert np.abs(nodes[:, :2].max(0) + nodes[:, :2].min(0)).max() < 1e-12


@pytest.mark.parametrize("name", SHAPES)
def test_lengths_from_the_shortest_to_long_ones(name):
    with pytest.raises(ValueError, match=r"length: .* needs at least .* m \(") as caught:
        shape(name, RADIUS, 1e-6)
    shortest = float(re.search(r"\(([\d.]+) radii\)", str(caught.value)).group(1)) * RADIUS
    for length in (shortest, 0.7):
        nodes = shape(name, RADIUS, length)
        assert_valid(name, nodes, RADIUS)
        assert shapes.compute_arc_lengths(nodes)[-1] == pytest.approx(length, rel=1e-3)
    with pytest.raises(ValueError, match=r"length: .* needs at least .* m \("):
        shape(name, RADIUS, 0.99 * shortest)


@pytest.mark.parametrize("name", SHAPES)
def test_seeds_place_and_vary_valid_shapes(name):
    for seed in range(4):
        (nodes,) = scene(name, seed=seed, views=1, camera=Camera(size=(32, 24))).truth
        assert_valid(name, nodes, RADIUS)
        assert shapes.compute_arc_lengths(nodes)[-1] == pytest.approx(USUAL[name], rel=1e-3)


@pytest.mark.parametrize("name", [name for name, count in CROSSINGS.items() if count])
def test_crossings_alternate_under_and_over(name):
    nodes = shape(name)
    passes = sorted(
        (s, z * side) for low, high, z in find_crossings(nodes) for s, side in ((low, -1), (high, 1))
    )
    heights = np.array([z for _, z in passes])
    assert (np.sign(heights) == np.tile([-1, 1], len(heights) // 2)).all()
    assert np.abs(heights) == pytest.approx(2.1 * RADIUS, rel=0.01)
    # the rope lies on the table at both ends, and wherever it passes under
    assert nodes[[0, -1], 2] == pytest.approx(RADIUS)
    s = shapes.compute_arc_lengths(nodes)
    assert np.interp([at for at, z in passes if z < 0], s, nodes[:, 2]) == pytest.approx(RADIUS, rel=0.01)


def order_of_crossings(nodes):
    found = find_crossings(nodes)
    passes = sorted((s, i) for i, (low, high, _) in enumerate(found) for s in (low, high))
    names = {i: "ABCDEF"[k] for k, i in enumerate(dict.fromkeys(i for _, i in passes))}
    return "".join(names[i] for _, i in passes)


def test_knots():
    # alternating, so A B C A B C is the trefoil, A B C A D C B D the figure-eight knot; A B B A comes apart,
    # and C C is the circle. Two trefoils are a granny or a square knot
    assert order_of_crossings(shape("overhand")) == "ABCABC"
    assert order_of_crossings(shape("paper")) == "ABBACC"
    assert order_of_crossings(shape("figure8")) == "ABBA"
    assert order_of_crossings(shape("figure8_knot")) == "ABCADCBD"
    assert order_of_crossings(shape("granny")) == order_of_crossings(shape("square")) == "ABCABCDEFDEF"


def test_halves_of_a_square_knot_are_mirrored():
    # the first halves are equal; in the second half, the plan turns the other way
    turns = {}
    for name in ("granny", "square"):
        steps = np.diff(shape(name)[:, :2], axis=0)
        headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
        turns[name] = np.diff(headings[[0, len(headings) // 2, -1]])
    assert turns["granny"][1] == pytest.approx(turns["granny"][0], abs=0.1)
    assert turns["square"][1] == pytest.approx(-turns["square"][0], abs=0.1)


@pytest.mark.parametrize("seed", [None, 0, 1, 2, 3, 4, 5])
def test_crossings_of_the_papers_string_are_steep_and_isolated(seed):
    nodes = shape("paper") if seed is None else scene("paper", seed=seed, views=1).truth[0]
    s = shapes.compute_arc_lengths(nodes) / RADIUS
    flat = nodes[:, :2] / RADIUS
    found = [(low / RADIUS, high / RADIUS) for low, high, _ in find_crossings(nodes)]

    def at(x):
        return np.array([np.interp(x, s, flat[:, k]) for k in range(2)])

    def direction(x):
        d = at(x + 0.3) - at(x - 0.3)
        return d / np.linalg.norm(d)

    assert len(found) == CROSSINGS["paper"]
    for low, high in found:
        angle = np.degrees(np.arccos(abs(direction(low) @ direction(high))))
        assert 60 <= angle <= 90
    places = np.array([at(low) for low, _ in found])
    assert cdist(places, places)[np.triu_indices(3, 1)].min() >= 7
    passes = np.sort(np.ravel(found))
    assert np.diff(passes).min() >= 8
    assert min(passes[0], s[-1] - passes[-1]) >= 7
    strands = np.abs(s[:, None] - s) > 8
    for low, high in found:
        near = (np.abs(s - low) < 6.6)[:, None] & (np.abs(s - high) < 6.6)
        strands &= ~(near | near.T)
    assert cdist(flat, flat)[strands].min() >= 5
    for end in (0, -1):
        assert np.linalg.norm(flat - flat[end], axis=1)[np.abs(s - s[end]) > 8].min() >= 5
    if seed is None:
        assert (np.sort(np.ptp(nodes[:, :2], axis=0)) <= (0.15, 0.2)).all()


def test_wrong_shapes():
    with pytest.raises(ValueError, match=r"name: expected one of straight, arc, .*square, got 'bow'"):
        shape("bow")
    with pytest.raises(ValueError, match="radius: expected a positive"):
        shape("arc", radius=0.0)
    with pytest.raises(ValueError, match="length: expected a positive"):
        shape("arc", length=math.nan)
    with pytest.raises(TypeError, match="radius: expected a number"):
        shape("arc", radius="4.2mm")
