"""Tests that messages fit ROS's definitions and match the chains."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import strand
from lib import ros_messages
from lib.bag_files import STORES, Messages
from lib.ros_messages import fill_message
from shared.ropes import draw_circle
from strand import msgs

STORE = STORES[False]
STAMP = 1_700_000_000_123_456_789
NODES = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0.1, 0.1, 0.1], [0, 0.1, 0.1], [-0.1, 0.1, 0.1]])
CHAIN = strand.Chain(NODES, 0.004)
MODEL = strand.Model((CHAIN, draw_circle(0.05, 40, True)), np.eye(4)[None], confidence=0.5)


def send(kind, values):
    """Return a message as another program receives it."""
    return ros_messages.send(fill_message(kind, values))


def test_a_path_has_a_pose_at_each_node():
    sent = msgs.make_path(CHAIN, "world", STAMP)
    assert json.loads(json.dumps(sent)) == sent
    path = send("nav_msgs/msg/Path", sent)
    assert (path.header.frame_id, path.header.stamp.sec, path.header.stamp.nanosec) == (
        "world",
        1_700_000_000,
        123_456_789,
    )
    assert len(path.poses) == len(NODES)
    for one, node, tangent in zip(path.poses, NODES, CHAIN.tangents, strict=True):
        p, q = one.pose.position, one.pose.orientation
        assert [p.x, p.y, p.z] == node.tolist()
        turned = Rotation.from_quat([q.x, q.y, q.z, q.w]).apply([1.0, 0.0, 0.0])
        np.testing.assert_allclose(turned, tangent, atol=1e-12)
        assert one.header.frame_id == "world"


def test_a_ring_ends_where_it_starts():
    ring = MODEL.chains[1]
    poses = msgs.make_path(ring, "world")["poses"]
    assert len(poses) == len(ring.points) + 1
    assert poses[0] == poses[-1]


def test_markers_are_lines_with_spheres_at_their_ends():
    markers = send(
        "visualization_msgs/msg/MarkerArray", msgs.make_marker_array(MODEL, "world", STAMP)
    ).markers
    kinds = STORE.types["visualization_msgs/msg/Marker"]
    first, line, ends, ring = markers
    assert first.action == kinds.DELETEALL
    assert [one.type for one in (line, ends, ring)] == [
        kinds.LINE_STRIP,
        kinds.SPHERE_LIST,
        kinds.LINE_STRIP,
    ]
    assert all(one.action == kinds.ADD and one.header.frame_id == "world" for one in (line, ends, ring))
    assert len({(one.ns, one.id) for one in (line, ends, ring)}) == 3
    assert [[p.x, p.y, p.z] for p in line.points] == NODES.tolist()
    assert [[p.x, p.y, p.z] for p in ends.points] == [NODES[0].tolist(), NODES[-1].tolist()]
    assert [ring.points[0].x, ring.points[0].y] == [ring.points[-1].x, ring.points[-1].y]
    assert (line.scale.x, ends.scale.x, ends.scale.z) == (0.008, 0.016, 0.016)
    assert line.pose.orientation.w == 1.0
    colors = [(one.color.r, one.color.g, one.color.b) for one in (line, ring)]
    assert colors[0] != colors[1]
    assert all(one.color.a == 1.0 for one in (line, ends, ring))


def test_colours_are_paler_if_the_model_is_unsure():
    def saturation(confidence):
        model = strand.Model((CHAIN,), np.eye(4)[None], confidence=confidence)
        color = msgs.make_marker_array(model, "world", namespace="rope")["markers"][1]["color"]
        rgb = [color[name] for name in "rgb"]
        return max(rgb) - min(rgb)

    assert saturation(0.1) < saturation(0.9) == saturation(0.9) < saturation(float("nan"))


@pytest.mark.parametrize("colors", [None, np.arange(18, dtype=np.uint8).reshape(6, 3)])
def test_points_are_read_back_as_other_programs_do(colors):
    sent = msgs.make_point_cloud2(NODES, "world", STAMP, colors=colors)
    cloud = send("sensor_msgs/msg/PointCloud2", sent)
    view = msgs.read_view(cloud)
    np.testing.assert_array_equal(view.points, NODES[1:].astype(np.float32))  # the first point is the camera
    if colors is not None:
        np.testing.assert_array_equal(view.colors, colors[1:] / 255.0)
    assert (cloud.width, cloud.height, cloud.row_step) == (6, 1, 6 * cloud.point_step)


def test_views_of_messages():
    scene = strand.synthetic.scene("arc", views=1, camera=strand.synthetic.Camera(size=(64, 48)))
    made = Messages()
    depth = np.round(scene.depth[0] * 0.1).astype(np.uint16)
    image, info = made.image(depth, STAMP), made.info(scene.intrinsics, depth.shape, STAMP)
    want = strand.View.from_depth(depth, scene.intrinsics, scene.poses[0], depth_scale=0.001)
    got = msgs.read_view(image, info, scene.poses[0])
    np.testing.assert_array_equal(got.points, want.points)
    np.testing.assert_array_equal(got.pose, want.pose)
    np.testing.assert_array_equal(msgs.read_view(made.compressed(depth, 0), info).points, want.points)
    scaled = msgs.read_view(made.image(depth, 0, encoding="mono16"), info, depth_scale=1e-4)
    np.testing.assert_allclose(scaled.points, want.points / 10)
    with pytest.raises(ValueError, match="depth images need a CameraInfo"):
        msgs.read_view(image)
    with pytest.raises(ValueError, match="mono16 has no unit"):
        msgs.read_view(made.image(depth, 0, encoding="mono16"), info)
    with pytest.raises(ValueError, match="expected one for images of 64 x 48 pixels, got 7 x 9"):
        msgs.read_view(image, made.info(scene.intrinsics, (9, 7), 0))
    with pytest.raises(TypeError, match="rectified: expected True or False"):
        msgs.read_view(image, info, rectified=1)
    with pytest.raises(TypeError, match=r"message: expected one of sensor_msgs \(Image, .*\), got dict"):
        msgs.read_view(msgs.make_point_cloud2(np.zeros((1, 3)), "world"))
    with pytest.raises(TypeError, match="camera_info: expected a CameraInfo, got ndarray"):
        msgs.read_view(image, scene.intrinsics)


def test_views_of_messages_with_colours_and_masks():
    scene = strand.synthetic.color_scene("two ropes", seed=2)
    made, depth, colors = Messages(), scene.scene.depth[0], scene.color[0]
    image, info = made.image(depth, STAMP), made.info(scene.scene.intrinsics, depth.shape, STAMP)
    labels = np.arange(depth.size, dtype=np.uint16).reshape(depth.shape) % 3
    white = np.where(labels == 1, 255, 0).astype(np.uint16)
    want = strand.View.from_depth(
        depth, scene.scene.intrinsics, None, colors, depth_scale=0.001, mask=labels, occluders=labels == 1
    )
    got = msgs.read_view(
        image,
        info,
        color=made.color(colors, STAMP, encoding="bgra8"),
        mask=made.image(labels, STAMP),
        occluders=made.image(white.astype(np.uint8), STAMP, encoding="mono8"),
    )
    np.testing.assert_array_equal(got.points, want.points)
    np.testing.assert_array_equal(got.colors, want.colors)
    np.testing.assert_array_equal(got.image.labels, want.image.labels)
    np.testing.assert_array_equal(got.image.occluders, want.image.occluders)
    black_and_white = msgs.read_view(image, info, mask=made.image(white, STAMP, encoding="mono16"))
    np.testing.assert_array_equal(black_and_white.image.labels, labels == 1)
    for changed, error in (
        ({"color": made.color(colors[:9, :7], 0)}, "color: expected the depth image's .* got 7 x 9"),
        ({"mask": made.image(labels[:9, :7], 0)}, "mask: expected the depth image's .* pixels, got 7 x 9"),
        ({"mask": made.color(colors, 0)}, "mask: expected an Image of mono8, .* got 'rgb8'"),
        ({"color": image}, "encoding: expected colours"),
    ):
        with pytest.raises(ValueError, match=error):
            msgs.read_view(image, info, **changed)
    with pytest.raises(TypeError, match="occluders: expected a sensor_msgs/Image, got ndarray"):
        msgs.read_view(image, info, occluders=labels)
    with pytest.raises(ValueError, match="expected a depth image along with them, got points"):
        msgs.read_view(SimpleNamespace(**msgs.make_point_cloud2(NODES, "a")), mask=made.image(labels, 0))


def test_poses_of_messages():
    want = np.eye(4)
    want[:3, :3] = Rotation.from_rotvec([0.3, -2.0, 0.9]).as_matrix()
    want[:3, 3] = [1.0, -2.0, 3.0]
    (stamped,) = Messages().tf([("world", "camera", want)], STAMP).transforms
    for message in (stamped, stamped.transform):
        np.testing.assert_allclose(msgs.read_pose(message), want, atol=1e-12)
    pose = msgs.make_path(CHAIN, "world")["poses"][2]["pose"]
    read = msgs.read_pose(fill_message("geometry_msgs/msg/Pose", pose))
    np.testing.assert_allclose(read[:3, 0], CHAIN.tangents[2], atol=1e-12)
    np.testing.assert_array_equal(read[:3, 3], NODES[2])
    with pytest.raises(ValueError, match="message: expected a translation in metres and a unit quaternion"):
        msgs.read_pose(fill_message("geometry_msgs/msg/Pose", {}))
    with pytest.raises(TypeError, match=r"message: expected a geometry_msgs/TransformStamped, .*Time"):
        msgs.read_pose(stamped.header.stamp)


def test_a_planning_scene_has_a_cylinder_and_spheres_for_each_capsule():
    scene = msgs.make_planning_scene(MODEL, 1e-3, "world", STAMP)
    assert json.loads(json.dumps(scene)) == scene
    assert scene["is_diff"]
    assert scene["robot_state"] == {"is_diff": True}
    objects = scene["world"]["collision_objects"]
    assert [one["id"] for one in objects] == ["rope_0", "rope_1"]
    capsules = MODEL.capsules(1e-3)
    for number, one in enumerate(objects):
        mine = capsules.chain == number
        assert set(one) == {"header", "id", "primitives", "primitive_poses"}
        assert one["header"]["frame_id"] == "world"
        kinds = np.array([shape["type"] for shape in one["primitives"]])
        poses = np.array(
            [[*p["position"].values(), *p["orientation"].values()] for p in one["primitive_poses"]]
        )
        height, radius = np.array([s["dimensions"] for s in one["primitives"] if s["type"] == 3]).T
        np.testing.assert_allclose(height, capsules.lengths[mine])
        np.testing.assert_allclose(radius, capsules.radius[mine])
        tubes = poses[kinds == 3]
        np.testing.assert_allclose(tubes[:, :3], capsules.poses[mine, :3, 3], atol=1e-12)
        along = Rotation.from_quat(tubes[:, 3:]).apply([0.0, 0.0, 1.0])
        np.testing.assert_allclose(along, capsules.poses[mine, :3, 2], atol=1e-9)
        ends = np.vstack([capsules.start[mine][:1], capsules.stop[mine]])
        np.testing.assert_allclose(poses[kinds == 2, :3], ends, atol=1e-12)


@pytest.mark.parametrize(
    ("call", "error", "reason"),
    [
        (lambda: msgs.make_path(NODES, "world"), TypeError, "chain: expected a Chain, got ndarray"),
        (lambda: msgs.make_path(CHAIN, 3), TypeError, "frame_id: expected text"),
        (lambda: msgs.make_path(CHAIN, "world", -1), ValueError, "stamp: expected at least 0"),
        (lambda: msgs.make_path(CHAIN, "world", 1.5), TypeError, "stamp: expected an integer"),
        (lambda: msgs.make_marker_array(CHAIN, "world"), TypeError, "model: expected a Model, got Chain"),
        (
            lambda: msgs.make_planning_scene(CHAIN, 1e-3, "world"),
            TypeError,
            "model: expected a Model, got Chain",
        ),
        (lambda: msgs.make_planning_scene(MODEL, 0.0, "world"), ValueError, "error: expected a positive"),
        (lambda: msgs.make_point_cloud2(NODES[:, :2], "world"), ValueError, "points: expected shape"),
        (lambda: msgs.make_point_cloud2(NODES * 1e50, "world"), ValueError, "fit in single precision"),
        (
            lambda: msgs.make_point_cloud2(NODES, "world", colors=NODES[:2]),
            ValueError,
            "colors: expected shape",
        ),
    ],
)
def test_wrong_arguments_are_named(call, error, reason):
    with pytest.raises(error, match=reason):
        call()


def test_an_empty_cloud_is_a_message():
    cloud = send("sensor_msgs/msg/PointCloud2", msgs.make_point_cloud2(np.empty((0, 3)), "world"))
    assert (cloud.width, len(cloud.data)) == (0, 0)
