"""The node: topics, TF and parameters of ROS 2. All else is in modules that need no ROS."""

from __future__ import annotations

import time
from functools import partial
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from numpy.typing import NDArray
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.time import Time
from rosidl_runtime_py import set_message_fields
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_srvs.srv import Trigger
from strand_msgs.msg import Ropes
from tf2_ros import Buffer, TransformException, TransformListener
from visualization_msgs.msg import MarkerArray

import strand
from strand.support.stamps import SECOND
from strand_ros.following import Follower, WrongImageError
from strand_ros.health import Health
from strand_ros.messages import Message, make_header
from strand_ros.parameters import PARAMETERS, Parameter, read_settings
from strand_ros.tf_gaps import TransformGaps
from strand_ros.waiting import Dropped, Frame, WaitingRoom, read_stamp

_POLL = 0.02  # s between two looks whether TF has come
_REPORT = 1.0  # s between diagnostics
_QUIET = 5.0  # s between log lines about trouble
_KEPT = 10  # messages that publishers keep
_THREADS = 2  # one computes while the other takes TF


class _GapBuffer(Buffer):
    """TF's buffer, which also notes gaps of TF."""

    def __init__(self, node: Node) -> None:
        self.gaps = TransformGaps()
        super().__init__(node=node)

    def set_transform(self, transform: Any, authority: str) -> None:
        self.gaps.add(transform, static=False)
        super().set_transform(transform, authority)

    def set_transform_static(self, transform: Any, authority: str) -> None:
        self.gaps.add(transform, static=True)
        super().set_transform_static(transform, authority)

    def clear(self) -> None:
        self.gaps.clear()
        super().clear()


class RopeNode(Node):
    """Subscribes to one depth camera, and publishes its ropes."""

    def __init__(self) -> None:
        super().__init__("strand")
        self._settings = read_settings({one.name: self._declare(one) for one in PARAMETERS})
        self._follower, self._health = Follower(self._settings), Health()
        find_pose = self._find_pose if self._settings.world_frame else None
        self._room = WaitingRoom(
            self._settings.needed,
            self._settings.tolerance,
            self._settings.patience,
            self._settings.queue,
            find_pose,
            newest=self._settings.mode == "reconstruct",
        )
        self._buffer = _GapBuffer(self)
        self._listener = TransformListener(self._buffer, self)
        self._ropes = self.create_publisher(Ropes, "ropes", _KEPT)
        self._points = self.create_publisher(PointCloud2, "points", _KEPT)
        self._markers = self.create_publisher(MarkerArray, "markers", _KEPT)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", _KEPT)
        sensors = qos_profile_sensor_data
        self.create_subscription(CameraInfo, "depth/camera_info", self._room.set_info, sensors)
        for name in self._settings.needed:
            self.create_subscription(Image, f"{name}/image", partial(self._take_image, name), sensors)
        self.create_subscription(Image, "depth/image", self._take_depth, sensors)
        self.create_service(Trigger, "~/reset", self._reset)
        self.create_timer(_POLL, self._step)
        self.create_timer(_REPORT, self._report)

    def _declare(self, one: Parameter) -> Any:
        descriptor = ParameterDescriptor(description=one.description, read_only=True)
        if one.least is not None and isinstance(one.default, float):
            descriptor.floating_point_range = [FloatingPointRange(from_value=one.least, to_value=one.most)]
        elif one.least is not None:
            descriptor.integer_range = [IntegerRange(from_value=int(one.least), to_value=int(one.most or 0))]
        return self.declare_parameter(one.name, one.default, descriptor).value

    def _find_pose(self, frame_id: str, stamp: Any) -> NDArray[Any]:
        world = self._settings.world_frame
        try:
            found = self._buffer.lookup_transform(world, frame_id, Time.from_msg(stamp))
        except TransformException as error:
            raise LookupError(str(error)) from error
        gap = self._buffer.gaps.find(world, frame_id, stamp.sec * SECOND + stamp.nanosec)
        if gap is not None:
            moved, length = gap
            raise ValueError(f"TF has a gap of {length:.2f} s, in which {moved!r} moved")
        return strand.msgs.read_pose(found)

    def _take_image(self, name: str, message: Any) -> None:
        self._room.add_image(name, message)
        self._step()

    def _take_depth(self, message: Any) -> None:
        self._health.count_depth()
        for dropped in self._room.add_depth(message, time.monotonic()):
            self._complain(dropped.kind, dropped.reason)
            if dropped.kind == "jump":
                self._buffer.clear()  # it would refuse the TF of earlier times
        self._step()

    def _step(self) -> None:
        for one in self._room.take(time.monotonic()):
            if isinstance(one, Dropped):
                self._complain(one.kind, one.reason)
            else:
                self._answer(one)

    def _answer(self, frame: Frame) -> None:
        begun = time.monotonic()
        try:
            answer = self._follower.answer(frame)
        except WrongImageError as error:
            self._complain("wrong image", str(error))
            return
        except Exception as error:  # a node that dies helps nobody: it says so, and begins anew
            self._follower.reset()
            self._complain("error", f"{type(error).__name__}: {error}")
            return
        self._publish(self._ropes, Ropes, answer.ropes)
        self._publish(self._markers, MarkerArray, answer.markers)
        if answer.points is not None:
            self._publish(self._points, PointCloud2, answer.points)
        delay = (self.get_clock().now().nanoseconds - read_stamp(frame.depth)) / SECOND
        self._health.count_answer(len(answer.model.chains), time.monotonic() - begun, delay)
        if answer.renewed:
            self._complain("calibration", answer.renewed)
        if answer.trouble:
            self._complain("doubt" if answer.model.chains else "no rope", answer.trouble)

    def _publish(self, publisher: Any, kind: Any, values: Message) -> None:
        message = kind()
        set_message_fields(message, values)
        publisher.publish(message)

    def _complain(self, kind: str, reason: str) -> None:
        self._health.count_trouble(kind, reason)
        if kind != "skipped":
            self.get_logger().warning(f"{kind}: {reason}", throttle_duration_sec=_QUIET)

    def _report(self) -> None:
        header = make_header(self.get_clock().now().to_msg(), "")
        self._publish(
            self._diagnostics, DiagnosticArray, {"header": header, "status": [self._health.report()]}
        )

    def _reset(self, _: Any, response: Any) -> Any:
        self._follower.reset()
        response.success = True
        return response


def main() -> None:
    """Run the node until it is told to stop."""
    rclpy.init()
    try:
        node = RopeNode()
        executor = MultiThreadedExecutor(num_threads=_THREADS)
        executor.add_node(node)
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()
