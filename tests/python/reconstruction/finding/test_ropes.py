"""Ropes found among other things on a table."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from lib.measure import measure_chains
from strand.synthetic import SyntheticScene, cluttered_scene, color_scene


@pytest.fixture(scope="module")
def one() -> SyntheticScene:
    """One view."""
    return cluttered_scene(4)


@pytest.fixture(scope="module")
def three() -> SyntheticScene:
    """Three views of a tilted table."""
    return cluttered_scene(1)


def rope_pixels(scene, number):
    """Columns and rows of the rope's axis in an image, and its depth there."""
    pose = scene.poses_true[number]
    x, y, z = ((scene.truth[0] - pose[:3, 3]) @ pose[:3, :3]).T
    focal, center = scene.intrinsics[0, 0], scene.intrinsics[:2, 2]
    return np.rint(focal * x / z + center[0]).astype(int), np.rint(focal * y / z + center[1]).astype(int), z


def right(scene, model):
    return measure_chains([model.chains[0].points], scene.truth, scene.radius).right


@pytest.mark.parametrize("scene", ["one", "three"])
def test_masks_hold_the_rope_and_nothing_else(scene, request):
    made = request.getfixturevalue(scene)
    found = strand.find_ropes(made.views)
    assert found.radius == pytest.approx(made.radius, rel=0.15)
    for number, view in enumerate(found.views):
        columns, rows, z = rope_pixels(made, number)
        seen = np.abs(view.image.depth[rows, columns] - z) < 3.0 * made.radius
        assert view.mask[rows[seen], columns[seen]].mean() > 0.95
        # every pixel of the mask is near the rope
        v, u = np.nonzero(view.mask)
        near = np.min((v[:, None] - rows[::5]) ** 2 + (u[:, None] - columns[::5]) ** 2, axis=1)
        width = made.intrinsics[0, 0] * made.radius / np.median(z)
        assert np.mean(near < (2.0 * width + 3.0) ** 2) > 0.97
    normal, offset = found.tables[0]
    on_table = made.truth[0] @ normal - offset
    assert np.quantile(on_table, 0.1) == pytest.approx(made.radius, abs=0.4 * made.radius)
    assert len(found.other_objects) >= 3


@pytest.mark.parametrize("scene", ["one", "three"])
def test_a_rope_among_things_is_reconstructed_without_hints(scene, request):
    made = request.getfixturevalue(scene)
    model = strand.reconstruct(made.views)
    assert right(made, model)
    assert model.chains[0].confidence >= 0.5
    assert "thing" in {warning.kind for warning in model.warnings}
    assert "find" in model.timings


@pytest.mark.parametrize("scene", ["one", "three"])
def test_bounds_that_hold_the_table_do_no_harm(scene, request):
    made = request.getfixturevalue(scene)
    model = strand.reconstruct(made.views, bounds=made.bounds)
    assert "find" in model.timings
    assert right(made, model)
    assert model.chains[0].confidence >= 0.5


def test_bounds_whose_floor_is_the_table():
    made = strand.synthetic.scene(
        "overhand",
        views=2,
        noise=strand.synthetic.Noise(depth=0.0005),
        camera=strand.synthetic.Camera(size=(480, 360)),
    )
    low, high = made.bounds
    model = strand.reconstruct(made.views, made.radius, ((*low[:2], 0.0), high))
    assert "find" in model.timings
    assert right(made, model)
    # bounds that exclude the table change nothing, nor do bounds where noise hides the rope's height
    assert "find" not in strand.reconstruct(made.views, made.radius, made.bounds).timings
    noisy = strand.synthetic.scene("arc", views=1, noise=strand.synthetic.Noise(depth=0.003))
    assert "find" not in strand.reconstruct(noisy.views, noisy.radius, ((*low[:2], 0.0), high)).timings


def test_ropes_are_sought_within_bounds(one):
    rope = one.truth[0]
    middle = np.median(rope, axis=0)
    half = strand.Box(middle - (0.0, 1.0, 1.0), middle + 1.0)
    found = strand.find_ropes(one.views, one.radius, half)
    (everywhere,) = strand.find_ropes(one.views, one.radius).views
    (view,) = found.views
    assert half.holds(view.world_points).all()
    assert set(map(tuple, view.points)) <= set(map(tuple, everywhere.points))
    assert len(view.points) > 0.2 * len(everywhere.points)
    assert all(half.holds(thing.place) for thing in found.other_objects)
    with pytest.raises(strand.NoRopeError):
        strand.find_ropes(one.views, bounds=strand.Box(rope.max(axis=0) + 0.1, rope.max(axis=0) + 0.2))


def test_points_without_an_image_do_as_well(one):
    model = strand.reconstruct([strand.View(view.points, view.pose) for view in one.views])
    assert right(one, model)


