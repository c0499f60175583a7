"""One message of a recording, as it is in the file."""

from __future__ import annotations

from dataclasses import dataclass

Data = bytes | bytearray
MESSAGE_BYTES = 512  # memory of a message beside its data, bytes


@dataclass(frozen=True)
class Message:
    """An encoded message.

    Attributes
    ----------
    topic : str
    kind : str
        Type by its name in ROS 2, such as "sensor_msgs/msg/Image".
    time : int
        Time of recording, nanoseconds since 1970.
    data : bytes or bytearray
    """

    topic: str
    kind: str
    time: int
    data: Data

    @property
    def place(self) -> str:
        """Topic and time, for errors."""
        return f"{self.topic} at {self.time * 1e-9:.3f} s"

    @property
    def size(self) -> int:
        """Memory that the message takes, bytes."""
        return MESSAGE_BYTES + len(self.data)
