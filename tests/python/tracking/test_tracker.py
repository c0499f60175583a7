"""Tracker: simulated sequences against their truth, invariances, saved states and wrong input."""

from __future__ import annotations

import io

import numpy as np
import pytest

import strand
from strand.synthetic import sequence
from strand.tracking.track import TrackedRope


def draw(kind, frames, **options):
    made = sequence(kind, 3, frames=frames, **options)
    return made, list(made)


@pytest.fixture(scope="module")
def carried():
    return draw("carry", 26)


@pytest.fixture(scope="module")
def still():
    return draw("still", 8, views=2)


@pytest.fixture(scope="module")
def pair():
    return draw("two", 14)


def track_all(made, frames, tracker=None, views=lambda frame: frame.views):
    tracker = tracker or strand.Tracker(made.radius, len(made.nodes[0]))
    return [tracker.update(views(frame), frame.time) for frame in frames]


def measure_points(rope, line):
    """Return how far (N,) true points are from the rope's at the same share of its length, for both ways."""
    shares = np.linspace(0.0, rope.s[-1], len(line))
    there = np.stack([np.interp(shares, rope.s, rope.points[:, k]) for k in range(3)], axis=1)
    return [np.linalg.norm(way - line, axis=1) for way in (there, there[::-1])]


def test_a_carried_rope_is_followed_in_one_direction(carried):
    made, frames = carried
    tracks = track_all(made, frames)
    ways = [
        int(np.argmin([off.mean() for off in measure_points(track.ropes[0], frame.nodes[0])]))
        for track, frame in zip(tracks, frames, strict=True)
    ]
    assert set(ways) == {ways[0]}
    for track, frame in zip(tracks[4:], frames[4:], strict=True):
        (rope,) = track.ropes
        off = measure_points(rope, frame.nodes[0])[ways[0]]
        assert np.median(off) < 1.5 * made.radius
        assert off.max() < 5.0 * made.radius
        assert rope.number == 0
        assert rope.generation == 0
    assert np.linalg.norm(frames[-1].nodes[0] - frames[0].nodes[0], axis=1).max() > 5.0 * made.radius


def test_deviations_and_hidden_nodes_agree_with_the_truth(carried):
    made, frames = carried
    tracks = track_all(made, frames)
    within, predicted, hidden, both = [], 0, 0, 0
    for track, frame in zip(tracks[4:], frames[4:], strict=True):
        (rope,) = track.ropes
        off = min(measure_points(rope, frame.nodes[0]), key=np.mean)
        turned = np.argmin([way.mean() for way in measure_points(rope, frame.nodes[0])])
        near = np.searchsorted(rope.s, np.linspace(0.0, rope.s[-1], len(off))).clip(max=len(rope.s) - 1)
        sd = np.sqrt(np.trace(rope.covariance[near], axis1=1, axis2=2))
        said = rope.predicted[near]
        if turned:
            sd, said = sd[::-1], said[::-1]
        within.append((off < 2.0 * sd).mean())
        predicted, hidden = predicted + said.sum(), hidden + frame.hidden[0].sum()
        both += (said & frame.hidden[0]).sum()
    assert np.mean(within) > 0.9
    assert both / hidden > 0.6
    assert both / predicted > 0.6


def test_velocity_and_prediction_go_ahead(carried):
    made, frames = carried
    tracker = strand.Tracker(made.radius, 1)
    tracks = track_all(made, frames, tracker)
    now = tracks[-1]
    speeds = np.linalg.norm(now.ropes[0].velocity, axis=1)
    moved = np.linalg.norm(frames[-1].nodes[0] - frames[-2].nodes[0], axis=1).max()
    assert speeds.max() == pytest.approx(moved / (frames[-1].time - frames[-2].time), rel=0.6)
    ahead = tracker.predict(now.time + 0.05)
    assert ahead.time == pytest.approx(now.time + 0.05)
    way = ahead.ropes[0].points - now.ropes[0].points
    assert np.allclose(way, 0.05 * now.ropes[0].velocity, atol=1e-12)
    grown = np.trace(ahead.ropes[0].covariance - now.ropes[0].covariance, axis1=1, axis2=2)
    assert (grown > 0).all()


