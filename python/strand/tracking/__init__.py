"""The same ropes, frame after frame."""
