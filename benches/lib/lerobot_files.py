"""LeRobot data sets of version 3, written as LeRobot 0.6.2 lays them out, without LeRobot."""

from __future__ import annotations

import io
import json
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from PIL import Image

DEPTH, COLOR = "observation.images.top_depth", "observation.images.top"
RATE = 30
LOSSLESS = {"x265-params": "lossless=1:log-level=none"}
DATA, EPISODES = "data/chunk-000/file-000.parquet", "meta/episodes/chunk-000/file-000.parquet"


def quantize(metres, low=0.01, high=10.0, shift=3.5):
    """Return the 12-bit codes of depths, as LeRobot does by default."""
    scale = np.log(high + shift) - np.log(low + shift)
    share = (np.log(np.asarray(metres) + shift) - np.log(low + shift)) / scale
    return np.rint(share * 4095).clip(0, 4095).astype(np.uint16)


def write_video(path, images, codec, pixels, options, key_frames=2):
    """Write images as a video: (H, W) uint16 codes, or (H, W, 3) uint8 colours."""
    path.parent.mkdir(parents=True, exist_ok=True)
    height, width = images[0].shape[:2]
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, RATE, options={**options, "g": f"{key_frames}"})
        stream.width, stream.height, stream.pix_fmt = width, height, pixels
        stream.time_base = Fraction(1, RATE)
        for number, image in enumerate(images):
            if image.ndim == 2:
                frame = av.VideoFrame(width, height, pixels)
                plane = frame.planes[0]
                rows = np.frombuffer(plane, np.uint16).reshape(height, -1)
                rows[:, :width] = image
            else:
                frame = av.VideoFrame.from_ndarray(image, format="rgb24")
            frame.pts, frame.time_base = number, Fraction(1, RATE)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def _pack(image, kind):
    data = io.BytesIO()
    Image.fromarray(image).save(data, kind)
    return data.getvalue()


def make_info(size, frames, episodes, kind, depth_info):
    """Return the content of `meta/info.json`."""
    stored = "video" if kind == "video" else "image"
    names = ["height", "width", "channels"]
    features = {
        DEPTH: {
            "dtype": stored,
            "shape": [*size, 1],
            "names": names,
            "info": {"is_depth_map": True, **depth_info},
        },
        COLOR: {"dtype": stored, "shape": [*size, 3], "names": names, "info": {"is_depth_map": False}},
        "observation.state": {"dtype": "float32", "shape": [2], "names": ["x", "y"]},
    }
    for name, dtype in (
        ("timestamp", "float32"),
        *((name, "int64") for name in ("frame_index", "episode_index", "index", "task_index")),
    ):
        features[name] = {"dtype": dtype, "shape": [1], "names": None}
    return {
        "codebase_version": "v3.0",
        "fps": RATE,
        "features": features,
        "total_episodes": episodes,
        "total_frames": frames,
        "total_tasks": 1,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",
        "robot_type": None,
        "splits": {"train": f"0:{episodes}"},
    }


