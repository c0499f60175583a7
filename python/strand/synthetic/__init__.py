"""Simulated ropes on a table and a depth camera that sees them: views with known true centrelines.

For users without a camera, and for demonstrations, tests and benches.
"""

from strand.synthetic.camera import camera_pose, render_depth, sense
from strand.synthetic.cluttered_scenes import cluttered
from strand.synthetic.depth_camera import CAMERAS, DepthCamera
from strand.synthetic.random_ropes import random_ropes
from strand.synthetic.rough_scenes import ROUGH, rough
from strand.synthetic.scenes import SyntheticScene, scene
from strand.synthetic.segmentation import Segmentation
from strand.synthetic.shapes import SHAPES, shape

__all__ = [
    "CAMERAS",
    "ROUGH",
    "SHAPES",
    "DepthCamera",
    "Segmentation",
    "SyntheticScene",
    "camera_pose",
    "cluttered",
    "random_ropes",
    "render_depth",
    "rough",
    "scene",
    "sense",
    "shape",
]
