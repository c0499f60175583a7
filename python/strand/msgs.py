"""Convert chains to ROS messages, and messages to views, without ROS.

Messages are nested dictionaries with the fields of the ROS 2 messages; missing fields keep their defaults.
In a ROS node, `rosidl_runtime_py.set_message_fields(message, values)` copies the dictionary to a message.
"""

from __future__ import annotations

import colorsys
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strand.io.budget import Budget
from strand.io.recordings.camera_info import read_calibration
from strand.io.recordings.color_messages import decode_color_message
from strand.io.recordings.message_views import make_view
from strand.io.recordings.transforms import make_motions, read_motion
from strand.ropes.chain import Chain
from strand.ropes.model import Model
from strand.support.checks import (
    Array,
    check_bool,
    check_colors,
    check_finite_array,
    check_integer,
    check_positive,
    check_text,
)
from strand.support.stamps import SECOND, count_nanoseconds
from strand.views.view import View

Message = dict[str, Any]

# constants of the message definitions
_LINE_STRIP = 4  # visualization_msgs/Marker: type
_SPHERE_LIST = 7  # visualization_msgs/Marker: type
_ADD = 0  # visualization_msgs/Marker: action
_DELETE_ALL = 3  # visualization_msgs/Marker: action
_SPHERE = 2  # shape_msgs/SolidPrimitive: type
_CYLINDER = 3  # shape_msgs/SolidPrimitive: type
_FLOAT32 = 7  # sensor_msgs/PointField: datatype
_SIZE = ("height", "width", "is_bigendian", "data")
_DEPTH_MESSAGES = {  # messages with depth, and the fields that strand reads
    "Image": ("encoding", "step", *_SIZE),
    "CompressedImage": ("format", "data"),
    "PointCloud2": ("fields", "point_step", "row_step", *_SIZE),
}
_HUE_STEP = 0.618034  # turns of hue from rope to rope (golden ratio), so that neighbours differ
_OPPOSITE = 1e-9  # how close a component may be to -1 before the shortest turn is not unique


def make_path(chain: Chain, frame_id: str, stamp: int = 0) -> Message:
    """Return a nav_msgs/Path of a chain: a pose at each node, with x along the rope.

    Parameters
    ----------
    chain : Chain
        The path of a closed chain ends at its first node.
    frame_id : str
        The TF frame that is strand's world frame.
    stamp : int
        Time of the views, nanoseconds since 1970, such as `Frame.stamp`.

    Returns
    -------
    dict

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong type, or `stamp` is negative.

    Examples
    --------
    >>> import strand
    >>> chain = strand.Chain([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]], radius=0.004)
    >>> message = strand.msgs.make_path(chain, "table")
    >>> message["poses"][1]["pose"]["position"]
    {'x': 0.1, 'y': 0.0, 'z': 0.0}
    """
    if not isinstance(chain, Chain):
        raise TypeError(f"chain: expected a Chain, got {type(chain).__name__}")
    head = _make_header(frame_id, stamp)
    poses = [
        {"header": head, "pose": {"position": _make_point(node), "orientation": _turn_x(tangent)}}
        for node, tangent in zip(chain.points, chain.tangents, strict=True)
    ]
    return {"header": head, "poses": poses + poses[: int(chain.closed)]}


