"""Masks: what a reconstruction makes of them, and how it names those that cannot be right."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import strand
from shared.ropes import find_rope_pixels, find_warnings
from strand.reconstruction.masks import find_misplaced_masks, warn_of_surplus_labels

SCENES = {
    name: strand.synthetic.scene(
        name,
        views=3,
        seed=seed,
        noise=strand.synthetic.Noise(depth=noise),
        camera=strand.synthetic.Camera(size=(480, 360)),
    )
    for seed, (name, noise) in enumerate([("arc", 0.7e-3), ("paper", 3e-3), ("straight", 1.5e-3)])
}
MASKS = {name: find_rope_pixels(scene) for name, scene in SCENES.items()}


def masked(name, masks):
    """A scene's views, with other masks."""
    return dataclasses.replace(SCENES[name], mask=masks).views


def misplaced(name, masks, bounds=None):
    """The numbers of the views whose masks are named."""
    views = masked(name, masks)
    found = find_misplaced_masks(views, range(len(views)), bounds, np.array([SCENES[name].radius]))
    assert all(mask.doubt.kind == "mask" and f"view {mask.view}: " in mask.doubt.reason for mask in found)
    return [mask.view for mask in found]


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("bounded", [False, True])
def test_masks_of_other_frames_are_named_and_right_ones_are_not(name, bounded):
    bounds = strand.Box(*SCENES[name].bounds) if bounded else None
    mask = MASKS[name]
    assert misplaced(name, mask, bounds) == []
    # a pixel too wide, or too narrow
    wide = mask | np.roll(mask, 1, 1) | np.roll(mask, -1, 1) | np.roll(mask, 1, 2) | np.roll(mask, -1, 2)
    narrow = mask & np.roll(mask, 1, 1) & np.roll(mask, -1, 2)
    assert misplaced(name, wide, bounds) == misplaced(name, narrow, bounds) == []
    if not bounded:  # off the rope, a mask holds nothing of the extraction range
        assert misplaced(name, np.roll(mask, 40, 1)) == [0, 1, 2]
        assert misplaced(name, ~mask) == [0, 1, 2]
    other = MASKS["arc" if name == "paper" else "paper"]
    assert len(misplaced(name, other)) == 3
    only_one = np.stack([mask[0], other[1], mask[2]])
    assert misplaced(name, only_one) == [1]


def test_a_mask_of_everything_is_as_none_within_bounds_and_holds_the_background_without():
    everything = np.ones_like(MASKS["arc"])
    assert misplaced("arc", everything, strand.Box(*SCENES["arc"].bounds)) == []
    assert misplaced("arc", everything) == [0, 1, 2]


def test_a_mask_is_not_judged_where_nothing_around_it_was_seen():
    scene, mask = SCENES["arc"], MASKS["arc"]
    alone = dataclasses.replace(scene, depth=np.where(mask, scene.depth, 0).astype(np.uint16))
    for masks in (mask, np.ones_like(mask)):
        views = dataclasses.replace(alone, mask=masks).views
        assert find_misplaced_masks(views, [0, 1, 2], None, np.array([scene.radius])) == []


def test_the_answer_from_a_mask_of_another_frame_is_unsure():
    scene = SCENES["arc"]
    masks = MASKS["arc"].copy()
    masks[0] = np.roll(masks[0], 40, 0)
    model = strand.reconstruct(masked("arc", masks), scene.radius, ropes=1)
    (warning,) = find_warnings(model, "mask")
    (doubt,) = (doubt for doubt in model.doubts if doubt.kind == "mask")
    assert warning.view == 0
    assert warning.amount == doubt.amount
    assert "is it the mask of this frame?" in str(warning)
    assert model.confidence < 0.4


def test_masks_stand_in_for_the_extraction_range():
    scene = SCENES["arc"]
    model = strand.reconstruct(masked("arc", MASKS["arc"]), scene.radius)
    inside = strand.reconstruct(scene.views, scene.radius, scene.bounds)
    (chain,), (other,) = model.chains, inside.chains
    assert chain.length == pytest.approx(other.length, rel=0.02)
    assert other.nearest(chain.points).distance.max() < 0.5 * scene.radius
    assert find_warnings(model, "mask") == []
    assert model.confidence > 0.8


@pytest.mark.parametrize("method", ["default", "published"])
def test_only_some_views_may_have_masks(method):
    scene = SCENES["arc"]
    views = [masked("arc", MASKS["arc"])[0], *scene.views[1:]]
    config = strand.Config(method=method)
    model = strand.reconstruct(views, scene.radius, scene.bounds, ropes=1, config=config)
    want = strand.Chain(scene.truth[0], 0.001).length
    assert model.chains[0].length == pytest.approx(want, rel=0.03)
    assert find_warnings(model, "mask") == []


