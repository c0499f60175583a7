"""Read ROS bags, MCAP files and LeRobot data sets frame by frame, without ROS and LeRobot."""

from strand.io.recordings.frames import Frame
from strand.io.recordings.recording import Recording, is_recording

__all__ = ["Frame", "Recording", "is_recording"]
