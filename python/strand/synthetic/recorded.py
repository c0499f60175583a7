"""Write a simulated sequence as a recording of ROS 2: an MCAP file with depth, colours, cameras and TF."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from struct import Struct, pack
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from strand._core import __version__
from strand.support.checks import Array, check_path
from strand.support.files import check_suffix, replace_file
from strand.support.mcap_file import Channel, McapFile
from strand.support.stamps import SECOND
from strand.synthetic.sequence_frames import SequenceFrame

START = 1_700_000_000 * SECOND
"""Time of a recording's first frame, nanoseconds since 1970."""

_WORLD = "table"  # the TF frame of the world, whose origin lies on the table
_MILLIMETER = 1e-3  # metres: unit of depth in 16UC1
_PREAMBLE = b"\x00\x01\x00\x00"  # of a message in CDR, little endian
_SEPARATOR = "\n" + "=" * 80 + "\n"

# definitions of messages in ROS 2, and of the types that they are made of
_TIME = ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec")
_HEADER = ("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id")
_REGION = (
    "sensor_msgs/RegionOfInterest",
    "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify",
)
_VECTOR = ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z")
_QUATERNION = ("geometry_msgs/Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w")
_TRANSFORM = (
    "geometry_msgs/Transform",
    "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation",
)
_STAMPED = (
    "geometry_msgs/TransformStamped",
    "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform",
)
_DEFINITIONS = {
    "sensor_msgs/msg/Image": (
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\n"
        "uint32 step\nuint8[] data",
        (_HEADER, _TIME),
    ),
    "sensor_msgs/msg/CameraInfo": (
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\n"
        "float64[9] k\nfloat64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 binning_y\n"
        "sensor_msgs/RegionOfInterest roi",
        (_HEADER, _TIME, _REGION),
    ),
    "tf2_msgs/msg/TFMessage": (
        "geometry_msgs/TransformStamped[] transforms",
        (_STAMPED, _HEADER, _TIME, _TRANSFORM, _VECTOR, _QUATERNION),
    ),
}


class _Topic(NamedTuple):
    """A topic, the type of its messages, and the message of a frame at a time, nanoseconds."""

    name: str
    kind: str
    data: bytes


def save_recording(frames: Iterable[SequenceFrame], path: str | os.PathLike[str]) -> None:
    """Write the frames of a sequence to an MCAP file, which appears when it is complete."""
    path = check_path("path", path)
    check_suffix(path, ("mcap",))
    with replace_file(path) as file:
        written = None
        for number, frame in enumerate(frames):
            stamp = START + round(frame.time * SECOND)
            sent: list[_Topic] = []
            names = ["camera"] if len(frame.depth) == 1 else [f"camera_{k}" for k in range(len(frame.depth))]
            for camera, depth in enumerate(frame.depth):
                color = None if frame.color is None else frame.color[camera]
                shown = np.rint(depth * (frame.depth_scale / _MILLIMETER)).astype("<u2")
                sent += _send_camera(names[camera], shown, color, frame.intrinsics, stamp)
            moved = [(_WORLD, name, pose) for name, pose in zip(names, frame.poses, strict=True)]
            first = [_Topic("/tf_static", "tf2_msgs/msg/TFMessage", _pack_transforms(moved, stamp))]
            if written is None:
                channels = [
                    Channel(one.name, one.kind, _describe(one.kind), "cdr", "ros2msg")
                    for one in (*first, *sent)
                ]
                written = McapFile(file, channels, f"strand {__version__}", "ros2")
            for k, one in enumerate((*first, *sent)):
                if number == 0 or k:
                    written.add(stamp, one.data, k)
        if written is not None:
            written.end()