def test_two_ropes_keep_their_numbers(pair):
    made, frames = pair
    tracks = track_all(made, frames)
    owners = []
    for track, frame in zip(tracks, frames, strict=True):
        assert [rope.number for rope in track.ropes] == [0, 1]
        owners.append(
            tuple(
                int(
                    np.argmin([min(off.mean() for off in measure_points(rope, line)) for line in frame.nodes])
                )
                for rope in track.ropes
            )
        )
    assert set(owners) == {owners[0]}
    assert sorted(owners[0]) == [0, 1]


def test_equal_frames_give_equal_bits_for_any_number_of_threads(carried):
    made, frames = carried
    before = strand.num_threads()
    try:
        answers = []
        for threads in (1, 2):
            strand.set_num_threads(threads)
            answers.append(track_all(made, frames[:10]))
    finally:
        strand.set_num_threads(before)
    for one, other in zip(*answers, strict=True):
        assert np.array_equal(one.ropes[0].points, other.ropes[0].points)
        assert np.array_equal(one.ropes[0].covariance, other.ropes[0].covariance)
        assert one.events == other.events


def test_a_moved_world_moves_the_answer(carried):
    made, frames = carried
    turn = strand.pose_from_angles(0.3, -0.2, 0.5, [0.4, 0.1, -0.7])
    model = strand.reconstruct(frames[0].views, made.radius, ropes=1)
    line = model.chains[0].points @ turn[:3, :3].T + turn[:3, 3]
    there = strand.Model((strand.Chain(line, made.radius),), poses=np.empty((0, 4, 4)), up=turn[:3, 2])
    own = track_all(made, frames[:6], strand.Tracker(made.radius, 1, model=model))
    moved = track_all(
        made,
        frames[:6],
        strand.Tracker(made.radius, 1, model=there),
        lambda frame: [view.moved(turn) for view in frame.views],
    )
    for one, other in zip(own, moved, strict=True):
        expected = one.ropes[0].points @ turn[:3, :3].T + turn[:3, 3]
        assert np.abs(other.ropes[0].points - expected).max() < 0.25 * made.radius


def test_several_cameras_and_one_that_drops_out(still):
    made, frames = still
    tracker = strand.Tracker(made.radius, 1)
    for number, frame in enumerate(frames):
        views = frame.views if number % 3 else [frame.views[0], None]
        track = tracker.update(views, [frame.time, frame.time - 0.004])
        (rope,) = track.ropes
        assert min(off.mean() for off in measure_points(rope, frame.nodes[0])) < 0.5 * made.radius
    assert track.image_times == (frames[-1].time, frames[-1].time - 0.004)


def test_a_saved_state_goes_on(carried):
    made, frames = carried
    tracker = strand.Tracker(made.radius, 1)
    track_all(made, frames[:10], tracker)
    file = io.BytesIO()
    np.savez(file, **tracker.state)
    file.seek(0)
    with np.load(file) as state:
        again = strand.Tracker.from_state(state, made.radius, 1)
    for frame in frames[10:13]:
        one, other = (each.update(frame.views, frame.time) for each in (tracker, again))
        assert np.abs(one.ropes[0].points - other.ropes[0].points).max() < 0.3 * made.radius
        assert other.ropes[0].number == 0
    with pytest.raises(ValueError, match="state: expected the arrays of"):
        strand.Tracker.from_state({"version": np.array(1)})