def test_masks_of_everything_change_no_bit():
    scene = SCENES["arc"]
    answers = [
        strand.reconstruct(views, scene.radius, scene.bounds).chains[0].points
        for views in (scene.views, masked("arc", np.ones_like(MASKS["arc"])))
    ]
    np.testing.assert_array_equal(*answers)


def test_what_lies_outside_of_a_mask_says_what_space_is_free():
    # two ropes in line; between their ends the cameras see the table
    nodes = [
        np.stack([np.linspace(a, b, 61), np.zeros(61), np.full(61, 0.0042)], axis=1)
        for a, b in ((-0.08, -0.02), (0.02, 0.08))
    ]
    scene = strand.synthetic.scene(chains=nodes, views=3)
    mask = find_rope_pixels(scene)
    seen = dataclasses.replace(scene, mask=mask)
    assert len(strand.reconstruct(seen.views, scene.radius).chains) == 2
    hidden = dataclasses.replace(scene, depth=np.where(mask, scene.depth, 0).astype(np.uint16))
    bridged = strand.reconstruct(hidden.views, scene.radius, ropes=1)
    apart = strand.reconstruct(seen.views, scene.radius, ropes=1)
    assert bridged.chains[0].length == pytest.approx(0.16, abs=0.01)
    assert apart.chains[0].length == pytest.approx(0.06, abs=0.01)


def test_labels_for_more_ropes_than_there_are_are_named():
    scene = SCENES["arc"]
    labels = MASKS["arc"] * (1 + (np.arange(480) > 240) + (np.arange(480) > 300)).astype(np.uint8)
    labels[1] = MASKS["arc"][1]
    views = masked("arc", labels)
    assert [len(np.unique(view.image.labels)) - 1 for view in views] == [3, 1, 3]
    found = list(warn_of_surplus_labels(views, 2))
    assert [(one.kind, one.view, one.amount) for one in found] == [("mask", 0, 3.0), ("mask", 2, 3.0)]
    assert str(found[0]) == "view 0: its mask has 3 labels, more than ropes = 2"
    assert list(warn_of_surplus_labels(views, None)) == list(warn_of_surplus_labels(views, 3)) == []
    model = strand.reconstruct(views, scene.radius, ropes=1)
    assert [one.view for one in find_warnings(model, "mask")] == [0, 2]
    # labels may be pieces of one rope
    assert [doubt for doubt in model.doubts if doubt.kind == "mask"] == []
    assert model.confidence > 0.8


def test_a_view_whose_mask_holds_no_rope_is_not_used():
    scene = SCENES["arc"]
    masks = MASKS["arc"].copy()
    masks[0] = False
    views = list(masked("arc", masks))
    blind = np.where(masks[2], 0.0, scene.depth[2] * scene.depth_scale)
    views[2] = strand.View.from_depth(blind, scene.intrinsics, scene.poses[2], mask=masks[2])
    model = strand.reconstruct(views, scene.radius, ropes=1)
    assert [(one.view, str(one)) for one in find_warnings(model, "unused view")] == [
        (0, "view 0 has an empty mask and was not used"),
        (2, "view 2 has no depth inside its mask and was not used"),
    ]
    assert len(model.chains) == 1


def specks(mask):
    """A mask with a few pixels in a corner."""
    made = np.zeros_like(mask)
    made[10:13, 10:14] = True
    return made


@pytest.mark.parametrize("number", [0, 1])
def test_a_view_whose_mask_shows_specks_alone_is_left_out_and_named(number):
    masks = MASKS["arc"].copy()
    masks[number] = specks(masks[number])
    model = strand.reconstruct(masked("arc", masks), SCENES["arc"].radius, ropes=1)
    (warning,) = find_warnings(model, "unused view")
    assert warning.view == number
    assert "a mask that shows no rope: the largest part has 12 pixels" in str(warning)
    truth = strand.Chain(SCENES["arc"].truth[0], 0.001)
    assert model.chains[0].length == pytest.approx(truth.length, rel=0.05)


def test_masks_of_specks_alone_are_refused():
    masks = np.stack([specks(mask) for mask in MASKS["arc"]])
    with pytest.raises(strand.NotEnoughDataError, match="view 2 has a mask that shows no rope"):
        strand.reconstruct(masked("arc", masks), SCENES["arc"].radius)


@pytest.mark.parametrize("rows", [slice(300, 312), slice(0, 9)])
def test_masks_of_the_bare_table_are_refused_also_at_the_border(rows):
    scene = SCENES["arc"]
    masks = np.zeros_like(MASKS["arc"])
    masks[:, rows, 60:400] = True
    masks &= ~MASKS["arc"]
    with pytest.raises(strand.NotEnoughDataError, match=r"background alone \(views 0, 1, 2\)"):
        strand.reconstruct(masked("arc", masks), scene.radius)
    # with the rope in another view's mask it is a doubt
    masks[1] = MASKS["arc"][1]
    assert misplaced("arc", masks) == [0, 2]


