"""Read ROS 1 bags, ROS 2 bags and MCAP files frame by frame, without ROS."""

from strand.io.recordings.bags import is_recording
from strand.io.recordings.frames import Frame
from strand.io.recordings.recording import Recording

__all__ = ["Frame", "Recording", "is_recording"]
