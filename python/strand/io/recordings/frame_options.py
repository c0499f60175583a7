"""The options of a recording, checked, as the readers of its kinds take them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from numpy.typing import ArrayLike

from strand.support.checks import Array, check_rigid_motion, check_sequence


@dataclass(frozen=True, eq=False)
class FrameOptions:
    """The arguments of `strand.Recording`; the tolerance is in nanoseconds."""

    topics: Sequence[str] | None
    world: str | None
    poses: Sequence[ArrayLike] | None
    tolerance: int
    intrinsics: Array | None
    depth_scale: float | None
    color_topics: Sequence[str] | None
    ignore_distortion: bool
    max_bytes: int


def check_poses(
    poses: Sequence[ArrayLike] | None, topics: Sequence[str], world: str | None
) -> list[Array | None]:
    """Return one fixed pose for each topic; None for the only camera, or if TF gives the poses."""
    if poses is None:
        if len(topics) > 1 and world is None:
            raise ValueError(
                f"world: {len(topics)} cameras need poses: give world, a TF frame (--world), or poses"
            )
        return [None] * len(topics)
    given = check_sequence("poses", poses, "matrices")
    if len(given) != len(topics):
        raise ValueError(f"poses: expected one for each of {len(topics)} topics, got {len(given)}")
    return [check_rigid_motion(f"poses[{i}]", pose) for i, pose in enumerate(given)]
