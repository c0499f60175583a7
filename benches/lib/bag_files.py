"""Bags of scenes in ROS 1, ROS 2 (SQLite) and MCAP, written by rosbags."""

from __future__ import annotations

import io
import struct
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from strand.synthetic import SyntheticScene
from strand.synthetic.recorded import compute_quaternion

FORMATS = ("ros1", "sqlite3", "mcap")
STORES = {False: get_typestore(Stores.LATEST), True: get_typestore(Stores.ROS1_NOETIC)}
for _store in STORES.values():
    _store.register(
        get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage")
    )
START = 1_700_000_000 * 10**9  # nanoseconds: stamp of the first message
PERIOD = 33_333_333  # nanoseconds between frames

Entry = tuple[str, int, Any]  # topic, nanoseconds, message


class Messages:
    """Makes messages of ROS 1 or ROS 2. They differ in the names of some fields."""

    def __init__(self, ros1: bool = False) -> None:
        self.ros1, self.store = ros1, STORES[ros1]

    def make(self, kind: str, **fields: Any) -> Any:
        """Return a message of a type, such as "sensor_msgs/msg/Image"."""
        return self.store.types[kind](**fields)

    def header(self, frame: str, stamp: int) -> Any:
        """Return a header."""
        time = self.make("builtin_interfaces/msg/Time", sec=stamp // 10**9, nanosec=stamp % 10**9)
        more = {"seq": 0} if self.ros1 else {}
        return self.make("std_msgs/msg/Header", stamp=time, frame_id=frame, **more)

    def image(self, depth: NDArray[Any], stamp: int, frame: str = "camera", **changes: Any) -> Any:
        """Return depth as uint16 in millimetres or float32 in metres, in the array's order of bytes."""
        fields = {
            "height": depth.shape[0],
            "width": depth.shape[1],
            "encoding": "16UC1" if depth.dtype.kind == "u" else "32FC1",
            "is_bigendian": int(depth.dtype.str[0] == ">"),
            "step": depth.shape[1] * depth.itemsize,
            "data": np.frombuffer(depth.tobytes(), dtype=np.uint8),
        }
        return self.make("sensor_msgs/msg/Image", header=self.header(frame, stamp), **(fields | changes))

    def color(self, colors: NDArray[np.uint8], stamp: int, frame: str = "camera", encoding="rgb8") -> Any:
        """Return (H, W, 3) red, green and blue in an encoding, or compressed as "jpeg" or "png"."""
        header = self.header(frame, stamp)
        if encoding in ("jpeg", "png"):
            packed = io.BytesIO()
            Image.fromarray(colors).save(packed, encoding, **({"quality": 98} if encoding == "jpeg" else {}))
            data = np.frombuffer(packed.getvalue(), dtype=np.uint8)
            kind = f"rgb8; {encoding} compressed bgr8"
            return self.make("sensor_msgs/msg/CompressedImage", header=header, format=kind, data=data)
        pixels = colors if encoding.startswith("rgb") else colors[..., ::-1]
        if "a" in encoding:
            pixels = np.concatenate([pixels, np.full_like(pixels[..., :1], 255)], axis=2)
        return self.make(
            "sensor_msgs/msg/Image",
            header=header,
            height=pixels.shape[0],
            width=pixels.shape[1],
            encoding=encoding,
            is_bigendian=0,
            step=pixels.shape[1] * pixels.shape[2],
            data=np.ascontiguousarray(pixels).ravel(),
        )

    def compressed(
        self, depth: NDArray[np.uint16], stamp: int, frame: str = "camera", kind: str = "16UC1", a=0.0, b=0.0
    ) -> Any:
        """Return numbers as "compressedDepth": 12 bytes and a PNG."""
        png = io.BytesIO()
        Image.fromarray(depth).save(png, "png")
        data = struct.pack("<iff", 0, a, b) + png.getvalue()
        return self.make(
            "sensor_msgs/msg/CompressedImage",
            header=self.header(frame, stamp),
            format=f"{kind}; compressedDepth png",
            data=np.frombuffer(data, dtype=np.uint8),
        )

    def info(self, intrinsics: Any, size: tuple[int, int], stamp: int, frame: str = "camera", d=()) -> Any:
        """Return a CameraInfo of a pinhole; `size` is (height, width)."""
        k = np.asarray(intrinsics, dtype=np.float64)
        fields = {
            "D": np.array(d, dtype=np.float64),
            "K": k.ravel(),
            "R": np.eye(3).ravel(),
            "P": np.hstack([k, np.zeros((3, 1))]).ravel(),
        }
        names = fields if self.ros1 else {name.lower(): value for name, value in fields.items()}
        region = self.make(
            "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        return self.make(
            "sensor_msgs/msg/CameraInfo",
            header=self.header(frame, stamp),
            height=size[0],
            width=size[1],
            distortion_model="plumb_bob",
            binning_x=0,
            binning_y=0,
            roi=region,
            **names,
        )

    def tf(self, poses: Iterable[tuple[str, str, Any]], stamp: int) -> Any:
        """Return transforms; each has a parent, a child, and the (4, 4) motion from child to parent."""
        transforms = []
        for parent, child, pose in poses:
            x, y, z, w = compute_quaternion(np.asarray(pose)[:3, :3])
            place = dict(zip("xyz", np.asarray(pose)[:3, 3].tolist(), strict=True))
            motion = self.make(
                "geometry_msgs/msg/Transform",
                translation=self.make("geometry_msgs/msg/Vector3", **place),
                rotation=self.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w),
            )
            transforms.append(
                self.make(
                    "geometry_msgs/msg/TransformStamped",
                    header=self.header(parent, stamp),
                    child_frame_id=child,
                    transform=motion,
                )
            )
        return self.make("tf2_msgs/msg/TFMessage", transforms=transforms)


