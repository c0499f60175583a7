"""Small scenes, models and files that public functions are called with."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np

import strand
from strand import synthetic
from strand.synthetic import SyntheticScene

R = 0.0042
LINE = np.stack([np.linspace(-0.08, 0.08, 161), np.zeros(161), np.full(161, R)], axis=1)
OVER = np.stack([np.zeros(161), np.linspace(-0.08, 0.08, 161), np.full(161, 3 * R)], axis=1)
CHAIN = strand.Chain(LINE, R)
RIVAL = strand.ropes.doubt.Doubt("rival", 1e4, "which strand is on top", "both fit", np.array([0.0, 0.0, R]))
MODEL = strand.Model((CHAIN, strand.Chain(OVER, R)), np.eye(4)[None], confidence=0.5, doubts=(RIVAL,))
CUBE = ([-1.0, -1.0, -1.0], [1.0, 1.0, 1.0])
K = np.array([[200.0, 0.0, 31.5], [0.0, 200.0, 23.5], [0.0, 0.0, 1.0]])
GRIPPER = strand.Gripper(opening=0.04, width=0.01, thickness=0.008, depth=0.04)
DEPTH = np.full((48, 64), 0.5)
MASK = np.zeros((48, 64), bool)
MASK[22:27, 4:60] = True
DEPTH[MASK] = 0.495
ON_TABLE = np.repeat(np.repeat(np.where(MASK, 0.49, 0.5), 3, axis=0), 3, axis=1)
COLORS = np.where(MASK[..., None], [0.8, 0.1, 0.1], [0.5, 0.5, 0.5])
CLOUD = np.random.default_rng(0).uniform(0.1, 1.0, (60, 3))
NORMALS = CLOUD / np.linalg.norm(CLOUD, axis=1, keepdims=True)
SHADES = np.abs(NORMALS)


@cache
def make_scene() -> SyntheticScene:
    """Return a straight rope on a table, seen by two small cameras."""
    return synthetic.scene(chains=[LINE], views=2, camera=synthetic.Camera(size=(160, 120)), seed=5)


@cache
def make_model() -> strand.Model:
    """Return its model with the stages."""
    scene = make_scene()
    return strand.reconstruct(scene.views, R, scene.bounds, ropes=1, keep_stages=True)


@cache
def make_published_model() -> strand.Model:
    """Return a model by the published method with the stages."""
    scene, config = synthetic.scene("straight", seed=2, views=2), strand.Config.published()
    return strand.reconstruct(scene.views, scene.radius, scene.bounds, config=config, keep_stages=True)


@cache
def make_frame() -> synthetic.SequenceFrame:
    """Return a frame of a rope that lies still."""
    return synthetic.sequence("still", frames=1)[0]


def make_tracker() -> strand.Tracker:
    """Return a tracker that has seen one frame, at 0 s."""
    return strand.Tracker.from_state(_make_state(), radius=R)


@cache
def _make_state() -> dict[str, np.ndarray]:
    tracker = strand.Tracker(radius=R, ropes=1)
    tracker.update([make_frame().view()], 0.0)
    return tracker.state


@cache
def make_track():
    """Return an answer of a tracker."""
    return make_tracker().predict(0.02)


def save_scene(folder: Path) -> Path:
    """Write the scene to a file, once."""
    path = folder / "scene.npz"
    if not path.exists():
        make_scene().save(path)
    return path


def make_cloud_message():
    """Return a message of points as ROS gives it."""
    message = SimpleNamespace(**strand.msgs.make_point_cloud2(CLOUD, "camera"))
    message.fields = [SimpleNamespace(**field) for field in message.fields]
    return message
