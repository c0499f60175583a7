"""Decode the messages of ROS 1 and ROS 2 that strand reads.

Messages are decoded by ROS's own definitions; definitions in a recording are ignored. Pixels are not
copied, texts and lists are short, and transforms come one after the other: so a message takes little memory
beside its data.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from struct import Struct
from struct import error as struct_error
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.io.recordings.message import Data

TRANSFORMS = "tf2_msgs/msg/TFMessage"  # the type of TF's messages
_MAX_TEXT = 1024  # bytes of a frame's name, an encoding or a format
_MAX_FIELDS = 256  # fields of a point; drivers write up to about 20
_MAX_COEFFICIENTS = 32  # numbers of a lens model; the longest known has 14
_PADDING = 3  # bytes that may follow a message
_CDR = (b"\0\0", b"\0\1")  # how messages of ROS 2 begin: in big and little endian


class _Fields:
    """The fields of an encoded message, read one after the other.

    ROS 2 aligns numbers to their size, and ends texts with a zero; ROS 1 does neither.
    """

    def __init__(self, data: Data, ros1: bool) -> None:
        self._data, self._ros1 = memoryview(data), ros1
        self._order, self._at, self._start = "<", 0, 0
        if not ros1:
            if data[:2] not in _CDR or len(data) < 4:
                raise ValueError("expected a message in CDR")
            self._order, self._at, self._start = "><"[data[1]], 4, 4

    def read(self, kind: str) -> Any:
        """Return the next number, of a type of the module `struct`."""
        one = Struct(self._order + kind)
        self._align(one.size)
        try:
            (value,) = one.unpack_from(self._data, self._at)
        except struct_error:
            raise ValueError("the message ends too early") from None
        self._at += one.size
        return value

    def read_text(self) -> str:
        """Return the next text."""
        size = self.read("I")
        if size > _MAX_TEXT:
            raise ValueError(f"expected texts of at most {_MAX_TEXT} bytes, got one of {size}")
        text = bytes(self._take(size))
        if self._ros1:
            return text.decode()
        if text[-1:] not in (b"", b"\0"):
            raise ValueError("expected a text that ends with a zero")
        return text[:-1].decode()

    def read_numbers(self, kind: str, count: int) -> NDArray[Any]:
        """Return the next numbers, of a type of NumPy."""
        dtype = np.dtype(self._order + kind)
        if count:
            self._align(dtype.itemsize)
        return np.frombuffer(self._take(count * dtype.itemsize), dtype=dtype)

    def read_count(self, most: int, what: str) -> int:
        """Return the length of the next list; ValueError if it is longer than `most`."""
        count = int(self.read("I"))
        if count > most:
            raise ValueError(f"expected at most {most} {what}, got {count}")
        return count

    def finish(self) -> None:
        """Raise ValueError if more follows."""
        left = len(self._data) - self._at
        if left > _PADDING:
            raise ValueError(f"{left} bytes follow the message")

    def _align(self, size: int) -> None:
        if not self._ros1:
            self._at += -(self._at - self._start) % size

    def _take(self, size: int) -> memoryview:
        part = self._data[self._at : self._at + size]
        if len(part) != size:
            raise ValueError(f"expected {size} bytes, but {len(part)} are left of the message")
        self._at += size
        return part


def decode(kind: str, data: Data, ros1: bool) -> Any:
    """Return a message's fields as an object with attributes; `transforms` is an iterator.

    ValueError is raised if the message is damaged, also by the iterator, or of a type that strand does not
    read.
    """
    if kind not in _DECODERS:
        known = ", ".join(_DECODERS)
        raise ValueError(f"expected a message of one of {known}, got {kind[:80]!r}")
    return _DECODERS[kind](_Fields(data, ros1), ros1)


def _read_header(fields: _Fields, ros1: bool) -> SimpleNamespace:
    if ros1:
        fields.read("I")  # a number of the message
    stamp = SimpleNamespace(sec=fields.read("I" if ros1 else "i"), nanosec=fields.read("I"))
    return SimpleNamespace(stamp=stamp, frame_id=fields.read_text())


def _read_bytes(fields: _Fields) -> NDArray[np.uint8]:
    return fields.read_numbers("u1", int(fields.read("I")))


def _decode_image(fields: _Fields, ros1: bool) -> SimpleNamespace:
    message = SimpleNamespace(
        header=_read_header(fields, ros1),
        height=fields.read("I"),
        width=fields.read("I"),
        encoding=fields.read_text(),
        is_bigendian=fields.read("B"),
        step=fields.read("I"),
        data=_read_bytes(fields),
    )
    fields.finish()
    return message


def _decode_compressed_image(fields: _Fields, ros1: bool) -> SimpleNamespace:
    message = SimpleNamespace(
        header=_read_header(fields, ros1), format=fields.read_text(), data=_read_bytes(fields)
    )
    fields.finish()
    return message


def _decode_camera_info(fields: _Fields, ros1: bool) -> SimpleNamespace:
    """Return a CameraInfo up to its matrices."""
    return SimpleNamespace(
        header=_read_header(fields, ros1),
        height=fields.read("I"),
        width=fields.read("I"),
        distortion_model=fields.read_text(),
        # copied, as these numbers are kept without the message
        d=fields.read_numbers("f8", fields.read_count(_MAX_COEFFICIENTS, "numbers of a lens model")).copy(),
        k=fields.read_numbers("f8", 9).copy(),
        r=fields.read_numbers("f8", 9).copy(),
        p=fields.read_numbers("f8", 12).copy(),
    )


def _decode_points(fields: _Fields, ros1: bool) -> SimpleNamespace:
    header, height, width = _read_header(fields, ros1), fields.read("I"), fields.read("I")
    parts = [
        SimpleNamespace(
            name=fields.read_text(),
            offset=fields.read("I"),
            datatype=fields.read("B"),
            count=fields.read("I"),
        )
        for _ in range(fields.read_count(_MAX_FIELDS, "fields of a point"))
    ]
    message = SimpleNamespace(
        header=header,
        height=height,
        width=width,
        fields=parts,
        is_bigendian=fields.read("?"),
        point_step=fields.read("I"),
        row_step=fields.read("I"),
        data=_read_bytes(fields),
        is_dense=fields.read("?"),
    )
    fields.finish()
    return message


def _decode_transforms(fields: _Fields, ros1: bool) -> SimpleNamespace:
    return SimpleNamespace(transforms=_iterate_transforms(fields, ros1))


def _iterate_transforms(fields: _Fields, ros1: bool) -> Iterator[SimpleNamespace]:
    for _ in range(int(fields.read("I"))):
        header, child = _read_header(fields, ros1), fields.read_text()
        x, y, z, *turn = fields.read_numbers("f8", 7).tolist()
        motion = SimpleNamespace(
            translation=SimpleNamespace(x=x, y=y, z=z),
            rotation=SimpleNamespace(**dict(zip("xyzw", turn, strict=True))),
        )
        yield SimpleNamespace(header=header, child_frame_id=child, transform=motion)
    fields.finish()


def _decode_number(fields: _Fields, ros1: bool) -> SimpleNamespace:
    return SimpleNamespace(data=fields.read("f"))


_DECODERS: dict[str, Callable[[_Fields, bool], SimpleNamespace]] = {
    "sensor_msgs/msg/Image": _decode_image,
    "sensor_msgs/msg/CompressedImage": _decode_compressed_image,
    "sensor_msgs/msg/CameraInfo": _decode_camera_info,
    "sensor_msgs/msg/PointCloud2": _decode_points,
    TRANSFORMS: _decode_transforms,
    "tf/msg/tfMessage": _decode_transforms,  # its older name
    "std_msgs/msg/Float32": _decode_number,
}
