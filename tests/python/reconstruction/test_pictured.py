"""Clouds as images: answers from points alone, without an image or a mask."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import strand
from strand.reconstruction.pictured import differ_in_gaps, find_support
from strand.synthetic import Camera, scene

FLIP = np.diag([1.0, -1.0, -1.0, 1.0])


def is_right(model, truth, radius):
    """Whether each chain runs along a rope, and each rope along a chain, within 3 radii."""
    chains = [chain.points for chain in model.chains]
    return len(chains) == len(truth) and all(
        min(max(spread(chain, rope), spread(rope, chain)) for chain in chains) < 3.0 * radius
        for rope in truth
    )


def spread(points, others):
    """The greatest distance of points from others."""
    return np.linalg.norm(points[:, None] - others[None], axis=2).min(axis=1).max()


@pytest.fixture(scope="module")
def stereo():
    """A crossed rope in the depth of a stereo camera, whose neighbouring pixels share errors."""
    return scene("figure8", seed=11, views=1, camera=Camera("zed", size=(640, 480)))


def as_it_is(view):
    return strand.View(view.points, view.pose)


def from_world(view):
    return strand.View.from_world(view.world_points, view.viewpoint)


def in_opengl_axes(view):
    return strand.View(view.points * [1.0, -1.0, -1.0], view.pose @ FLIP)


def thinned(view):
    order = np.random.default_rng(3).permutation(len(view.points))
    return strand.View(view.points[order[: int(0.7 * len(order))]], view.pose)


@pytest.mark.parametrize("make", [as_it_is, from_world, in_opengl_axes, thinned])
def test_points_alone_of_a_stereo_camera_are_read_as_an_image(stereo, make):
    view = make(stereo.views[0])
    model = strand.reconstruct([view], stereo.radius)
    assert model.branch == "images"
    assert is_right(model, stereo.truth, stereo.radius)
    # points show nothing around the ropes
    assert "end" in [doubt.kind for doubt in model.doubts]
    assert model.poses[0][:3, :3] == pytest.approx(view.pose[:3, :3], abs=0.02)
    assert model.poses[0][:3, 3] == pytest.approx(view.viewpoint, abs=0.01)


def test_tubes_answer_where_errors_are_independent():
    made = scene("loop", seed=1, views=3)
    views = [strand.View(view.crop(made.bounds).points, view.pose) for view in made.views]
    model = strand.reconstruct(views, made.radius)
    assert model.branch == "tubes"
    assert is_right(model, made.truth, made.radius)


def test_tubes_beside_a_table_keep_the_frames_of_the_views():
    made = scene(seed=3, views=2)
    views = [from_world(view) for view in made.views]
    model = strand.reconstruct(views, made.radius)
    assert model.branch == "tubes"
    # images of points have axes of their own
    assert [pose[:3, :3] for pose in model.poses] == [pytest.approx(np.eye(3), abs=0.05)] * 2
    assert "pose" not in [doubt.kind for doubt in model.doubts]


def test_a_cloud_with_its_table_gives_the_answer_of_its_image():
    made = strand.synthetic.cluttered_scene(4)
    views = made.views[:1]
    image = strand.reconstruct(views)
    points = strand.reconstruct([strand.View(view.points, view.pose) for view in views])
    assert len(points.chains) == len(image.chains)
    for chain, other in zip(points.chains, image.chains, strict=True):
        assert chain.length == pytest.approx(other.length, rel=0.01)
    assert points.confidence == pytest.approx(image.confidence, abs=0.1)


def test_flat_ropes_alone_show_the_table_that_they_lie_on(stereo):
    view = as_it_is(stereo.views[0])
    normal, offset = find_support(view, stereo.radius)
    assert normal @ [0.0, 0.0, 1.0] > 0.99
    middle = np.append(np.mean(stereo.truth[0][:, :2], axis=0), 0.0)
    assert normal @ middle == pytest.approx(offset, abs=stereo.radius)


def test_a_rope_that_rises_shows_no_table():
    angle = np.linspace(0.0, 6.0, 2000)
    rising = np.column_stack([0.1 * np.cos(angle), 0.1 * np.sin(angle), 0.6 + 0.03 * angle**2 / 6.0])
    assert find_support(strand.View(rising), 0.004) is None
    line = np.column_stack([angle / 20.0, np.zeros(2000), np.full(2000, 0.6)])
    assert find_support(strand.View(line), 0.004) is None


def test_answers_differ_in_gaps_where_there_are_no_points():
    x = np.linspace(-0.1, 0.1, 401)
    straight, bent = (np.column_stack([x, 0.0 * x, 0.0 * x + 0.6]) for _ in range(2))
    bent[:, 1] = 0.03 * np.cos(np.clip(x / 0.05, -1.0, 1.0) * np.pi / 2.0)
    some, other = (SimpleNamespace(chains=[strand.Chain(nodes, 0.004)]) for nodes in (straight, bent))
    ends = SimpleNamespace(views=[strand.View(straight[np.abs(x) > 0.05])])
    whole = SimpleNamespace(views=[strand.View(np.vstack([straight, bent]))])
    assert differ_in_gaps(ends, some, other)
    assert not differ_in_gaps(whole, some, other)
    assert not differ_in_gaps(ends, some, some)


def test_points_on_no_rope_are_doubted_in_images_of_points(stereo):
    view, camera = as_it_is(stereo.views[0]), stereo.views[0].image.camera
    distances = np.linalg.norm(view.world_points - stereo.truth[0][300], axis=1)
    middle = view.points[distances.argmin()]
    rows, columns = (places.ravel() for places in np.mgrid[:480, :640])
    disc = camera.lift(rows, columns, np.full(len(rows), middle[2]))
    taken = np.zeros((480, 640), dtype=bool)
    own_columns, own_rows = np.rint(camera.project(view.points)).astype(int).T
    taken[own_rows, own_columns] = True
    disc = disc[(np.linalg.norm(disc - middle, axis=1) < 5.0 * stereo.radius) & ~taken.ravel()]
    plain = strand.reconstruct([view], stereo.radius)
    model = strand.reconstruct([strand.View(np.vstack([view.points, disc]), view.pose)], stereo.radius)
    assert plain.branch == model.branch == "images"
    assert model.confidence < 0.5 * plain.confidence
    kinds = [[doubt.kind for doubt in one.doubts] for one in (plain, model)]
    assert "points" not in kinds[0]
    assert "points" in kinds[1]


@pytest.mark.parametrize("seed", [1, 3])
def test_ropes_on_a_table_are_as_exact_as_ropes_alone(seed):
    # seven fits of images pull the axis up, and then seem noisy
    made = scene(seed=seed, views=7)
    model = strand.reconstruct(made.views, made.radius)
    squares = ((model.chains[0].points[:, None] - made.truth[0]) ** 2).sum(axis=2)
    assert np.sqrt(np.median(squares.min(axis=1))) < 0.15 * made.radius
    assert model.confidence > 0.95