def make_marker_array(
    model: Model, frame_id: str, stamp: int | None = None, *, namespace: str = "strand"
) -> Message:
    """Return a visualization_msgs/MarkerArray of a model: a line for each chain, and spheres at its ends.

    Lines are as thick as the ropes. Colours are paler if the confidence is lower. The first marker deletes
    the markers of the previous array.

    Parameters
    ----------
    model : Model
    frame_id : str
        The TF frame that is strand's world frame.
    stamp : int, optional
        Time of the views, nanoseconds since 1970; by default `Model.stamp`, or 0 without one.
    namespace : str
        Namespace of the lines; that of the ends has the suffix "_ends".

    Returns
    -------
    dict

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong type, or `stamp` is negative.
    """
    if not isinstance(model, Model):
        raise TypeError(f"model: expected a Model, got {type(model).__name__}")
    head, name = _make_header(frame_id, _choose_stamp(model, stamp)), check_text("namespace", namespace)
    sure = 1.0 if math.isnan(model.confidence) else model.confidence
    markers: list[Message] = [{"header": head, "ns": name, "id": 0, "action": _DELETE_ALL}]
    for i, chain in enumerate(model.chains):
        red, green, blue = colorsys.hsv_to_rgb(i * _HUE_STEP % 1.0, 0.3 + 0.6 * sure, 0.95)
        color = {"r": red, "g": green, "b": blue, "a": 1.0}
        nodes = [_make_point(node) for node in chain.points]
        line = nodes + nodes[: int(chain.closed)]
        width = {"x": 2.0 * chain.radius, "y": 0.0, "z": 0.0}
        markers.append(_make_marker(head, name, i, _LINE_STRIP, line, width, color))
        if not chain.closed:
            ball = dict.fromkeys("xyz", 4.0 * chain.radius)
            ends = [nodes[0], nodes[-1]]
            markers.append(_make_marker(head, f"{name}_ends", i, _SPHERE_LIST, ends, ball, color))
    return {"markers": markers}


def make_planning_scene(model: Model, error: float, frame_id: str, stamp: int | None = None) -> Message:
    """Return a moveit_msgs/PlanningScene difference that adds one collision object for each chain.

    The objects `rope_0`, `rope_1`, ... replace existing objects of these names. MoveIt has no capsules, so
    each capsule becomes a cylinder with spheres at its ends.

    Parameters
    ----------
    model : Model
    error : float
        Largest distance of the shapes from the ropes, metres, as in `Model.capsules`.
    frame_id : str
        The TF frame that is strand's world frame.
    stamp : int, optional
        Time of the views, nanoseconds since 1970; by default `Model.stamp`, or 0 without one.

    Returns
    -------
    dict

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong type, `error` is too small, or `stamp` is negative.
    """
    if not isinstance(model, Model):
        raise TypeError(f"model: expected a Model, got {type(model).__name__}")
    head, capsules = _make_header(frame_id, _choose_stamp(model, stamp)), model.capsules(error)
    axes = capsules.stop - capsules.start
    objects = []
    for number, chain in enumerate(model.chains):
        shapes, poses = [], []
        own = np.flatnonzero(capsules.chain == number)
        for i in own:
            size = [float(capsules.lengths[i]), chain.radius]
            shapes.append({"type": _CYLINDER, "dimensions": size})
            middle = 0.5 * (capsules.start[i] + capsules.stop[i])
            poses.append({"position": _make_point(middle), "orientation": _turn_z(axes[i] / size[0])})
        for place in np.vstack([capsules.start[own[:1]], capsules.stop[own]]):
            shapes.append({"type": _SPHERE, "dimensions": [chain.radius]})
            poses.append({"position": _make_point(place), "orientation": _make_identity()})
        objects.append(
            {"header": head, "id": f"rope_{number}", "primitives": shapes, "primitive_poses": poses}
        )
    return {"is_diff": True, "robot_state": {"is_diff": True}, "world": {"collision_objects": objects}}


