"""ROS messages without ROS: chains as plain data, and views of messages.

Messages are nested dictionaries whose keys are the fields of the ROS 2 messages. Fields that are left out
keep their defaults. In a node `rosidl_runtime_py.set_message_fields(message, values)` fills one in.
"""

from __future__ import annotations

import colorsys
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from strand.io.recordings.camera_info import read_calibration
from strand.io.recordings.message_views import make_view
from strand.ropes.chain import Chain
from strand.ropes.model import Model
from strand.support.checks import (
    Array,
    check_bool,
    check_colors,
    check_finite_array,
    check_integer,
    check_text,
)
from strand.views.view import View

Message = dict[str, Any]

_LINE_STRIP, _SPHERE_LIST = 4, 7  # constants of visualization_msgs/Marker
_ADD, _DELETE_ALL = 0, 3
_SPHERE, _CYLINDER = 2, 3  # constants of shape_msgs/SolidPrimitive
_FLOAT32 = 7  # constant of sensor_msgs/PointField
# messages with depth, and the fields that are read
_SIZE = ("height", "width", "is_bigendian", "data")
_DEPTH_MESSAGES = {
    "Image": ("encoding", "step", *_SIZE),
    "CompressedImage": ("format", "data"),
    "PointCloud2": ("fields", "point_step", "row_step", *_SIZE),
}
_GOLDEN = 0.618034  # of a turn of hue from rope to rope: neighbours differ


def make_path(chain: Chain, frame_id: str, stamp: int = 0) -> Message:
    """nav_msgs/Path of a chain: a pose at each node, x along the rope.

    Parameters
    ----------
    chain : Chain
        A closed one ends where it starts.
    frame_id : str
        The TF frame that is the world frame.
    stamp : int
        When it was seen, nanoseconds since 1970, such as `Frame.stamp`.

    Returns
    -------
    dict

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, or `stamp` is negative.
    """
    if not isinstance(chain, Chain):
        raise TypeError(f"chain: expected a Chain, got {type(chain).__name__}")
    head = _header(frame_id, stamp)
    poses = [
        {"header": head, "pose": {"position": _place(node), "orientation": _along(tangent)}}
        for node, tangent in zip(chain.points, chain.tangents, strict=True)
    ]
    return {"header": head, "poses": poses + poses[: int(chain.closed)]}


def make_marker_array(model: Model, frame_id: str, stamp: int = 0, *, namespace: str = "strand") -> Message:
    """visualization_msgs/MarkerArray of a model: a line for each chain, spheres at its ends.

    Lines are as thick as the ropes. Each chain has a colour, paler the less sure the model is. The first
    marker deletes those of the array before.

    Parameters
    ----------
    model : Model
    frame_id : str
        The TF frame that is the world frame.
    stamp : int
        When it was seen, nanoseconds since 1970.
    namespace : str
        The markers' namespace; ropes are `namespace`, ends `namespace`_ends.

    Returns
    -------
    dict

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, or `stamp` is negative.
    """
    if not isinstance(model, Model):
        raise TypeError(f"model: expected a Model, got {type(model).__name__}")
    head, name = _header(frame_id, stamp), check_text("namespace", namespace)
    sure = 1.0 if math.isnan(model.confidence) else model.confidence
    markers: list[Message] = [{"header": head, "ns": name, "id": 0, "action": _DELETE_ALL}]
    for i, chain in enumerate(model.chains):
        red, green, blue = colorsys.hsv_to_rgb(i * _GOLDEN % 1.0, 0.3 + 0.6 * sure, 0.95)
        color = {"r": red, "g": green, "b": blue, "a": 1.0}
        nodes = [_place(node) for node in chain.points]
        line = nodes + nodes[: int(chain.closed)]
        width = {"x": 2.0 * chain.radius, "y": 0.0, "z": 0.0}
        markers.append(_marker(head, name, i, _LINE_STRIP, line, width, color))
        if not chain.closed:
            ball = dict.fromkeys("xyz", 4.0 * chain.radius)
            ends = [nodes[0], nodes[-1]]
            markers.append(_marker(head, f"{name}_ends", i, _SPHERE_LIST, ends, ball, color))
    return {"markers": markers}


def make_planning_scene(model: Model, error: float, frame_id: str, stamp: int = 0) -> Message:
    """moveit_msgs/PlanningScene of a model: a difference that adds a collision object for each chain.

    Objects are `rope_0`, `rope_1`, ...; one that is there already is replaced. MoveIt knows no capsule: each
    is a cylinder, with spheres at its ends.

    Parameters
    ----------
    model : Model
    error : float
        How far shapes may be from the ropes, metres, as in `Model.capsules`.
    frame_id : str
        The TF frame that is the world frame.
    stamp : int
        When it was seen, nanoseconds since 1970.

    Returns
    -------
    dict

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, `error` is too small, or `stamp` is negative.
    """
    if not isinstance(model, Model):
        raise TypeError(f"model: expected a Model, got {type(model).__name__}")
    head, capsules = _header(frame_id, stamp), model.capsules(error)
    axes = capsules.stop - capsules.start
    objects = []
    for number, chain in enumerate(model.chains):
        shapes, poses = [], []
        mine = np.flatnonzero(capsules.chain == number)
        for i in mine:
            size = [float(capsules.lengths[i]), chain.radius]
            shapes.append({"type": _CYLINDER, "dimensions": size})
            middle = 0.5 * (capsules.start[i] + capsules.stop[i])
            poses.append({"position": _place(middle), "orientation": _upright(axes[i] / size[0])})
        for place in np.vstack([capsules.start[mine[:1]], capsules.stop[mine]]):
            shapes.append({"type": _SPHERE, "dimensions": [chain.radius]})
            poses.append({"position": _place(place), "orientation": _still()})
        objects.append(
            {"header": head, "id": f"rope_{number}", "primitives": shapes, "primitive_poses": poses}
        )
    return {"is_diff": True, "robot_state": {"is_diff": True}, "world": {"collision_objects": objects}}


