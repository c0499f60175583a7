"""Observations of cameras: views, poses, boxes, sensors."""
