"""Options that several commands share: the scene, and the user's knowledge of its ropes."""

from __future__ import annotations

import argparse
import re

from strand.cli import values
from strand.io.budget import MAX_BYTES
from strand.io.recordings.recording import TOLERANCE


def add_scene(command: argparse.ArgumentParser) -> None:
    """Add the scene, and the options of single files and of recordings."""
    command.add_argument(
        "scene",
        type=values.parse_path,
        nargs="+",
        metavar="SCENE",
        help="a folder with a scene.toml; an .npz file; a single view as points (.ply, .pcd, .npy, .xyz, "
        ".csv, ...) or as a depth image (.png, .tiff, .npy); or a recording as a .bag, .mcap or .db3 file or "
        "the folder of a ROS 2 bag or LeRobot data set",
    )
    add_camera(command)
    group = command.add_argument_group("recordings")
    add_recording(group)
    group.add_argument(
        "--frame", type=int, metavar="N", help="number of the first or only frame, from 0 (default: 0)"
    )
    add_episode(group)


def add_episode(group: argparse._ArgumentGroup) -> None:
    """Add the choice of an episode of a LeRobot data set."""
    group.add_argument(
        "--episode",
        type=int,
        metavar="N",
        help="take one episode of a LeRobot data set, whose --frame 0 is its first one (default: all)",
    )


def add_camera(command: argparse.ArgumentParser) -> None:
    """Add the camera's properties that a single file may lack."""
    command.add_argument(
        "--viewpoint",
        type=values.parse_position,
        metavar="X,Y,Z",
        help="the camera's position, metres, if a single file's points are in the world frame",
    )
    command.add_argument(
        "--camera-frame",
        action="store_true",
        help="a single file's points are in the camera frame: x right, y down, z forward",
    )
    add_pinhole(command)


def add_pinhole(command: argparse.ArgumentParser) -> None:
    """Add the pinhole and the unit of depth that depth images may lack."""
    command.add_argument(
        "--intrinsics",
        type=values.parse_intrinsics,
        metavar="FX,FY,CX,CY",
        help="intrinsics of a single depth image, or of a recording without CameraInfo such as a LeRobot "
        "data set, pixels; or a file with the 3 x 3 matrix",
    )
    command.add_argument(
        "--depth-scale",
        type=float,
        metavar="METRES",
        help="metres per unit of a single depth image or a recording, such as 0.001 (default: 1 for floats; "
        "for a recording's whole numbers its own scale, else 0.001)",
    )


def add_recording(group: argparse._ArgumentGroup) -> None:
    """Add the choice of a recording's topics, and how to read them."""
    group.add_argument(
        "--topic",
        nargs="+",
        metavar="TOPIC",
        help="depth topics, one per camera; * stands for any text (default: the only depth topic)",
    )
    group.add_argument(
        "--world",
        metavar="FRAME",
        help="the TF frame to use as world frame (default: the frame of the only camera)",
    )
    group.add_argument(
        "--tolerance",
        type=float,
        metavar="SECONDS",
        help=f"largest time between the cameras' images of one frame (default: {TOLERANCE})",
    )
    group.add_argument(
        "--ignore-distortion", action="store_true", help="use the images of lenses that distort as they are"
    )
    group.add_argument(
        "--color-topic",
        nargs="+",
        metavar="TOPIC",
        help="topics with the colours of the depth topics, one for each (default: the nearest by name)",
    )
    group.add_argument("--no-color", action="store_true", help="do not read colours of recordings")


def add_branches(command: argparse.ArgumentParser) -> None:
    """Add the user's knowledge of ropes that branch."""
    command.add_argument(
        "--branches",
        action="store_true",
        help="the ropes may branch, as a wire harness does: the model is a graph of junctions and ends",
    )
    command.add_argument(
        "--wire",
        type=values.parse_length,
        metavar="LENGTH",
        help="with --branches: the radius of one wire, such as 1.2mm, to count the wires of each branch",
    )


def add_priors(command: argparse.ArgumentParser) -> None:
    """Add the user's knowledge of the ropes, and masks, colours and occluders of the views."""
    add_ropes(command)
    add_deadline(command)
    add_branches(command)
    command.add_argument(
        "--mask",
        type=values.parse_path,
        nargs="+",
        metavar="PATH",
        help="masks of the ropes, a PNG or NPY file for each depth image: 0 is background, other numbers are "
        "labels of ropes or of pieces of them (default: the scene's)",
    )
    command.add_argument(
        "--color",
        type=values.parse_path,
        nargs="+",
        metavar="PATH",
        help="colour images, a PNG, JPEG, BMP or PPM file of the same size for each depth image (default: "
        "the scene's)",
    )
    command.add_argument(
        "--occluders",
        type=values.parse_path,
        nargs="+",
        metavar="PATH",
        help="pixels of the robot or a hand, a PNG or NPY file for each depth image: 0 is none (default: the "
        "scene's)",
    )


def add_ropes(command: argparse.ArgumentParser) -> None:
    """Add the user's knowledge of the ropes of any scene, the configuration and the limits."""
    command.add_argument(
        "--radius",
        type=values.parse_length,
        action=values.Repeated,
        metavar="LENGTH",
        help="the ropes' radius, such as 4.2mm; once for each radius if ropes differ (default: the scene's, "
        "else estimated)",
    )
    command.add_argument(
        "--ropes", type=int, metavar="N", help="number of ropes (default: as many as the data show)"
    )
    command.add_argument(
        "--length",
        type=values.parse_length,
        nargs="+",
        metavar="LENGTH",
        help="the ropes' length, such as 0.4m: one for all, or one for each (default: not known)",
    )
    command.add_argument(
        "--bounds",
        type=values.parse_length,
        nargs=6,
        metavar=("X0", "Y0", "Z0", "X1", "Y1", "Z1"),
        help="low and high corner of the space with the ropes, in the world frame, metres (default: the "
        "scene's)",
    )
    command.add_argument(
        "--config", type=values.parse_path, metavar="FILE", help="a TOML file with parameters of the method"
    )
    add_limits(command)
    # argparse takes "-4mm" for an option unless this pattern says that it is a negative number
    command._negative_number_matcher = re.compile(r"^-\.?\d")


def add_deadline(command: argparse.ArgumentParser) -> None:
    """Add the limit on the time of a reconstruction."""
    command.add_argument(
        "--deadline",
        type=float,
        metavar="SECONDS",
        help="skip optional work after this time (default: none)",
    )


def add_limits(command: argparse.ArgumentParser) -> None:
    """Add the limits on the files to read."""
    command.add_argument(
        "--max-bytes",
        type=int,
        default=MAX_BYTES,
        metavar="N",
        help=f"largest memory for the scene's files, bytes (default: {MAX_BYTES})",
    )
    command.add_argument(
        "--outside",
        action="store_true",
        help="let the scene.toml name files outside its folder, which may be any of yours",
    )
