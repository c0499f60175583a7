"""Views without masks among views with masks: they help where noise is independent, and do no harm else."""

import dataclasses

import numpy as np
import pytest

import strand
from shared.ropes import find_warnings
from strand.synthetic import Camera, Layout, Noise, Segmentation, scene


def only_first_masked(made):
    return [made.views[0], *dataclasses.replace(made, mask=None).views[1:]]


@pytest.mark.parametrize("camera", ["d435", "d405", "zed"])
@pytest.mark.parametrize("bounded", [True, False])
def test_depth_images_without_masks_are_dropped_and_named_where_noise_is_correlated(camera, bounded):
    made = scene(
        "s",
        seed=5,
        views=3,
        camera=Camera(camera, size=(640, 480)),
        mask=Segmentation(),
        layout=Layout(distance=0.6),
    )
    given = {"radius": made.radius, "ropes": 1, "bounds": made.bounds if bounded else None}
    some = strand.reconstruct(only_first_masked(made), **given)
    alone = strand.reconstruct(made.views[:1], **given)
    np.testing.assert_array_equal(some.chains[0].points, alone.chains[0].points)
    assert some.confidence == pytest.approx(alone.confidence, abs=0.02)
    assert [doubt.kind for doubt in some.doubts] == [doubt.kind for doubt in alone.doubts]
    assert [warning.view for warning in find_warnings(some, "unused view")] == [1, 2]
    np.testing.assert_array_equal(some.poses[1:], [view.pose for view in made.views[1:]])
    assert np.isnan(some.pose_sd[1:]).all()


@pytest.mark.parametrize("noise", [0.1, 0.3])
@pytest.mark.parametrize("seed", [1, 4])
def test_views_without_masks_help_where_noise_is_independent(noise, seed, measure):
    made = scene("loop", seed=seed, views=3, mask=Segmentation(), noise=Noise(depth=noise * 0.0042))
    some = strand.reconstruct(only_first_masked(made), made.radius, made.bounds, ropes=1)
    alone = strand.reconstruct(made.views[:1], made.radius, made.bounds, ropes=1)
    found = measure(some, made.truth, made.radius)
    assert found.right
    assert found.rms < 0.5 * measure(alone, made.truth, made.radius).rms
    assert find_warnings(some, "unused view") == []


def test_points_without_an_image_are_used_unless_they_show_the_table():
    made = scene("loop", seed=1, views=2, camera=Camera("d435", size=(480, 360)), mask=Segmentation())
    first, second = made.views
    rope = strand.View(second.points, second.pose)
    table = strand.View(dataclasses.replace(made, mask=None).views[1].points, second.pose)
    for view, unused in ((rope, []), (table, [1])):
        model = strand.reconstruct([first, view], made.radius, ropes=1)
        assert [warning.view for warning in find_warnings(model, "unused view")] == unused


@pytest.mark.parametrize("masked", [(1, 2), (0, 2), (0, 1)])
def test_the_middle_view_keeps_its_pose_or_the_one_next_to_it(masked):
    made = scene(
        "s",
        seed=7,
        views=3,
        camera=Camera("d435", size=(640, 480)),
        mask=Segmentation(),
        layout=Layout(distance=0.6),
    )
    bare = dataclasses.replace(made, mask=None).views
    views = [made.views[i] if i in masked else bare[i] for i in range(3)]
    model = strand.reconstruct(views, made.radius, made.bounds, ropes=1)
    held = 1 if 1 in masked else 0
    np.testing.assert_array_equal(model.poses[held], views[held].pose)
    moved = next(i for i in masked if i != held)
    assert not np.array_equal(model.poses[moved], views[moved].pose)


def test_a_mask_of_everything_is_none(measure):
    made = scene(
        "s",
        seed=3,
        views=3,
        camera=Camera("zed", size=(640, 480)),
        mask=Segmentation(),
        layout=Layout(distance=0.6),
    )
    bare = dataclasses.replace(made, mask=None).views
    whole = dataclasses.replace(made, mask=np.ones_like(made.mask)).views
    for views in ([whole[0], *bare[1:]], bare):
        with pytest.raises(strand.NotEnoughDataError, match="smooth surface"):
            strand.reconstruct(views, made.radius, made.bounds, ropes=1)
    # beside a mask of the ropes it is none either
    some = strand.reconstruct([made.views[0], whole[1], bare[2]], made.radius, made.bounds, ropes=1)
    assert [warning.view for warning in find_warnings(some, "unused view")] == [1, 2]
    assert measure(some, made.truth, made.radius).right
