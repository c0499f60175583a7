"""Read frames of one or several depth cameras from a recording, one in memory at a time."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strand.io.budget import MAX_BYTES
from strand.io.lerobot.layout import is_data_set
from strand.io.recordings.bag_frames import BagFrames
from strand.io.recordings.bags import is_bag
from strand.io.recordings.data_set_frames import DataSetFrames
from strand.io.recordings.frame_options import FrameOptions
from strand.io.recordings.frames import Frame, UndecodedFrame
from strand.support.checks import (
    check_bool,
    check_instance,
    check_integer,
    check_intrinsics,
    check_nonnegative,
    check_path,
    check_positive,
    check_sequence,
    check_text,
)
from strand.support.stamps import SECOND

TOLERANCE = 0.02  # seconds between the views of a frame, at most: half a frame at 25 Hz

_MAX_TOLERANCE = 1e9  # seconds: its nanoseconds fit in 64 bits


class _Frames(Protocol):
    """The frames of a kind of recording; the attributes are those of `Recording`."""

    files: tuple[Path, ...]
    topics: tuple[str, ...]
    color_topics: tuple[str | None, ...]
    color_troubles: dict[str, str]
    episodes: tuple[range, ...]

    def close(self) -> None: ...

    @property
    def frame_id(self) -> str: ...

    @property
    def most_frames(self) -> int: ...

    @property
    def stamps(self) -> NDArray[np.int64]: ...

    def read_undecoded(self, start: int, stop: int | None, step: int) -> Iterator[UndecodedFrame]: ...

    def decode(self, frame: UndecodedFrame) -> Frame: ...


class Recording:
    """A bag, MCAP file or LeRobot data set, read frame by frame; use it in a `with` statement.

    Each message of the first topic makes a frame with the nearest message in time of every other topic.
    Iteration yields the frames in the order of the first topic, and holds one in memory. ROS and
    LeRobot are not needed.

    Depth images get the colours of the nearest colour image in time, within `tolerance`, if there is one. If
    it is from another camera, each depth pixel's point is projected into it by TF and the CameraInfo.

    Parameters
    ----------
    path : str or path-like
        A `.bag` file of ROS 1 (RealSense records these), an `.mcap` or `.db3` file, the folder of a ROS
        2 bag, or that of a LeRobot data set of version 3. Its rows are the frames, its features the topics.
    topics : sequence of str, optional
        One topic with depth for each camera: Image (16UC1, 32FC1), CompressedImage ("compressedDepth" with
        a PNG) or PointCloud2. `*` matches any text, `?` any letter. By default, the only topic that shows
        depth; depth images are preferred to points.
    world : str, optional
        The TF frame that becomes the world frame. Frames for which TF lacks the pose of a camera are dropped.
    poses : sequence of (4, 4) array_like, optional
        One fixed camera-to-world pose for each topic, instead of TF. Without `world` and `poses`, the frame
        of the only camera is the world frame.
    tolerance : float
        Largest difference in time between the views of a frame, seconds; 0.02 by default. TF's first and last
        transforms hold this long before and after them.
    intrinsics : (3, 3) array_like, optional
        The pinhole matrix of all depth images, pixels. By default, each topic's CameraInfo gives it: P for
        rectified images ("image_rect"), K for others. LeRobot data sets need it.
    depth_scale : float, optional
        Metres per unit of 16-bit depth images. By default, the unit in a RealSense file, else 0.001.
    color_topics : sequence of str, optional
        One topic with colours for each topic: Image (rgb8, bgr8, rgba8, bgra8) or CompressedImage (JPEG,
        PNG). An empty sequence: no colours. By default, the topic whose name is nearest to that of the depth
        topic, if it can be aligned. LeRobot does not align colours, so a data set has none by default.
    ignore_distortion : bool
        Whether to use images of lenses with distortion as they are; by default, they raise an error.
    max_bytes : int
        Memory limit for the decompressed chunks of the file, and for messages, transforms and the views of
        two frames together, bytes; 4 GiB by default.

    Attributes
    ----------
    path : Path
    topics : tuple of str
    color_topics : tuple of (str or None)
        The topic with the colours of each topic; None for none.
    color_troubles : dict of str to str
        For depth topics without colours, why the likeliest colour topic cannot be aligned.
    files : tuple of Path
        The files of the recording.
    episodes : tuple of range
        The frames of each episode of a LeRobot data set; empty for others.

    Raises
    ------
    OSError
        If the file is missing or cannot be opened.
    strand.FileFormatError
        If the file is truncated, damaged, not indexed or not a bag, has no depth, or a CameraInfo is
        missing or not a pinhole. While frames are read: if a message is damaged.
    TypeError, ValueError
        If an argument is of the wrong type or out of range, a topic or TF frame does not exist, or several
        cameras have no poses. The message lists the topics or frames that exist.
    ImportError
        If lz4 or backports.zstd is not installed for compressed files, or Pillow for compressed images.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        topics: Sequence[str] | None = None,
        *,
        world: str | None = None,
        poses: Sequence[ArrayLike] | None = None,
        tolerance: float = TOLERANCE,
        intrinsics: ArrayLike | None = None,
        depth_scale: float | None = None,
        color_topics: Sequence[str] | None = None,
        ignore_distortion: bool = False,
        max_bytes: int = MAX_BYTES,
    ) -> None:
        if world is not None and poses is not None:
            raise ValueError("poses: expected either poses, or world to take them from TF, got both")
        patterns, named = (
            None if given is None else [check_text(name, one) for one in check_sequence(name, given, "text")]
            for name, given in (("topics", topics), ("color_topics", color_topics))
        )
        options = FrameOptions(
            patterns,
            None if world is None else check_text("world", world),
            poses,
            round(min(check_nonnegative("tolerance", tolerance), _MAX_TOLERANCE) * SECOND),
            None if intrinsics is None else check_intrinsics("intrinsics", intrinsics),
            None if depth_scale is None else check_positive("depth_scale", depth_scale),
            named,
            check_bool("ignore_distortion", ignore_distortion),
            check_integer("max_bytes", max_bytes, 1),
        )
        self.path = check_path("path", path)
        kind = DataSetFrames if is_data_set(self.path) else BagFrames
        self._frames: _Frames = kind(self.path, options)
        self.files = self._frames.files
        self.topics = self._frames.topics
        self.color_topics = self._frames.color_topics
        self.color_troubles = self._frames.color_troubles
        self.episodes = self._frames.episodes

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._frames.close()

    def __len__(self) -> int:
        """Return the number of frames; the first call reads the time stamps of the whole file."""
        return len(self.stamps)

    @property
    def frame_id(self) -> str:
        """The frame of the views' world, for messages: `world`, the only camera's frame, or "world"."""
        return self._frames.frame_id

    @property
    def most_frames(self) -> int:
        """Upper bound of the number of frames: messages of the first topic, by the index."""
        return self._frames.most_frames

    @property
    def stamps(self) -> NDArray[np.int64]:
        """(F,) Time stamps of the frames, nanoseconds since 1970; the first access reads the whole file."""
        return self._frames.stamps

    def __iter__(self) -> Iterator[Frame]:
        return self.read()

    def read(self, start: int = 0, stop: int | None = None, step: int = 1) -> Iterator[Frame]:
        """Yield some of the frames; the others are not decoded.

        Parameters
        ----------
        start : int
            The first frame.
        stop : int, optional
            The frame after the last one, as in `range`; by default, the end of the recording.
        step : int
            The difference between two frames.

        Raises
        ------
        TypeError, ValueError
            If an argument is not a whole number, is negative, or `step` is 0.
        strand.FileFormatError
            If a message of a frame is damaged.
        """
        return (self.decode(each) for each in self.read_undecoded(start, stop, step))

    def read_undecoded(
        self, start: int = 0, stop: int | None = None, step: int = 1
    ) -> Iterator[UndecodedFrame]:
        """Yield some of the frames as `read` does, but not decoded: a damaged message spoils only its frame.

        FileFormatError is raised only if the file itself is damaged.
        """
        start, step = check_integer("start", start), check_integer("step", step, 1)
        stop = None if stop is None else check_integer("stop", stop)
        return self._frames.read_undecoded(start, stop, step)

    def decode(self, frame: UndecodedFrame) -> Frame:
        """Decode a frame; raise FileFormatError if one of its messages is damaged."""
        return self._frames.decode(check_instance("frame", frame, UndecodedFrame))


def is_recording(path: str | os.PathLike[str]) -> bool:
    """Tell whether a path is a recording, by its suffix or by the files that describe a folder."""
    return is_bag(path) or is_data_set(path)