def make_point_cloud2(
    points: ArrayLike, frame_id: str, stamp: int = 0, *, colors: ArrayLike | None = None
) -> Message:
    """Return a sensor_msgs/PointCloud2: x, y and z in single precision, and rgb if colours are given.

    Parameters
    ----------
    points : (N, 3) array_like of float
        Metres, such as a chain's nodes or `View.world_points`.
    frame_id : str
        The TF frame of the points.
    stamp : int
        Time of the points, nanoseconds since 1970.
    colors : (N, 3) array_like, optional
        Red, green and blue from 0 to 1, or uint8.

    Returns
    -------
    dict
        With `data` as bytes.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong type, a number is not finite or too large for single precision, the
        number of colours is not that of points, or `stamp` is negative.
    """
    cloud = check_finite_array("points", points, ("N", 3))
    if cloud.size and np.abs(cloud).max() > np.finfo(np.float32).max:
        raise ValueError("points: expected coordinates that fit in single precision")
    step = 12 if colors is None else 16
    data = np.zeros((len(cloud), step // 4), dtype="<u4")
    data[:, :3] = cloud.astype("<f4").view("<u4")
    if colors is not None:
        shares = check_colors("colors", colors, (len(cloud), 3))
        red, green, blue = np.round(255.0 * shares).astype(np.uint32).T
        data[:, 3] = red << 16 | green << 8 | blue
    fields = [
        {"name": axis, "offset": 4 * i, "datatype": _FLOAT32, "count": 1} for i, axis in enumerate("xyz")
    ]
    if colors is not None:  # four bytes declared as a float, as PCL and RViz read them
        fields.append({"name": "rgb", "offset": 12, "datatype": _FLOAT32, "count": 1})
    return {
        "header": _make_header(frame_id, stamp),
        "height": 1,
        "width": len(cloud),
        "fields": fields,
        "is_bigendian": False,
        "point_step": step,
        "row_step": step * len(cloud),
        "data": data.tobytes(),
        "is_dense": True,
    }


def read_view(
    message: Any,
    camera_info: Any = None,
    pose: ArrayLike | None = None,
    *,
    rectified: bool = False,
    depth_scale: float | None = None,
    ignore_distortion: bool = False,
    color: Any = None,
    mask: Any = None,
    occluders: Any = None,
) -> View:
    """Return the view of a sensor_msgs/Image, CompressedImage or PointCloud2 from rclpy, rospy or rosbags.

    Parameters
    ----------
    message : object
        An object with the message's attributes. Depth images are 16UC1 in millimetres or 32FC1 in metres;
        compressed ones are "compressedDepth" with a PNG. Points are in the sensor's frame.
    camera_info : object, optional
        The CameraInfo, which images need.
    pose : (4, 4) array_like, optional
        Camera-to-world rigid motion; the identity by default.
    rectified : bool
        Whether the image is rectified; strand then uses P instead of K.
    depth_scale : float, optional
        Metres per unit of 16-bit images; millimetres by default.
    ignore_distortion : bool
        Whether to use images of lenses with distortion as they are; by default, they raise an error.
    color : object, optional
        An Image or CompressedImage of the depth image's pixels, with their colours.
    mask, occluders : object, optional
        Images of the depth image's pixels, as in `View.from_depth`: mono8, 8UC1, mono16 or 16UC1. Pixels of
        0 and 255 alone mean False and True; else they are labels.

    Returns
    -------
    View
        Its `stamp` is that of the message's header, if there is one.

    Raises
    ------
    TypeError, ValueError
        If the message has no depth or points, its sizes do not match, its CameraInfo is missing, of another
        image size or with distortion, or an argument is of the wrong type. Also if colours or masks are not
        of the depth image's size.
    FileFormatError
        If a compressed image is damaged.
    ImportError
        If a message is compressed and Pillow is not installed.
    """
    if not any(all(hasattr(message, name) for name in names) for names in _DEPTH_MESSAGES.values()):
        known = ", ".join(_DEPTH_MESSAGES)
        raise TypeError(f"message: expected one of sensor_msgs ({known}), got {type(message).__name__}")
    check_bool("rectified", rectified)
    check_bool("ignore_distortion", ignore_distortion)
    scale = None if depth_scale is None else check_positive("depth_scale", depth_scale)
    camera = None
    if camera_info is not None:
        matrices = all(hasattr(camera_info, name) or hasattr(camera_info, name.upper()) for name in "kdp")
        if not (matrices and hasattr(camera_info, "height") and hasattr(camera_info, "width")):
            raise TypeError(f"camera_info: expected a CameraInfo, got {type(camera_info).__name__}")
        camera = read_calibration(camera_info, rectified=rectified, ignore_distortion=ignore_distortion)
    masks = {name: one for name, one in (("mask", mask), ("occluders", occluders)) if one is not None}
    for name, one in masks.items():
        _check_image(name, one, ("Image",))
    if color is not None:
        _check_image("color", color, ("Image", "CompressedImage"))
    if hasattr(message, "point_step") and (masks or color is not None):
        raise ValueError("color, mask, occluders: expected a depth image along with them, got points")

    def find_colors(depth: Array, _: Array, budget: Budget) -> NDArray[np.uint8]:
        found = decode_color_message(color, budget)
        if found.shape[:2] != depth.shape:
            sizes = [f"{shape[1]} x {shape[0]}" for shape in (depth.shape, found.shape)]
            raise ValueError(f"color: expected the depth image's {sizes[0]} pixels, got {sizes[1]}")
        return found

    colors, stamp = None if color is None else find_colors, _read_stamp(message)
    return make_view(message, camera, pose, scale, find_colors=colors, stamp=stamp, masks=masks)


def read_pose(message: Any) -> Array:
    """Return the pose in a geometry_msgs/TransformStamped, Transform, PoseStamped or Pose.

    Parameters
    ----------
    message : object
        An object with the message's attributes, such as what TF's `lookup_transform(world, camera, stamp)`
        returns.

    Returns
    -------
    (4, 4) ndarray
        For TF's answer, the camera-to-world rigid motion that `read_view` takes.

    Raises
    ------
    TypeError
        If it is another message.
    ValueError
        If its translation is not finite or beyond a million kilometres, or its quaternion has no unit norm.
    """
    inner = getattr(message, "transform", getattr(message, "pose", message))
    for names in (("translation", "rotation"), ("position", "orientation")):
        fields = [getattr(inner, name, None) for name in names]
        if all(
            all(isinstance(getattr(field, axis, None), (int, float)) for axis in axes)
            for field, axes in zip(fields, ("xyz", "xyzw"), strict=True)
        ):
            motions = make_motions(np.array([read_motion("message", *fields)]))
            return np.asarray(motions[0])
    raise TypeError(
        "message: expected a geometry_msgs/TransformStamped, Transform, PoseStamped or Pose, "
        f"got {type(message).__name__}"
    )


def _check_image(name: str, message: Any, kinds: Sequence[str]) -> None:
    if not any(all(hasattr(message, field) for field in _DEPTH_MESSAGES[kind]) for kind in kinds):
        known = " or ".join(kinds)
        raise TypeError(f"{name}: expected a sensor_msgs/{known}, got {type(message).__name__}")


def _choose_stamp(model: Model, stamp: int | None) -> int:
    """Return the given stamp, else the model's, nanoseconds."""
    if stamp is not None or model.stamp is None:
        return 0 if stamp is None else stamp
    return count_nanoseconds(model.stamp)


def _read_stamp(message: Any) -> float | None:
    """Return the time of a message's header, seconds; None without one."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    sec, nanosec = (
        check_integer(
            f"message.header.stamp.{names[0]}", getattr(stamp, names[0], getattr(stamp, names[1], 0))
        )
        for names in (("sec", "secs"), ("nanosec", "nsecs"))
    )
    return (sec * SECOND + nanosec) / SECOND or None


def _make_header(frame_id: str, stamp: int) -> Message:
    sec, nanosec = divmod(check_integer("stamp", stamp), SECOND)
    return {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": check_text("frame_id", frame_id)}


def _make_point(node: Array) -> Message:
    return dict(zip("xyz", node.tolist(), strict=True))


def _turn_x(tangent: Array) -> Message:
    """Return the quaternion of the shortest turn from the x axis to a unit tangent."""
    x, y, z = tangent.tolist()
    if x < -1.0 + _OPPOSITE:
        return {"x": 0.0, "y": 0.0, "z": 1.0, "w": 0.0}
    w = math.sqrt(0.5 * (1.0 + x))
    return {"x": 0.0, "y": -0.5 * z / w, "z": 0.5 * y / w, "w": w}


def _turn_z(axis: Array) -> Message:
    """Return the quaternion of the shortest turn from the z axis to a unit vector."""
    x, y, z = axis.tolist()
    if z < -1.0 + _OPPOSITE:
        return {"x": 1.0, "y": 0.0, "z": 0.0, "w": 0.0}
    w = math.sqrt(0.5 * (1.0 + z))
    return {"x": -0.5 * y / w, "y": 0.5 * x / w, "z": 0.0, "w": w}


def _make_identity() -> Message:
    return dict.fromkeys("xyz", 0.0) | {"w": 1.0}


def _make_marker(
    head: Message, name: str, number: int, kind: int, points: list[Message], scale: Message, color: Message
) -> Message:
    identity = {"position": dict.fromkeys("xyz", 0.0), "orientation": _make_identity()}
    return {
        "header": head,
        "ns": name,
        "id": number,
        "type": kind,
        "action": _ADD,
        "pose": identity,
        "scale": scale,
        "color": color,
        "points": points,
    }
