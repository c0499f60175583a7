"""Options that several commands have: what names a scene, and what may be known of it."""

from __future__ import annotations

import argparse
import re

from strand.cli import values
from strand.io.budget import MAX_BYTES
from strand.io.recordings.recording import TOLERANCE


def add_scene(command: argparse.ArgumentParser) -> None:
    """Add what names a scene, and what single files do not say of themselves."""
    command.add_argument(
        "scene",
        type=values.path,
        nargs="+",
        metavar="SCENE",
        help="a folder with a scene.toml, an .npz file, a single file of one view: points "
        "(.ply, .pcd, .npy, .xyz, .csv, ...) or a depth image (.png, .tiff, .npy); or a recording: a .bag, "
        ".mcap or .db3 file, or the folder of a ROS 2 bag",
    )
    add_camera(command)
    group = command.add_argument_group("recordings")
    add_recording(group)
    group.add_argument(
        "--frame", type=int, metavar="N", help="which frame, or the first of several, from 0 (default: 0)"
    )


def add_camera(command: argparse.ArgumentParser) -> None:
    """Add what single files do not say of themselves."""
    command.add_argument(
        "--viewpoint",
        type=values.place,
        metavar="X,Y,Z",
        help="where the camera was: a single file's points are in the world frame, metres",
    )
    command.add_argument(
        "--camera-frame",
        action="store_true",
        help="a single file's points are in the camera frame: x right, y down, z forward",
    )
    command.add_argument(
        "--intrinsics",
        type=values.intrinsics,
        metavar="FX,FY,CX,CY",
        help="the camera of a single depth image, or of a recording without CameraInfo, pixels; or a file "
        "with its 3 x 3 matrix",
    )
    command.add_argument(
        "--depth-scale",
        type=float,
        metavar="METRES",
        help="what a unit of a single depth image or a recording's is, such as 0.001 (default: floats are "
        "metres, and a recording's whole numbers what it says, else 0.001)",
    )


def add_recording(group: argparse._ArgumentGroup) -> None:
    """Add which of a recording's topics are read, and how."""
    group.add_argument(
        "--topic",
        nargs="+",
        metavar="TOPIC",
        help="topics with depth, one a camera; * stands for any text (default: the only one with depth)",
    )
    group.add_argument(
        "--world",
        metavar="FRAME",
        help="the TF frame that is the world frame (default: the frame of the only camera)",
    )
    group.add_argument(
        "--tolerance",
        type=float,
        metavar="SECONDS",
        help=f"how far apart in time the cameras' images may be (default: {TOLERANCE})",
    )
    group.add_argument(
        "--ignore-distortion", action="store_true", help="take images of lenses that distort as they are"
    )


def add_known(command: argparse.ArgumentParser) -> None:
    """Add what may be known of a scene, and how it is worked on."""
    add_ropes(command)
    command.add_argument(
        "--mask",
        type=values.path,
        nargs="+",
        metavar="PATH",
        help="where the ropes are in each depth image: a PNG or NPY file for each view; 0 is no rope, other "
        "numbers are ropes or pieces of them (default: the scene's)",
    )


def add_ropes(command: argparse.ArgumentParser) -> None:
    """Add what may be known of ropes in any scene, and how it is worked on."""
    command.add_argument(
        "--radius",
        type=values.length,
        metavar="LENGTH",
        help="the ropes' radius, such as 4.2mm (default: the scene's; estimated if it has none)",
    )
    command.add_argument(
        "--ropes", type=int, metavar="N", help="how many there are (default: as many as the data show)"
    )
    command.add_argument(
        "--length",
        type=values.length,
        nargs="+",
        metavar="LENGTH",
        help="how long they are, such as 0.4m: one length for all, or one for each (default: not known)",
    )
    command.add_argument(
        "--bounds",
        type=values.length,
        nargs=6,
        metavar=("X0", "Y0", "Z0", "X1", "Y1", "Z1"),
        help="extraction range in the world frame, low and high corner, metres (default: the scene's)",
    )
    command.add_argument(
        "--config", type=values.path, metavar="FILE", help="a TOML file with the method's numbers"
    )
    add_limits(command)
    command.add_argument(
        "--deadline",
        type=float,
        metavar="SECONDS",
        help="leave out what an answer can do without after this time (default: never)",
    )
    # lengths such as -4mm are values, not options
    command._negative_number_matcher = re.compile(r"^-\.?\d")


def add_limits(command: argparse.ArgumentParser) -> None:
    """Add what may be read of files."""
    command.add_argument(
        "--max-bytes",
        type=int,
        default=MAX_BYTES,
        metavar="N",
        help=f"how much memory the scene's files may take (default: {MAX_BYTES})",
    )
    command.add_argument(
        "--outside",
        action="store_true",
        help="let the scene.toml name files outside of its folder, which may be any of yours",
    )
