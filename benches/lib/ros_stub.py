"""A stand-in for rclpy, TF and generated messages, in which the node of `ros/` runs on entries of a bag."""

from __future__ import annotations

import contextlib
import importlib
import sys
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np

from lib.bag_files import Entry, Messages
from lib.ros_messages import fill_message, send
from strand.io.recordings.transforms import Transforms

SECOND = 10**9  # nanoseconds
CACHE = 10 * SECOND  # nanoseconds that TF's buffer keeps
KINDS = {
    "diagnostic_msgs": ("DiagnosticArray",),
    "sensor_msgs": ("CameraInfo", "Image", "PointCloud2"),
    "strand_msgs": ("Ropes",),
    "visualization_msgs": ("MarkerArray",),
}


class Bus:
    """Carries messages between the node and a test, and has the time.

    Attributes
    ----------
    sent : dict of str to list
        What the node published, by topic, as another program receives it.
    said : list of str
        What it logged.
    published : list of str
        The topics that it offers.
    """

    def __init__(self, parameters: dict[str, Any]) -> None:
        self.parameters, self.now = parameters, 0
        self.sent: dict[str, list[Any]] = defaultdict(list)
        self.said: list[str] = []
        self.published: list[str] = []
        self.subscribed: dict[str, list[Callable[[Any], None]]] = defaultdict(list)
        self.services: dict[str, Callable[[Any, Any], Any]] = {}
        self._timers: list[list[Any]] = []

    def add_timer(self, period: float, call: Callable[[], None]) -> None:
        """Call a function again and again."""
        self._timers.append([None, round(period * SECOND), call])

    def advance(self, time: int) -> None:
        """Let time go on to `time`, ns, with all timers; time that goes back lets none run."""
        for timer in self._timers:
            due, period, _ = timer
            if due is None or due > time + period:
                timer[0] = time + period
        while (first := min(self._timers, key=lambda timer: timer[0]))[0] <= time:
            self.now = max(self.now, first[0])
            first[0] += first[1]
            first[2]()
        self.now = time

    def play(self, entries: Iterable[Entry]) -> None:
        """Deliver the messages of a bag at their times."""
        for topic, time, message in entries:
            self.advance(time)
            for call in self.subscribed[topic]:
                call(message)


def make_modules(bus: Bus) -> dict[str, ModuleType]:
    """Return the modules that the node imports."""

    class Node:
        def __init__(self, name: str) -> None:
            self.name = name

        def declare_parameter(self, name: str, default: Any, descriptor: Any) -> Any:
            assert descriptor.description
            value = bus.parameters.get(name, default)
            assert type(value) is type(default), name
            return SimpleNamespace(value=value)

        def create_publisher(self, kind: Any, topic: str, depth: int) -> Any:
            assert depth > 0
            bus.published.append(topic)

            def publish(message: Any) -> None:
                assert message.__msgtype__ == kind.__msgtype__
                bus.sent[topic].append(send(message))

            return SimpleNamespace(publish=publish)

        def create_subscription(self, kind: Any, topic: str, call: Any, qos: Any) -> None:
            assert qos == "sensor data"
            bus.subscribed[topic].append(call)

        def create_service(self, kind: Any, name: str, call: Any) -> None:
            bus.services[name] = call

        def create_timer(self, period: float, call: Any) -> None:
            bus.add_timer(period, call)

        def get_clock(self) -> Any:
            stamp = SimpleNamespace(sec=bus.now // SECOND, nanosec=bus.now % SECOND)
            return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=bus.now, to_msg=lambda: stamp))

        def get_logger(self) -> Any:
            return SimpleNamespace(warning=lambda text, throttle_duration_sec: bus.said.append(text))

    class Time:
        @staticmethod
        def from_msg(stamp: Any) -> int:
            return int(stamp.sec) * SECOND + int(stamp.nanosec)

    class Listener:
        def __init__(self, buffer: Buffer, node: Node) -> None:
            for topic, take in (("/tf", buffer.set_transform), ("/tf_static", buffer.set_transform_static)):
                bus.subscribed[topic].append(lambda message, take=take: give(message, take))

    def give(message: Any, take: Callable[[Any, str], None]) -> None:
        for transform in message.transforms:
            take(transform, "default_authority")

    def set_message_fields(message: Any, values: dict[str, Any]) -> None:
        message.__dict__.update(fill_message(message.__msgtype__, values).__dict__)

    def describe(**fields: Any) -> Any:
        return SimpleNamespace(**fields)

    contents: dict[str, dict[str, Any]] = {
        "rclpy": {},
        "rclpy.executors": {"ExternalShutdownException": RuntimeError, "MultiThreadedExecutor": None},
        "rclpy.node": {"Node": Node},
        "rclpy.qos": {"qos_profile_sensor_data": "sensor data"},
        "rclpy.time": {"Time": Time},
        "rosidl_runtime_py": {"set_message_fields": set_message_fields},
        "rcl_interfaces.msg": {
            name: describe for name in ("FloatingPointRange", "IntegerRange", "ParameterDescriptor")
        },
        "std_srvs.srv": {"Trigger": None},
        "tf2_ros": {
            "Buffer": Buffer,
            "TransformException": TransformError,
            "TransformListener": Listener,
        },
    }
    for package, names in KINDS.items():
        contents[f"{package}.msg"] = {name: _make_kind(f"{package}/msg/{name}") for name in names}
    modules = {}
    for name, content in contents.items():
        for part in {name.split(".")[0], name}:
            modules.setdefault(part, ModuleType(part))
        modules[name].__dict__.update(content)
    return modules


