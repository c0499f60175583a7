"""Recordings: ROS 1 and ROS 2 bags and MCAP files, read frame by frame without ROS."""

from strand.io.recordings.bags import is_recording
from strand.io.recordings.recording import Frame, Recording

__all__ = ["Frame", "Recording", "is_recording"]
