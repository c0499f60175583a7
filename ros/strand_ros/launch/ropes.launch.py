"""Start the node with topics of a camera: `ros2 launch strand_ros ropes.launch.py world_frame:=base_link`."""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

# the topics that the driver of RealSense cameras has with align_depth.enable:=true
TOPICS = {
    "depth/image": "/camera/camera/aligned_depth_to_color/image_raw",
    "depth/camera_info": "/camera/camera/aligned_depth_to_color/camera_info",
    "color/image": "/camera/camera/color/image_raw",
    "mask/image": "/mask",
    "occluders/image": "/robot_mask",
    "points": "/ropes/points",
    "markers": "/ropes/markers",
    "ropes": "/ropes",
}


def generate_launch_description() -> LaunchDescription:
    """Return the node, with an argument for the parameter file, the world frame, and each topic."""
    config = PathJoinSubstitution([FindPackageShare("strand_ros"), "config", "ropes.yaml"])
    arguments = [
        DeclareLaunchArgument("config", default_value=config, description="a file of parameters"),
        DeclareLaunchArgument("world_frame", default_value="", description="TF frame of the answers"),
    ]
    names = {topic: topic.replace("/", "_") for topic in TOPICS}
    arguments += [DeclareLaunchArgument(names[topic], default_value=TOPICS[topic]) for topic in TOPICS]
    world = ParameterValue(LaunchConfiguration("world_frame"), value_type=str)  # empty is a name too
    node = Node(
        package="strand_ros",
        executable="ropes",
        name="strand",
        parameters=[LaunchConfiguration("config"), {"world_frame": world}],
        remappings=[(topic, LaunchConfiguration(name)) for topic, name in names.items()],
        output="screen",
    )
    return LaunchDescription([*arguments, node])
