"""Mistakes in the caller's input: units, poses, intrinsics, masks."""