def test_a_mask_with_little_depth_says_so():
    scene = SCENES["arc"]
    kept = np.zeros(scene.depth.shape[1:], dtype=bool)
    kept[::40, ::40] = True
    mask = np.ones_like(MASKS["arc"])
    views = dataclasses.replace(scene, depth=scene.depth * kept, mask=mask).views
    with pytest.raises(strand.NotEnoughDataError, match="view 0 has depth in only 0% of its mask"):
        strand.reconstruct(views, scene.radius)


@pytest.mark.parametrize("number", [0, 1])
def test_one_mask_tells_the_ropes_in_views_without(number):
    made = strand.synthetic.scene(
        "arc",
        seed=1,
        views=3,
        camera=strand.synthetic.Camera("zed", size=(480, 360)),
        mask=strand.synthetic.Segmentation(),
    )
    bare = dataclasses.replace(made, mask=None).views
    views = [view if i == number else bare[i] for i, view in enumerate(made.views)]
    model = strand.reconstruct(views, made.radius, ropes=1)
    truth = strand.Chain(made.truth[0], made.radius)
    assert model.chains[0].length == pytest.approx(truth.length, rel=0.04)
    assert truth.nearest(model.chains[0].points).distance.max() < 2.0 * made.radius
    assert model.confidence > 0.4


@pytest.mark.parametrize("count", [7, 12, 18])
def test_a_mask_in_many_pieces_makes_no_sure_answer(count):
    """Dashes all over a table: the ways to read them are more than can be tried."""
    rng = np.random.default_rng(count)
    height, width = 360, 480
    rows, columns = np.mgrid[:height, :width]
    mask = np.zeros((height, width), dtype=bool)
    for row, column in np.ndindex(count, count):
        angle = rng.uniform(0.0, np.pi)
        right = columns - (column + 0.5) * width / count
        down = rows - (row + 0.5) * height / count
        along, across = (
            right * np.cos(angle) + down * np.sin(angle),
            down * np.cos(angle) - right * np.sin(angle),
        )
        mask |= (np.abs(along) < rng.uniform(5.0, 0.5 * width / count)) & (np.abs(across) < 3.0)
    depth = 0.6 + 1e-3 * rng.normal(size=mask.shape) - 0.004 * mask
    camera = np.array([[450.0, 0.0, 240.0], [0.0, 450.0, 180.0], [0.0, 0.0, 1.0]])
    try:
        model = strand.reconstruct([strand.View.from_depth(depth, camera, mask=mask)], 0.004)
    except strand.NotEnoughDataError:
        return
    assert model.confidence < 0.5


@pytest.mark.parametrize(("step", "named"), [(0.002, [0, 1, 2]), (0.02, [])])
def test_a_mask_is_not_doubted_where_depth_has_wider_steps_than_its_rope(step, named):
    scene = SCENES["arc"]
    # the rope is in none of the images
    table = np.median(scene.depth) * scene.depth_scale
    depth = np.full(scene.depth.shape, table)
    depth[:, ::2, ::2] += step
    depth[:, ::5] -= step
    depth[:, 1::7] += 2 * step
    masks = MASKS["arc"]
    views = [
        strand.View.from_depth(each, scene.intrinsics, pose, mask=mask)
        for each, pose, mask in zip(depth, scene.poses, masks, strict=True)
    ]
    found = find_misplaced_masks(views, [0, 1, 2], None, np.array([scene.radius]))
    assert [mask.view for mask in found] == named


@pytest.mark.parametrize("device", ["d435", "zed"])
def test_ends_just_behind_a_crossing_are_those_of_two_ropes(device):
    # their other ends are almost in line, so that masks alone show one rope with two bumps
    radius, past, turn = 4e-3, 4.0, np.radians(35.0)
    along = np.linspace(-past * radius, 0.1, 150)
    height = radius + 2.0 * radius * np.exp(-((along / (2.5 * radius)) ** 4))
    over = np.column_stack([along * np.cos(turn), -along * np.sin(turn), height])
    under = np.column_stack([-along, np.zeros(150), np.full(150, radius)])
    made = strand.synthetic.scene(
        chains=[over, under],
        radius=radius,
        seed=1,
        views=1,
        camera=strand.synthetic.Camera(device, size=(640, 480)),
        mask=strand.synthetic.Segmentation(),
        layout=strand.synthetic.Layout(distance=0.5, elevation=np.radians(80.0)),
    )
    assert len(strand.reconstruct(made.views, radius).chains) == 2


def test_tubes_are_not_sought_in_masks_that_strand_found():
    made = strand.synthetic.frame_scene("usual", 2)
    model = strand.reconstruct(made.views)
    assert "readings" in model.timings
    assert "arcs" not in model.timings
