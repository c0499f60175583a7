"""Tests of the time of views: who keeps it, and which one a model, a file and a message have."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import jsonschema
import numpy as np
import pytest

import strand
from shared.ropes import draw_circle
from strand import msgs

K = [[200.0, 0.0, 19.5], [0.0, 200.0, 14.5], [0.0, 0.0, 1.0]]
DEPTH = np.full((30, 40), 0.5)
POINTS = np.random.default_rng(0).uniform(0.1, 1.0, (30, 3))
STAMP = 1_700_000_000.25
CHAINS = (draw_circle(0.05, 40, True),)
POSES = np.eye(4)[None]


def make_views(stamp):
    return (
        strand.View(POINTS, stamp=stamp),
        strand.View(np.ones((4, 5, 3)), stamp=stamp),
        strand.View.from_depth(DEPTH, K, mask=DEPTH > 0, stamp=stamp),
        strand.View.from_world(POINTS, [0.0, 0.0, 2.0], stamp=stamp),
    )


def test_views_made_of_a_view_keep_its_time():
    for view in make_views(STAMP):
        moved = view.moved(np.eye(4))
        cropped = view.crop(([-1.0] * 3, [1.0] * 3))
        chosen = view.select(np.ones(len(view.points), dtype=bool))
        assert [one.stamp for one in (view, moved, cropped, chosen)] == [STAMP] * 4
    assert [view.stamp for view in make_views(None)] == [None] * 4


@pytest.mark.parametrize(
    ("stamp", "error", "reason"),
    [
        (1_700_000_000_000_000_000, ValueError, "stamp: expected seconds, got 1.*, as large as nanoseconds"),
        (np.nan, ValueError, "stamp: expected a finite number"),
        ("now", TypeError, "stamp: expected a number, got str"),
    ],
)
def test_wrong_times_are_named(stamp, error, reason):
    for call in (make_views, lambda one: strand.Model(CHAINS, POSES, stamp=one)):
        with pytest.raises(error, match=reason):
            call(stamp)


@pytest.mark.parametrize(
    ("stamps", "latest"), [((None, None, None), None), ((2.5, None, 1.0), 2.5), ((-3.0, -2.0, None), -2.0)]
)
def test_a_model_has_the_latest_time_of_its_views(stamps, latest):
    made = strand.synthetic.scene("arc", views=3, camera=strand.synthetic.Camera(size=(160, 120)))
    views = [
        strand.View.from_depth(depth, made.intrinsics, pose, depth_scale=made.depth_scale, stamp=stamp)
        for depth, pose, stamp in zip(made.depth, made.poses, stamps, strict=True)
    ]
    model = strand.reconstruct(views, made.radius, made.bounds, ropes=1)
    assert model.stamp == latest


def test_a_file_holds_the_time_and_one_without_it_keeps_its_bytes(tmp_path):
    path = tmp_path / "model.json"
    strand.Model(CHAINS, POSES, stamp=STAMP).save(path)
    assert strand.load_model(path).stamp == STAMP
    content = json.loads(path.read_text())
    schema = json.loads((Path(__file__).parents[3] / "docs" / "model.schema.json").read_text())
    jsonschema.Draft202012Validator(schema).validate(content)
    strand.Model(CHAINS, POSES).save(path)
    assert content.pop("stamp") == STAMP
    assert json.loads(path.read_text()) == content
    assert strand.load_model(path).stamp is None
    path.write_text(json.dumps(content | {"stamp": "now"}))
    with pytest.raises(strand.FileFormatError, match="stamp: expected a number"):
        strand.load_model(path)


def test_messages_have_the_time_of_their_model_unless_another_is_given():
    for make in (msgs.make_marker_array, lambda model, *rest: msgs.make_planning_scene(model, 1e-3, *rest)):
        for stamp, given, want in (
            (STAMP, (), (1_700_000_000, 250_000_000)),
            (STAMP, (7,), (0, 7)),
            (STAMP, (0,), (0, 0)),
            (None, (), (0, 0)),
        ):
            message = make(strand.Model(CHAINS, POSES, stamp=stamp), "table", *given)
            head = (message.get("markers") or message["world"]["collision_objects"])[0]["header"]["stamp"]
            assert (head["sec"], head["nanosec"]) == want


@pytest.mark.parametrize("names", [("sec", "nanosec"), ("secs", "nsecs")])
def test_views_of_messages_have_the_time_of_the_header(names):
    values = msgs.make_point_cloud2(POINTS, "camera")
    values["fields"] = [SimpleNamespace(**field) for field in values["fields"]]
    for sec, want in ((1_700_000_000, STAMP), (0, None)):
        stamp = SimpleNamespace(**dict(zip(names, (sec, 250_000_000 * (sec > 0)), strict=True)))
        message = SimpleNamespace(**{**values, "header": SimpleNamespace(stamp=stamp)})
        assert msgs.read_view(message).stamp == want


def test_a_tracker_takes_the_times_of_views_by_default():
    frames = strand.synthetic.sequence("carry", seed=1, frames=2)
    stamped = [
        strand.View.from_depth(view.image.depth, frames.intrinsics, view.pose, mask=view.mask, stamp=at)
        for view, at in ((frame.view(), 5.0 + 0.1 * k) for k, frame in enumerate(frames))
    ]
    tracker = strand.Tracker(radius=frames.radius, ropes=1)
    tracks = [tracker.update([view]) for view in stamped]
    assert [track.time for track in tracks] == [5.0, 5.1]
    assert [track.model.stamp for track in tracks] == [5.0, 5.1]
    assert tracker.update([stamped[0]], 5.2).model.stamp == 5.2
