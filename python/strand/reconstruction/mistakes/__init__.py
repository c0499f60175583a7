"""Mistakes in the caller's input: wrong units, poses, intrinsics, bounds. `diagnosis` is the door."""
