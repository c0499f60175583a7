"""Simulated sequences of moving ropes: their physics, what the kinds do, and their truth."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import strand
from strand.synthetic import SEQUENCES, Segmentation, sequence
from strand.synthetic.sequence_truth import find_crossings

RATE = 30.0


@cache
def make(kind, seed=0):
    return sequence(kind, seed)


def track(made, rope=0):
    """Return the (T, N, 3) nodes of a rope."""
    return np.stack([ropes[rope] for ropes in made.nodes])


def measure_speeds(made, rope=0):
    nodes = track(made, rope)
    return np.linalg.norm(np.diff(nodes, axis=0), axis=2) / np.diff(made.times)[:, None]


def list_crossings(made):
    return [find_crossings(nodes, made.spacings, made.radius) for nodes in made.nodes]


def measure_hidden(made, numbers):
    return np.array([np.concatenate(made[number].hidden).mean() for number in numbers])


def measure_gap(nodes, spacings, radius):
    """Return the least distance between the axes of strands, from places half a radius apart."""
    places, ropes, along = [], [], []
    for number, (rope, spacing) in enumerate(zip(nodes, spacings, strict=True)):
        s = np.arange(len(rope)) * spacing
        at = np.arange(0.0, s[-1], 0.5 * radius)
        places.append(np.column_stack([np.interp(at, s, axis) for axis in rope.T]))
        ropes.append(np.full(len(at), number))
        along.append(at)
    places, ropes, along = (np.concatenate(parts) for parts in (places, ropes, along))
    apart = (ropes[:, None] != ropes) | (np.abs(along[:, None] - along) > 6.0 * radius)
    return np.linalg.norm(places[:, None] - places, axis=2)[apart].min(initial=np.inf)


@pytest.mark.parametrize("kind", SEQUENCES)
def test_ropes_keep_their_length_and_lie_on_the_table_and_on_each_other(kind):
    made = make(kind)
    assert len(made) == len(made.times) == 90
    assert 0.0035 <= made.radius <= 0.005
    for rope, spacing in enumerate(made.spacings):
        nodes = track(made, rope)
        steps = np.linalg.norm(np.diff(nodes, axis=1), axis=2)
        np.testing.assert_allclose(steps, spacing, rtol=0.02)
        assert 0.4 <= spacing * (nodes.shape[1] - 1) <= 1.0
        assert nodes[..., 2].min() > made.radius - 1e-6
        ways = np.diff(nodes, axis=1) / steps[..., None]
        # no kinks
        assert np.degrees(np.arccos((ways[:, 1:] * ways[:, :-1]).sum(axis=2).min())) < 70.0
        assert np.abs(nodes[:6] - nodes[0]).max() < 0.002
    for nodes in made.nodes[::9]:
        assert measure_gap(nodes, made.spacings, made.radius) > 2.0 * 0.9 * made.radius


@pytest.mark.parametrize("kind", ["loop", "two"])
def test_a_crossing_is_made_by_the_end_and_stays(kind):
    made = make(kind)
    found = list_crossings(made)
    assert found[0] == ()
    assert len(found[-1]) == 1
    first = next(number for number, crossings in enumerate(found) if crossings)
    length = made.spacings[0] * (len(made.nodes[0][0]) - 1)
    for number, crossings in enumerate(found[first:], first):
        ((rope, over),) = [one.over for one in crossings]
        assert rope == 0
        if number == first:
            assert over > length - 0.03
        if kind == "loop":
            assert over > crossings[0].under[1] + 0.1
        else:
            assert crossings[0].under[0] == 1
    # the gripper has opened, and gone
    frame = made[-1]
    assert frame.crossings == found[-1]
    assert [gripper.holds for gripper in frame.grippers] == [False]
    assert frame.grippers[0].pose[2, 3] > 0.04


def test_a_crossing_is_undone():
    found = list_crossings(make("unloop"))
    assert [len(crossings) for crossings in found[:20]] == [1] * 20
    assert found[-1] == found[60] == ()


def test_an_end_is_carried_and_friction_holds_the_other():
    made = make("carry")
    speeds = measure_speeds(made)
    (gripper,) = made[45].grippers
    assert gripper.holds
    along = np.arange(speeds.shape[1]) * made.spacings[0]
    place = [np.interp(gripper.s, along, axis) for axis in made.nodes[45][0].T]
    assert np.linalg.norm(place - gripper.pose[:3, 3]) < 0.001
    held = round(gripper.s / made.spacings[0])
    assert 0.2 < speeds[:, held].max() < 0.5
    moved = np.linalg.norm(made.nodes[-1][0] - made.nodes[0][0], axis=1)
    assert moved[0] < 0.01
    assert np.linalg.norm(track(made)[:, held] - made.nodes[0][0][held], axis=1).max() > 0.1


@pytest.mark.parametrize("kind", ["wave", "barwave"])
def test_a_rope_is_waved_in_the_air(kind):
    made = make(kind)
    assert 0.9 < measure_speeds(made).max() < 1.5
    assert track(made)[..., 2].min() > 0.05
    assert len(made[0].grippers) == 2


def test_a_rope_slides_along_its_own_axis():
    made = make("slide")
    nodes, speeds = track(made), measure_speeds(made)
    moving = np.flatnonzero(speeds.min(axis=1) > 0.1)
    assert len(moving) > 15
    ways = np.diff(nodes, axis=0)[moving]
    tangents = np.gradient(nodes[moving], axis=1)
    along = (ways * tangents).sum(axis=2)
    along /= np.linalg.norm(ways, axis=2) * np.linalg.norm(tangents, axis=2)
    assert np.median(along) > 0.98
    assert np.linalg.norm(nodes[-1] - nodes[0], axis=1).min() > 0.1


def test_a_still_rope_is_still():
    assert np.ptp(track(make("still")), axis=0).max() < 0.001
    assert make("still")[3].grippers == ()


@pytest.mark.parametrize("kind", ["bar", "barwave"])
def test_a_bar_hides_a_part_for_a_while(kind):
    numbers = range(0, 90, 5)
    hidden = measure_hidden(make(kind), numbers)
    assert hidden[:2].max() < 0.15
    assert hidden.max() < 0.65
    assert 0.5 <= (hidden > 0.2).sum() * 5 / RATE <= 2.2
    assert hidden[-1] < 0.2


@pytest.mark.parametrize("seed", [0, 1])
def test_nothing_is_seen_in_a_blackout(seed):
    made = make("blackout", seed)
    hidden = measure_hidden(made, range(0, 90, 5))
    dark = np.flatnonzero(hidden == 1.0) * 5
    assert 0.3 <= len(dark) * 5 / RATE <= 1.2
    frame = made[int(dark[1])]
    assert not frame.labels.any()
    # a plate, or an empty image
    assert frame.occluders.all() == (seed == 0)
    assert frame.depth.any() == (seed == 0)
    assert not frame.mask.any()


@pytest.mark.parametrize(("kind", "number"), [("bar", 45), ("two", 60), ("loop", 80), ("unloop", 2)])
def test_hidden_nodes_are_those_that_the_image_does_not_show(kind, number):
    frame = make(kind)[number]
    pose, hidden = frame.poses[0], np.concatenate(frame.hidden)
    owner = np.concatenate([np.full(len(rope), i) for i, rope in enumerate(frame.nodes, 1)])
    seen = (np.concatenate(frame.nodes) - pose[:3, 3]) @ pose[:3, :3]
    columns, rows = np.rint((seen @ frame.intrinsics.T)[:, :2] / seen[:, 2:]).astype(int).T
    shown, depth = frame.labels[0, rows, columns], frame.depth[0, rows, columns] * frame.depth_scale
    np.testing.assert_array_equal(shown[~hidden], owner[~hidden])
    # the tubes' surfaces are about a radius nearer than their axes
    assert np.median(np.abs(depth - seen[:, 2])[~hidden]) < 2.0 * make(kind).radius
    assert ((shown != owner) | (depth < seen[:, 2] - 1.5 * make(kind).radius))[hidden].mean() > 0.9
    assert 0.0 < hidden.mean() < 0.7


def test_masks_are_ragged_labels_are_exact_and_grippers_are_occluders():
    frame = make("carry")[20]
    exact, mask = frame.labels[0] > 0, frame.mask[0]
    assert mask.dtype == bool
    assert 0.7 < (exact & mask).sum() / (exact | mask).sum() < 0.99
    assert not (exact & frame.occluders[0]).any()
    gripper = frame.grippers[0].pose[:3, 3]
    seen = (gripper - frame.poses[0][:3, 3]) @ frame.poses[0][:3, :3]
    column, row = np.rint((frame.intrinsics @ seen)[:2] / seen[2]).astype(int)
    assert frame.occluders[0, row, column]
    view = frame.view()
    assert isinstance(view, strand.View)
    np.testing.assert_array_equal(view.mask, mask)
    assert len(frame.views) == 1
    assert frame.view(occluders=True).measured is not None


def test_the_same_seed_gives_the_same_bits_in_any_order():
    made, fewer = make("carry"), sequence("carry", frames=12)
    assert len(fewer) == 12
    late, early = fewer[11], fewer[2]
    for frame in (made[2], made[11]):
        other = early if frame.number == 2 else late
        for name in ("depth", "mask", "labels", "occluders", "time"):
            np.testing.assert_array_equal(getattr(frame, name), getattr(other, name))
        np.testing.assert_array_equal(frame.nodes[0], other.nodes[0])
    assert not np.array_equal(sequence("carry", 1, frames=1).nodes[0][0][:9], made.nodes[0][0][:9])
    np.testing.assert_array_equal(fewer[-1].depth, late.depth)
    assert [frame.number for frame in fewer][-1] == 11
    with pytest.raises(IndexError, match="number"):
        fewer[12]


def test_times_rise_unevenly():
    gaps = np.diff(make("still").times)
    assert gaps.min() > 0.015
    assert gaps.mean() == pytest.approx(1.0 / RATE, rel=0.02)
    assert 0.001 < gaps.std() < 0.006


def test_cameras_color_and_devices():
    made = sequence("still", camera="d435", views=2, frames=1, color=True)
    frame, plain = made[0], make("still")[0]
    assert frame.depth.shape == (2, 480, 640)
    assert frame.color.shape == (2, 480, 640, 3)
    np.testing.assert_array_equal(frame.poses[0], plain.poses[0])
    np.testing.assert_array_equal(frame.labels[0], plain.labels[0])
    assert not np.array_equal(frame.depth[0], plain.depth[0])
    # the rope differs from the table
    inside, outside = frame.color[0][frame.labels[0] > 0], frame.color[0][frame.labels[0] == 0]
    assert np.abs(np.median(inside, axis=0) - np.median(outside, axis=0)).max() > 50
    assert plain.color is None
    assert frame.view(1).colors is not None


@pytest.mark.parametrize(
    ("name", "error", "arguments"),
    [
        ("kind", ValueError, {"kind": "carried"}),
        ("kind", TypeError, {"kind": 3}),
        ("seed", ValueError, {"seed": -1}),
        ("seed", TypeError, {"seed": 0.5}),
        ("camera", ValueError, {"camera": "d999"}),
        ("camera", TypeError, {"camera": Segmentation()}),
        ("views", ValueError, {"views": 0}),
        ("frames", ValueError, {"frames": 0}),
        ("frames", TypeError, {"frames": 1.5}),
        ("color", TypeError, {"color": 1}),
    ],
)
def test_wrong_arguments_are_refused(name, error, arguments):
    with pytest.raises(error, match=f"^{name}"):
        sequence(**{"kind": "still", **arguments})


def test_a_view_of_no_camera_is_refused():
    frame = make("still")[0]
    with pytest.raises(ValueError, match="camera"):
        frame.view(1)
    with pytest.raises(TypeError, match="occluders"):
        frame.view(occluders=1)