def test_an_anchor_moves_a_hidden_end(carried):
    made, frames = carried
    tracker = strand.Tracker(made.radius, 1)
    track = track_all(made, frames[:8], tracker)[-1]
    rope = track.ropes[0]
    goal = rope.points[-1] + [0.0, 0.0, 0.015]
    for step in range(1, 7):
        time = track.time + step / 30.0
        tracker.anchor(0, rope.length, goal, time)
        moved = tracker.update([empty_view(frames[7])], time)
    assert np.linalg.norm(moved.ropes[0].points[-1] - goal) < made.radius
    assert moved.ropes[0].state == "coasting"
    tracker.release(0, rope.length)
    with pytest.raises(ValueError, match="expected a place that is held"):
        tracker.release(0, 0.0)
    with pytest.raises(ValueError, match="rope: expected the number of a tracked rope"):
        tracker.anchor(4, 0.0, goal)


def empty_view(frame):
    """Return a view in which something covers everything."""
    depth = np.full(frame.depth[0].shape, 0.3)
    return strand.View.from_depth(depth, frame.intrinsics, frame.poses[0], mask=np.zeros(depth.shape, bool))


def test_nothing_seen_is_coasting_and_then_lost_and_found(carried):
    made, frames = carried
    tracker = strand.Tracker(made.radius, 1)
    last = track_all(made, frames[:8], tracker)[-1]
    states, kinds = [], []
    for step in range(1, 20):
        track = tracker.update([empty_view(frames[0])], last.time + step / 30.0)
        states.append(track.ropes[0].state)
        kinds += [event.kind for event in track.events]
        assert track.ropes[0].predicted.all()
        assert np.isfinite(track.ropes[0].points).all()
    assert states[0] == "coasting"
    assert states[-1] == "lost"
    assert "lost" in kinds
    for step in range(20, 24):
        track = tracker.update(frames[8].views, last.time + step / 30.0)
        kinds += [event.kind for event in track.events]
    assert track.ropes[0].state == "tracking"
    assert "found" in kinds


@pytest.mark.parametrize("gap", [0.6, 1.5])
@pytest.mark.parametrize("shift", [(0.0, 0.0, 0.0), (0.0, 0.1, 0.0), (0.2, 0.0, 0.0)])
def test_a_rope_that_moved_in_a_gap_is_lost_until_it_is_found(gap, shift):
    made, frames = draw("still", 18)
    tracker = strand.Tracker(made.radius, 1)
    track_all(made, frames[:10], tracker)
    states, events = [], []
    for frame in frames[10:]:
        views = [
            strand.View.from_depth(
                view.image.depth, frame.intrinsics, move(pose, shift), mask=view.mask, depth_scale=1.0
            )
            for view, pose in zip(frame.views, frame.poses, strict=True)
        ]
        track = tracker.update(views, frame.time + gap)
        (rope,) = track.ropes
        off = min(measure_points(rope, frame.nodes[0] + shift), key=np.max).max()
        states.append(rope.state)
        events += [event.kind for event in track.events]
        assert rope.state == "lost" or off < 2.0 * made.radius
    assert states[-3:] == ["tracking"] * 3
    assert events == (["lost", "restarted", "found"] if any(shift) else [])


def move(pose, shift):
    moved = np.array(pose)
    moved[:3, 3] += shift
    return moved


def test_a_tracked_rope_is_a_chain(still):
    made, frames = still
    track = track_all(made, frames[:2])[-1]
    (rope,) = track.ropes
    assert isinstance(rope, TrackedRope)
    assert rope.length == rope.s[-1] == rope.arc_length[-1]
    assert np.allclose(rope.at(rope.s[40]), rope.points[40], atol=1e-12)
    back = rope.reversed()
    assert np.allclose(back.points, rope.points[::-1])
    assert np.allclose(back.at(0.1), rope.at(rope.length - 0.1))
    assert track.model.chains[0].number == 0
    assert isinstance(track.model.crossings(), tuple)
    assert (rope.seen | rope.bridged | rope.predicted).all()
    assert np.linalg.eigvalsh(rope.covariance).min() > 0
    gripper = strand.Gripper(opening=0.05, width=0.01, thickness=0.008, depth=0.04)
    assert len(track.model.grasps(gripper)) > 0