def _make_kind(kind: str) -> Any:
    """Return what stands for a generated class: called, it makes a message with defaults."""

    def make() -> Any:
        return fill_message(kind, {})

    make.__msgtype__ = kind  # type: ignore[attr-defined]
    return make


class TransformError(Exception):
    """TF has no answer, or none yet."""


class Buffer:
    """TF's buffer: it interpolates, never extrapolates, and refuses what is older than its cache."""

    def __init__(self, node: Any) -> None:
        self._static: list[Any] = []
        self.clear()

    def clear(self) -> None:
        """Forget all but static transforms."""
        self._tree, self._latest = Transforms(0, 1 << 30, fill_gaps=True), 0
        for message in self._static:
            self._tree.add(message, True)

    def set_transform(self, transform: Any, authority: str) -> None:
        """Add a transform."""
        time = _count(transform.header.stamp)
        self._latest = max(self._latest, time)
        if time > self._latest - CACHE:
            self._tree.add(SimpleNamespace(transforms=[transform]), False)

    def set_transform_static(self, transform: Any, authority: str) -> None:
        """Add a transform that holds at all times."""
        message = SimpleNamespace(transforms=[transform])
        self._static.append(message)
        self._tree.add(message, True)

    def lookup_transform(self, world: str, frame: str, time: int) -> Any:
        """Return a TransformStamped, or raise TransformError."""
        try:
            pose = self._tree.find_pose(world, frame, time)
        except ValueError as error:
            raise TransformError(str(error)) from error
        if pose is None:
            raise TransformError(f"TF from {frame} to {world} does not reach the time of the image")
        return Messages().tf([(world, frame, pose)], time).transforms[0]


def _count(stamp: Any) -> int:
    return int(stamp.sec) * SECOND + int(stamp.nanosec)


@contextlib.contextmanager
def run_node(**parameters: Any) -> Iterator[tuple[Bus, Any]]:
    """Give a bus, and the node that runs on it with some parameters."""
    bus = Bus(parameters)
    modules = make_modules(bus)
    assert not set(modules) & set(sys.modules)
    sys.modules.update(modules)
    try:
        module = importlib.import_module("strand_ros.node")
        with patch.object(module, "time", SimpleNamespace(monotonic=lambda: bus.now / SECOND)):
            yield bus, module.RopeNode()
    finally:
        for name in ("strand_ros.node", *modules):
            sys.modules.pop(name, None)


def read_points(cloud: Any) -> np.ndarray:
    """Return the (N, 3) points of a PointCloud2, as consumers of other trackers read them: x, y, z at 0."""
    names = [(field.name, field.offset, field.datatype) for field in cloud.fields]
    assert names == [("x", 0, 7), ("y", 4, 7), ("z", 8, 7)]
    return np.frombuffer(cloud.data, "<f4").reshape(cloud.width, 3).astype(float)
