"""Grey values as depths and poses in millimetres are named; unusual but right numbers are not suspected."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest

import strand
from strand.reconstruction.mistakes.field_of_view import doubt_far_depths
from strand.reconstruction.mistakes.units import doubt_gray_levels, refuse_poses_in_other_units
from strand.synthetic import Segmentation
from strand.views.extract import extract_views

MADE = strand.synthetic.scene("s", seed=2, views=3)
DEPTH = MADE.depth[0] * MADE.depth_scale


def make_view(depth=DEPTH, scale=1.0, pose=MADE.poses[0], **given):
    return strand.View.from_depth(depth, MADE.intrinsics, pose, depth_scale=scale, **given)


def to_gray(depth=DEPTH):
    near = depth[depth > 0].min()
    return np.clip((depth - near) / (depth.max() - near) * 254.0 + 1.0, 0.0, 255.0).astype(np.uint8)


def move_away(pose, shift):
    moved = pose.copy()
    moved[:3, 3] += shift
    return moved


@pytest.mark.parametrize("scale", [1e-3, 4e-3, 1.0 / 255.0, 0.257])
def test_an_8_bit_image_is_no_depth(scale):
    doubt = doubt_gray_levels([make_view(to_gray(), scale)])
    assert doubt.kind == "depth"
    assert "8-bit image" in doubt.reason


def test_depths_are_no_grey_values():
    assert doubt_gray_levels(MADE.views) is None
    # one level for the table, one for the ropes
    assert doubt_gray_levels([make_view(np.where(np.median(DEPTH) < DEPTH, 0.5, 0.49))]) is None
    # a near camera with steps of a millimetre
    near = np.linspace(160.0, 250.0, DEPTH.size).reshape(DEPTH.shape).round()
    assert doubt_gray_levels([make_view(near, 1e-3)]) is None
    assert doubt_gray_levels([strand.View(MADE.views[0].points)]) is None


def test_an_answer_from_grey_values_is_not_sure():
    made = strand.synthetic.scene("s", seed=7, views=1, mask=Segmentation())
    view = make_view(to_gray(made.depth[0] * made.depth_scale), 1e-3, mask=made.mask[0])
    model = strand.reconstruct([view], made.radius)
    assert model.confidence < 0.1
    assert any("8-bit" in str(warning) for warning in model.warnings)


def test_tubes_behind_the_camera_raise_no_internal_error():
    rng = np.random.default_rng(3)
    radius = float(rng.uniform(3e-3, 6e-3))
    noise = strand.synthetic.Noise(depth=0.1 * radius)
    made = strand.synthetic.scene("figure8", radius=radius, seed=3, noise=noise, views=1)
    gray = to_gray(made.depth[0] * made.depth_scale).astype(np.uint16)
    for scale in (1e-3, 2e-3, 4e-3):
        view = strand.View.from_depth(gray, made.intrinsics, made.poses[0], depth_scale=scale)
        with contextlib.suppress(strand.StrandError):
            assert strand.reconstruct([view], radius).confidence < 0.1


def test_depths_in_centimetres_are_too_far_for_the_camera():
    focal = float(MADE.intrinsics[0, 0])
    centimetres = [make_view(DEPTH, 100.0)]
    assert "are more than" in doubt_far_depths(centimetres, 6e-3, focal).reason
    assert doubt_far_depths([make_view(DEPTH, 90.0)], 6e-2, focal) is None
    # a wall far behind a thin rope
    assert doubt_far_depths([make_view(DEPTH, 20.0)], 1.5e-3, focal) is None


def test_a_pose_in_millimetres_is_refused():
    view = make_view(pose=move_away(MADE.poses[0], [300.0, 0.0, 200.0]))
    with pytest.raises(ValueError, match=r"views: cameras stand .* are the translations in metres"):
        strand.reconstruct([view], MADE.radius)
    scaled = MADE.poses.copy()
    scaled[:, :3, 3] *= 1e3
    views = [make_view(d * MADE.depth_scale, pose=p) for d, p in zip(MADE.depth, scaled, strict=True)]
    with pytest.raises(ValueError, match="views: "):
        refuse_poses_in_other_units(extract_views(views, None))


def test_far_origins_are_not_refused():
    def check(views, bounds=None):
        refuse_poses_in_other_units(extract_views(views, bounds))

    hall = [200.0, 40.0, 0.0]
    # a robot's cell
    check([make_view(pose=move_away(MADE.poses[0], [5.0, 0.0, 0.0]))])
    # several views of a robot in a hall
    check([make_view(pose=move_away(pose, hall)) for pose in MADE.poses])
    # bounds that hold what one view shows
    box = strand.Box(*(corner + hall for corner in MADE.bounds))
    check([make_view(pose=move_away(MADE.poses[0], hall))], box)
    points = MADE.views[0].world_points + hall
    check([strand.View.from_world(points, MADE.poses[0, :3, 3] + hall)])