def _send_camera(
    name: str, depth: NDArray[np.uint16], color: NDArray[np.uint8] | None, intrinsics: Array, stamp: int
) -> Iterator[_Topic]:
    """Yield the messages of a camera's images."""
    size = (depth.shape[0], depth.shape[1])
    info = _pack_camera(intrinsics, size, name, stamp)
    yield _Topic(f"/{name}/depth/camera_info", "sensor_msgs/msg/CameraInfo", info)
    yield _Topic(
        f"/{name}/depth/image_raw", "sensor_msgs/msg/Image", _pack_image(depth, "16UC1", name, stamp)
    )
    if color is not None:
        yield _Topic(f"/{name}/color/camera_info", "sensor_msgs/msg/CameraInfo", info)
        yield _Topic(
            f"/{name}/color/image_raw", "sensor_msgs/msg/Image", _pack_image(color, "rgb8", name, stamp)
        )


def _describe(kind: str) -> bytes:
    """Return the definition of a type of messages."""
    own, parts = _DEFINITIONS[kind]
    return _SEPARATOR.join([own, *(f"MSG: {name}\n{text}" for name, text in parts)]).encode()


class _Message:
    """A message in CDR: numbers start at multiples of their size."""

    def __init__(self, frame: str, stamp: int | None) -> None:
        self._data = bytearray()
        if stamp is not None:
            self.put_header(frame, stamp)

    def put_header(self, frame: str, stamp: int) -> None:
        self.put("i", stamp // SECOND)
        self.put("I", stamp % SECOND)
        self.put_text(frame)

    def put(self, kind: str, *values: float) -> None:
        size = Struct(kind).size
        self._data += bytes(-len(self._data) % size)
        self._data += pack(f"<{len(values)}{kind}", *values)

    def put_text(self, text: str) -> None:
        data = text.encode() + b"\0"
        self.put("I", len(data))
        self._data += data

    def put_bytes(self, data: bytes) -> None:
        self.put("I", len(data))
        self._data += data

    def end(self) -> bytes:
        return _PREAMBLE + bytes(self._data)


def _pack_image(pixels: NDArray[np.generic], encoding: str, frame: str, stamp: int) -> bytes:
    message = _Message(frame, stamp)
    message.put("I", pixels.shape[0], pixels.shape[1])
    message.put_text(encoding)
    message.put("B", 0)
    message.put("I", pixels[0].nbytes)
    message.put_bytes(pixels.tobytes())
    return message.end()


def _pack_camera(intrinsics: Array, size: tuple[int, int], frame: str, stamp: int) -> bytes:
    message = _Message(frame, stamp)
    message.put("I", *size)
    message.put_text("plumb_bob")
    message.put("I", 5)
    message.put("d", *[0.0] * 5)  # no distortion
    message.put("d", *intrinsics.ravel(), *np.eye(3).ravel())
    message.put("d", *np.column_stack([intrinsics, np.zeros(3)]).ravel())
    message.put("I", 0, 0, 0, 0, 0, 0)  # no binning, no region
    message.put("B", 0)
    return message.end()


def _pack_transforms(poses: list[tuple[str, str, Array]], stamp: int) -> bytes:
    """Return the message of transforms: each a parent, a child, and the pose of the child in the parent."""
    message = _Message("", None)
    message.put("I", len(poses))
    for parent, child, pose in poses:
        message.put_header(parent, stamp)
        message.put_text(child)
        message.put("d", *pose[:3, 3], *compute_quaternion(pose[:3, :3]))
    return message.end()


def compute_quaternion(rotation: Array) -> list[float]:
    """Return x, y, z, w of a rotation: the eigenvector of a symmetric matrix (Bar-Itzhack 2000)."""
    (a, b, c), (d, e, f), (g, h, i) = rotation
    symmetric = np.array(
        [
            [a - e - i, d + b, g + c, h - f],
            [d + b, e - a - i, h + f, c - g],
            [g + c, h + f, i - a - e, d - b],
            [h - f, c - g, d - b, a + e + i],
        ]
    )
    found: list[float] = np.linalg.eigh(symmetric)[1][:, -1].tolist()
    return found
