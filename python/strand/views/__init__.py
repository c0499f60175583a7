"""What cameras saw: views, poses, boxes, sensors."""