def write_data_set(
    folder: Path, depth, lengths, kind="video", colors=None, info=None, options=LOSSLESS, key_frames=2
) -> Path:
    """Write depth images, (F, H, W) uint16 millimetres or float32 metres, as episodes of these lengths.

    `kind` is "video", "tiff" or "png". All episodes share one table and one video.
    """
    count, *size = depth.shape
    assert sum(lengths) == count
    if colors is None:
        colors = np.zeros((count, *size, 3), np.uint8)
    numbers = np.repeat(np.arange(len(lengths)), lengths)
    starts = np.cumsum([0, *lengths])
    inside = np.arange(count) - starts[numbers]
    unit = {"depth_unit": "m" if depth.dtype.kind == "f" else "mm"}
    if kind == "video":
        metres = depth if depth.dtype.kind == "f" else depth * 1e-3
        codes = [quantize(image) for image in metres]
        path = "videos/{}/chunk-000/file-000.mp4"
        write_video(folder / path.format(DEPTH), codes, "hevc", "gray12le", options, key_frames)
        write_video(folder / path.format(COLOR), list(colors), "libx264", "yuv420p", {"qp": "0"}, key_frames)
        unit |= {"video.depth_min": 0.01, "video.depth_max": 10.0, "video.shift": 3.5, "video.use_log": True}
        unit |= {"video.pix_fmt": "gray12le", "video.extra_options": options}
    state = np.stack([inside, numbers], 1).astype(np.float32)
    columns = {
        "observation.state": pa.FixedSizeListArray.from_arrays(pa.array(state.ravel()), 2),
        "timestamp": pa.array((inside / RATE).astype(np.float32)),
        "frame_index": pa.array(inside),
        "episode_index": pa.array(numbers),
        "index": pa.array(np.arange(count)),
        "task_index": pa.array(np.zeros(count, np.int64)),
    }
    if kind != "video":
        kind_of_column = pa.struct([("bytes", pa.binary()), ("path", pa.string())])
        for key, images, suffix in ((DEPTH, depth, kind), (COLOR, colors, "png")):
            files = [
                {"bytes": _pack(image, suffix), "path": f"frame-{number:06}.{suffix}"}
                for number, image in zip(inside, images, strict=True)
            ]
            columns[key] = pa.array(files, kind_of_column)
    table = pa.table(columns)
    (folder / DATA).parent.mkdir(parents=True)
    with pq.ParquetWriter(folder / DATA, table.schema, compression="snappy") as writer:
        for start, length in zip(starts, lengths, strict=False):
            writer.write_table(table.slice(start, length))
    episodes = {
        "episode_index": list(range(len(lengths))),
        "tasks": [["hold the rope"]] * len(lengths),
        "length": list(lengths),
        "data/chunk_index": [0] * len(lengths),
        "data/file_index": [0] * len(lengths),
        "dataset_from_index": starts[:-1].tolist(),
        "dataset_to_index": starts[1:].tolist(),
    }
    for key in (DEPTH, COLOR) if kind == "video" else ():
        episodes |= {f"videos/{key}/{name}_index": [0] * len(lengths) for name in ("chunk", "file")}
        episodes |= {f"videos/{key}/from_timestamp": (starts[:-1] / RATE).tolist()}
        episodes |= {f"videos/{key}/to_timestamp": (starts[1:] / RATE).tolist()}
    episodes |= {"stats/timestamp/min": [[0.0]] * len(lengths)}
    (folder / EPISODES).parent.mkdir(parents=True)
    pq.write_table(pa.table(episodes), folder / EPISODES)
    pq.write_table(pa.table({"task_index": [0], "task": ["hold the rope"]}), folder / "meta/tasks.parquet")
    content = make_info(size, count, len(lengths), kind, {**unit, **(info or {})})
    (folder / "meta/info.json").write_text(json.dumps(content), encoding="utf-8")
    (folder / "meta/stats.json").write_text(json.dumps({"timestamp": {"min": [0.0]}}), encoding="utf-8")
    return folder


def change_info(folder: Path, change) -> None:
    """Apply a function to the content of `meta/info.json`."""
    path = folder / "meta/info.json"
    content = json.loads(path.read_text(encoding="utf-8"))
    change(content)
    path.write_text(json.dumps(content), encoding="utf-8")


def make_ramp(frames, height=48, width=64):
    """Return (F, H, W) uint16 depths in millimetres that differ from frame to frame, and 0 in a corner."""
    y, x = np.mgrid[:height, :width]
    depth = np.stack([500 + 3 * x + 2 * y + 5 * number for number in range(frames)]).astype(np.uint16)
    depth[:, :5, :5] = 0
    return depth


def make_colors(frames, height=48, width=64):
    """Return (F, H, W, 3) uint8 colours that differ from frame to frame."""
    image = np.zeros((frames, height, width, 3), np.uint8)
    image[..., 0] = np.arange(frames)[:, None, None] * 10
    image[..., 1] = np.arange(width) * 2
    return image
