"""Calls of views, boxes, poses, configuration, tracking."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

import strand
from shared.public.scenes import (
    CLOUD,
    COLORS,
    DEPTH,
    MASK,
    SHADES,
    K,
    R,
    make_frame,
    make_model,
    make_tracker,
)
from shared.public.surface import Call

EYE = np.eye(4)
LOW, HIGH = np.zeros(3), np.ones(3)
SECTIONS = (
    "Filter",
    "Known",
    "Poses",
    "Tubes",
    "Linking",
    "Normals",
    "Registration",
    "Centerline",
    "Tracing",
    "Splitting",
    "Reconnection",
)


def list_calls(folder: Path) -> dict[str, Call]:
    """Return the calls by their names."""
    return _list_views() | _list_configuration(folder) | _list_tracking()


def _list_views() -> dict[str, Call]:
    view, box = strand.View(CLOUD, EYE, colors=SHADES), strand.Box(LOW, HIGH, EYE)
    return {
        "View": Call(
            strand.View,
            {"points": CLOUD, "pose": EYE, "dropped": 0, "colors": SHADES, "stamp": 1.5},
            {"points": np.ones((4, 5, 3)), "colors": np.ones((4, 5, 3))},
        ),
        "View.from_depth": Call(
            strand.View.from_depth,
            {
                "depth": DEPTH,
                "intrinsics": K,
                "pose": EYE,
                "colors": COLORS,
                "depth_scale": 1.0,
                "mask": MASK,
                "occluders": ~MASK,
                "stamp": 1.5,
            },
            {"depth": (DEPTH * 1e3).astype(np.uint16), "intrinsics": K, "depth_scale": 1e-3},
        ),
        "View.from_world": Call(
            strand.View.from_world,
            {"points": CLOUD, "viewpoint": np.array([0.0, 0.0, 9.0]), "colors": SHADES, "stamp": 1.5},
        ),
        "View.crop": Call(view.crop, {"bounds": (LOW, HIGH)}, {"bounds": box}),
        "View.moved": Call(view.moved, {"motion": EYE}),
        "View.select": Call(view.select, {"chosen": np.arange(len(CLOUD)) % 2 == 0}),
        "Box": Call(strand.Box, {"low": LOW, "high": HIGH, "pose": EYE}),
        "Box.express": Call(box.express, {"points": CLOUD}),
        "Box.express_directions": Call(box.express_directions, {"vectors": CLOUD}),
        "Box.express_pose": Call(box.express_pose, {"pose": EYE}),
        "Box.find_hull": Call(box.find_hull, {}),
        "Box.move_inside": Call(box.move_inside, {"points": CLOUD}),
        "Box.grown": Call(box.grown, {"margin": 0.1}),
        "Box.holds": Call(box.holds, {"points": CLOUD, "margin": 0.1}),
        "rotation_xyz": Call(strand.rotation_xyz, {"rx": 0.1, "ry": 0.2, "rz": 0.3}),
        "pose_from_angles": Call(
            strand.pose_from_angles, {"rx": 0.1, "ry": 0.2, "rz": 0.3, "origin": np.array([0.0, 0.0, 0.5])}
        ),
        "turntable_pose": Call(
            strand.turntable_pose,
            {"camera": EYE, "angle": 0.1, "center": LOW, "axis": np.array([0.0, 0.0, 1.0])},
        ),
    }


def _list_configuration(folder: Path) -> dict[str, Call]:
    path = folder / "config.toml"
    path.write_text("[filter]\nradius = 2.0\n", encoding="utf-8")
    config, sensor = strand.Config(sensor="d435"), strand.Sensor(sd=1e-3)
    sections = {name: getattr(strand.config, name) for name in SECTIONS}
    values = {"sd": 1e-3, "slope": 1e-3, "disparity": 0.1, "baseline": 0.05, "correlation": 1.0}
    values |= {"step": 1e-4, "disparity_step": 0.1, "bias": 1e-3, "lateral": 0.5}
    return {
        "Config": Call(
            strand.Config, {one.name: getattr(config, one.name) for one in dataclasses.fields(config)}
        ),
        "Config.published": Call(strand.Config.published, {}),
        "config.load": Call(strand.config.load, {"path": path}),
        **{
            f"config.{name}": Call(
                section, dataclasses.asdict(section()) | ({"noise": 1e-3} if name == "Tubes" else {})
            )
            for name, section in sections.items()
        },
        "Sensor": Call(strand.Sensor, values),
        "Sensor.at": Call(sensor.at, {"depth": 0.5, "focal": 600.0}),
    }


def _list_tracking() -> dict[str, Call]:
    view, model = make_frame().view(), make_model()
    state = make_tracker().state
    rope = make_tracker().predict(0.0).ropes[0]
    place = rope.at(0.1)

    def anchor(**given):
        tracker = make_tracker()
        tracker.anchor(**given)
        return tracker.state

    def release(**given):
        tracker = make_tracker()
        tracker.anchor(0, 0.1, place)
        tracker.release(**given)
        return tracker.state

    known = {"radius": R, "ropes": 1, "length": 0.4, "config": strand.Config()}
    many = {"radius": np.array([R]), "length": np.array([0.4])}
    return {
        "Tracker": Call(strand.Tracker, known | {"model": model}, many),
        "Tracker.from_state": Call(
            strand.Tracker.from_state, {"state": state, **known}, {"state": state, **many}
        ),
        "Tracker.update": Call(
            lambda **given: make_tracker().update(**given),
            {"views": [view], "time": 0.05},
            {"views": [view], "time": np.array([0.05])},
        ),
        "Tracker.predict": Call(lambda **given: make_tracker().predict(**given), {"time": 0.05}),
        "Tracker.anchor": Call(
            anchor,
            {"rope": 0, "s": 0.1, "pose": place, "time": 0.05},
            {"rope": 0, "s": 0.1, "pose": EYE + np.pad(place[:, None], ((0, 1), (3, 0)))},
        ),
        "Tracker.release": Call(release, {"rope": 0, "s": 0.1}),
    }