def write_bag(path: Path, kind: str, entries: Iterable[Entry], compression: str | None = None) -> Path:
    """Write a bag of one of `FORMATS`, and return its file, or its folder if it has more files.

    Compression is "lz4" or "bz2" for ROS 1. It is "message" or "file" for ROS 2, or "storage" for MCAP.
    """
    ros1 = kind == "ros1"
    store, connections = STORES[ros1], {}
    if ros1:
        writer: Any = Writer1(path.with_suffix(".bag"))
        if compression:
            writer.set_compression(Writer1.CompressionFormat[compression.upper()])
    else:
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer = Writer2(path, version=9, storage_plugin=plugin)
        if compression:
            writer.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)
    with writer:
        for topic, time, message in entries:
            name = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=store)
            data = store.serialize_ros1(message, name) if ros1 else store.serialize_cdr(message, name)
            writer.write(connections[topic], time, data)
    if ros1:
        return path.with_suffix(".bag")
    return path / f"{path.name}.mcap" if kind == "mcap" and compression in (None, "storage") else path


def convert_to_millimeters(scene: SyntheticScene) -> NDArray[np.uint16]:
    """Return (V, H, W) the scene's depths in whole millimetres, as in 16UC1."""
    return np.round(scene.depth * (scene.depth_scale * 1e3)).astype(np.uint16)


def record_cameras(
    scene: SyntheticScene, ros1: bool = False, poses: Sequence[Any] | None = None
) -> Iterator[Entry]:
    """Yield one frame of a scene: a camera for each view, with static transforms to "world"."""
    made = Messages(ros1)
    poses = scene.poses if poses is None else poses
    placed = [("world", f"camera_{k}", pose) for k, pose in enumerate(poses)]
    yield "/tf_static", START, made.tf(placed, START)
    for k, depth in enumerate(convert_to_millimeters(scene)):
        stamp = START + k * 10**6
        frame = f"camera_{k}"
        yield f"/{frame}/depth/camera_info", stamp, made.info(scene.intrinsics, depth.shape, stamp, frame)
        yield f"/{frame}/depth/image_raw", stamp, made.image(depth, stamp, frame)


def record_film(scene: SyntheticScene, frames: int, ros1: bool = False) -> Iterator[Entry]:
    """Yield the views of a scene one after the other, again and again, from one camera that moves."""
    made = Messages(ros1)
    depths = convert_to_millimeters(scene)
    for i in range(frames):
        stamp, k = START + i * PERIOD, i % len(depths)
        if i == 0:
            yield "/camera_info", stamp, made.info(scene.intrinsics, depths[k].shape, stamp)
        yield "/tf", stamp, made.tf([("world", "camera", scene.poses[k])], stamp)
        yield "/depth", stamp, made.image(depths[k], stamp)
