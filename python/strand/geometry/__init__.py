"""Lines in space: arc length, curves, bends, frames, meshes."""