@pytest.mark.parametrize("share", [0.7, 0.5, 0.3])
def test_thinned_points_do_as_well(one, three, share):
    for made in (one, three):
        rng = np.random.default_rng(0)
        kept = [rng.permutation(view.points)[: int(share * len(view.points))] for view in made.views]
        model = strand.reconstruct([strand.View(*each) for each in zip(kept, made.poses, strict=True)])
        assert right(made, model)


def test_thinned_points_of_a_table_without_a_rope_are_refused():
    points = cluttered_scene(2, views=1, rope=False).views[0].points
    with pytest.raises(strand.NoRopeError, match="no rope on the table"):
        strand.reconstruct([strand.View(np.random.default_rng(0).permutation(points)[: len(points) // 2])])


def test_a_table_without_a_rope_is_refused_and_the_error_names_what_stands_there():
    for views in (1, 3):
        with pytest.raises(strand.NoRopeError, match=r"no rope on the table: .*strip of one width"):
            strand.reconstruct(cluttered_scene(2, views=views, rope=False).views)


def test_a_given_radius_is_used(one):
    found = strand.find_ropes(one.views, one.radius)
    assert any(f"radius {1e3 * one.radius:.1f} mm" in thing.reason for thing in found.other_objects)
    with pytest.raises(ValueError, match="radius: expected"):
        strand.find_ropes(one.views, -1.0)
    with pytest.raises(TypeError, match="views: expected"):
        strand.find_ropes(one.views[0])


def test_views_with_masks_and_views_of_ropes_alone_stay_as_they_are(one, paper):
    (view,) = strand.find_ropes(one.views).views
    assert strand.find_ropes([view]).views == (view,)
    alone = [view.crop(paper.bounds) for view in paper.views]
    found = strand.find_ropes(alone)
    assert found.views == tuple(alone)
    assert found.radius is None
    assert found.tables == (None,) * len(alone)
    assert found.other_objects == ()


def test_each_chain_has_doubts_of_its_own(paper_model):
    (chain,) = paper_model.chains
    assert chain.confidence == pytest.approx(paper_model.confidence, abs=0.05)
    assert chain.doubts == paper_model.doubts


@pytest.mark.parametrize("scatter", [0.3e-3, 0.7e-3])
def test_a_bare_table_is_no_rope_of_a_given_radius(scatter):
    depth = 0.5 + np.random.default_rng(0).normal(scale=scatter, size=(240, 320))
    view = strand.View.from_depth(depth, [[400, 0, 160], [0, 400, 120], [0, 0, 1]])
    with pytest.raises(strand.NoRopeError, match="no rope on the table") as refused:
        strand.reconstruct([view], 0.004)
    assert not refused.value.low_things


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1e3, 1e30, 1e60, 1e90])
@pytest.mark.filterwarnings("error")
def test_a_bare_table_is_refused_in_any_unit(scale):
    depth = scale * (0.5 + np.random.default_rng(0).normal(scale=1e-3, size=(240, 320)))
    view = strand.View.from_depth(depth, [[400, 0, 160], [0, 400, 120], [0, 0, 1]])
    for seen in (view, strand.View(view.points)):
        with pytest.raises(strand.NotEnoughDataError):
            strand.reconstruct([seen])


def test_the_outline_of_a_high_thing_is_no_rope():
    # heights that are smoothed make a strip of one width around a gripper
    views = color_scene("gripper", 204, rope=False).views
    with pytest.raises(strand.NoRopeError, match="thing was dropped"):
        strand.find_ropes(views)


def test_noise_as_high_as_ropes_is_refused_early():
    scene = color_scene("plain", 201).scene
    view = strand.View.from_depth(
        scene.depth[0], scene.intrinsics, scene.poses[0], depth_scale=scene.depth_scale
    )
    # strand used to search among all pieces for 20 s
    with pytest.raises(strand.NoRopeError, match="many short pieces"):
        strand.reconstruct([view])


def test_colors_show_the_radius_without_bias():
    errors = []
    for kind in ("two ropes", "shadows", "hand"):
        for seed in (210, 211, 212):
            made = color_scene(kind, seed)
            found = strand.find_ropes(made.views)
            errors.append(found.radius / made.scene.radius - 1.0)
    assert np.abs(errors).max() < 0.1
    assert abs(np.mean(errors)) < 0.03


@pytest.mark.parametrize(
    ("kind", "seed"), [("plain", 445), ("two ropes", 456), ("plain", 400), ("shadows", 448)]
)
def test_noise_that_makes_strips_wider_or_narrower_leaves_the_radius(kind, seed):
    made = color_scene(kind, seed).scene
    assert strand.find_ropes(made.views).radius == pytest.approx(made.radius, rel=0.1)
