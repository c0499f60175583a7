"""The ROS 2 node of strand: depth images of a camera to ordered ropes."""
