"""Calls of the functions that simulate scenes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from shared.public.scenes import DEPTH, LINE, MASK, K, R, make_frame, make_scene
from shared.public.surface import Call
from strand import synthetic
from strand.synthetic import Camera, DepthCamera, Layout, Noise, Paint, Segmentation


def list_calls(folder: Path) -> dict[str, Call]:
    """Return the calls by their names."""
    return _list_scenes(folder) | _list_parts()


def _seeded(function: Any) -> Any:
    """Return the function with random numbers that are the same in every call."""

    def call(**given: Any) -> Any:
        rng = given["rng"]
        return function(
            **given | {"rng": np.random.default_rng(0) if isinstance(rng, np.random.Generator) else rng}
        )

    return call


def _list_scenes(folder: Path) -> dict[str, Call]:
    size = {"size": (64, 48)}
    seed = {"seed": 0}
    options = {
        "views": 1,
        "camera": Camera(**size),
        "noise": Noise(),
        "mask": Segmentation(),
        "layout": Layout(),
    }

    def save(**given: Any) -> None:
        make_scene().save(**given)

    return {
        "synthetic.scene": Call(
            synthetic.scene,
            {"name": "straight", "radius": R, "length": 0.1, **seed, **options},
            {"chains": [LINE], "radius": np.array([R]), **seed, **options},
        ),
        "synthetic.cluttered_scene": Call(synthetic.cluttered_scene, {**seed, "views": 1, "rope": True}),
        "synthetic.color_scene": Call(synthetic.color_scene, {"kind": "plain", **seed, "rope": True}),
        "synthetic.frame_scene": Call(synthetic.frame_scene, {"kind": synthetic.FRAMES[0], **seed}),
        "synthetic.harness": Call(
            synthetic.harness,
            {
                "kind": "tree",
                **seed,
                **{name: options[name] for name in ("views", "camera", "noise", "mask")},
            },
        ),
        "synthetic.rough_scene": Call(
            synthetic.rough_scene, {"kind": synthetic.ROUGH[0], **seed, "device": "d435", "views": 1}
        ),
        "synthetic.sequence": Call(
            synthetic.sequence,
            {"kind": "still", **seed, "camera": "d435", "views": 1, "frames": 1, "color": False},
        ),
        "synthetic.SequenceFrame.view": Call(make_frame().view, {"camera": 0, "occluders": False}),
        "synthetic.SyntheticSequence.save": Call(
            synthetic.sequence("still", frames=1).save, {"path": folder / "saved.mcap"}
        ),
        "synthetic.SyntheticScene.save": Call(save, {"path": folder / "saved.npz"}),
        "synthetic.paint_scene": Call(
            synthetic.paint_scene,
            {"scene": synthetic.scene("straight", views=1, mask=Segmentation()), "paint": Paint(), **seed},
        ),
        "synthetic.random_ropes": Call(
            synthetic.random_ropes, {"crossings": 1, "ropes": 1, "radius": R, **seed}
        ),
        "synthetic.shape": Call(synthetic.shape, {"name": "loop", "radius": R, "length": 0.4}),
        "synthetic.render_depth": Call(
            synthetic.render_depth,
            {"chains": [LINE], "radius": R, "intrinsics": K, "pose": np.eye(4), **size, "table": 0.5},
            {"chains": [LINE], "radius": np.array([R]), "intrinsics": K, "pose": np.eye(4), **size},
        ),
        "synthetic.camera_pose": Call(
            synthetic.camera_pose, {"azimuth": 0.1, "distance": 0.5, "elevation": 0.7}
        ),
    }


def _list_parts() -> dict[str, Call]:
    camera = synthetic.CAMERAS["d435"]
    rng = {"rng": np.random.default_rng(0)}
    return {
        "synthetic.sense": Call(
            _seeded(synthetic.sense),
            {"depth": DEPTH, "noise": 1e-3, "flying": 0.05, "step": R, "depth_scale": 1e-4, **rng},
        ),
        "synthetic.Camera": Call(Camera, {"device": "d435", "size": (64, 48), "depth_scale": 1e-4}),
        "synthetic.DepthCamera": Call(
            DepthCamera,
            {name: getattr(camera, name) for name in camera.__dataclass_fields__}
            | {"grain": ((1.0, 1.0), (2.0, 0.5)), "missing": 0.1, "missing_edge": 0.1},
        ),
        "synthetic.DepthCamera.sense": Call(
            _seeded(camera.sense),
            {"depth": np.where(MASK, DEPTH, 5.0), "intrinsics": K, "depth_scale": 1e-4, **rng},
        ),
        "synthetic.DepthCamera.with_noise": Call(
            camera.with_noise, {"noise": 1e-3, "focal_length": 600.0, "distance": 0.5}
        ),
        "synthetic.Layout": Call(
            Layout, {"distance": 0.5, "elevation": 0.7, "wall": 0.4, "bars": [(LINE, 0.01)]}
        ),
        "synthetic.Layout.find_background": Call(Layout().find_background, {"distance": 0.5}),
        "synthetic.Layout.place_cameras": Call(
            Layout().place_cameras, {"views": 2, "nodes": LINE, "radius": R, "size": (64, 48)}
        ),
        "synthetic.Noise": Call(Noise, {"depth": 1e-3, "flying": 0.05, "turn": 0.01, "shift": 1e-3}),
        "synthetic.Noise.misplace": Call(_seeded(Noise().misplace), {"poses": make_scene().poses, **rng}),
        "synthetic.Paint": Call(
            Paint,
            {
                "ropes": (((0.75, 0.1, 0.1),),),
                "table": (0.6, 0.6, 0.58),
                "texture": "plain",
                "shadow": 0.4,
                "softness": 1.0,
                "highlight": 0.2,
                "noise": 0.008,
                "light": (0.4, 0.3, 1.0),
            },
        ),
        "synthetic.Segmentation": Call(
            Segmentation, {"grow": 1, "ragged": 0.1, "lost": 0.1, "taken": 0.1, "patch": 1.5, "filled": 0.1}
        ),
        "synthetic.Segmentation.make_mask": Call(
            _seeded(Segmentation(grow=1, ragged=0.1, lost=0.1).make_mask), {"ropes": MASK, **rng}
        ),
    }
