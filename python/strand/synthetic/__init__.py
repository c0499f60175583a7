"""Simulated scenes: depth images of ropes with known centrelines, for tests and users without a camera."""

from strand.synthetic.camera import Camera, camera_pose
from strand.synthetic.cluttered_scenes import cluttered_scene
from strand.synthetic.color_scenes import COLOR_KINDS, ColorScene, color_scene
from strand.synthetic.depth_camera import CAMERAS, DepthCamera
from strand.synthetic.frame_scenes import FRAMES, frame_scene
from strand.synthetic.grippers import Gripper
from strand.synthetic.harness_scenes import HARNESSES, HarnessScene, harness
from strand.synthetic.layout import Layout
from strand.synthetic.noise import Noise, sense
from strand.synthetic.painting import Paint, paint_scene
from strand.synthetic.random_curves import random_ropes
from strand.synthetic.rendering import render_depth
from strand.synthetic.rough_scenes import ROUGH, rough_scene
from strand.synthetic.scenes import SyntheticScene, scene
from strand.synthetic.segmentation import Segmentation
from strand.synthetic.sequence_frames import SequenceFrame
from strand.synthetic.sequence_truth import TrueCrossing
from strand.synthetic.sequences import SEQUENCES, SyntheticSequence, sequence
from strand.synthetic.shapes import SHAPES, shape

__all__ = [
    "CAMERAS",
    "COLOR_KINDS",
    "FRAMES",
    "HARNESSES",
    "ROUGH",
    "SEQUENCES",
    "SHAPES",
    "Camera",
    "ColorScene",
    "DepthCamera",
    "Gripper",
    "HarnessScene",
    "Layout",
    "Noise",
    "Paint",
    "Segmentation",
    "SequenceFrame",
    "SyntheticScene",
    "SyntheticSequence",
    "TrueCrossing",
    "camera_pose",
    "cluttered_scene",
    "color_scene",
    "frame_scene",
    "harness",
    "paint_scene",
    "random_ropes",
    "render_depth",
    "rough_scene",
    "scene",
    "sense",
    "sequence",
    "shape",
]