def test_colours_take_the_place_of_masks():
    made, frames = draw("carry", 8, color=True)
    tracker = strand.Tracker(made.radius, 1)
    for frame in frames:
        view = strand.View.from_depth(
            frame.depth[0], frame.intrinsics, frame.poses[0], frame.color[0], depth_scale=frame.depth_scale
        )
        track = tracker.update([view], frame.time)
    (rope,) = track.ropes
    assert min(np.median(off) for off in measure_points(rope, frames[-1].nodes[0])) < 2.0 * made.radius


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda views, time: (views, time - 1.0), "time: expected a time after"),
        (lambda views, time: (views, float("nan")), "time: expected a finite number"),
        (lambda views, time: (views, 1e-5), "time: expected a time after 0 s, .* by 0.001 s"),
        (lambda views, time: (views * 2, time), "views: expected 1 cameras"),
        (lambda views, time: ([], time), "views: expected at least one view"),
        (lambda views, time: ([make_small(views[0])], time), r"views\[0\]: expected an image of"),
        (
            lambda views, time: ([strand.View(np.zeros((4, 3)) + 1.0)], time),
            r"views\[0\]: expected a view of a",
        ),
        (lambda views, time: (views, [time, time]), "time: expected one time, or one for each"),
    ],
)
def test_wrong_frames_are_refused_and_change_nothing(still, change, message):
    made, frames = still
    tracker = strand.Tracker(made.radius, 1)
    first = tracker.update(frames[0].views[:1], frames[0].time)
    views, time = change(frames[1].views[:1], frames[1].time)
    with pytest.raises(ValueError, match=message):
        tracker.update(views, time)
    assert np.array_equal(tracker.predict(first.time).ropes[0].points, first.ropes[0].points)


def test_cameras_have_times_of_their_own(still):
    made, frames = still
    tracker = strand.Tracker(made.radius, 1)
    tracker.update(frames[0].views, [0.0, 0.01])
    with pytest.raises(ValueError, match=r"time\[1\]: expected a time after 0.01"):
        tracker.update(frames[1].views, [0.03, 0.01])
    with pytest.raises(ValueError, match=r"time\[1\]: expected times within 0.5 s"):
        tracker.update(frames[1].views, [1.0, 0.03])
    tracker.update([None, None], 0.06)
    with pytest.raises(ValueError, match=r"views\[1\]: expected an image of"):
        tracker.update([frames[1].views[0], make_small(frames[1].views[1])], 0.09)


def test_frames_without_an_image_wait(still):
    made, frames = still
    tracker = strand.Tracker(made.radius, 1)
    assert tracker.update([None], 0.0).ropes == ()
    assert len(tracker.update(frames[0].views[:1], 0.03).ropes) == 1


def test_an_anchor_is_within_reach(still):
    made, frames = still
    tracker = strand.Tracker(made.radius, 1)
    rope = tracker.update(frames[0].views[:1], 0.0).ropes[0]
    with pytest.raises(ValueError, match="pose: expected a place that rope 0 reaches at 0 m"):
        tracker.anchor(0, 0.0, rope.points[0] + [0.0, 0.0, 0.5])
    for wrong in ("here", [1.0, 2.0], np.full(3, np.nan)):
        with pytest.raises((TypeError, ValueError), match="pose"):
            tracker.anchor(0, 0.0, wrong)
    # poses nearly at once say nothing of the speed
    tracker.anchor(0, rope.length, rope.points[-1], 0.02)
    tracker.anchor(0, rope.length, rope.points[-1] + 0.001, 0.0201)
    after = tracker.update(frames[1].views[:1], 0.033).ropes[0]
    assert np.linalg.norm(after.points[-1] - rope.points[-1]) < made.radius


def test_a_length_that_the_rope_cannot_have_is_not_believed(still):
    made, frames = still
    known = strand.Tracker(made.radius, 1, length=3.0)
    rope = known.update(frames[0].views[:1], 0.0).ropes[0]
    true = made.spacings[0] * (len(made.nodes[0][0]) - 1)
    assert abs(rope.length - true) < 10.0 * made.radius