def make_point_cloud2(
    points: ArrayLike, frame_id: str, stamp: int = 0, *, colors: ArrayLike | None = None
) -> Message:
    """sensor_msgs/PointCloud2 of points: x, y and z in single precision, and rgb if there are colours.

    Parameters
    ----------
    points : (N, 3) array_like of float
        Metres: a chain's nodes, or `View.world_points`.
    frame_id : str
        The TF frame that they are in.
    stamp : int
        When they were seen, nanoseconds since 1970.
    colors : (N, 3) array_like, optional
        Red, green and blue from 0 to 1, or uint8.

    Returns
    -------
    dict
        Its `data` is of bytes.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, a number is not finite or does not fit in single precision, there
        is not one colour for each point, or `stamp` is negative.
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
    if colors is not None:  # as PCL and RViz read it: four bytes that count as a float
        fields.append({"name": "rgb", "offset": 12, "datatype": _FLOAT32, "count": 1})
    return {
        "header": _header(frame_id, stamp),
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
) -> View:
    """View of a sensor_msgs/Image, CompressedImage or PointCloud2, as rclpy, rospy or rosbags give them.

    Parameters
    ----------
    message : object
        With a message's attributes. Depth images are 16UC1 in millimetres or 32FC1 in metres; compressed ones
        "compressedDepth" with a PNG. Points are in the sensor's frame.
    camera_info : object, optional
        The CameraInfo; needed for images.
    pose : (4, 4) array_like, optional
        Camera-to-world rigid motion; the identity if not given.
    rectified : bool
        Whether the image is rectified: P then says how it is seen, not K.
    depth_scale : float, optional
        Metres for each unit of images of 16 bits, if these are not millimetres.
    ignore_distortion : bool
        Take images of lenses that distort as they are. They are refused otherwise.

    Returns
    -------
    View

    Raises
    ------
    TypeError, ValueError
        If the message holds no depth or points, its sizes do not fit together, the CameraInfo is missing or
        another image's, its lens distorts, or an argument is of the wrong kind.
    ImportError
        If it is compressed, and Pillow is not installed.
    """
    if not any(all(hasattr(message, name) for name in names) for names in _DEPTH_MESSAGES.values()):
        known = ", ".join(_DEPTH_MESSAGES)
        raise TypeError(f"message: expected one of sensor_msgs ({known}), got {type(message).__name__}")
    camera = None
    if camera_info is not None:
        matrices = all(hasattr(camera_info, name) or hasattr(camera_info, name.upper()) for name in "kdp")
        if not (matrices and hasattr(camera_info, "height") and hasattr(camera_info, "width")):
            raise TypeError(f"camera_info: expected a CameraInfo, got {type(camera_info).__name__}")
        rectified, ignore = (
            check_bool("rectified", rectified),
            check_bool("ignore_distortion", ignore_distortion),
        )
        camera = read_calibration(camera_info, rectified=rectified, ignore_distortion=ignore)
    return make_view(message, camera, pose, depth_scale)


def _header(frame_id: str, stamp: int) -> Message:
    sec, nanosec = divmod(check_integer("stamp", stamp), 10**9)
    return {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": check_text("frame_id", frame_id)}


def _place(node: Array) -> Message:
    return dict(zip("xyz", node.tolist(), strict=True))


def _along(tangent: Array) -> Message:
    """Return the quaternion of the shortest turn from the x axis to a unit tangent."""
    x, y, z = tangent.tolist()
    if x < -1.0 + 1e-9:
        return {"x": 0.0, "y": 0.0, "z": 1.0, "w": 0.0}
    w = math.sqrt(0.5 * (1.0 + x))
    return {"x": 0.0, "y": -0.5 * z / w, "z": 0.5 * y / w, "w": w}


def _upright(axis: Array) -> Message:
    """Return the quaternion of the shortest turn from the z axis to a unit vector."""
    x, y, z = axis.tolist()
    if z < -1.0 + 1e-9:
        return {"x": 1.0, "y": 0.0, "z": 0.0, "w": 0.0}
    w = math.sqrt(0.5 * (1.0 + z))
    return {"x": -0.5 * y / w, "y": 0.5 * x / w, "z": 0.0, "w": w}


def _still() -> Message:
    return dict.fromkeys("xyz", 0.0) | {"w": 1.0}


def _marker(
    head: Message, name: str, number: int, kind: int, points: list[Message], scale: Message, color: Message
) -> Message:
    still = {"position": dict.fromkeys("xyz", 0.0), "orientation": _still()}
    return {
        "header": head,
        "ns": name,
        "id": number,
        "type": kind,
        "action": _ADD,
        "pose": still,
        "scale": scale,
        "color": color,
        "points": points,
    }
