"""Recordings and folders of the frames of a simulated sequence."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from lib.bag_files import START, Entry, Messages, write_bag
from strand.synthetic.sequence_frames import SequenceFrame

K_WORDS = ("--intrinsics", "600,600,319.5,239.5", "--depth-scale", "0.0001")


def record(path: Path, frames: Sequence[SequenceFrame], more: Iterable[Entry] = ()) -> Path:
    """Write an MCAP file with a frame of each camera at its time, and further messages."""
    entries = sorted([*_make_entries(frames), *more], key=lambda entry: entry[1])
    return write_bag(path, "mcap", entries)


def _make_entries(frames: Sequence[SequenceFrame]) -> Iterator[Entry]:
    made, first = Messages(), frames[0]
    names = [f"camera_{k}" for k in range(len(first.depth))]
    placed = [("world", name, pose) for name, pose in zip(names, first.poses, strict=True)]
    yield "/tf_static", START, made.tf(placed, START)
    for k, name in enumerate(names):
        yield f"/{name}/camera_info", START, made.info(first.intrinsics, first.depth[k].shape, START, name)
    for frame in frames:
        for k, name in enumerate(names):
            stamp = stamp_of(frame, k)
            depth = (frame.depth[k] * frame.depth_scale).astype(np.float32)
            yield f"/{name}/depth", stamp, made.image(depth, stamp, name)


def stamp_of(frame: SequenceFrame, camera: int = 0) -> int:
    """Return the time stamp of a camera's image, nanoseconds: cameras are 2 ms apart."""
    return START + round(frame.time * 1e9) + 2_000_000 * camera


def save_images(folder: Path, frames: Sequence[SequenceFrame]) -> Path:
    """Fill a folder with the depth images of the first camera, and its folder `masks` with their masks."""
    (folder / "masks").mkdir(parents=True)
    for frame in frames:
        Image.fromarray(frame.depth[0]).save(folder / f"{frame.number:03}.png")
        Image.fromarray(frame.mask[0].astype(np.uint8)).save(folder / "masks" / f"{frame.number:03}.png")
    return folder


def save_scenes(folder: Path, frames: Sequence[SequenceFrame], radius: float) -> Path:
    """Fill a folder with a scene of all cameras, masks included, for each frame."""
    folder.mkdir()
    for frame in frames:
        np.savez(
            folder / f"{frame.number:03}.npz",
            depth=frame.depth,
            depth_scale=frame.depth_scale,
            K=frame.intrinsics,
            poses=frame.poses,
            mask=frame.mask,
            radius=radius,
        )
    return folder