@pytest.mark.parametrize(
    "damage",
    [
        lambda state: {name: state[name] for name in state if name != "rope0.nodes"},
        lambda state: state | {"table": np.full(4, np.nan)},
        lambda state: state | {"rope0.integers": state["rope0.integers"][:3]},
        lambda state: state | {"rope0.nodes": state["rope0.nodes"] * 1e30},
        lambda state: state | {"counts": np.array([1])},
        lambda state: state | {"version": np.array(99)},
    ],
)
def test_a_damaged_state_is_refused(still, damage):
    made, frames = still
    tracker = strand.Tracker(made.radius, 1)
    tracker.update(frames[0].views[:1], 0.0)
    with pytest.raises(ValueError, match="state: expected"):
        strand.Tracker.from_state(damage(tracker.state))


def make_small(view):
    image = view.image
    return strand.View.from_depth(image.depth[::2, ::2].copy(), [[300, 0, 160], [0, 300, 120], [0, 0, 1]])


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"radius": -1.0}, ValueError, "radius"),
        ({"ropes": 0}, ValueError, "ropes"),
        ({"radius": []}, ValueError, "radius: expected one number or several"),
        ({"length": [0.4, 0.5], "ropes": 3}, ValueError, "length: expected one length or 3"),
        ({"model": "rope"}, TypeError, "model: expected a Model"),
        ({"config": 3}, TypeError, "config: expected a Config"),
    ],
)
def test_wrong_settings_are_refused(options, error, message):
    with pytest.raises(error, match=message):
        strand.Tracker(**options)


def test_a_rope_goes_on_to_where_its_tip_is_seen_again(still):
    made, frames = still
    frame, radius = frames[0], made.radius
    view = frame.views[0]
    length = made.spacings[0] * (len(frame.nodes[0]) - 1)
    depth, mask = np.array(view.image.depth), np.array(view.mask)
    for s in np.arange(4.5, 9.5, 0.5) * radius:
        place = frame.nodes[0][round(s / made.spacings[0])]
        rows, columns, _ = view.image.find_pixels(place[None])
        half = round(2.5 * radius * made.intrinsics[0, 0] / depth[rows[0], columns[0]])
        around = slice(rows[0] - half, rows[0] + half + 1), slice(columns[0] - half, columns[0] + half + 1)
        depth[around], mask[around] = 0.9 * depth[around].min(), False
    covered = strand.View.from_depth(depth, made.intrinsics, frame.poses[0], mask=mask)
    tracker = strand.Tracker(radius, 1)
    rope = tracker.update([covered], frame.time).ropes[0]
    assert abs(rope.length - length) < 2.0 * radius


def test_a_rope_at_rest_lies_still():
    made, frames = draw("still", 40)
    lines = np.array([track.ropes[0].points for track in track_all(made, frames)[20:]])
    moved = np.linalg.norm(lines - lines.mean(axis=0), axis=2)
    assert moved.mean() < 0.025 * made.radius


def test_an_end_stays_straight_where_a_gripper_lets_go():
    made = sequence("two", 5, frames=60)
    for track in track_all(made, made)[45:]:
        for rope in track.ropes:
            for end in (rope.points[:13], rope.points[-13:]):
                edges = np.diff(end, axis=0)
                edges /= np.linalg.norm(edges, axis=1, keepdims=True)
                assert (edges @ edges.mean(axis=0)).min() > 0.5


def test_a_rope_without_masks_ends_at_the_grippers_that_hold_it():
    made = sequence("wave", 61, frames=1, color=True)
    frame = made[0]
    view = strand.View.from_depth(
        frame.depth[0], made.intrinsics, frame.poses[0], frame.color[0], depth_scale=frame.depth_scale
    )
    rope = strand.Tracker(made.radius, 1).update([view], frame.time).ropes[0]
    length = made.spacings[0] * (len(frame.nodes[0]) - 1)
    assert abs(rope.length - length) < 3.0 * made.radius
    off = min(measure_points(rope, frame.nodes[0]), key=lambda off: off.mean())
    assert off.max() < 4.0 * made.radius
